"""The view matcher: keeps views of watched patterns up to date, and searches for the matches of others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from envgraph.errors import MAX_NESTING, InvalidArgument, TransactionError
from envgraph.graph import Model
from envgraph.match._matcher import FREE, Matcher, Row, check_arguments
from envgraph.match.demand._compiled_matcher import CompiledMatcher
from envgraph.match.explain._why_not import WhyNot
from envgraph.match.passes._call_graph import check_nesting
from envgraph.match.views.operators._materialized_view import RowOperator
from envgraph.match.views.operators._row_set import make_key_function
from envgraph.match.views.watch._loop_views import LoopViews
from envgraph.match.views.watch._notifications import Change, Subscription
from envgraph.match.views.watch._watched_views import WatchedViews
from envgraph.metamodel import Value
from envgraph.pattern import Library


class ViewMatcher(Matcher):
    """A `Matcher` whose watched patterns are views, updated after every change of the model.

    The matches of a watched pattern have the order of the view, which depends only on the version of the model.

    Args:
        model: the model.
        library: the patterns; more may be added later.

    Attributes:
        demand: the matcher for unwatched patterns.
        watched_views: the views.
        listeners: the subscriptions to changes.
        loops: the running loops of units, which register here.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self.model = model
        self.library = library
        self.demand = CompiledMatcher(model, library)
        self.watched_views = WatchedViews(model, library, self.demand)
        self.listeners = self.watched_views.listeners
        self.loops = LoopViews(self.watched_views, self.demand)
        self._lookups = self.watched_views.lookups
        self._to_watch: dict[str, None] = {}

    # --- watching

    @property
    def watched(self) -> tuple[str, ...]:
        """Return the names of the watched patterns, in the order of the requests; first watch postponed ones."""
        if self._to_watch:
            self._watch_postponed()
        return tuple(self.watched_views.permanent_views)

    def watch(self, *patterns: str) -> None:
        """Make views of patterns, and keep them up to date from now on.

        Raises:
            InvalidArgument: a pattern is unknown, a `search` pattern, or needs values for parameters; or another
                matcher of this model has views.
            EvaluationError: closures and recursive patterns are nested too deeply.
            TransactionError: a savepoint is open or a version exists: in that state the pattern had no view.
        """
        new = [pattern for pattern in dict.fromkeys(patterns) if pattern not in self.watched_views.permanent_views]
        for pattern in new:
            self._check_watchable(pattern)
        if not new:
            return
        if not self.model.graph.history.is_idle:
            raise TransactionError(
                f"cannot begin to watch `{new[0]}` inside a transaction or while a version exists: "
                "call `watch` before the transaction and before the first commit"
            )
        self.watched_views.update_views()
        self.watched_views.build_network((*self.watched_views.views, *new))

    def watch_later(self, *patterns: str) -> None:
        """Watch patterns at the next query when no savepoint or version is open and no other matcher has views.

        For patterns declared `incremental`. Patterns that cannot be enumerated or are nested too deeply are skipped.
        """
        calls = self.demand.call_graph
        possible = (name for name in patterns if not self.library.inputs(name))
        self._to_watch.update((name, None) for name in possible if calls.summary_of(name).nesting <= MAX_NESTING)

    def _watch_postponed(self) -> None:
        """Watch the patterns of `watch_later`, if no savepoint or version is open and no other matcher has views."""
        if self.model.graph.history.is_idle and self.watched_views.other_views() is None:
            wanted, self._to_watch = self._to_watch, {}
            self.watch(*wanted)

    def unwatch(self, *patterns: str) -> None:
        """Discard the views of patterns; patterns without a view are skipped.

        Raises:
            InvalidArgument: a pattern has subscribers.
        """
        for pattern in patterns:
            if pattern in self.listeners.patterns:
                raise InvalidArgument(f"`{pattern}` has listeners or event rules: remove them first")
        for pattern in patterns:
            self.watched_views.views.pop(pattern, None)
            self._to_watch.pop(pattern, None)
        self._lookups.discard_costs()
        if not self.watched_views.views:
            self.watched_views.discard_all()

    def listen(self, pattern: str, changed: Change, restored: Change | None = None) -> Subscription:
        """Subscribe to the net changes of a pattern, which is then watched: see `Listeners`. Return the subscription.

        Args:
            pattern: qualified name.
            changed: called with the inserted and the deleted matches since its last call.
            restored: called instead after a checkout; None for `changed`.

        Raises:
            InvalidArgument, TransactionError: as `watch`.
        """
        self.watch(pattern)
        return self.listeners.add(Subscription(pattern, changed, restored or changed))

    def _check_watchable(self, pattern: str) -> None:
        """Raise an `InvalidArgument` or `EvaluationError` if a pattern cannot be watched."""
        if self.library.get(pattern).strategy == "search":
            raise InvalidArgument(f"`{pattern}` cannot be watched: remove `search` from its definition")
        inputs = self.library.inputs(pattern)
        if inputs:
            name = self.library.get(pattern).parameters[inputs[0]].name
            raise InvalidArgument(
                f"`{pattern}` cannot be watched: its parameter `{name}` always needs a value; query it instead"
            )
        check_nesting(self.demand.call_graph, pattern)

    # --- the interface of `Matcher`

    def _current(self, pattern: str) -> RowOperator | None:
        """Return the updated view of a pattern; None without a usable view. First watch patterns of `watch_later`."""
        if self._to_watch:
            self._watch_postponed()
        return self.watched_views.current(pattern)

    def rows(self, pattern: str, arguments: tuple[object, ...]) -> Sequence[Row]:
        """Return all matches whose values equal the arguments that are not `FREE`."""
        view = self._current(pattern)
        if view is None:
            return self.demand.rows(pattern, arguments)
        positions, known = self._positions_and_key(pattern, arguments)
        if not positions:
            return view.rows[:]
        if not self._lookups.is_worthwhile(pattern, view, positions):
            return self.demand.rows(pattern, arguments)
        return [] if known is None else list(self._lookups.rows(pattern, view, positions, known))

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """Return the first match that `rows` would return, or None if there is none."""
        view = self._current(pattern)
        if view is None:
            return self.demand.first(pattern, arguments)
        positions, known = self._positions_and_key(pattern, arguments)
        if not positions:
            return view.rows[0] if view.rows else None
        if not self._lookups.is_worthwhile(pattern, view, positions):
            return self.demand.first(pattern, arguments)
        return None if known is None else self._lookups.first(pattern, view, positions, known)

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Return True if `rows` would return at least one match."""
        view = self._current(pattern)
        if view is None:
            return self.demand.exists(pattern, arguments)
        return self._number(pattern, view, arguments) > 0

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """Return the number of matches that `rows` would return."""
        view = self._current(pattern)
        if view is None:
            return self.demand.count(pattern, arguments)
        return self._number(pattern, view, arguments)

    def _number(self, pattern: str, view: RowOperator, arguments: tuple[object, ...]) -> int:
        """Return the number of rows of a view whose values equal the arguments that are not `FREE`."""
        positions, known = self._positions_and_key(pattern, arguments)
        if not positions:
            return len(view.rows)
        return 0 if known is None else self._lookups.count(pattern, view, positions, known)

    def _positions_and_key(self, pattern: str, arguments: tuple[object, ...]) -> tuple[tuple[int, ...], Any]:
        """Check arguments. Return the positions that are not `FREE`, and their key; None if an object is deleted."""
        types = self.library.parameter_types(pattern)
        if arguments.count(FREE) == len(arguments) == len(types):
            return (), None
        checked = check_arguments(self.model, self.library, pattern, types, arguments)
        positions = tuple([place for place, value in enumerate(arguments) if value is not FREE])
        return positions, None if checked is None else make_key_function(positions)(checked)

    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Return a function that takes values for the bound positions (ascending) and returns all matches with them.

        The function does not check the values. It reads the view of a watched pattern if this is faster than a search.
        """
        search = self._search(pattern) if not bound else self.demand.prepare(pattern, bound)
        if not bound:
            return lambda: (
                self._list_rows(pattern, search) if (view := self._current(pattern)) is None else view.rows[:]
            )
        if not self._lookups.may_be_worthwhile(pattern, bound):
            return search

        def rows(*values: Any) -> list[Row]:
            view = self._current(pattern)
            if view is None or not self._lookups.is_worthwhile(pattern, view, bound):
                return search(*values)
            wanted = values if len(values) > 1 else values[0]
            return list(self._lookups.rows(pattern, view, bound, wanted))

        return rows

    def prepare_iterator(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """Return a function that takes values for the bound positions and yields all matches with them.

        It reads the view of a watched pattern; otherwise it searches for each match only when the caller asks for it.
        """
        seek = self.demand.prepare_iterator(pattern, bound)
        if bound and not self._lookups.may_be_worthwhile(pattern, bound):
            return seek
        held = self.prepare(pattern, bound) if bound else self.prepare_listing(pattern)

        def rows(*values: Any) -> Iterator[Row]:
            if self._current(pattern) is not None:
                return iter(held(*values))
            if self.loops.depth and not bound:
                self.loops.count_first_search(pattern)
            return seek(*values)

        return rows

    def _list_rows(self, pattern: str, search: Callable[[], list[Row]]) -> list[Row]:
        """Return the rows of a search; inside a loop count them, and perhaps read them from a temporary view."""
        return self.loops.rows(pattern, search) if self.loops.depth else search()

    def _search(self, pattern: str) -> Callable[[], list[Row]]:
        """Return the function that lists all matches of a pattern by a search, and note its order in
        `loops.sort_keys`.
        """
        search = self.demand.prepare(pattern, ())
        self.loops.sort_keys[search] = self.demand.sort_key(pattern)
        return search

    def prepare_listing(self, pattern: str) -> Callable[[], Sequence[Row]]:
        """Return a function that returns all matches; of a watched pattern the view's own list, not to be modified."""
        search = self._search(pattern)

        def rows() -> Sequence[Row]:
            view = self._current(pattern)
            return self._list_rows(pattern, search) if view is None else view.rows

        return rows

    def prepare_test(self, pattern: str) -> Callable[[Row], bool]:
        """Return a function that returns True if a row is a match; a watched pattern needs one lookup."""
        search = self.demand.prepare_test(pattern)

        def test(row: Row) -> bool:
            view = self._current(pattern)
            return search(row) if view is None else row in view.rows.position

        return test

    def explain(self, pattern: str, bound: tuple[int, ...] = (), values: Sequence[Any] = ()) -> str:
        """Return as text how matches are found, or for a watched pattern how its view is updated."""
        if not bound and self._current(pattern) is not None:
            return self.watched_views.network.explain(pattern, self.demand.build)
        return self.demand.explain(pattern, bound, values)

    def why_not(self, pattern: str, given: Mapping[int, Value]) -> WhyNot:
        """Return the explanation why there is no match for values at some positions: see `WhyNot`."""
        return self.demand.why_not(pattern, given)

    def analyze(self) -> None:
        """Measure the sizes of the model for plans made from now on, and rebuild the views if no savepoint is open."""
        self.demand.analyze()
        self._lookups.discard_costs()
        if self.watched_views.views and self.model.graph.history.is_idle and self.watched_views.update_views():
            self.watched_views.build_network(self.watched_views.views)

    def discard_caches(self) -> None:
        """Discard cached plans of unwatched patterns, because pattern names may now refer to other definitions."""
        self.demand.discard_caches()
        self._lookups.discard_costs()

    def check_integrity(self) -> None:
        """Assert that every usable view contains the rows that a new computation finds. For tests."""
        if not self.watched_views.update_views():
            return
        self.watched_views.network.check()
        for pattern, view in self.watched_views.views.items():
            view.check_rows(self.demand.rows(pattern, (FREE,) * len(self.library.parameter_types(pattern))))
