"""Transitive closures, driven by demand: from the ends that are known, never by materialising all pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Protocol

from envgraph.graph import Model

MOST_KEPT: Final = 100_000
"""Reached objects that are remembered for the present state of the model."""

Search = Callable[[Any], list[Any]]
Meeting = Callable[[Any, Any], bool]


class Steps(Protocol):
    """Searches along the step of a closure, made when they are first asked for."""

    @property
    def backward_is_better(self) -> bool:
        """Whether a question about two known ends is better answered from the target."""

    def search(self, forward: bool) -> Search:
        """Everything that is reached from a source (or reaches a target) by one or more steps, nearest first."""

    def meeting(self, forward: bool) -> Meeting:
        """Whether a search from the first argument comes to the second."""

    def sources(self) -> Iterable[Any]:
        """Everything that may be the source of a pair."""


class ClosureView:
    """The reachability that a binary pattern spans.

    Whether one object reaches another is first answered by a search that ends there. When the same start is asked for
    again in the same state of the model, all that it reaches is found once and kept.

    Args:
        model: its revision tells when answers are out of date.
        steps: see `Steps`.
        reflexive: tells which values are related to themselves without a step, or None for a closure by `+`.
    """

    def __init__(self, model: Model, steps: Steps, reflexive: Callable[[Any], bool] | None) -> None:
        self._store = model.store
        self._steps = steps
        self._reflexive = reflexive
        self._reached: dict[Any, set[Any] | None] = {}
        self._kept = 0
        self._revision = -1

    def forward(self) -> Search:
        """What a source reaches, nearest first."""
        return self._with_start(self._steps.search(forward=True))

    def backward(self) -> Search:
        """What reaches a target, nearest first."""
        return self._with_start(self._steps.search(forward=False))

    def pairs(self) -> Callable[[], Iterator[tuple[Any, Any]]]:
        """Every source with everything that it reaches."""
        forward = self.forward()

        def pairs() -> Iterator[tuple[Any, Any]]:
            return ((source, target) for source in self._steps.sources() for target in forward(source))

        return pairs

    def holds(self) -> Meeting:
        """Whether a source reaches a target."""
        flipped, reflexive = self._steps.backward_is_better, self._reflexive
        meets = self._remembering(self._steps.meeting(not flipped))
        if not flipped and reflexive is None:
            return meets

        def holds(source: Any, target: Any) -> bool:
            if source == target and reflexive is not None and reflexive(source):
                return True
            return meets(target, source) if flipped else meets(source, target)

        return holds

    def _remembering(self, meets: Meeting) -> Meeting:
        store, reached = self._store, self._reached

        def meets_again(start: Any, goal: Any) -> bool:
            if self._revision != store.revision:
                self._revision = store.revision
                reached.clear()
                self._kept = 0
            if start not in reached:
                reached[start] = None
                return meets(start, goal)
            return goal in (reached[start] or self._all(start))

        return meets_again

    def _all(self, start: Any) -> set[Any]:
        found = set(self._steps.search(not self._steps.backward_is_better)(start))
        self._kept += len(found)
        if self._kept > MOST_KEPT:
            self._reached.clear()
            self._kept = len(found)
        self._reached[start] = found
        return found

    def _with_start(self, search: Search) -> Search:
        reflexive = self._reflexive
        if reflexive is None:
            return search

        def search_with_start(start: Any) -> list[Any]:
            reached = search(start)
            return [start, *(node for node in reached if node != start)] if reflexive(start) else reached

        return search_with_start
