"""Notification of the changes of watched patterns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import EvaluationError
from envgraph.graph import guarded
from envgraph.match._matcher import Row
from envgraph.match.views.operators._sets import LONG, Log, MatchSet, net

if TYPE_CHECKING:
    from envgraph.match.views.watch._kept import KeptViews

Change = Callable[[list[Row], list[Row]], object]
"""Called with the rows that have appeared, and those that have disappeared."""


MOST_ROUNDS: Final = 1_000
"""How often listeners may change the model again when they are notified of a change."""


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


class Listeners:
    """Those who are notified of the net changes of watched patterns; true if there are any.

    Listeners are notified at the end of the outermost transaction, at a commit, and by `deliver`, but of nothing
    that was rolled back. The rows that have appeared are in the order of the view, those that have disappeared in
    ascending order.

    Attributes:
        subscriptions: in the order in which they are notified.
        notifying: whether they are being notified: of what they change they are notified after that.
    """

    def __init__(self, kept: KeptViews) -> None:
        self._kept = kept
        self.subscriptions: list[Subscription] = []
        self._news: list[tuple[int, Change, list[Row], list[Row]]] = []
        self.notifying = False

    def __bool__(self) -> bool:
        return bool(self.subscriptions)

    @property
    def patterns(self) -> tuple[str, ...]:
        """The patterns that somebody listens to."""
        return tuple(dict.fromkeys(each.pattern for each in self.subscriptions))

    def add(self, subscription: Subscription) -> Subscription:
        """Tell somebody from now on; the pattern is watched."""
        self._kept.up_to_date()  # what is pending is no news
        rows = self._kept.views[subscription.pattern].rows
        if rows.log is None:
            rows.log = BoundedLog()
        elif rows.log:
            self.deliver()
        self.subscriptions.append(subscription)
        return subscription

    def remove(self, subscription: Subscription) -> None:
        """Stop notifying somebody; once is enough."""
        self.subscriptions = [each for each in self.subscriptions if each is not subscription]
        if not any(each.pattern == subscription.pattern for each in self.subscriptions):
            view = self._kept.views.get(subscription.pattern)
            if view is not None:
                view.rows.log = None

    def deliver(self) -> None:
        """Bring the views up to date and notify the listeners of what has changed since the last time.

        If listeners raise exceptions, the first is raised after all have been notified; a `KeyboardInterrupt` rather
        than others.
        """
        if self._kept.up_to_date():
            if not self.notifying:
                self._kept.plan_anew()  # not when a listener asks: it has been notified of rows in their order by then
            self.tell(restored=False)

    def tell(self, restored: bool) -> None:
        """Tell, until listeners have nothing more to hear; those that change the model are notified in turn."""
        if self.notifying:
            return
        self.notifying = True
        try:
            for _ in range(MOST_ROUNDS):
                changing = self._note(restored)
                if not self._news:
                    return
                self._notify_all()
                restored = False
                if not self._kept.up_to_date():
                    return
            raise EvaluationError(
                f"listeners of {', '.join(f'`{name}`' for name in changing)} change the model each time they are told"
            )
        finally:
            self.notifying = False

    def _notify_all(self) -> None:
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
        """Note who is to be notified of what, and empty the logs; returns the patterns that have changed."""
        views = self._kept.views
        for each in self.subscriptions:
            if views[each.pattern].rows.log:
                break
        else:
            return []
        changed: list[str] = []
        for pattern in self.patterns:
            rows = views[pattern].rows
            if not rows.log:
                continue
            news, change = list(self._news), net_changes(rows)
            if any(change):
                changed.append(pattern)
                news += [
                    (number, each.restored if restored else each.changed, *change)
                    for number, each in enumerate(self.subscriptions)
                    if each.pattern == pattern
                ]
            log = BoundedLog()
            self._news, rows.log = news, log
        self._news.sort(key=itemgetter(0))
        return changed

    @guarded
    def muted(self) -> Iterator[None]:
        """Notify nobody of what happens in the block; at its end the state must be that at its start."""
        self._kept.settle()
        logs = {pattern: view.rows.log for pattern, view in self._kept.views.items()}
        try:
            for view in self._kept.views.values():
                view.rows.log = None
            yield
        finally:
            for pattern, log in logs.items():
                self._kept.views[pattern].rows.log = log


def net_changes(rows: MatchSet) -> tuple[list[Row], list[Row]]:
    """Return the rows that were inserted into a view and deleted, in the order in which listeners are notified."""
    appeared, disappeared = net(rows.log or ())
    return sorted(appeared, key=rows.position.__getitem__), sorted(disappeared)
