"""The conflict set: the pending activations of event rules in their order of firing, and the firing itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
from itertools import count, islice
from typing import TYPE_CHECKING, overload

from envgraph.code import short_repr
from envgraph.errors import SHOWN, EvaluationError
from envgraph.graph import guarded
from envgraph.match import ViewMatcher
from envgraph.rewrite._match import Row
from envgraph.rewrite.events._event_rules import Activation, EventRule

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine


class ConflictSet:
    """The event rules of an engine and their conflict set. A `Follower` of the model, notified after the matcher.

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
        self._held = 0
        self._firing = False
        self._muted = False
        self._asleep = False

    # --- rules

    @property
    def rules(self) -> tuple[EventRule, ...]:
        """Return the event rules that are not cancelled."""
        return tuple(self._rules)

    def add(self, rule: EventRule, pattern: str, existing: bool) -> None:
        """Add an event rule and watch its pattern. If `existing`, activate the rule for the current matches.

        Raises:
            InvalidArgument, TransactionError: as `Engine.watch`.
        """

        def changed(appeared: list[Row], disappeared: list[Row]) -> None:
            if not self._muted:
                rule.changed(appeared, disappeared)

        rule.subscription = self._matcher.listen(pattern, changed, _nothing)
        self._rules[rule] = next(self._registered)
        followers = self.engine.model.graph.store.followers
        if not any(follower is self for follower in followers):
            followers.append(self)
        if existing:
            for row in self._matcher.prepare(pattern, ())():
                rule.came(row)

    def remove(self, rule: EventRule) -> None:
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

    def push(self, activation: Activation) -> None:
        """Add an activation to the conflict set."""
        rule = activation.rule
        heappush(self._heap, (-rule.priority, self._rules[rule], next(self._arrived), activation))

    def pending(self) -> Iterator[Activation]:
        """Return the activations of the conflict set, in the order of firing."""
        return (entry[-1] for entry in sorted(self._heap) if entry[-1].live)

    def _next(self) -> Activation | None:
        while self._heap:
            activation = heappop(self._heap)[-1]
            if activation.live:
                return activation
        return None

    def clear(self) -> None:
        """Drop all activations of the conflict set."""
        for rule in self._rules:
            rule.clear()
        self._heap.clear()

    def run(self) -> None:
        """Notify listeners and fire activations until none is pending.

        Do nothing while activations are firing or delayed (`held`), or inside a transaction or notification.

        Raises:
            EvaluationError: more firings than the step limit of the engine.
            Exception: raised by a job.
        """
        if (
            self._firing
            or self._held
            or self._matcher.listeners.notifying
            or self.engine.model.graph.history.depth
        ):
            return
        self._firing = True
        try:
            self._fire_all()
        finally:
            self._firing = False

    def _fire_all(self) -> None:
        limit = self.engine.step_limit
        last: list[str] = []
        for fired in count():
            self._matcher.listeners.deliver()
            if fired == limit and any(True for _ in self.pending()):
                names = ", ".join(f"`{name}`" for name in dict.fromkeys(last))
                message = f"event rules do not terminate: {limit} firings, the last ones of {names}"
                hint = "make each job remove the match that triggers it, or set `step_limit` of the engine"
                raise EvaluationError(message, hint=hint)
            activation = self._next()
            if activation is None:
                return
            if fired >= limit - SHOWN.firings:
                last.append(activation.rule.name)
            self._fire(activation)

    def _fire(self, activation: Activation) -> None:
        rule = activation.rule
        rule.take(activation)
        try:
            with self.engine.transaction():
                rule.jobs[activation.event](activation.match, activation.old)
        except BaseException as error:
            rule.failed(activation)
            error.add_note(f"raised by event rule `{rule.name}`, {activation!r}")
            raise

    @guarded
    def held(self) -> Iterator[None]:
        """Delay all firings to the end of the block. After an exception nothing is fired."""
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
        self.run()

    @guarded
    def muted(self) -> Iterator[None]:
        """Fire pending activations, then ignore changes inside the block, and empty the conflict set at its end."""
        self.run()
        self._muted = True
        try:
            yield
        finally:
            self._muted = False
            self.clear()

    @guarded
    def asleep(self) -> Iterator[None]:
        """Fire nothing inside the block, which must restore the state of the model, and keep the conflict set."""
        self._held += 1
        self._asleep = True
        try:
            yield
        finally:
            self._asleep = False
            self._held -= 1

    # --- Follower

    def settle(self) -> None:
        """Do nothing before a savepoint or commit: activations fire only when the outermost transaction ends."""

    def released(self) -> None:
        """Fire pending activations after the outermost transaction or a commit, but not inside `muted`."""
        if not self._muted:
            self.run()

    def checked_out(self) -> None:
        """Empty the conflict set, as the model was set to another version. Do nothing inside `asleep`."""
        if not self._asleep:
            self.clear()

    def rolled_back(self) -> None:
        """Do nothing: rolled back changes have never reached the conflict set."""

    def interrupted(self) -> None:
        """Do nothing: the matcher repairs its matches itself."""

    def suspend(self) -> None:
        """Do nothing before a model is loaded."""

    def loaded(self) -> None:
        """Do nothing after a model was loaded: its net change arrives with the next notification."""


def _nothing(appeared: list[Row], disappeared: list[Row]) -> None:
    """Do nothing: changes of matches by a checkout activate no event rules."""


@short_repr
class Agenda(Sequence[Activation]):
    """A live, read-only view of the conflict set of an engine: pending activations of event rules in firing order.

    Outside of jobs the agenda is empty, unless a job has raised an exception, a rule is new, or a transaction is open.
    """

    __slots__ = ("_conflicts",)

    def __init__(self, conflicts: ConflictSet | None) -> None:
        self._conflicts = conflicts

    def _list(self) -> list[Activation]:
        return [] if self._conflicts is None else list(self._conflicts.pending())

    def __len__(self) -> int:
        return len(self._list())

    @overload
    def __getitem__(self, index: int) -> Activation: ...
    @overload
    def __getitem__(self, index: slice) -> list[Activation]: ...
    def __getitem__(self, index: int | slice) -> Activation | list[Activation]:
        return self._list()[index]

    def __repr__(self) -> str:
        return f"<agenda: {len(self._list())} to fire>"

    def __str__(self) -> str:
        """Return the number of activations, and the first twenty, one per line."""
        found = self._list()
        lines = [
            f"<agenda: {len(found)} to fire>",
            *(f"  {activation!r}" for activation in islice(found, 20)),
        ]
        return "\n".join([*lines, f"  and {len(found) - 20} more"] if len(found) > 20 else lines)
