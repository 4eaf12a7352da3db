"""Listeners of people, who are notified of matches, as listeners of the matcher, which notifies of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.rewrite._match import Match, Row, Shape
from envgraph.rewrite.events._event_rules import paired
from envgraph.rewrite.events._jobs import check_runs

Listener = Callable[[list[Match], list[Match]], object]
"""Called with the matches that have appeared, and those that have disappeared."""

UpdateListener = Callable[[list[tuple[Match, Match]]], object]
"""Called with the matches that were replaced, each with the one that is there now."""

Change = Callable[[list[Row], list[Row]], object]


def match_listener(model: Model, shape: Shape, listener: Listener) -> Change:
    """A listener that is notified of rows."""
    return lambda appeared, disappeared: listener(
        _matches(model, shape, appeared), _matches(model, shape, disappeared)
    )


def update_listener(
    model: Model, shape: Shape, changed: Listener, updated: UpdateListener, key: Sequence[int]
) -> Change:
    """A listener of rows: those of one key as updates, then the others, even if the first call raises."""
    others = match_listener(model, shape, changed)

    def notified(appeared: list[Row], disappeared: list[Row]) -> None:
        pairs, new, gone = paired(appeared, disappeared, key)
        try:
            if pairs:
                before = _matches(model, shape, (row for row, _ in pairs))
                after = _matches(model, shape, (row for _, row in pairs))
                updated(list(zip(before, after, strict=True)))
        finally:
            if new or gone:
                others([*new], [*gone])

    return notified


def _matches(model: Model, shape: Shape, rows: Iterable[Row]) -> list[Match]:
    return [Match(model, shape, row) for row in rows]


def check_functions(*given: object) -> None:
    """Refuse listeners that cannot be called.

    Raises:
        InvalidArgument: one is no function, or one whose body a call does not run.
    """
    for one in given:
        if not callable(one):
            raise InvalidArgument(f"a listener is a function, not {one!r}")
        check_runs(one)
