"""The conflict set: the pending activations of event rules in their order of firing, and the firing itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
from itertools import count, islice
from typing import TYPE_CHECKING, overload

from envgraph.code import shorten_repr
from envgraph.draw import html_text
from envgraph.errors import SHOWN, EvaluationError
from envgraph.graph import Follower, guarded_contextmanager
from envgraph.match import ViewMatcher
from envgraph.rewrite._matches import Row
from envgraph.rewrite.events._event_rules import Activation, EventRule

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine


class ConflictSet(Follower):
    """The event rules of an engine and their conflict set. It follows the model, and is notified after the matcher.

    It ignores savepoints and commits, because activations fire only when the outermost transaction ends; rollbacks,
    because rolled back changes have never reached the conflict set; interruptions, because the matcher repairs its
    matches itself; and loads, whose net change arrives with the next notification.

    Invariant: the conflict set is a heap in the order of firing. Activations with `live` False remain in the heap but
    do not belong to the conflict set.
    """

    def __init__(self, engine: Engine, matcher: ViewMatcher) -> None:
        self.engine = engine
        self._matcher = matcher
        self._rules: dict[EventRule, int] = {}
        self._registered = count()
        self._arrived = count()
        self._heap: list[tuple[int, int, int, Activation]] = []
        self._delay_depth = 0
        self._is_firing = False
        self._is_muted = False
        self._is_hidden = False

    # --- rules

    @property
    def rules(self) -> tuple[EventRule, ...]:
        """Return the event rules that are not cancelled."""
        return tuple(self._rules)

    def add_rule(self, rule: EventRule, pattern: str, existing: bool) -> None:
        """Add an event rule and watch its pattern. If `existing`, activate the rule for the current matches.

        Raises:
            InvalidArgument, TransactionError: as `Engine.watch`.
        """

        def on_change(appeared: list[Row], disappeared: list[Row]) -> None:
            if not self._is_muted:
                rule.on_change(appeared, disappeared)

        rule.subscription = self._matcher.listen(pattern, on_change, _ignore_checkout)
        self._rules[rule] = next(self._registered)
        followers = self.engine.model.graph.store.followers
        if not any(follower is self for follower in followers):
            followers.append(self)
        if existing:
            for row in self._matcher.prepare(pattern, ())():
                rule.on_appear(row)

    def remove_rule(self, rule: EventRule) -> None:
        """Remove an event rule, which is notified no more. Do nothing if it is removed already."""
        if rule.subscription is None:
            return
        self._matcher.listeners.remove(rule.subscription)
        rule.subscription = None
        del self._rules[rule]
        if not self._rules:
            followers = self.engine.model.graph.store.followers
            followers[:] = [follower for follower in followers if follower is not self]

    # --- the conflict set

    def add_activation(self, activation: Activation) -> None:
        """Add an activation to the conflict set."""
        rule = activation.rule
        heappush(self._heap, (-rule.priority, self._rules[rule], next(self._arrived), activation))

    def pending_activations(self) -> Iterator[Activation]:
        """Return the activations of the conflict set, in the order of firing."""
        return (entry[-1] for entry in sorted(self._heap) if entry[-1].live)

    def _pop_live(self) -> Activation | None:
        while self._heap:
            activation = heappop(self._heap)[-1]
            if activation.live:
                return activation
        return None

    def drop_activations(self) -> None:
        """Drop all activations of the conflict set."""
        for rule in self._rules:
            rule.drop_all()
        self._heap.clear()

    def fire_pending(self) -> None:
        """Notify listeners and fire activations until none is pending.

        Do nothing while activations are firing or delayed (`delayed`), or inside a transaction or notification.

        Raises:
            EvaluationError: more firings than the step limit of the engine.
            Exception: raised by a job.
        """
        if (
            self._is_firing
            or self._delay_depth
            or self._matcher.listeners.is_notifying
            or self.engine.model.graph.history.savepoint_depth
        ):
            return
        self._is_firing = True
        try:
            self._fire_all()
        finally:
            self._is_firing = False

    def _fire_all(self) -> None:
        limit = self.engine.step_limit
        last: list[str] = []
        for fired in count():
            self._matcher.listeners.deliver()
            if fired == limit and any(True for _ in self.pending_activations()):
                names = ", ".join(f"`{name}`" for name in dict.fromkeys(last))
                message = f"event rules do not terminate: {limit} firings, the last ones of {names}"
                hint = "make each job remove the match that triggers it, or set `step_limit` of the engine"
                raise EvaluationError(message, hint=hint)
            activation = self._pop_live()
            if activation is None:
                return
            if fired >= limit - SHOWN.firings:
                last.append(activation.rule.name)
            self._fire(activation)

    def _fire(self, activation: Activation) -> None:
        rule = activation.rule
        rule.drop_activation(activation)
        try:
            with self.engine.transaction():
                rule.jobs[activation.event](activation.match, activation.old)
        except BaseException as error:
            rule.on_failure(activation)
            error.add_note(f"raised by event rule `{rule.name}`, {activation!r}")
            raise

    @guarded_contextmanager
    def delayed(self) -> Iterator[None]:
        """Delay all firings to the end of the block. After an exception nothing is fired."""
        self._delay_depth += 1
        try:
            yield
        finally:
            self._delay_depth -= 1
        self.fire_pending()

    @guarded_contextmanager
    def muted(self) -> Iterator[None]:
        """Fire pending activations, then ignore changes inside the block, and empty the conflict set at its end."""
        self.fire_pending()
        self._is_muted = True
        try:
            yield
        finally:
            self._is_muted = False
            self.drop_activations()

    @guarded_contextmanager
    def hidden(self) -> Iterator[None]:
        """Fire nothing inside the block, which must restore the state of the model, and keep the conflict set."""
        self._delay_depth += 1
        self._is_hidden = True
        try:
            yield
        finally:
            self._is_hidden = False
            self._delay_depth -= 1

    # --- Follower

    def on_release(self) -> None:
        """Fire pending activations after the outermost transaction or a commit, but not inside `muted`."""
        if not self._is_muted:
            self.fire_pending()

    def on_checkout(self) -> None:
        """Empty the conflict set, as the model was set to another version. Do nothing inside `hidden`."""
        if not self._is_hidden:
            self.drop_activations()


def _ignore_checkout(appeared: list[Row], disappeared: list[Row]) -> None:
    """Do nothing: changes of matches by a checkout activate no event rules."""


@shorten_repr
class Agenda(Sequence[Activation]):
    """A live, read-only view of the conflict set of an engine: pending activations of event rules in firing order.

    Outside of jobs the agenda is empty, unless a job has raised an exception, a rule is new, or a transaction is open.
    """

    __slots__ = ("_conflicts",)

    def __init__(self, conflicts: ConflictSet | None) -> None:
        self._conflicts = conflicts

    def _activations(self) -> list[Activation]:
        return [] if self._conflicts is None else list(self._conflicts.pending_activations())

    def __len__(self) -> int:
        return len(self._activations())

    @overload
    def __getitem__(self, index: int) -> Activation: ...
    @overload
    def __getitem__(self, index: slice) -> list[Activation]: ...
    def __getitem__(self, index: int | slice) -> Activation | list[Activation]:
        return self._activations()[index]

    def __repr__(self) -> str:
        return f"<agenda: {len(self._activations())} to fire>"

    _repr_html_ = html_text

    def __str__(self) -> str:
        """Return the number of activations, and the first twenty, one per line."""
        found = self._activations()
        lines = [
            f"<agenda: {len(found)} to fire>",
            *(f"  {activation!r}" for activation in islice(found, 20)),
        ]
        return "\n".join([*lines, f"  and {len(found) - 20} more"] if len(found) > 20 else lines)
