"""What there is too much of for a table; `make` and `envgraph train` then go on with the compiled program."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from math import prod
from typing import Final

from envgraph.behaviour import MOST_VALUES, Behaviour
from envgraph.errors import EvaluationError, Span

MOST_ENTRIES: Final = 50_000_000
"""Of a table, with 21 bytes each: it has room for the outcomes of each action in each state that the widest has."""


class TooManyStates(EvaluationError):
    """An environment has more states than it may, or more outcomes of actions in all of them together."""

    def __init__(self, behaviour: Behaviour, limit: int, outcomes: int | None = None) -> None:
        most = f"{limit:,} states" if outcomes is None else f"{outcomes:,} outcomes of actions in its states"
        super().__init__(
            f"environment `{behaviour.name}` has more than {most}",
            behaviour.span,
            'do without a table (`engine="compiled"`, `envgraph.learn.train_program`), or raise the limit; where rules '
            "create objects, states may have no end: let the rules ask how many there are",
        )

    @classmethod
    def again(
        cls, behaviour: Behaviour, message: str, hint: str | None, span: Span | None = None
    ) -> TooManyStates:
        """Return what was raised before, of which these words were kept, or at the place of what asked for a table."""
        error = cls.__new__(cls)
        EvaluationError.__init__(error, message, span or behaviour.span, hint)
        return error


class TooManyOutcomes(TooManyStates):
    """An action has more outcomes in one state than it may."""

    def __init__(self, behaviour: Behaviour, action: str, limit: int) -> None:
        EvaluationError.__init__(
            self,
            f"action `{action}` has more than {limit} outcomes in one state",
            behaviour.span,
            'in a unit, `all r;` takes every match without a choice; `engine="compiled"` and "live" need no table',
        )


class TooLargeTable(TooManyStates):
    """Few states have so many outcomes that a table with room for them in all states takes too much memory."""

    def __init__(self, behaviour: Behaviour, states: int, actions: int, outcomes: int) -> None:
        EvaluationError.__init__(
            self,
            f"the table of environment `{behaviour.name}` is too large: {states:,} states, {actions} actions, up to "
            f"{outcomes:,} outcomes of one",
            behaviour.span,
            'do without a table: `engine="compiled"`, `envgraph.learn.train_program`',
        )


class TooManyObservations(TooManyStates):
    """Observations cannot be numbered, as a table does."""

    def __init__(self, behaviour: Behaviour, count: int) -> None:
        EvaluationError.__init__(
            self,
            f"environment `{behaviour.name}` has {Decimal(count):.3g} observations, a table at most {MOST_VALUES:,}",
            behaviour.span,
            'observe less, or do without a table: `engine="compiled"`, `envgraph.learn.train_program`',
        )


def check_observations(behaviour: Behaviour, shape: Sequence[int]) -> None:
    """See that each observation with components of these sizes can have a number.

    Raises:
        TooManyStates: there are too many.
    """
    if prod(shape) > MOST_VALUES:
        raise TooManyObservations(behaviour, prod(shape))


def check_entries(behaviour: Behaviour, shape: tuple[int, int, int]) -> None:
    """See that a table of states, actions and outcomes can be made.

    Raises:
        TooManyStates: it would be too large.
    """
    if prod(shape) > MOST_ENTRIES:
        raise TooLargeTable(behaviour, *shape)
