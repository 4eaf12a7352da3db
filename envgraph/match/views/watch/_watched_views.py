"""The views of a matcher: created, updated with the model, and repaired after interruptions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from gc import collect
from math import inf

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import Follower, Model
from envgraph.match.demand._compiled_matcher import CompiledMatcher
from envgraph.match.views.network._view_network import Network
from envgraph.match.views.operators._materialized_view import RowOperator, unrecorded
from envgraph.match.views.operators._row_set import MatchSet, RowLog
from envgraph.match.views.watch._notifications import BoundedLog, Listeners
from envgraph.match.views.watch._partial_lookup import PartialLookup
from envgraph.pattern import Library

GROWTH, LEAST = 4, 1000
"""The model is planned anew when it has `GROWTH` times as many objects as before, plus `LEAST`."""


class WatchedViews(Follower):
    """The views of one matcher: a network of operators that follows the model and contains the watched patterns.

    A rollback or checkout restores the views without evaluating a query.

    Views whose update was interrupted, for example by Ctrl-C, are recomputed at the next use; their rows may then have
    another order. If a value cannot be computed, patterns are searched instead, until a rollback or checkout restores
    the views, or they can be rebuilt because no earlier state can be restored.

    Only one matcher of a model can have views, because the store calls the functions of one network.

    Args:
        model: the model.
        library: the patterns.
        demand: the matcher that searches for unwatched patterns.

    Attributes:
        views: the views of the watched patterns.
        lookups: lookups in views with some bound values.
        listeners: the subscriptions.
        too_large: patterns that `watch_temporarily` could not watch as `sorted_view`, because operators had too
            many rows.
        user: weak reference to the user of the matcher; None if unknown. If the user no longer exists, the views are
            discarded when another matcher of the model watches patterns.

    Invariants: while `_broken_depth` is None and no load is under way, the network is notified of every change. Else
    `_broken_depth` is the smallest number of open savepoints since the interruption: a rollback to fewer savepoints
    restores the views. The views and the journal agree. A recomputation is journalled (if `_can_recompute`), so a
    rollback undoes it and then the interrupted change. While `_has_broken_version` is True, a version may contain
    broken views.
    """

    def __init__(self, model: Model, library: Library, demand: CompiledMatcher) -> None:
        self.model = model
        self._library = library
        self._demand = demand
        self.views: dict[str, RowOperator] = {}
        self._sorted_views: dict[str, RowOperator] = {}
        self.too_large: set[str] = set()
        self.lookups = PartialLookup(demand)
        self.network = self._new_network()
        self.listeners = Listeners(self)
        self.user: Callable[[], object] | None = None
        self._broken_depth: int | None = None
        self._can_recompute = False
        self._has_broken_version = False
        self._failed_revision = -1
        self._replan_size = 0
        self._is_suspended = False
        self._temporary_depth: int | None = None

    def _new_network(self) -> Network:
        """Return a new, empty network."""
        return Network(
            self.model.graph.store,
            self._library,
            self._demand.call_graph,
            lambda source: self._demand.build(source, self.network.operator_value),
            lambda pattern: self._demand.prepare(pattern, ()),
        )

    # --- which views there are

    @property
    def permanent_views(self) -> Mapping[str, RowOperator]:
        """Return the views that a user has requested; none while loops have temporary views."""
        return self.views if self._temporary_depth is None else {}

    def current(self, pattern: str) -> RowOperator | None:
        """Return the updated view of a pattern; None if the pattern is not watched or its view cannot be used.

        If the model has outgrown the plans of the views, all views are rebuilt first.
        """
        if pattern not in self.views or not self.update_views():
            return None
        if self.model.graph.store.next_id > self._replan_size:
            self.replan_if_outgrown()
        return self.views[pattern]

    def watch_temporarily(self, patterns: Sequence[str], aside: Sequence[str], max_size: int) -> bool:
        """Make temporary views inside a transaction, until `end_temporary`; return True if this was possible.

        They replace earlier temporary views; if these were of the same patterns, their order of rows is kept. Return
        False if a user watches patterns, another matcher has views, or a view cannot be computed. A rollback to a state
        before the call discards the views.

        Args:
            patterns: patterns whose rows are listed in the order of their views.
            aside: patterns whose views are only used through `aside`; not watched if any operator has more than
                `max_size` rows.
            max_size: also the largest number of pairs in a closure.
        """
        if (self.views and self._temporary_depth is None) or self._is_suspended or self.other_views() is not None:
            return False
        same = self.views.keys() == set(patterns) and self.update_views()
        rows = {pattern: view.rows[:] for pattern, view in self.views.items() if same}
        for others in ((*aside,), ()) if aside else ((),):
            try:
                with unrecorded(self.model.graph.store):
                    self.build_network((*patterns, *others), max_size)
                    for pattern, ordered in rows.items():
                        self.views[pattern].rows.replace(ordered)
            except EvaluationError:
                self.discard_all()
            else:
                self._sorted_views = {pattern: self.views.pop(pattern) for pattern in others}
                self._temporary_depth = self.model.graph.history.savepoint_depth
                if not others or self.network.largest_size() <= max_size:
                    return bool(patterns or others)
            self.too_large.update(others)
        return False

    def sorted_view(self, pattern: str) -> RowOperator | None:
        """Return the updated view of an `aside` pattern of `watch_temporarily`; None if there is none or it is
        unusable.
        """
        return self._sorted_views.get(pattern) if self._sorted_views and self.update_views() else None

    def end_temporary(self) -> None:
        """Discard all views if they are temporary."""
        if self._temporary_depth is not None:
            self.discard_all()

    def discard_all(self) -> None:
        """Discard all views, temporary or not, and unsubscribe from the store."""
        followers = self.model.graph.store.followers
        if any(follower is self for follower in followers):
            followers[:] = [follower for follower in followers if follower is not self]
            self.network.subscriptions.unsubscribe()
        self.views = {}
        self._sorted_views = {}
        self.lookups.discard_costs()
        self.network = self._new_network()
        self._broken_depth, self._can_recompute, self._has_broken_version, self._is_suspended = (
            None,
            False,
            False,
            False,
        )
        self._temporary_depth = None

    def other_views(self) -> WatchedViews | None:
        """Return the `WatchedViews` of another matcher that follows the model; None if there is none."""
        for other in self.model.graph.store.followers:
            if isinstance(other, WatchedViews) and other is not self:
                return other
        return None

    def _claim_model(self) -> None:
        """Check that no other matcher in use has views of the model; discard the views of a matcher without a user.

        Raises:
            InvalidArgument: another matcher has views, and its user may still exist.
        """
        rival = self.other_views()
        if rival is None:
            return
        if rival.user is not None:
            collect()  # engines are only freed by the cycle collector
        if rival.user is None or rival.user() is not None:
            has = "has listeners or event rules" if rival.listeners else "watches patterns"
            names = ", ".join(f"`{name}`" for name in rival.views)
            raise InvalidArgument(
                f"another engine of model {self.model.name!r} {has}, but only one engine of a model can watch: "
                f"`unwatch` {names} there, or give this engine a copy of the model"
            )
        rival.discard_all()

    def build_network(self, patterns: Iterable[str], max_pairs: float = inf) -> None:
        """Replace the views by a new network for these patterns; its closures may have at most `max_pairs` pairs.

        If views were broken, append the differences to the new rows to the logs. After an exception the old views are
        broken.
        """
        self._claim_model()
        store, old, known = self.model.graph.store, self.network, self.views
        try:
            if not any(follower is self for follower in store.followers):
                store.followers.append(self)
            network = self.network = self._new_network()
            network.limit_closures(max_pairs)
            views = {pattern: network.view(pattern) for pattern in patterns}
            old.subscriptions.unsubscribe()
            network.subscriptions.connect()
            for pattern, view in known.items():
                views[pattern].rows.log = _continue_log(view.rows, views[pattern].rows, self._broken_depth is not None)
            self.views = views
            self.lookups.discard_costs()
            self._broken_depth, self._has_broken_version = None, False
            self._replan_size = GROWTH * store.next_id + LEAST
        except BaseException:
            self.network, self.views = old, known
            store.interrupted_writes.append(self)
            store.interrupted_writes.repair()
            raise

    def replan_if_outgrown(self) -> None:
        """Rebuild the views if the model has outgrown their plans and no savepoint or version is open."""
        if self.model.graph.store.next_id > self._replan_size and self.views and self.model.graph.history.is_idle:
            self.build_network(self.views)

    # --- the interface of `Follower`

    def process_pending(self) -> None:
        """Update all views before a savepoint or version is created; recompute broken and outgrown views."""
        if self._broken_depth is None:
            self._process_pending_changes()
            self.replan_if_outgrown()  # not later: the order of rows must not change after a savepoint
        elif not self._repair():
            self._broken_depth = min(self._broken_depth, self.model.graph.history.savepoint_depth)
            self._has_broken_version |= not self._broken_depth

    def _process_pending_changes(self) -> None:
        """Process all pending changes, except during a load. After an exception mark the store as interrupted."""
        if self._is_suspended:
            return
        try:
            self.network.settle()
        except BaseException as problem:
            interrupted = self.model.graph.store.interrupted_writes
            interrupted.append(self)
            interrupted.repair()
            if isinstance(problem, EvaluationError):
                self._can_recompute = False  # a recomputation would fail again
            raise

    def _mark_broken(self) -> None:
        """Mark the views as broken, with the number of open savepoints, and unsubscribe them from the store."""
        depth = self.model.graph.history.savepoint_depth
        self._broken_depth = depth if self._broken_depth is None else min(self._broken_depth, depth)
        self.network.subscriptions.unsubscribe()

    def on_interruption(self) -> None:
        """Mark the views as broken, after a change or an update has been interrupted; discard views in `aside`."""
        self.lookups.discard_costs()
        self._sorted_views = {}
        if not self.views:
            self.discard_all()
            return
        if self._is_suspended:
            return
        for view in self.views.values():
            view.rows.mend()
        self._can_recompute |= self._broken_depth is None
        self._mark_broken()

    def update_views(self) -> bool:
        """Repair interrupted changes, and update or recompute all views. Return True if the views can be used."""
        store = self.model.graph.store
        if store.interrupted_writes:
            store.interrupted_writes.repair()
        if self._is_suspended:
            if store.loading:
                return False
            self.on_load_end()
        if self._broken_depth is not None:
            return self._repair()
        self._process_pending_changes()
        return True

    def _repair(self) -> bool:
        """Recompute broken views, or rebuild them if no savepoint or version is open. Return True on success."""
        model = self.model
        assert self._broken_depth is not None
        try:
            if (
                self._can_recompute
                and not self._has_broken_version
                and model.graph.history.savepoint_depth <= self._broken_depth
            ):
                self.network.recompute()
                self._resubscribe()
                return True
            if self._failed_revision == model.graph.store.revision or not model.graph.history.is_idle:
                return False
            self._failed_revision = model.graph.store.revision
            self.build_network(self.views)
            return True
        except EvaluationError:  # raised again by the search for that pattern
            self._can_recompute = False
            return False
        except BaseException:
            model.graph.store.interrupted_writes.append(self)
            model.graph.store.interrupted_writes.repair()
            raise

    def on_rollback(self) -> None:
        """Discard pending changes after a rollback, because the journal has restored the views.

        Temporary views made after the restored state are discarded. Broken views that it restores are subscribed again.
        """
        if self._temporary_depth is not None and self.model.graph.history.savepoint_depth < self._temporary_depth:
            self.discard_all()
            return
        if self._broken_depth is not None:
            if self._broken_depth <= self.model.graph.history.savepoint_depth:
                return
            self._resubscribe()
        self.network.rolled_back()
        for view in self.views.values():
            if view.rows.log is not None:
                view.rows.log.shorten()

    def _resubscribe(self) -> None:
        """Subscribe restored views to the store again, and mark them as intact."""
        self.network.subscriptions.subscribe()
        self._broken_depth, self._can_recompute = None, False

    def on_release(self) -> None:
        """Discard temporary views and notify subscribers, at the end of the outermost transaction."""
        self.end_temporary()
        if self.listeners.subscriptions:
            self.listeners.deliver()

    def on_checkout(self) -> None:
        """Discard pending changes and temporary views after a checkout, and notify subscribers of the differences.

        If views were broken, subscribe them again; but do nothing if a version may contain broken views.
        """
        self.end_temporary()
        if self._broken_depth is not None:
            if self._has_broken_version:
                return
            self._resubscribe()
        self.network.discard_pending()
        if self.listeners.subscriptions:
            self.listeners.notify_in_rounds(after_checkout=True)

    def on_load_start(self) -> None:
        """Unsubscribe the views while the model is loaded; patterns are searched until the end of the load."""
        self._is_suspended, self._sorted_views = True, {}
        self.network.subscriptions.unsubscribe()

    def on_load_end(self) -> None:
        """Rebuild the views after a load, if their values can be computed."""
        self._is_suspended = False
        if self.views:
            self._mark_broken()
            self._can_recompute, self._failed_revision = False, -1
            self._repair()


def _continue_log(old: MatchSet, new: MatchSet, was_broken: bool) -> RowLog | None:
    """Return the log for rows that replace old ones, with differences if the old view was broken; None if no log."""
    if old.log is None:
        return None
    log = BoundedLog()
    list.extend(log, old.log)
    if was_broken:
        list.extend(log, [part for row in old for part in (row, False)])
        list.extend(log, [part for row in new for part in (row, True)])
    return log
