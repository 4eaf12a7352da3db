"""The matcher that keeps some patterns current, and looks for the others when it is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from gc import collect
from operator import itemgetter
from typing import Any, Final

from envgraph.errors import MOST_NESTED, EvaluationError, InvalidArgument, TransactionError
from envgraph.graph import Model, guarded
from envgraph.match._matcher import FREE, Row, check_arguments
from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.explain._why import WhyNot
from envgraph.match.generate._symbols import Source
from envgraph.match.passes._calls import check_nesting
from envgraph.match.views._loops import Loops
from envgraph.match.views._network import Network
from envgraph.match.views._operators import Rows, unrecorded
from envgraph.match.views._partial_lookup import PartialLookup
from envgraph.match.views._sets import LONG, Log, MatchSet, key_of, net
from envgraph.metamodel import Value
from envgraph.pattern import Library

GROWTH, LEAST = 4, 1000
"""A model that has had so many times the objects, and so many more, is planned for anew."""

Change = Callable[[list[Row], list[Row]], object]
"""Called with the rows that have appeared, and those that have disappeared."""


MOST_ROUNDS: Final = 1_000
"""How often listeners may change the model again when they are told of a change."""


class BoundedLog(Log):
    """A log that is shortened when it has grown: edits outside of transactions may go on without an end."""

    __slots__ = ("_most",)

    def __init__(self) -> None:
        super().__init__()
        self._most = 2 * LONG

    def extend(self, parts: Iterable[Any]) -> None:
        """Add rows, each followed by whether it came."""
        if len(self) > self._most:  # before: what comes last is what an interruption leaves in doubt
            self.shorten()
            self._most = 2 * (len(self) + LONG)
        super().extend(parts)


class Subscription:
    """Somebody who wants to hear of the changes of a pattern; made by `ViewMatcher.listen`."""

    __slots__ = ("changed", "pattern", "restored")

    def __init__(self, pattern: str, changed: Change, restored: Change) -> None:
        self.pattern = pattern
        self.changed = changed
        self.restored = restored


class ViewMatcher:
    """A `Matcher` whose watched patterns are views: kept current with every change of the model.

    A rollback or checkout brings the views back without evaluating a query. The matches of a watched pattern are
    listed in the order of the view, which is a function of the version like every other order.

    Views whose update was interrupted, such as by Ctrl-C, are counted anew when they are next asked: their rows may
    then be in another order. If that fails, because a value cannot be computed, patterns are searched for until a
    rollback or checkout has brought the views back, or there is no state to go back to and they are built anew.

    Only one matcher of a model has views: the store calls the functions of one network.

    Args:
        model: what is searched.
        library: the patterns; more may be added later.

    Attributes:
        loops: who runs a loop says so here.
        user: who asks this matcher, weakly; None if that is not known. The views of a matcher whose user is gone are
            given up when another one of the model watches.

    Invariants: while `_broken` is None and no load is under way, the network hears of every change. If not None it is
    the least number of open savepoints since the interruption: a rollback to fewer brings the views back. Whatever the
    views hold, and the journal, then agree; counting anew is recorded (`_countable`), so that a rollback takes it back,
    then what was interrupted. While `_spoilt`, a version may have been made of views that were broken.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self.model = model
        self.library = library
        self.demand = CompiledMatcher(model, library)
        self._views: dict[str, Rows] = {}
        self._network = self._new_network()
        self._subscriptions: list[Subscription] = []
        self._news: list[tuple[int, Change, list[Row], list[Row]]] = []
        self._wanted: dict[str, None] = {}
        self._broken: int | None = None
        self._countable = False
        self._spoilt = False
        self._tried = -1
        self._outgrown = 0
        self._telling = False
        self._suspended = False
        self._partly = PartialLookup(self.demand)
        self._brief: int | None = None
        self.loops = Loops(self)
        self.user: Callable[[], object] | None = None

    def _new_network(self) -> Network:
        return Network(self.model.store, self.library, self.demand.calls, self._build, self._evaluation)

    # --- watching

    @property
    def watched(self) -> tuple[str, ...]:
        """The patterns that are kept current, in the order in which they were asked for."""
        if self._wanted:
            self._watch_wanted()
        return tuple(self._views) if self._brief is None else ()

    def watch(self, *patterns: str) -> None:
        """Keep patterns current from now on.

        Raises:
            InvalidArgument: an unknown pattern, a `search` pattern, one that needs values for parameters, or another
                matcher of this model watches.
            EvaluationError: closures and recursive patterns stand inside each other too deep.
            TransactionError: there is a state to go back to (a savepoint is open, or a version is held), in which the
                pattern was not watched.
        """
        known = self._views if self._brief is None else {}
        new = [pattern for pattern in dict.fromkeys(patterns) if pattern not in known]
        for pattern in new:
            self._check_watchable(pattern)
        if not new:
            return
        if not self.model.idle:
            raise TransactionError(
                f"cannot begin to watch `{new[0]}` inside a transaction or while a version is held: "
                "watch before the first commit"
            )
        self._up_to_date()
        self._rebuild((*self._views, *new))

    def watch_later(self, *patterns: str) -> None:
        """Watch patterns when something is next asked, there is no state to go back to, and no other matcher watches.

        For patterns that say so themselves: those that nothing enumerates, or that are too deep, are passed over.
        """
        calls = self.demand.calls
        possible = (name for name in patterns if not self.library.inputs(name))
        self._wanted.update((name, None) for name in possible if calls.nesting(name) <= MOST_NESTED)

    def _watch_wanted(self) -> None:
        if self.model.idle and self._rival() is None:
            wanted, self._wanted = self._wanted, {}
            self.watch(*wanted)

    def watch_briefly(self, patterns: Sequence[str]) -> bool:
        """Keep patterns current although there is a state to go back to, until `give_up`; whether that is possible.

        It is given up by itself where that state comes back.
        """
        if (self._views and self._brief is None) or self._suspended or self._rival() is not None:
            return False
        try:
            with unrecorded(self.model.store):
                self._rebuild(patterns)
        except EvaluationError:
            self._leave()
            return False
        self._brief = self.model.depth
        return True

    def give_up(self) -> None:
        """End `watch_briefly`."""
        if self._brief is not None:
            self._leave()

    def worth_watching(self, pattern: str, most: int) -> bool:
        """Whether a view of a pattern is no larger than so many rows, and made of nothing larger."""
        if self.library.get(pattern).strategy == "search" or self.library.inputs(pattern):
            return False
        if self.demand.calls.searches(pattern):
            return False
        return self.demand.count(pattern, (FREE,) * len(self.library.parameter_types(pattern))) <= most

    def unwatch(self, *patterns: str) -> None:
        """Keep patterns current no longer; those that are not watched are passed over.

        Raises:
            InvalidArgument: somebody listens to the pattern.
        """
        for pattern in patterns:
            if any(subscription.pattern == pattern for subscription in self._subscriptions):
                raise InvalidArgument(f"somebody listens to `{pattern}`")
        for pattern in patterns:
            self._views.pop(pattern, None)
            self._wanted.pop(pattern, None)
        self._partly.forget()
        if not self._views:
            self._leave()

    def forget(self) -> None:
        """Names of patterns may mean something else from now on, but for those that are watched."""
        self.demand.forget()
        self._partly.forget()

    def _leave(self) -> None:
        """Follow the model no longer."""
        followers = self.model.store.followers
        if any(follower is self for follower in followers):
            followers[:] = [follower for follower in followers if follower is not self]
            self._network.unhang()
        self._views = {}
        self._partly.forget()
        self._network = self._new_network()
        self._broken, self._countable, self._spoilt, self._suspended = None, False, False, False
        self._brief = None

    def _rival(self) -> ViewMatcher | None:
        """Another matcher of the model that has views."""
        for other in self.model.store.followers:
            if isinstance(other, ViewMatcher) and other is not self:
                return other
        return None

    def _be_alone(self) -> None:
        """The functions that the store calls belong to one matcher.

        Raises:
            InvalidArgument: to another, which somebody may still ask.
        """
        rival = self._rival()
        if rival is None:
            return
        if rival.user is not None:
            collect()  # engines are part of cycles
        if rival.user is None or rival.user() is not None:
            has = "has listeners or event rules" if rival._subscriptions else "watches patterns"
            names = ", ".join(f"`{name}`" for name in rival._views)
            raise InvalidArgument(
                f"another engine of model {self.model.name!r} {has}, and only one can watch: let that one `unwatch` "
                f"{names}, or give this one a copy of the model"
            )
        rival._leave()

    def _check_watchable(self, pattern: str) -> None:
        if self.library.get(pattern).strategy == "search":
            raise InvalidArgument(f"`{pattern}` is a `search` pattern: it is never watched")
        inputs = self.library.inputs(pattern)
        if inputs:
            name = self.library.get(pattern).parameters[inputs[0]].name
            raise InvalidArgument(f"`{pattern}` cannot be watched: nothing enumerates its parameter `{name}`")
        check_nesting(self.demand.calls, pattern)

    def _rebuild(self, patterns: Iterable[str]) -> None:
        """Make a network for these patterns; sizes are measured as they are now.

        What differs from what broken views held is logged.
        """
        self._be_alone()
        store, old, known = self.model.store, self._network, self._views
        try:
            if not any(follower is self for follower in store.followers):
                store.followers.append(self)
            network = self._network = self._new_network()
            views = {pattern: network.view(pattern) for pattern in patterns}
            old.unhang()
            network.connect()
            for pattern, view in known.items():
                views[pattern].rows.log = self._continued(view.rows, views[pattern].rows)
            self._views = views
            self._partly.forget()
            self._broken, self._spoilt = None, False
            self._outgrown = GROWTH * store.next_id + LEAST
        except BaseException:
            self._network, self._views = old, known
            store.interrupted.append(self)
            store.interrupted.repair()
            raise

    def _continued(self, old: MatchSet, new: MatchSet) -> Log | None:
        """The log of new rows that take the place of old ones; those of broken views may differ."""
        if old.log is None:
            return None
        log = BoundedLog()
        list.extend(log, old.log)
        if self._broken is not None:
            list.extend(log, [part for row in old for part in (row, False)])
            list.extend(log, [part for row in new for part in (row, True)])
        return log

    def _build(self, source: Source) -> Any:
        network = self._network
        return self.demand.build(source, network.held)

    def _evaluation(self, pattern: str) -> Callable[[], Sequence[Row]]:
        return self.demand.prepare(pattern, ())

    # --- Follower

    def settle(self) -> None:
        """Bring all views up to date: a savepoint or version follows."""
        if self._broken is None:
            self._bring_up()
            self._plan_anew()  # not after it: the order of the rows has to be the same then
        elif not self._mended():
            self._broken = min(self._broken, self.model.depth)
            self._spoilt |= not self._broken

    def _bring_up(self) -> None:
        if self._suspended:
            return
        try:
            self._network.settle()
        except BaseException as problem:
            interrupted = self.model.store.interrupted
            interrupted.append(self)
            interrupted.repair()
            if isinstance(problem, EvaluationError):
                self._countable = False  # it would fail again
            raise

    def _break(self) -> None:
        depth = self.model.depth
        self._broken = depth if self._broken is None else min(self._broken, depth)
        self._network.unhang()

    def interrupted(self) -> None:
        """A change or a turn has been interrupted."""
        self._partly.forget()
        if not self._views:
            self._leave()
            return
        if self._suspended:
            return
        for view in self._views.values():
            view.rows.mend()
        self._countable |= self._broken is None
        self._break()

    def _up_to_date(self) -> bool:
        """Bring all views up to date, if they can be used; whether they can."""
        store = self.model.store
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
            if self._countable and not self._spoilt and model.depth <= self._broken:
                self._network.recount()
                self._hear_again()
                return True
            if self._tried == model.revision or not model.idle:
                return False
            self._tried = model.revision
            self._rebuild(self._views)
            return True
        except EvaluationError:  # whoever asks for that very pattern is told
            self._countable = False
            return False
        except BaseException:
            model.store.interrupted.append(self)
            model.store.interrupted.repair()
            raise

    def rolled_back(self) -> None:
        """Views are as they were: the journal has brought them back."""
        if self._brief is not None and self.model.depth < self._brief:
            self._leave()
            return
        if self._broken is not None:
            if self._broken <= self.model.depth:
                return
            self._hear_again()
        self._network.rolled_back()
        for view in self._views.values():
            if view.rows.log is not None:
                view.rows.log.shorten()

    def _hear_again(self) -> None:
        self._network.hang()
        self._broken, self._countable = None, False

    def released(self) -> None:
        """The outermost transaction has ended: tell what has changed."""
        self.give_up()
        if self._subscriptions:
            self.deliver()

    def checked_out(self) -> None:
        """Another version: tell what differs."""
        self.give_up()
        if self._broken is not None:
            if self._spoilt:
                return
            self._hear_again()
        self._network.forget()
        if self._subscriptions:
            self._tell(restored=True)

    def suspend(self) -> None:
        """A load begins: until it ends, patterns are searched for."""
        self._suspended = True
        self._network.unhang()

    def loaded(self) -> None:
        """A load has ended."""
        self._suspended = False
        if self._views:
            self._break()
            self._countable, self._tried = False, -1
            self._mended()

    # --- listening

    def listen(self, pattern: str, changed: Change, restored: Change | None = None) -> Subscription:
        """Hear of the net changes of a pattern, which is watched from now on.

        Changes are told at the end of the outermost transaction, at a commit, and by `deliver`. What was rolled back
        is never told. The rows that have appeared are in the order of the view, those that have disappeared in
        ascending order.

        Args:
            pattern: qualified name.
            changed: called with the rows that have appeared and those that have disappeared since it was last called.
            restored: called instead after a checkout; `changed` if None.

        Raises:
            InvalidArgument, TransactionError: as `watch`.
        """
        self.watch(pattern)
        self._up_to_date()  # what is pending is no news
        subscription = Subscription(pattern, changed, restored or changed)
        rows = self._views[pattern].rows
        if rows.log is None:
            rows.log = BoundedLog()
        elif rows.log:
            self.deliver()
        self._subscriptions.append(subscription)
        return subscription

    def unlisten(self, subscription: Subscription) -> None:
        """Stop telling somebody; once is enough."""
        self._subscriptions = [each for each in self._subscriptions if each is not subscription]
        if not any(each.pattern == subscription.pattern for each in self._subscriptions):
            view = self._views.get(subscription.pattern)
            if view is not None:
                view.rows.log = None

    @property
    def listened(self) -> tuple[str, ...]:
        """The patterns that somebody listens to."""
        return tuple(dict.fromkeys(each.pattern for each in self._subscriptions))

    @property
    def heard(self) -> bool:
        """Whether anybody listens."""
        return bool(self._subscriptions)

    @property
    def telling(self) -> bool:
        """Whether listeners are being told: what they change is told after that."""
        return self._telling

    def deliver(self) -> None:
        """Bring the views up to date and tell the listeners what has changed since they were last told.

        If listeners raise exceptions, the first one is raised after all have been told; a `KeyboardInterrupt` rather
        than others.
        """
        if self._up_to_date():
            if not self._telling:
                self._plan_anew()  # not when a listener asks: it has been told rows in their order by then
            self._tell(restored=False)

    def _tell(self, restored: bool) -> None:
        """Tell, until listeners have nothing more to hear; those that change the model are told in turn."""
        if self._telling:
            return
        self._telling = True
        try:
            for _ in range(MOST_ROUNDS):
                changing = self._note(restored)
                if not self._news:
                    return
                self._tell_all()
                restored = False
                if not self._up_to_date():
                    return
            raise EvaluationError(
                f"listeners of {', '.join(f'`{name}`' for name in changing)} change the model each time they are told"
            )
        finally:
            self._telling = False

    def _tell_all(self) -> None:
        first: BaseException | None = None
        while self._news:
            _, call, appeared, disappeared = self._news[0]
            try:
                call(appeared, disappeared)
            except BaseException as problem:  # Ctrl-C, too: the others would never hear of this
                if first is None or isinstance(first, Exception) > isinstance(problem, Exception):
                    first = problem
            finally:
                del self._news[0]
        if first is not None:
            raise first

    def _note(self, restored: bool) -> list[str]:
        """Note who is to be told what, and empty the logs; returns the patterns that have changed."""
        views = self._views
        for each in self._subscriptions:
            if views[each.pattern].rows.log:
                break
        else:
            return []
        changed: list[str] = []
        for pattern in self.listened:
            rows = views[pattern].rows
            if not rows.log:
                continue
            news, change = list(self._news), net_changes(rows)
            if any(change):
                changed.append(pattern)
                news += [
                    (number, each.restored if restored else each.changed, *change)
                    for number, each in enumerate(self._subscriptions)
                    if each.pattern == pattern
                ]
            log = BoundedLog()
            self._news, rows.log = news, log
        self._news.sort(key=itemgetter(0))
        return changed

    @guarded
    def unheard(self) -> Iterator[None]:
        """Nobody is told what happens in the block, at whose end the state must be the one at its start."""
        self.settle()
        logs = {pattern: view.rows.log for pattern, view in self._views.items()}
        try:
            for view in self._views.values():
                view.rows.log = None
            yield
        finally:
            for pattern, log in logs.items():
                self._views[pattern].rows.log = log

    # --- Matcher

    def _current(self, pattern: str) -> Rows | None:
        """The view of a pattern, up to date; None if it is not watched."""
        if self._wanted:
            self._watch_wanted()
        if pattern not in self._views or not self._up_to_date():
            return None
        self._plan_anew()
        return self._views[pattern]

    def _plan_anew(self) -> None:
        """What was planned for a small model is slow in a large one: build it once more, if nobody can go back."""
        if self.model.store.next_id > self._outgrown and self._views and self.model.idle:
            self._rebuild(self._views)

    def rows(self, pattern: str, arguments: tuple[object, ...]) -> Sequence[Row]:
        """All matches that agree with the arguments."""
        view = self._current(pattern)
        if view is None:
            return self.demand.rows(pattern, arguments)
        if arguments.count(FREE) == len(arguments):
            self._check_number(pattern, arguments)
            return view.rows[:]
        positions, known = self._known(pattern, arguments)
        if not self._partly.worthwhile(pattern, view, positions):
            return self.demand.rows(pattern, arguments)
        return [] if known is None else list(self._partly.rows(pattern, view, positions, known))

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """The first of `rows`, or None."""
        view = self._current(pattern)
        if view is None:
            return self.demand.first(pattern, arguments)
        if arguments.count(FREE) == len(arguments):
            self._check_number(pattern, arguments)
            return view.rows[0] if view.rows else None
        positions, known = self._known(pattern, arguments)
        if not self._partly.worthwhile(pattern, view, positions):
            return self.demand.first(pattern, arguments)
        return None if known is None else self._partly.first(pattern, view, positions, known)

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Whether there is a match that agrees with the arguments."""
        view = self._current(pattern)
        if view is None:
            return self.demand.exists(pattern, arguments)
        if arguments.count(FREE) == len(arguments):
            self._check_number(pattern, arguments)
            return bool(view.rows)
        positions, known = self._known(pattern, arguments)
        return known is not None and self._partly.count(pattern, view, positions, known) > 0

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """The number of `rows`."""
        view = self._current(pattern)
        if view is None:
            return self.demand.count(pattern, arguments)
        if arguments.count(FREE) == len(arguments):
            self._check_number(pattern, arguments)
            return len(view.rows)
        positions, known = self._known(pattern, arguments)
        return 0 if known is None else self._partly.count(pattern, view, positions, known)

    def _known(self, pattern: str, arguments: tuple[object, ...]) -> tuple[tuple[int, ...], Any]:
        """The positions with a value, and what rows with these are filed under; None if an object is gone."""
        types = self.library.parameter_types(pattern)
        checked = check_arguments(self.model, self.library, pattern, types, arguments)
        positions = tuple([place for place, value in enumerate(arguments) if value is not FREE])
        return positions, None if checked is None else key_of(positions)(checked)

    def _check_number(self, pattern: str, arguments: tuple[object, ...]) -> None:
        size = len(self.library.parameter_types(pattern))
        if len(arguments) != size:
            raise InvalidArgument(f"pattern `{pattern}` has {size} parameters, not {len(arguments)}")

    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """`rows` for one set of bound positions; arguments are not checked, see `Matcher.prepare`."""
        search = self.demand.prepare(pattern, bound)
        if not bound:
            return lambda: (
                self._listed(pattern, search) if (view := self._current(pattern)) is None else view.rows[:]
            )
        if not self._partly.possible(pattern, bound):
            return search

        def rows(*values: Any) -> list[Row]:
            view = self._current(pattern)
            if view is None or not self._partly.worthwhile(pattern, view, bound):
                return search(*values)
            wanted = values if len(values) > 1 else values[0]
            return list(self._partly.rows(pattern, view, bound, wanted))

        return rows

    def seeker(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """The rows of `prepare`; those of a view are there."""
        seek = self.demand.seeker(pattern, bound)
        if bound and not self._partly.possible(pattern, bound):
            return seek
        held = self.prepare(pattern, bound) if bound else self.lister(pattern)

        def rows(*values: Any) -> Iterator[Row]:
            if self._current(pattern) is not None:
                return iter(held(*values))
            if self.loops.depth and not bound:
                self.loops.sought(pattern)
            return seek(*values)

        return rows

    def _listed(self, pattern: str, search: Callable[[], list[Row]]) -> list[Row]:
        rows = search()
        if self.loops.depth:
            self.loops.listed(pattern, len(rows))
        return rows

    def lister(self, pattern: str) -> Callable[[], Sequence[Row]]:
        """All rows, as they are held if the pattern is watched."""
        search = self.demand.lister(pattern)

        def rows() -> Sequence[Row]:
            view = self._current(pattern)
            return self._listed(pattern, search) if view is None else view.rows

        return rows

    def tester(self, pattern: str) -> Callable[[Row], bool]:
        """Whether a row is a match; a watched pattern only has to be looked up."""
        search = self.demand.tester(pattern)

        def test(row: Row) -> bool:
            view = self._current(pattern)
            return search(row) if view is None else row in view.rows.position

        return test

    def explain(self, pattern: str, bound: tuple[int, ...] = (), values: Sequence[Any] = ()) -> str:
        """How matches are found, see `CompiledMatcher.explain`; of a watched pattern, how they are kept current."""
        if not bound and self._current(pattern) is not None:
            return self._network.explain(pattern, self.demand.build)
        return self.demand.explain(pattern, bound, values)

    def why_not(self, pattern: str, given: Mapping[int, Value]) -> WhyNot:
        """Why there is no match for values at some positions: see `WhyNot`."""
        return self.demand.why_not(pattern, given)

    def analyze(self) -> None:
        """Measure the model, for plans that are made from now on: see `CompiledMatcher.analyze`."""
        self.demand.analyze()
        self._partly.forget()
        if self._views and self.model.idle and self._up_to_date():
            self._rebuild(self._views)

    def check_integrity(self) -> None:
        """Assert that every view in use holds what a new computation finds; for tests."""
        if not self._up_to_date():
            return
        self._network.check()
        for pattern, view in self._views.items():
            view.check(self.demand.rows(pattern, (FREE,) * len(self.library.parameter_types(pattern))))


def net_changes(rows: MatchSet) -> tuple[list[Row], list[Row]]:
    """What has come to a view and what has gone, in the order in which listeners are told."""
    appeared, disappeared = net(rows.log or ())
    return sorted(appeared, key=rows.position.__getitem__), sorted(disappeared)
