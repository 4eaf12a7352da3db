"""Transitive closures by search from the known ends, without materialising all pairs.

One question needs one search. Many questions about the same state of the model share their work. The reached sets of
ends that are queried repeatedly are cached. If the searches have visited twice as many nodes as exist, a condensation
(bit sets per strongly connected component) answers further questions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from envgraph.graph import Model
from envgraph.match._match_costs import DEMAND
from envgraph.match.demand._closure_aggregates import ClosureAggregate, ClosureAggregation
from envgraph.match.demand._condensation import Condensation, CondensationTooLarge
from envgraph.match.generate._symbols import ClosureQuestion

if TYPE_CHECKING:
    from envgraph.match.demand._compiled_functions import StepSearches

SearchFunction = Callable[[Any], list[Any]]
Spreading = Callable[[Any, set[Any]], list[Any]]
CallWithArguments = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""
ReachedSets = dict[Any, set[Any] | None]
"""The nodes reached from each end; None for an end that has been queried once."""


class DemandClosure:
    """The transitive closure of a binary step pattern, computed on demand.

    Most methods return functions that answer one kind of question about the present state of the model.

    Args:
        model: its revision shows when cached answers are out of date.
        steps: the searches along the step pattern.
        reflexive: returns True for values related to themselves without a step; None for the closure `+`.
    """

    def __init__(self, model: Model, steps: StepSearches, reflexive: Callable[[Any], bool] | None) -> None:
        self._store = model.graph.store
        self._steps = steps
        self._reflexive = reflexive
        self._reached: ReachedSets = {}
        self._reaching: ReachedSets = {}
        self._edges: dict[bool, dict[Any, list[Any]]] = {True: {}, False: {}}
        self._joined: dict[CallWithArguments, set[Any] | None] = {}
        self._values: dict[tuple[CallWithArguments, int], Any] = {}
        self._aggregates: dict[tuple[ClosureAggregation, tuple[Any, ...]], ClosureAggregate | None] = {}
        self._condensed: dict[bool, Condensation] = {}
        self._discard_all()
        self._revision = -1

    def _discard_all(self) -> None:
        """Discard all cached answers and counts. From now on, cached answers are those of the present model."""
        self._discard_cache(0)
        self._visited, self._enough, self._counted = 0, DEMAND.few_visited, False
        self._condensed.clear()
        self._too_large = False
        self._revision = self._store.revision  # last, so that an interruption (Ctrl-C) before leaves no outdated answer

    def _discard_cache(self, size: int) -> None:
        """Discard the cached sets and values, to make room for `size` nodes. Keep the condensations."""
        kept: tuple[dict[Any, Any], ...] = (self._reached, self._reaching, *self._edges.values())
        for each in (*kept, self._joined, self._values, self._aggregates):
            each.clear()
        self._size = size

    # --- reached nodes

    def search(self, forward: bool) -> SearchFunction:
        """Return a function that lists the nodes reached from a node in a direction, nearest first."""
        search, reflexive, store = self._steps.search(forward, ClosureQuestion.ALL), self._reflexive, self._store

        def counted_search(start: Any) -> list[Any]:
            reached: list[Any] = search(start)
            if self._revision != store.revision:
                self._discard_all()
            self._visited += len(reached) + 1
            return reached

        if reflexive is None:
            return counted_search

        def search_with_start(start: Any) -> list[Any]:
            reached = counted_search(start)
            return [start, *(node for node in reached if node != start)] if reflexive(start) else reached

        return search_with_start

    def successor_function(self, forward: bool) -> Callable[[Any], list[Any]]:
        """Return a function that lists the nodes one step from a node. Lists are cached until the model changes."""
        edges, store = self._edges[forward], self._store
        follow: Callable[[Any], Iterable[Any]] | None = None  # created late: closures may be nested

        def step(node: Any) -> list[Any]:
            nonlocal follow
            if self._revision != store.revision:
                self._discard_all()
            known = edges.get(node)
            if known is None:
                follow = follow or self._steps.successor_function(forward)
                known = list(follow(node))
                self._count_cached(len(known) + 1)
                edges[node] = known
            return known

        return step

    def spread_function(self, forward: bool) -> Spreading:
        """Return a function that takes (start, seen), lists reached nodes not in `seen`, and adds them to `seen`."""
        spread: Spreading = self._steps.search(forward, ClosureQuestion.NEW_NODES)
        reflexive = self._reflexive
        if reflexive is None:
            return spread

        def spread_with_start(start: Any, seen: set[Any]) -> list[Any]:
            if start in seen or not reflexive(start):
                return spread(start, seen)
            seen.add(start)
            return [start, *spread(start, seen)]

        return spread_with_start

    def pairs(self) -> Callable[[], Iterator[tuple[Any, Any]]]:
        """Return a function that yields all pairs of a source and a node that it reaches."""
        forward = self.search(forward=True)

        def pairs() -> Iterator[tuple[Any, Any]]:
            return ((source, target) for source in self._steps.sources() for target in forward(source))

        return pairs

    # --- values of the set of reached nodes

    def size(self, forward: bool) -> Callable[[Any], int]:
        """Return a function that returns the number of nodes reached from a node in a direction."""
        search, reflexive, store = self._steps.search(forward, ClosureQuestion.ALL), self._reflexive, self._store

        def size(start: Any) -> int:
            if self._revision != store.revision:
                self._discard_all()
            itself = reflexive is not None and reflexive(start)
            condensed = self._condensation(forward)
            if condensed is not None:
                try:
                    return condensed.size(start) + (itself and not condensed.reaches(start, start))
                except CondensationTooLarge:
                    self._discard_condensations()
            found = search(start)
            self._visited += len(found) + 1
            return len(found) + (itself and start not in found)

        return size

    def shared_value_function(self, forward: bool) -> Callable[..., Any]:
        """Return a function that computes a value shared by all starts with the same reached nodes.

        Its arguments are the start; a function and its arguments, which compute the value directly; the tuple of other
        inputs of the value; optionally a `ClosureAggregation`, which computes the value from the reached nodes, and its
        arguments.
        """
        reflexive, store, values = self._reflexive, self._store, self._values

        def shared_value(
            start: Any,
            function: Callable[..., Any],
            arguments: tuple[Any, ...],
            others: tuple[Any, ...],
            aggregation: ClosureAggregation | None = None,
            given: tuple[Any, ...] = (),
        ) -> Any:
            if self._revision != store.revision:
                self._discard_all()
            condensed = self._condensation(forward)
            if condensed is None:
                return function(*arguments)
            try:
                reached = condensed.reached(start)
                question = (function, others), id(reached)
                alone = reflexive is not None and not condensed.reaches(start, start)  # the start alone reaches itself
            except CondensationTooLarge:
                self._discard_condensations()
                return function(*arguments)
            if alone and reflexive is not None and reflexive(start):
                reached |= condensed.bit(start)
            elif question in values:
                return values[question]
            found = None if aggregation is None else self._aggregate_reached(aggregation, given, condensed, reached)
            value = function(*arguments) if found is None else found[0]
            if not alone:
                self._count_cached(1)
                values[question] = value
            return value

        return shared_value

    def _aggregate_reached(
        self, aggregation: ClosureAggregation, given: tuple[Any, ...], condensed: Condensation, reached: int
    ) -> tuple[Any] | None:
        """Return an aggregate of the reached nodes (a bit set) as a 1-tuple; None if it is better computed directly.

        That is the case for few nodes, and at the first call with the same aggregation and arguments.
        """
        call = aggregation, given
        if reached.bit_count() < DEMAND.few_reached:
            return None
        if call not in self._aggregates:
            self._aggregates[call] = None
            return None
        aggregate = self._aggregates[call]
        if aggregate is None:
            rows = list(aggregation.rows(*given))
            self._count_cached(len(rows) + 1)
            aggregate = self._aggregates[call] = ClosureAggregate(aggregation.function, aggregation.column, rows)
        aggregate.assign_bits(condensed.nodes)
        return aggregate.value(reached)

    # --- reachability tests

    def test_function(self) -> Callable[[Any, Any], bool]:
        """Return a function that returns True if a source reaches a target."""
        flipped, reflexive, store = self._steps.backward_is_better, self._reflexive, self._store
        find, reached, reaching = self._meeting_test(not flipped), self._reached, self._reaching

        def holds(source: Any, target: Any) -> bool:
            if reflexive is not None and source == target and reflexive(source):
                return True
            if self._revision != store.revision:
                self._discard_all()
            known = reached.get(source)
            if known is not None:
                return target in known
            known = reaching.get(target)
            if known is not None:
                return source in known
            return find(target, source) if flipped else find(source, target)

        return holds

    def _meeting_test(self, forward: bool) -> Callable[[Any, Any], bool]:
        """Return a function that returns True if a search in a direction from the first end reaches the second.

        It uses a condensation if that pays off, and caches the nodes reached from an end that is queried again.
        """
        meets, both_ways = self._steps.search(forward, ClosureQuestion.REACHES), self._steps.is_cheap_both_ways
        nears, fars = self._ends(forward), self._ends(not forward)

        def find(near: Any, far: Any) -> bool:
            condensed = self._condensation(forward)
            if condensed is not None:
                try:
                    return condensed.reaches(near, far)
                except CondensationTooLarge:
                    self._discard_condensations()
            if far in fars and both_ways:
                nears.setdefault(near)
                return near in self._reached_set(far, not forward)
            if near in nears:
                fars.setdefault(far)
                return far in self._reached_set(near, forward)
            nears[near] = fars[far] = None
            visited = [near]
            found: bool = meets(near, far, visited)
            self._visited += len(visited)
            return found

        return find

    def _ends(self, forward: bool) -> ReachedSets:
        """Return the cache of reached sets for a direction, by start node."""
        return self._reached if forward else self._reaching

    def _reached_set(self, start: Any, forward: bool) -> set[Any]:
        """Return the set of nodes that a start reaches, and cache it."""
        found = set(self._steps.search(forward, ClosureQuestion.ALL)(start))
        self._visited += len(found) + 1
        self._count_cached(len(found) + 1)
        self._ends(forward)[start] = found
        return found

    def meeting_any_function(self) -> Callable[..., bool]:
        """Return a function that returns True if one end reaches, or is reached by, at least one of several others.

        Its arguments are the end; a function and its arguments, which list all ends with this property; and a function
        and its arguments, which answer the question directly. The list is used, and cached, once it pays off.
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
                self._discard_all()
            call = whole, given
            found = joined.get(call)
            if found is None:
                if call not in joined or not self._pays_off():
                    joined[call] = None
                    return direct(*arguments)
                found = whole(*given)
                self._count_cached(len(found) + 1)
                joined[call] = found
            return start in found

        return holds

    # --- cache

    def _count_cached(self, size: int) -> None:
        """Count `size` more cached nodes. If there are too many, discard the cache."""
        self._size += size
        if self._size > DEMAND.most_reached:
            self._discard_cache(size)

    def _pays_off(self) -> bool:
        """Return True if searches have visited so many nodes since the last change that work for all nodes pays off."""
        if self._visited > self._enough and not self._counted:
            self._counted = True
            self._enough = max(DEMAND.few_visited, DEMAND.times * self._steps.nodes())
        return self._visited > self._enough

    def _condensation(self, forward: bool) -> Condensation | None:
        """Return the condensation for a direction, created if it pays off now; None if not, or if it is too large."""
        found = self._condensed.get(forward)
        if found is None and not self._too_large and self._pays_off():
            found = self._condensed[forward] = Condensation(self._steps.successor_function(forward))
        return found

    def _discard_condensations(self) -> None:
        """Discard the condensations and use none until the model changes, because they are too large."""
        self._condensed.clear()
        self._aggregates.clear()
        self._too_large = True
