"""Notification of listeners about changed matches, and firing of event rules."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Final, cast

from envgraph.errors import InvalidArgument
from envgraph.graph import guarded_contextmanager
from envgraph.match import Subscription, ViewMatcher
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.events._agenda import Agenda, ConflictSet
from envgraph.rewrite.events._event_rules import EventRule, update_key
from envgraph.rewrite.events._jobs import Event, Job, bind_job, job_name
from envgraph.rewrite.events._listeners import (
    Listener,
    UpdateListener,
    check_listeners,
    match_listener,
    update_listener,
)

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

NO_CONTEXT: Final[AbstractContextManager[None]] = nullcontext()
"""A context manager that does nothing."""


class EngineEvents:
    """The listeners and event rules of an engine; both watch patterns."""

    def __init__(self, catalog: Catalog, engine: Engine) -> None:
        self._catalog = catalog
        self._model = catalog.model
        self._engine = engine
        self._conflicts: ConflictSet | None = None

    def listen(
        self,
        name: str,
        changed: Listener,
        restored: Listener | None = None,
        *,
        updated: UpdateListener | None = None,
        key: Iterable[str] | None = None,
    ) -> Subscription:
        """Register a listener for the net changes of the matches of a pattern, which is watched from now on.

        Listeners are notified at the end of the outermost transaction (`apply` and `run` are transactions), at a
        commit, and by `settle`. They are not notified of changes that were rolled back.

        Args:
            name: name of the pattern or rule.
            changed: called with the matches that appeared and the matches that disappeared since its last call.
            restored: called, in place of the other functions, with the changes of a checkout. If it is None, the other
                functions are called.
            updated: called first, with pairs of a disappeared match and the new match with the same key. `changed` is
                called with the other matches, if there are any.
            key: variables of the key, as for `on`.

        Returns:
            A subscription, for `unlisten`.

        Raises:
            InvalidArgument, TransactionError: as `watch`. Also if `key` is given without `updated`, or is no valid key.
        """
        shape, pattern, _ = self._catalog.query_target(name)
        check_listeners(changed, *(one for one in (restored, updated) if one is not None))
        if updated is not None:
            places = update_key(self._catalog.library.get(pattern), shape, key)
            call = update_listener(self._model, shape, changed, updated, places)
        elif key is None:
            call = match_listener(self._model, shape, changed)
        else:
            raise InvalidArgument("`key` has no effect without `updated`: also pass a function as `updated`")
        later = None if restored is None else match_listener(self._model, shape, restored)
        return self._catalog.view_matcher.listen(pattern, call, later)

    def unlisten(self, subscription: Subscription) -> None:
        """Remove a listener.

        Raises:
            InvalidArgument: the argument was not returned by `listen`.
        """
        if not isinstance(subscription, Subscription):
            raise InvalidArgument(f"expected a subscription that `listen` returned, not {subscription!r}")
        self._catalog.view_matcher.listeners.remove(subscription)

    def settle(self) -> None:
        """Notify listeners of all changes since their last notification, and fire event rules until none is pending.

        Raises:
            EvaluationError: event rules exceed `step_limit`.
            Exception: raised by a job of an event rule.
        """
        if isinstance(self._catalog.matcher, ViewMatcher):
            self._catalog.matcher.listeners.deliver()
        self.run_event_rules()

    @property
    def has_event_rules(self) -> bool:
        """Return True if an event rule was ever registered."""
        return self._conflicts is not None

    def run_event_rules(self) -> None:
        """Fire pending event rules. Exceptions are raised as in `settle`."""
        if self._conflicts is not None:
            self._conflicts.fire_pending()

    def on(
        self,
        pattern: str,
        *,
        appear: Job | None = None,
        disappear: Job | None = None,
        update: Job | None = None,
        priority: int = 0,
        name: str | None = None,
        key: Iterable[str] | None = None,
        existing: bool = True,
    ) -> EventRule:
        """Register an event rule: jobs to execute when matches of a pattern appear, disappear or are updated.

        A job is a function or a name. A function takes variables of the match by name, as `Node`s or values. It also
        gets `engine`, `match` and (for an update) `old`, the match before, if it has such parameters. A name is that
        of a rule, group or unit; its variables are bound to the variables of the match with the same names.

        The pattern is watched from now on. Jobs are executed at the end of the outermost transaction, at a commit and
        by `settle`, each in its own transaction, until none is pending. `_event_rules` describes the order, and when
        a job is dropped.

        Args:
            pattern: name of the pattern.
            appear: executed for a new match.
            disappear: executed for a match that disappeared. The nodes of deleted objects have only an `id`.
            update: executed in place of both, if a match is replaced by another one with the same key.
            priority: rules with higher priorities are executed first.
            name: name for messages; by default the name of the first job.
            key: variables that identify a match; by default those after `forEach` in `@FunctionalDependency`, or else
                the variables that are bound to objects.
            existing: if True, current matches count as new: `appear` is executed for them at the next settling.

        Raises:
            InvalidArgument: an unknown name, no job, a job with unsuitable parameters, a pattern that cannot be
                watched, or an `update` job whose key contains all variables.
            TransactionError: as `watch`.
        """
        views = self._catalog.view_matcher
        shape, qualified, _ = self._catalog.query_target(pattern)
        given = {"appear": appear, "disappear": disappear, "update": update}
        jobs = [(cast("Event", event), job) for event, job in given.items() if job is not None]
        if not jobs:
            raise InvalidArgument("an event rule needs a job: pass `appear`, `disappear` or `update`")
        bound = {event: bind_job(self._engine, shape, event, job) for event, job in jobs}
        places = (
            update_key(self._catalog.library.get(qualified), shape, key)
            if update is not None or key is not None
            else ()
        )
        conflicts = self._conflicts or ConflictSet(self._engine, views)
        calls = [self._catalog.signature(job).name for _, job in jobs if isinstance(job, str)]
        rule = EventRule(conflicts, name or job_name(jobs[0][1]), shape, bound, priority, places, calls)
        conflicts.add_rule(rule, qualified, existing)
        self._conflicts = conflicts
        return rule

    @property
    def agenda(self) -> Agenda:
        """Return the pending activations of event rules, in the order of firing."""
        return Agenda(self._conflicts)

    def describe_users(self, names: Collection[str]) -> Iterator[str]:
        """Yield texts that name the event rules and listeners which use one of the definitions."""
        owner, matcher = self._catalog.owner_function(), self._catalog.matcher
        for rule in () if self._conflicts is None else self._conflicts.rules:
            if any(owner(name) in names for name in rule.calls):
                yield f"event rule `{rule.name}`"
        heard = matcher.listeners.patterns if isinstance(matcher, ViewMatcher) else ()
        yield from (f"a listener of `{name}`" for name in heard if owner(name) in names)

    def delayed(self) -> AbstractContextManager[None] | None:
        """Return a context manager that delays firings and notifications; None without event rules and listeners."""
        if self._conflicts is not None:
            return self._conflicts.delayed()
        matcher = self._catalog.matcher
        if isinstance(matcher, ViewMatcher) and matcher.listeners:
            return self._notifying_at_end(matcher)
        return None

    @guarded_contextmanager
    def _notifying_at_end(self, matcher: ViewMatcher) -> Iterator[None]:
        """Notify the listeners at the end of the block, if no transaction is open. A transaction would do so itself."""
        yield
        if not self._model.graph.history.savepoint_depth:
            matcher.listeners.deliver()

    def muted(self) -> AbstractContextManager[None]:
        """Return a context manager in which changes do not activate event rules."""
        return NO_CONTEXT if self._conflicts is None else self._conflicts.muted()

    @guarded_contextmanager
    def asleep(self) -> Iterator[None]:
        """Hide the changes inside the block, which must restore the model, from listeners and event rules."""
        matcher = self._catalog.matcher
        views = matcher.listeners.suppress_notifications() if isinstance(matcher, ViewMatcher) else NO_CONTEXT
        with views, NO_CONTEXT if self._conflicts is None else self._conflicts.hidden():
            yield
