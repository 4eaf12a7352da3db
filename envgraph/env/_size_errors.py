"""Errors for environments too large for a table; `make` and `envgraph train` then use the compiled program instead."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from math import prod

from envgraph.behaviour import Behaviour
from envgraph.env._float_ranges import FloatRange
from envgraph.errors import LARGEST_INT, LIMITS, EvaluationError, Span


class TooManyStates(EvaluationError):
    """An environment is too large for a table: it has too many states, outcomes of actions, or observations."""

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
        """Return an error with another message, also one that was stored; without `span`, it is at the behaviour."""
        error = cls.__new__(cls)
        EvaluationError.__init__(error, message, span or behaviour.span, hint)
        return error


def check_observation_count(behaviour: Behaviour, shape: Sequence[int], names: Sequence[str]) -> None:
    """Raise an error if a table cannot number the observations that have components of these sizes and names.

    Raises:
        TooManyStates: the number of observations is too large, or a component is a float.
    """
    floats = [names[place] for place, size in enumerate(shape) if isinstance(size, FloatRange)]
    if floats or prod(shape) > LARGEST_INT:
        what = f"has {Decimal(prod(shape)):.3g} observations, but a table can have at most {LARGEST_INT:,}"
        if floats:
            what = f"observes the float `{floats[0]}`, which has no index in a table"
        raise TooManyStates.from_message(
            behaviour,
            f"environment `{behaviour.name}` {what}",
            'observe less, or use `envgraph.make` with `observation="flat"`, which needs no table',
        )


def check_table_size(behaviour: Behaviour, shape: tuple[int, int, int]) -> None:
    """Raise an error if a table of shape [states, actions, outcomes] would be too large.

    Raises:
        TooManyStates: the table would be too large.
    """
    if prod(shape) > LIMITS["table entries"]:
        states, actions, outcomes = shape
        raise TooManyStates.from_message(
            behaviour,
            f"the table of environment `{behaviour.name}` is too large: {states:,} states, {actions} actions, up to "
            f"{outcomes:,} outcomes of an action",
            'use `engine="compiled"` or `envgraph.learn.train_program`, which need no table',
        )
