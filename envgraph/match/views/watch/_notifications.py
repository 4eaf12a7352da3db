"""Notify subscribers of the changes of watched patterns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from envgraph.errors import LIMITS, EvaluationError
from envgraph.graph import guarded_contextmanager
from envgraph.match._match_costs import VIEWS
from envgraph.match._matcher import Row
from envgraph.match.views.operators._row_set import MatchSet, RowLog, net_rows

if TYPE_CHECKING:
    from envgraph.match.views.watch._watched_views import WatchedViews

Change = Callable[[list[Row], list[Row]], object]
"""A subscriber's callback. Arguments: the inserted matches and the deleted matches."""


class BoundedLog(RowLog):
    """A log of row changes that is shortened when it has doubled, since edits outside of transactions have no limit."""

    __slots__ = ("_most",)

    def __init__(self) -> None:
        super().__init__()
        self._most = 2 * VIEWS.long_log

    def extend(self, parts: Iterable[Any]) -> None:
        """Append entries: a row, then True if it was inserted, else False. First shorten the log if it has doubled."""
        if len(self) > self._most:  # first, since an interruption leaves only the last entry in doubt
            self.shorten()
            self._most = 2 * (len(self) + VIEWS.long_log)
        super().extend(parts)


class Subscription:
    """A subscription to the changes of a pattern; created by `ViewMatcher.listen`."""

    __slots__ = ("changed", "pattern", "restored")

    def __init__(self, pattern: str, changed: Change, restored: Change) -> None:
        self.pattern = pattern
        self.changed = changed
        self.restored = restored


class Listeners:
    """The subscriptions to net changes of watched patterns; `bool()` is True if there are any.

    Subscribers are notified at the end of the outermost transaction, at a commit, after a checkout, and by `deliver`.
    Changes that were rolled back are not reported. Inserted matches have the order of the view, deleted matches
    ascending order.

    Attributes:
        subscriptions: in the order of notification.
        is_notifying: True while callbacks run. Their changes are reported in a further round.
    """

    def __init__(self, kept: WatchedViews) -> None:
        self._kept = kept
        self.subscriptions: list[Subscription] = []
        self._news: list[tuple[int, Change, list[Row], list[Row]]] = []
        self.is_notifying = False

    def __bool__(self) -> bool:
        return bool(self.subscriptions)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Return the names of the subscribed patterns, each once."""
        return tuple(dict.fromkeys(each.pattern for each in self.subscriptions))

    def add(self, subscription: Subscription) -> Subscription:
        """Add and return a subscription to a watched pattern. Earlier changes are reported to other subscribers."""
        self._kept.update_views()  # changes before the subscription are not reported
        rows = self._kept.views[subscription.pattern].rows
        if rows.log is None:
            rows.log = BoundedLog()
        elif rows.log:
            self.deliver()
        self.subscriptions.append(subscription)
        return subscription

    def remove(self, subscription: Subscription) -> None:
        """Remove a subscription, and pending changes that no other needs. Do nothing if it is already removed."""
        self.subscriptions = [each for each in self.subscriptions if each is not subscription]
        if not any(each.pattern == subscription.pattern for each in self.subscriptions):
            view = self._kept.views.get(subscription.pattern)
            if view is not None:
                view.rows.log = None

    def deliver(self) -> None:
        """Update the views, and notify the subscribers of the net changes since the last notification.

        If callbacks raise exceptions, the first one is raised after all callbacks have run; a `KeyboardInterrupt` has
        priority. Do nothing if the views cannot be updated.
        """
        if self._kept.update_views():
            if not self.is_notifying:
                self._kept.replan_if_outgrown()  # not inside callbacks: their rows have the present order
            self.notify_in_rounds(after_checkout=False)

    def notify_in_rounds(self, after_checkout: bool) -> None:
        """Notify subscribers in rounds until no change is left. Do nothing while callbacks run.

        If `after_checkout`, the first round follows a checkout. Raise an `EvaluationError` if rounds find changes again
        and again.
        """
        if self.is_notifying:
            return
        self.is_notifying = True
        try:
            for _ in range(LIMITS["rounds of callbacks"]):
                changing = self._collect_changes(after_checkout)
                if not self._news:
                    return
                self._run_callbacks()
                after_checkout = False
                if not self._kept.update_views():
                    return
            raise EvaluationError(
                f"callbacks of {', '.join(f'`{name}`' for name in changing)} change the model at every notification: "
                "a callback must stop changing the pattern that it listens to"
            )
        finally:
            self.is_notifying = False

    def _run_callbacks(self) -> None:
        """Run and remove the collected callbacks. Raise the first exception after all callbacks have run."""
        first: BaseException | None = None
        while self._news:
            _, call, appeared, disappeared = self._news[0]
            try:
                call(appeared, disappeared)
            except BaseException as problem:  # Ctrl-C, too: the other callbacks must still run
                if first is None or isinstance(first, Exception) > isinstance(problem, Exception):
                    first = problem
            finally:
                del self._news[0]
        if first is not None:
            raise first

    def _collect_changes(self, after_checkout: bool) -> list[str]:
        """Collect the callbacks to run with their net changes, and empty the logs. Return the changed patterns."""
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
                    (number, each.restored if after_checkout else each.changed, *change)
                    for number, each in enumerate(self.subscriptions)
                    if each.pattern == pattern
                ]
            log = BoundedLog()
            self._news, rows.log = news, log
        self._news.sort(key=itemgetter(0))
        return changed

    @guarded_contextmanager
    def suppress_notifications(self) -> Iterator[None]:
        """Do not record changes for subscribers in a `with` block, which must end in the state in which it starts."""
        self._kept.process_pending()
        logs = {pattern: view.rows.log for pattern, view in self._kept.views.items()}
        try:
            for view in self._kept.views.values():
                view.rows.log = None
            yield
        finally:
            for pattern, log in logs.items():
                self._kept.views[pattern].rows.log = log


def net_changes(rows: MatchSet) -> tuple[list[Row], list[Row]]:
    """Return the inserted rows of a view in the view's order, and the deleted rows in ascending order."""
    appeared, disappeared = net_rows(rows.log or ())
    return sorted(appeared, key=rows.position.__getitem__), sorted(disappeared)
