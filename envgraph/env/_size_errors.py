"""Errors for environments too large for a table; `make` and `envgraph train` then use the compiled program instead."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from math import prod

from envgraph.behaviour import Behaviour
from envgraph.errors import LARGEST_INT, LIMITS, EvaluationError, Span


class TooManyStates(EvaluationError):
    """An environment has more states than allowed, or more outcomes of actions in all states together."""

    def __init__(self, behaviour: Behaviour, limit: int, outcomes: int | None = None) -> None:
        most = f"{limit:,} states" if outcomes is None else f"{outcomes:,} outcomes of actions in its states"
        super().__init__(
            f"environment `{behaviour.name}` has more than {most}",
            behaviour.span,
            'use `engine="compiled"` or `envgraph.learn.train_program`, which need no table, or raise the limit; if '
            "rules create objects without end, let their patterns limit the number of objects",
        )

    @classmethod
    def from_message(
        cls, behaviour: Behaviour, message: str, hint: str | None, span: Span | None = None
    ) -> TooManyStates:
        """Recreate an error from its stored message; without `span`, it is reported at the behaviour."""
        error = cls.__new__(cls)
        EvaluationError.__init__(error, message, span or behaviour.span, hint)
        return error


class TooManyOutcomes(TooManyStates):
    """An action has more outcomes in one state than allowed."""

    def __init__(self, behaviour: Behaviour, action: str, limit: int) -> None:
        EvaluationError.__init__(
            self,
            f"action `{action}` has more than {limit} outcomes in one state",
            behaviour.span,
            'use `engine="compiled"` or "live", which need no table; in a unit, write `all r;` to avoid a choice',
        )


class TooLargeTable(TooManyStates):
    """A table needs too much memory, because it reserves space for the largest number of outcomes in every state."""

    def __init__(self, behaviour: Behaviour, states: int, actions: int, outcomes: int) -> None:
        EvaluationError.__init__(
            self,
            f"the table of environment `{behaviour.name}` is too large: {states:,} states, {actions} actions, up to "
            f"{outcomes:,} outcomes of an action",
            behaviour.span,
            'use `engine="compiled"` or `envgraph.learn.train_program`, which need no table',
        )


class TooManyObservations(TooManyStates):
    """An environment has more possible observations than a table can number."""

    def __init__(self, behaviour: Behaviour, count: int) -> None:
        EvaluationError.__init__(
            self,
            f"environment `{behaviour.name}` has {Decimal(count):.3g} observations, but a table can have at most "
            f"{LARGEST_INT:,}",
            behaviour.span,
            'observe less, or use `engine="compiled"` or `envgraph.learn.train_program`, which need no table',
        )


def check_observation_count(behaviour: Behaviour, shape: Sequence[int]) -> None:
    """Raise an error if a table cannot number the observations that have components of these sizes.

    Raises:
        TooManyStates: the number of observations is too large.
    """
    if prod(shape) > LARGEST_INT:
        raise TooManyObservations(behaviour, prod(shape))


def check_table_size(behaviour: Behaviour, shape: tuple[int, int, int]) -> None:
    """Raise an error if a table of shape [states, actions, outcomes] would be too large.

    Raises:
        TooManyStates: the table would be too large.
    """
    if prod(shape) > LIMITS["table entries"]:
        raise TooLargeTable(behaviour, *shape)
