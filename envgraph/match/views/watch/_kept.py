"""The views of a matcher: created, updated with the model, and repaired after interruptions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from gc import collect
from math import inf

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import Model
from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.views.network._network import Network
from envgraph.match.views.operators._operators import Rows, unrecorded
from envgraph.match.views.operators._sets import Log, MatchSet
from envgraph.match.views.watch._listeners import BoundedLog, Listeners
from envgraph.match.views.watch._partial_lookup import PartialLookup
from envgraph.pattern import Library

GROWTH, LEAST = 4, 1000
"""The model is planned anew when it has `GROWTH` times as many objects as before, plus `LEAST`."""


class KeptViews:
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
        partly: lookups in views with some bound values.
        listeners: the subscriptions.
        too_large: patterns that `watch_briefly` could not watch as `aside`, because operators had too many rows.
        user: weak reference to the user of the matcher; None if unknown. If the user no longer exists, the views are
            discarded when another matcher of the model watches patterns.

    Invariants: while `_broken` is None and no load is under way, the network is notified of every change. Else
    `_broken` is the smallest number of open savepoints since the interruption: a rollback to fewer savepoints restores
    the views. The views and the journal agree. A recomputation is journalled (if `_countable`), so a rollback undoes it
    and then the interrupted change. While `_spoilt` is True, a version may contain broken views.
    """

    def __init__(self, model: Model, library: Library, demand: CompiledMatcher) -> None:
        self.model = model
        self._library = library
        self._demand = demand
        self.views: dict[str, Rows] = {}
        self._aside: dict[str, Rows] = {}
        self.too_large: set[str] = set()
        self.partly = PartialLookup(demand)
        self.network = self._new_network()
        self.listeners = Listeners(self)
        self.user: Callable[[], object] | None = None
        self._broken: int | None = None
        self._countable = False
        self._spoilt = False
        self._tried = -1
        self._outgrown = 0
        self._suspended = False
        self._brief: int | None = None

    def _new_network(self) -> Network:
        """Return a new, empty network."""
        return Network(
            self.model.graph.store,
            self._library,
            self._demand.calls,
            lambda source: self._demand.build(source, self.network.held),
            lambda pattern: self._demand.prepare(pattern, ()),
        )

    # --- which views there are

    @property
    def lasting(self) -> Mapping[str, Rows]:
        """Return the views that a user has requested; none while loops have temporary views."""
        return self.views if self._brief is None else {}

    def current(self, pattern: str) -> Rows | None:
        """Return the updated view of a pattern; None if the pattern is not watched or its view cannot be used.

        If the model has outgrown the plans of the views, all views are rebuilt first.
        """
        if pattern not in self.views or not self.up_to_date():
            return None
        if self.model.graph.store.next_id > self._outgrown:
            self.plan_anew()
        return self.views[pattern]

    def watch_briefly(self, patterns: Sequence[str], aside: Sequence[str], most: int) -> bool:
        """Make temporary views inside a transaction, until `give_up`; return True if this was possible.

        They replace earlier temporary views; if these were of the same patterns, their order of rows is kept. Return
        False if a user watches patterns, another matcher has views, or a view cannot be computed. A rollback to a state
        before the call discards the views.

        Args:
            patterns: patterns whose rows are listed in the order of their views.
            aside: patterns whose views are only used through `aside`; not watched if any operator has more than `most`
                rows.
            most: also the largest number of pairs in a closure.
        """
        if (self.views and self._brief is None) or self._suspended or self.rival() is not None:
            return False
        same = self.views.keys() == set(patterns) and self.up_to_date()
        rows = {pattern: view.rows[:] for pattern, view in self.views.items() if same}
        for others in ((*aside,), ()) if aside else ((),):
            try:
                with unrecorded(self.model.graph.store):
                    self.make((*patterns, *others), most)
                    for pattern, ordered in rows.items():
                        self.views[pattern].rows.replace(ordered)
            except EvaluationError:
                self.leave()
            else:
                self._aside = {pattern: self.views.pop(pattern) for pattern in others}
                self._brief = self.model.graph.history.depth
                if not others or self.network.largest() <= most:
                    return bool(patterns or others)
            self.too_large.update(others)
        return False

    def aside(self, pattern: str) -> Rows | None:
        """Return the updated view of an `aside` pattern of `watch_briefly`; None if there is none or it is unusable."""
        return self._aside.get(pattern) if self._aside and self.up_to_date() else None

    def give_up(self) -> None:
        """Discard all views if they are temporary."""
        if self._brief is not None:
            self.leave()

    def leave(self) -> None:
        """Discard all views, temporary or not, and unsubscribe from the store."""
        followers = self.model.graph.store.followers
        if any(follower is self for follower in followers):
            followers[:] = [follower for follower in followers if follower is not self]
            self.network.wiring.unhang()
        self.views = {}
        self._aside = {}
        self.partly.forget()
        self.network = self._new_network()
        self._broken, self._countable, self._spoilt, self._suspended = None, False, False, False
        self._brief = None

    def rival(self) -> KeptViews | None:
        """Return the `KeptViews` of another matcher that follows the model; None if there is none."""
        for other in self.model.graph.store.followers:
            if isinstance(other, KeptViews) and other is not self:
                return other
        return None

    def _be_alone(self) -> None:
        """Check that no other matcher in use has views of the model; discard the views of a matcher without a user.

        Raises:
            InvalidArgument: another matcher has views, and its user may still exist.
        """
        rival = self.rival()
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
        rival.leave()

    def make(self, patterns: Iterable[str], most: float = inf) -> None:
        """Replace the views by a new network for these patterns; its closures may have at most `most` pairs.

        If views were broken, append the differences to the new rows to the logs. After an exception the old views are
        broken.
        """
        self._be_alone()
        store, old, known = self.model.graph.store, self.network, self.views
        try:
            if not any(follower is self for follower in store.followers):
                store.followers.append(self)
            network = self.network = self._new_network()
            network.limit_closures(most)
            views = {pattern: network.view(pattern) for pattern in patterns}
            old.wiring.unhang()
            network.wiring.connect()
            for pattern, view in known.items():
                views[pattern].rows.log = _continued(view.rows, views[pattern].rows, self._broken is not None)
            self.views = views
            self.partly.forget()
            self._broken, self._spoilt = None, False
            self._outgrown = GROWTH * store.next_id + LEAST
        except BaseException:
            self.network, self.views = old, known
            store.interrupted.append(self)
            store.interrupted.repair()
            raise

    def plan_anew(self) -> None:
        """Rebuild the views if the model has outgrown their plans and no savepoint or version is open."""
        if self.model.graph.store.next_id > self._outgrown and self.views and self.model.graph.history.idle:
            self.make(self.views)

    # --- the interface of `Follower`

    def settle(self) -> None:
        """Update all views before a savepoint or version is created; recompute broken and outgrown views."""
        if self._broken is None:
            self._bring_up()
            self.plan_anew()  # not later: the order of rows must not change after a savepoint
        elif not self._mended():
            self._broken = min(self._broken, self.model.graph.history.depth)
            self._spoilt |= not self._broken

    def _bring_up(self) -> None:
        """Process all pending changes, except during a load. After an exception mark the store as interrupted."""
        if self._suspended:
            return
        try:
            self.network.settle()
        except BaseException as problem:
            interrupted = self.model.graph.store.interrupted
            interrupted.append(self)
            interrupted.repair()
            if isinstance(problem, EvaluationError):
                self._countable = False  # a recomputation would fail again
            raise

    def _break(self) -> None:
        """Mark the views as broken, with the number of open savepoints, and unsubscribe them from the store."""
        depth = self.model.graph.history.depth
        self._broken = depth if self._broken is None else min(self._broken, depth)
        self.network.wiring.unhang()

    def interrupted(self) -> None:
        """Mark the views as broken, after a change or an update has been interrupted; discard views in `aside`."""
        self.partly.forget()
        self._aside = {}
        if not self.views:
            self.leave()
            return
        if self._suspended:
            return
        for view in self.views.values():
            view.rows.mend()
        self._countable |= self._broken is None
        self._break()

    def up_to_date(self) -> bool:
        """Repair interrupted changes, and update or recompute all views. Return True if the views can be used."""
        store = self.model.graph.store
        if store.interrupted:
            store.interrupted.repair()
        if self._suspended:
            if store.loading:
                return False
            self.loaded()
        if self._broken is not None:
            return self._mended()
        self._bring_up()
        return True

    def _mended(self) -> bool:
        """Recompute broken views, or rebuild them if no savepoint or version is open. Return True on success."""
        model = self.model
        assert self._broken is not None
        try:
            if self._countable and not self._spoilt and model.graph.history.depth <= self._broken:
                self.network.recount()
                self._hear_again()
                return True
            if self._tried == model.graph.store.revision or not model.graph.history.idle:
                return False
            self._tried = model.graph.store.revision
            self.make(self.views)
            return True
        except EvaluationError:  # raised again by the search for that pattern
            self._countable = False
            return False
        except BaseException:
            model.graph.store.interrupted.append(self)
            model.graph.store.interrupted.repair()
            raise

    def rolled_back(self) -> None:
        """Discard pending changes after a rollback, because the journal has restored the views.

        Temporary views made after the restored state are discarded. Broken views that it restores are subscribed again.
        """
        if self._brief is not None and self.model.graph.history.depth < self._brief:
            self.leave()
            return
        if self._broken is not None:
            if self._broken <= self.model.graph.history.depth:
                return
            self._hear_again()
        self.network.rolled_back()
        for view in self.views.values():
            if view.rows.log is not None:
                view.rows.log.shorten()

    def _hear_again(self) -> None:
        """Subscribe restored views to the store again, and mark them as intact."""
        self.network.wiring.hang()
        self._broken, self._countable = None, False

    def released(self) -> None:
        """Discard temporary views and notify subscribers, at the end of the outermost transaction."""
        self.give_up()
        if self.listeners.subscriptions:
            self.listeners.deliver()

    def checked_out(self) -> None:
        """Discard pending changes and temporary views after a checkout, and notify subscribers of the differences.

        If views were broken, subscribe them again; but do nothing if a version may contain broken views.
        """
        self.give_up()
        if self._broken is not None:
            if self._spoilt:
                return
            self._hear_again()
        self.network.forget()
        if self.listeners.subscriptions:
            self.listeners.tell(restored=True)

    def suspend(self) -> None:
        """Unsubscribe the views while the model is loaded; patterns are searched until the end of the load."""
        self._suspended, self._aside = True, {}
        self.network.wiring.unhang()

    def loaded(self) -> None:
        """Rebuild the views after a load, if their values can be computed."""
        self._suspended = False
        if self.views:
            self._break()
            self._countable, self._tried = False, -1
            self._mended()


def _continued(old: MatchSet, new: MatchSet, broken: bool) -> Log | None:
    """Return the log for rows that replace old ones, with differences if the old view was broken; None if no log."""
    if old.log is None:
        return None
    log = BoundedLog()
    list.extend(log, old.log)
    if broken:
        list.extend(log, [part for row in old for part in (row, False)])
        list.extend(log, [part for row in new for part in (row, True)])
    return log
