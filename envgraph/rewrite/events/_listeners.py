"""Adapters that are notified of rows by the matcher and call the listeners of the user with matches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.rewrite._matches import Match, Row, Shape
from envgraph.rewrite.events._event_rules import pair_updates
from envgraph.rewrite.events._jobs import check_not_deferred

Listener = Callable[[list[Match], list[Match]], object]
"""A function that is called with the matches that appeared and the matches that disappeared."""

UpdateListener = Callable[[list[tuple[Match, Match]]], object]
"""A function that is called with pairs: the match before an update and the match after it."""

RowListener = Callable[[list[Row], list[Row]], object]


def match_listener(model: Model, shape: Shape, listener: Listener) -> RowListener:
    """Return a listener of rows that calls a listener of matches."""
    return lambda appeared, disappeared: listener(_matches(model, shape, appeared), _matches(model, shape, disappeared))


def update_listener(
    model: Model, shape: Shape, changed: Listener, updated: UpdateListener, key: Sequence[int]
) -> RowListener:
    """Return a listener of rows that calls `updated` with pairs of equal key, and `changed` with the other matches.

    `changed` is called even if `updated` raises an exception.
    """
    others = match_listener(model, shape, changed)

    def on_change(appeared: list[Row], disappeared: list[Row]) -> None:
        pairs, new, gone = pair_updates(appeared, disappeared, key)
        try:
            if pairs:
                before = _matches(model, shape, (row for row, _ in pairs))
                after = _matches(model, shape, (row for _, row in pairs))
                updated(list(zip(before, after, strict=True)))
        finally:
            if new or gone:
                others([*new], [*gone])

    return on_change


def _matches(model: Model, shape: Shape, rows: Iterable[Row]) -> list[Match]:
    return [Match(model, shape, row) for row in rows]


def check_listeners(*given: object) -> None:
    """Check that listeners can be called.

    Raises:
        InvalidArgument: a listener is not callable, or is a coroutine or generator function.
    """
    for one in given:
        if not callable(one):
            raise InvalidArgument(f"a listener must be a function, not {one!r}")
        check_not_deferred(one)
