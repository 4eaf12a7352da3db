"""The views of a matcher: kept current with the model, and sound whatever interrupts that."""

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
"""A model that has had so many times the objects, and so many more, is planned for anew."""


class KeptViews:
    """What follows a model for a matcher: a network of operators, some of which hold the patterns that are watched.

    A rollback or checkout brings the views back without evaluating a query.

    Views whose update was interrupted, such as by Ctrl-C, are counted anew when they are next asked: their rows may
    then be in another order. If that fails, because a value cannot be computed, patterns are searched for until a
    rollback or checkout has brought the views back, or there is no state to go back to and they are built anew.

    Only one matcher of a model has views: the store calls the functions of one network.

    Args:
        model: what is followed.
        library: the patterns.
        demand: finds what is not kept.

    Attributes:
        views: of the watched patterns.
        partly: questions about views with some values given.
        listeners: who is notified of what changes.
        too_large: patterns whose views were too large to be used by `aside`.
        user: who asks the matcher, weakly; None if that is not known. The views of a matcher whose user is gone are
            given up when another one of the model watches.

    Invariants: while `_broken` is None and no load is under way, the network hears of every change. If not None it is
    the least number of open savepoints since the interruption: a rollback to fewer brings the views back. Whatever the
    views hold, and the journal, then agree; counting anew is recorded (`_countable`), so that a rollback undoes it,
    then what was interrupted. While `_spoilt`, a version may have been made of views that were broken.
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
        """The views that somebody has asked for, not a loop for its time."""
        return self.views if self._brief is None else {}

    def current(self, pattern: str) -> Rows | None:
        """The view of a pattern, up to date; None if it is not watched."""
        if pattern not in self.views or not self.up_to_date():
            return None
        if self.model.graph.store.next_id > self._outgrown:
            self.plan_anew()
        return self.views[pattern]

    def watch_briefly(self, patterns: Sequence[str], aside: Sequence[str], most: int) -> bool:
        """Watch patterns inside a transaction, until `give_up`; return whether this is possible.

        A rollback to a state before the call gives the views up. Views that exist for the same patterns keep the order
        of their rows.

        Args:
            patterns: patterns whose rows are listed in the order of their views.
            aside: patterns whose rows only the method `aside` returns. They are not watched if an operator would have
                more than `most` rows.
            most: the largest number of pairs in a closure, too.
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
        """Return the view of a pattern given to `watch_briefly` as `aside`; None if it has none or is out of date."""
        return self._aside.get(pattern) if self._aside and self.up_to_date() else None

    def give_up(self) -> None:
        """End `watch_briefly`."""
        if self._brief is not None:
            self.leave()

    def leave(self) -> None:
        """Follow the model no longer."""
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
        """Another matcher of the model that has views."""
        for other in self.model.graph.store.followers:
            if isinstance(other, KeptViews) and other is not self:
                return other
        return None

    def _be_alone(self) -> None:
        """The functions that the store calls belong to one matcher.

        Raises:
            InvalidArgument: to another, which somebody may still ask.
        """
        rival = self.rival()
        if rival is None:
            return
        if rival.user is not None:
            collect()  # engines are part of cycles
        if rival.user is None or rival.user() is not None:
            has = "has listeners or event rules" if rival.listeners else "watches patterns"
            names = ", ".join(f"`{name}`" for name in rival.views)
            raise InvalidArgument(
                f"another engine of model {self.model.name!r} {has}, and only one can watch: let that one `unwatch` "
                f"{names}, or give this one a copy of the model"
            )
        rival.leave()

    def make(self, patterns: Iterable[str], most: float = inf) -> None:
        """Make a network for these patterns, planned for the current sizes; closures may have at most `most` pairs.

        Log how the new rows differ from those of broken views.
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
        """What was planned for a small model is slow in a large one: build it once more, if nobody can go back."""
        if self.model.graph.store.next_id > self._outgrown and self.views and self.model.graph.history.idle:
            self.make(self.views)

    # --- Follower

    def settle(self) -> None:
        """Bring all views up to date: a savepoint or version follows."""
        if self._broken is None:
            self._bring_up()
            self.plan_anew()  # not after it: the order of the rows has to be the same then
        elif not self._mended():
            self._broken = min(self._broken, self.model.graph.history.depth)
            self._spoilt |= not self._broken

    def _bring_up(self) -> None:
        if self._suspended:
            return
        try:
            self.network.settle()
        except BaseException as problem:
            interrupted = self.model.graph.store.interrupted
            interrupted.append(self)
            interrupted.repair()
            if isinstance(problem, EvaluationError):
                self._countable = False  # it would fail again
            raise

    def _break(self) -> None:
        depth = self.model.graph.history.depth
        self._broken = depth if self._broken is None else min(self._broken, depth)
        self.network.wiring.unhang()

    def interrupted(self) -> None:
        """A change or a turn has been interrupted."""
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
        """Bring all views up to date, if they can be used; whether they can."""
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
        """Count broken views anew, or build them, if there is no state to go back to; whether that was possible."""
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
        except EvaluationError:  # reported to whoever asks for that very pattern
            self._countable = False
            return False
        except BaseException:
            model.graph.store.interrupted.append(self)
            model.graph.store.interrupted.repair()
            raise

    def rolled_back(self) -> None:
        """Views are as they were: the journal has brought them back."""
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
        self.network.wiring.hang()
        self._broken, self._countable = None, False

    def released(self) -> None:
        """The outermost transaction has ended: tell what has changed."""
        self.give_up()
        if self.listeners.subscriptions:
            self.listeners.deliver()

    def checked_out(self) -> None:
        """Another version: tell what differs."""
        self.give_up()
        if self._broken is not None:
            if self._spoilt:
                return
            self._hear_again()
        self.network.forget()
        if self.listeners.subscriptions:
            self.listeners.tell(restored=True)

    def suspend(self) -> None:
        """A load begins: until it ends, patterns are searched for."""
        self._suspended, self._aside = True, {}
        self.network.wiring.unhang()

    def loaded(self) -> None:
        """A load has ended."""
        self._suspended = False
        if self.views:
            self._break()
            self._countable, self._tried = False, -1
            self._mended()


def _continued(old: MatchSet, new: MatchSet, broken: bool) -> Log | None:
    """The log of new rows that take the place of old ones; those of broken views may differ."""
    if old.log is None:
        return None
    log = BoundedLog()
    list.extend(log, old.log)
    if broken:
        list.extend(log, [part for row in old for part in (row, False)])
        list.extend(log, [part for row in new for part in (row, True)])
    return log
