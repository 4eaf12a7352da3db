"""Transitive closures, driven by demand: from the ends that are known, never by materialising all pairs.

One question is answered by one search. Many questions about the same state of the model share their work: what was
reached is remembered for ends that are asked about again, from whichever side that is; and when the searches have
looked at as many nodes as there are, questions about many starts are answered for all of them at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Protocol

from envgraph.graph import Model
from envgraph.match.demand._closure_aggregates import ClosureAggregate, ClosureAggregation
from envgraph.match.demand._condensation import Condensation, TooLarge

MOST_KEPT: Final = 100_000
"""Reached objects that are remembered for the present state of the model, outside of condensations."""
FEW_VISITED: Final = 1_000
"""Nodes that searches may look at before anything is done for all nodes."""
TIMES: Final = 2
"""How often searches may look at as many nodes as there are before something is done for all nodes."""

FEW_REACHED: Final = 16
"""Objects that are better searched for again than told from the others."""

Search = Callable[[Any], list[Any]]
Meeting = Callable[[Any, Any, list[Any]], bool]
Spreading = Callable[[Any, set[Any]], list[Any]]
Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""
Ends = dict[Any, set[Any] | None]
"""What is reached from each end; None for an end that has been asked about once."""


class Steps(Protocol):
    """Searches along the step of a closure, made when they are first asked for."""

    @property
    def backward_is_better(self) -> bool:
        """Whether a question about two known ends is better answered from the target."""

    @property
    def both_ways(self) -> bool:
        """Whether the other direction is not much worse."""

    def search(self, forward: bool) -> Search:
        """Everything that is reached from a source (or reaches a target) by one or more steps, nearest first."""

    def meeting(self, forward: bool) -> Meeting:
        """Return whether a search from the first argument meets the second; the third, `[first]`, gets its visits."""

    def spreading(self, forward: bool) -> Spreading:
        """As `search`, without what is in a set already; what is found is added to it."""

    def following(self, forward: bool) -> Callable[[Any], Iterable[Any]]:
        """Return where one step leads."""

    def sources(self) -> Iterable[Any]:
        """Everything that may be the source of a pair."""

    def nodes(self) -> int:
        """About how many nodes a search may visit."""


class ClosureView:
    """The reachability that a binary pattern spans.

    All methods return functions that answer questions about the present state of the model.

    Args:
        model: its revision tells when answers are out of date.
        steps: see `Steps`.
        reflexive: tells which values are related to themselves without a step, or None for a closure by `+`.
    """

    def __init__(self, model: Model, steps: Steps, reflexive: Callable[[Any], bool] | None) -> None:
        self._store = model.graph.store
        self._steps = steps
        self._reflexive = reflexive
        self._reached: Ends = {}
        self._reaching: Ends = {}
        self._edges: dict[bool, dict[Any, list[Any]]] = {True: {}, False: {}}
        self._joined: dict[Call, set[Any] | None] = {}
        self._values: dict[tuple[Call, int], Any] = {}
        self._aggregates: dict[tuple[ClosureAggregation, tuple[Any, ...]], ClosureAggregate | None] = {}
        self._condensed: dict[bool, Condensation] = {}
        self._forget()
        self._revision = -1

    def _forget(self) -> None:
        """There is a new state of the model."""
        self._drop(0)
        self._visited, self._enough, self._counted = 0, FEW_VISITED, False
        self._condensed.clear()
        self._too_large = False
        self._revision = self._store.revision  # last: Ctrl-C before leaves nothing out of date

    def _drop(self, size: int) -> None:
        """What is remembered goes, to make room for something of some size."""
        kept: tuple[dict[Any, Any], ...] = (self._reached, self._reaching, *self._edges.values())
        for each in (*kept, self._joined, self._values, self._aggregates):
            each.clear()
        self._size = size

    # --- what is reached

    def search(self, forward: bool) -> Search:
        """Return what a source reaches, or what reaches a target; nearest first."""
        search, reflexive, store = self._steps.search(forward), self._reflexive, self._store

        def counted(start: Any) -> list[Any]:
            reached = search(start)
            if self._revision != store.revision:
                self._forget()
            self._visited += len(reached) + 1
            return reached

        if reflexive is None:
            return counted

        def search_with_start(start: Any) -> list[Any]:
            reached = counted(start)
            return [start, *(node for node in reached if node != start)] if reflexive(start) else reached

        return search_with_start

    def stepping(self, forward: bool) -> Callable[[Any], list[Any]]:
        """Return where one step leads, once for each node: steps may be searches along closures themselves."""
        edges, store = self._edges[forward], self._store
        follow: Callable[[Any], Iterable[Any]] | None = None  # made late: closures of closures may go deep

        def step(node: Any) -> list[Any]:
            nonlocal follow
            if self._revision != store.revision:
                self._forget()
            known = edges.get(node)
            if known is None:
                follow = follow or self._steps.following(forward)
                known = list(follow(node))
                self._remember(len(known) + 1)
                edges[node] = known
            return known

        return step

    def spreading(self, forward: bool) -> Spreading:
        """As `search`, without what is in a set already; what is found is added to it."""
        spread, reflexive = self._steps.spreading(forward), self._reflexive
        if reflexive is None:
            return spread

        def spread_with_start(start: Any, seen: set[Any]) -> list[Any]:
            if start in seen or not reflexive(start):
                return spread(start, seen)
            seen.add(start)
            return [start, *spread(start, seen)]

        return spread_with_start

    def pairs(self) -> Callable[[], Iterator[tuple[Any, Any]]]:
        """Every source with everything that it reaches."""
        forward = self.search(forward=True)

        def pairs() -> Iterator[tuple[Any, Any]]:
            return ((source, target) for source in self._steps.sources() for target in forward(source))

        return pairs

    # --- values of what is reached

    def size(self, forward: bool) -> Callable[[Any], int]:
        """Return how much a source reaches, or how much reaches a target."""
        search, reflexive, store = self._steps.search(forward), self._reflexive, self._store

        def size(start: Any) -> int:
            if self._revision != store.revision:
                self._forget()
            itself = reflexive is not None and reflexive(start)
            condensed = self._condensation(forward)
            if condensed is not None:
                try:
                    return condensed.size(start) + (itself and not condensed.holds(start, start))
                except TooLarge:
                    self._give_up()
            found = search(start)
            self._visited += len(found) + 1
            return len(found) + (itself and start not in found)

        return size

    def alike(self, forward: bool) -> Callable[..., Any]:
        """A value that is the same for all starts that reach the same.

        The function gets the start, another function, the arguments that this takes, and the other things that its
        value depends on; and, if it is known how the value is made of what is reached, that and its arguments.
        """
        reflexive, store, values = self._reflexive, self._store, self._values

        def alike(
            start: Any,
            function: Callable[..., Any],
            arguments: tuple[Any, ...],
            others: tuple[Any, ...],
            aggregation: ClosureAggregation | None = None,
            given: tuple[Any, ...] = (),
        ) -> Any:
            if self._revision != store.revision:
                self._forget()
            condensed = self._condensation(forward)
            if condensed is None:
                return function(*arguments)
            try:
                reached = condensed.reached(start)
                question = (function, others), id(reached)
                alone = reflexive is not None and not condensed.holds(
                    start, start
                )  # no other reaches just this one
            except TooLarge:
                self._give_up()
                return function(*arguments)
            if alone and reflexive is not None and reflexive(start):
                reached |= condensed.bit(start)
            elif question in values:
                return values[question]
            found = None if aggregation is None else self._aggregated(aggregation, given, condensed, reached)
            value = function(*arguments) if found is None else found[0]
            if not alone:
                self._remember(1)
                values[question] = value
            return value

        return alike

    def _aggregated(
        self, aggregation: ClosureAggregation, given: tuple[Any, ...], condensed: Condensation, reached: int
    ) -> tuple[Any] | None:
        """The value for what is reached, if that is much, from the second question with the same arguments on."""
        call = aggregation, given
        if reached.bit_count() < FEW_REACHED:
            return None
        if call not in self._aggregates:
            self._aggregates[call] = None
            return None
        aggregate = self._aggregates[call]
        if aggregate is None:
            rows = list(aggregation.rows(*given))
            self._remember(len(rows) + 1)
            aggregate = self._aggregates[call] = ClosureAggregate(
                aggregation.function, aggregation.column, rows
            )
        aggregate.catch_up(condensed.nodes)
        return aggregate.value(reached)

    # --- whether it is reached

    def holds(self) -> Callable[[Any, Any], bool]:
        """Return whether a source reaches a target."""
        flipped, reflexive, store = self._steps.backward_is_better, self._reflexive, self._store
        find, reached, reaching = self._finding(not flipped), self._reached, self._reaching

        def holds(source: Any, target: Any) -> bool:
            if reflexive is not None and source == target and reflexive(source):
                return True
            if self._revision != store.revision:
                self._forget()
            known = reached.get(source)
            if known is not None:
                return target in known
            known = reaching.get(target)
            if known is not None:
                return source in known
            return find(target, source) if flipped else find(source, target)

        return holds

    def _finding(self, forward: bool) -> Callable[[Any, Any], bool]:
        """Return whether the end that a search starts from meets the other; what either reaches is not remembered."""
        meets, both_ways = self._steps.meeting(forward), self._steps.both_ways
        nears, fars = self._ends(forward), self._ends(not forward)

        def find(near: Any, far: Any) -> bool:
            condensed = self._condensation(forward)
            if condensed is not None:
                try:
                    return condensed.holds(near, far)
                except TooLarge:
                    self._give_up()
            if far in fars and both_ways:
                nears.setdefault(near)
                return near in self._all(far, not forward)
            if near in nears:
                fars.setdefault(far)
                return far in self._all(near, forward)
            nears[near] = fars[far] = None
            visited = [near]
            found = meets(near, far, visited)
            self._visited += len(visited)
            return found

        return find

    def _ends(self, forward: bool) -> Ends:
        return self._reached if forward else self._reaching

    def _all(self, start: Any, forward: bool) -> set[Any]:
        found = set(self._steps.search(forward)(start))
        self._visited += len(found) + 1
        self._remember(len(found) + 1)
        self._ends(forward)[start] = found
        return found

    def joined(self) -> Callable[..., bool]:
        """Return whether one end reaches, or is reached by, one of several others.

        The function gets the end; a function that gives all that do, with its arguments; and one that gives the answer,
        with its arguments.
        """
        store, joined = self._store, self._joined

        def holds(
            start: Any,
            whole: Callable[..., set[Any]],
            given: tuple[Any, ...],
            direct: Callable[..., bool],
            arguments: tuple[Any, ...],
        ) -> bool:
            if self._revision != store.revision:
                self._forget()
            call = whole, given
            found = joined.get(call)
            if found is None:
                if call not in joined or not self._paid():
                    joined[call] = None
                    return direct(*arguments)
                found = whole(*given)
                self._remember(len(found) + 1)
                joined[call] = found
            return start in found

        return holds

    # --- what is kept

    def _remember(self, size: int) -> None:
        """Make room."""
        self._size += size
        if self._size > MOST_KEPT:
            self._drop(size)

    def _paid(self) -> bool:
        """Return whether searches have been so much work that all nodes may be looked at."""
        if self._visited > self._enough and not self._counted:
            self._counted = True
            self._enough = max(FEW_VISITED, TIMES * self._steps.nodes())
        return self._visited > self._enough

    def _condensation(self, forward: bool) -> Condensation | None:
        """That of the steps in a direction, as soon as it pays."""
        found = self._condensed.get(forward)
        if found is None and not self._too_large and self._paid():
            found = self._condensed[forward] = Condensation(self._steps.following(forward))
        return found

    def _give_up(self) -> None:
        self._condensed.clear()
        self._aggregates.clear()
        self._too_large = True
