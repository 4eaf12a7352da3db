"""Notification: listeners hear of changes of matches, and event rules fire."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Final, cast

from envgraph.errors import InvalidArgument
from envgraph.graph import guarded
from envgraph.match import Subscription, ViewMatcher
from envgraph.rewrite.engine._catalog import Catalog
from envgraph.rewrite.events._agenda import Agenda, ConflictSet
from envgraph.rewrite.events._event_rules import EventRule, update_key
from envgraph.rewrite.events._jobs import Event, Job, bind_job, job_name
from envgraph.rewrite.events._listening import (
    Listener,
    UpdateListener,
    check_functions,
    match_listener,
    update_listener,
)

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

NOTHING: Final[AbstractContextManager[None]] = nullcontext()
"""A block like any other."""


class Events:
    """The listeners and the event rules of an engine; both watch patterns."""

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
        """Be notified of the net changes of the matches of a pattern, which is watched from now on.

        This happens at the end of the outermost transaction (`apply` and `run` are transactions), at a commit, and by
        `settle`; nobody is notified of changes that were rolled back.

        Args:
            name: of the pattern or rule.
            changed: called with the matches that have appeared, and those that have disappeared, since it was last
                called.
            restored: called instead with what a checkout has changed; else the others are called.
            updated: called first with the matches that were replaced by one with the same key, each with the one that
                is there now. `changed` is called with the rest, if there is any.
            key: variables, as for `on`.

        Returns:
            For `unlisten`.

        Raises:
            InvalidArgument, TransactionError: as `watch`; `key` without `updated`, and an impossible key.
        """
        shape, pattern, _ = self._catalog.asked(name)
        check_functions(changed, *(one for one in (restored, updated) if one is not None))
        if updated is not None:
            places = update_key(self._catalog.library.get(pattern), shape, key)
            call = update_listener(self._model, shape, changed, updated, places)
        elif key is None:
            call = match_listener(self._model, shape, changed)
        else:
            raise InvalidArgument("`key` says which matches are `updated`: give a function for these")
        later = None if restored is None else match_listener(self._model, shape, restored)
        return self._catalog.views.listen(pattern, call, later)

    def unlisten(self, subscription: Subscription) -> None:
        """Take back a `listen`.

        Raises:
            InvalidArgument: that is nothing that `listen` gave.
        """
        if not isinstance(subscription, Subscription):
            raise InvalidArgument(f"{subscription!r} is nothing that `listen` gave")
        self._catalog.views.listeners.remove(subscription)

    def settle(self) -> None:
        """Notify listeners now of what has changed since the last time, and let event rules fire what is pending.

        Raises:
            EvaluationError: event rules go round; see `step_limit`.
            Exception: what the job of an event rule has raised.
        """
        if isinstance(self._catalog.matcher, ViewMatcher):
            self._catalog.matcher.listeners.deliver()
        self.run()

    @property
    def active(self) -> bool:
        """Whether there have been event rules."""
        return self._conflicts is not None

    def run(self) -> None:
        """Let event rules fire what is pending; raises as `settle`."""
        if self._conflicts is not None:
            self._conflicts.run()

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
        """Do something whenever matches of a pattern appear, disappear or are updated; it is watched from now on.

        A job is a function, which takes variables of the match by name, as `Node`s or values, and `engine`, `match`
        and (for an update) `old`, the match before, if it has such parameters; or the name of a rule, group or unit,
        whose variables are bound to those of the match that have the same names.

        Jobs are done when the outermost transaction ends, at a commit, and when asked to `settle`, each in a
        transaction of its own, until nothing is left to do. `_events` tells the order, and when a job is dropped.

        Args:
            pattern: its name.
            appear: done at a new match.
            disappear: done at a match that is gone. Its objects may be gone too: the node of one has only its `id`.
            update: done instead of both where a match is replaced by another one with the same key.
            priority: higher ones are done first.
            name: for messages; else that of the first job.
            key: variables; else those after `forEach` in `@FunctionalDependency`, else those that stand for objects.
            existing: the present matches count as new: `appear` is done for them when the engine next settles.

        Raises:
            InvalidArgument: an unknown name, no job, a job that takes something else, a key that contains all variables
                where there is an `update`; a pattern that cannot be watched.
            TransactionError: as `watch`.
        """
        views = self._catalog.views
        shape, qualified, _ = self._catalog.asked(pattern)
        given = {"appear": appear, "disappear": disappear, "update": update}
        jobs = [(cast("Event", event), job) for event, job in given.items() if job is not None]
        if not jobs:
            raise InvalidArgument("an event rule does something: give `appear`, `disappear` or `update`")
        bound = {event: bind_job(self._engine, shape, event, job) for event, job in jobs}
        places = (
            update_key(self._catalog.library.get(qualified), shape, key)
            if update is not None or key is not None
            else ()
        )
        conflicts = self._conflicts or ConflictSet(self._engine, views)
        calls = [self._catalog.signature(job).name for _, job in jobs if isinstance(job, str)]
        rule = EventRule(conflicts, name or job_name(jobs[0][1]), shape, bound, priority, places, calls)
        conflicts.add(rule, qualified, existing)
        self._conflicts = conflicts
        return rule

    @property
    def agenda(self) -> Agenda:
        """What event rules are about to do, in that order."""
        return Agenda(self._conflicts)

    def users(self, names: Collection[str]) -> Iterator[str]:
        """Event rules and listeners of definitions, in words."""
        owner, matcher = self._catalog.owners(), self._catalog.matcher
        for rule in () if self._conflicts is None else self._conflicts.rules:
            if any(owner(name) in names for name in rule.calls):
                yield f"event rule `{rule.name}`"
        heard = matcher.listeners.patterns if isinstance(matcher, ViewMatcher) else ()
        yield from (f"a listener of `{name}`" for name in heard if owner(name) in names)

    def holding(self) -> AbstractContextManager[None] | None:
        """Fire event rules and notify listeners at the end of the block, not inside it; None if there are none."""
        if self._conflicts is not None:
            return self._conflicts.held()
        matcher = self._catalog.matcher
        if isinstance(matcher, ViewMatcher) and matcher.listeners:
            return self._telling(matcher)
        return None

    @guarded
    def _telling(self, matcher: ViewMatcher) -> Iterator[None]:
        """Listeners are notified at the end: by the model if there was a transaction, but many rules need none."""
        yield
        if not self._model.graph.history.depth:
            matcher.listeners.deliver()

    def muted(self) -> AbstractContextManager[None]:
        """Let changes inside the block activate no event rule."""
        return NOTHING if self._conflicts is None else self._conflicts.muted()

    @guarded
    def asleep(self) -> Iterator[None]:
        """Listeners and event rules do not notice the block, which leaves the model as it was."""
        matcher = self._catalog.matcher
        views = matcher.listeners.muted() if isinstance(matcher, ViewMatcher) else NOTHING
        with views, NOTHING if self._conflicts is None else self._conflicts.asleep():
            yield
