"""What there is too much of for a table; `make` and `envgraph train` then go on with the compiled program."""

from __future__ import annotations

from envgraph.behaviour import Behaviour
from envgraph.errors import EvaluationError


class TooManyStates(EvaluationError):
    """An environment has more states than it may, or more outcomes of actions in all of them together."""

    def __init__(self, behaviour: Behaviour, limit: int, outcomes: int | None = None) -> None:
        most = f"{limit:,} states" if outcomes is None else f"{outcomes:,} outcomes of actions in its states"
        super().__init__(
            f"environment `{behaviour.name}` has more than {most}",
            behaviour.span,
            'do without a table (`engine="compiled"`, `envgraph.learn.train_program`), or raise the limit; where rules '
            "create objects, states may have no end: keep a pool of objects, and a flag that says which are there",
        )


class TooManyOutcomes(TooManyStates):
    """An action has more outcomes in one state than it may."""

    def __init__(self, behaviour: Behaviour, action: str, limit: int) -> None:
        EvaluationError.__init__(
            self,
            f"action `{action}` has more than {limit} outcomes in one state",
            behaviour.span,
            'in a unit, `all r;` takes every match without a choice; `engine="compiled"` and "live" need no table',
        )
