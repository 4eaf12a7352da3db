"""The conflict set: what event rules are about to do, in the order of firing, and who fires it when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
from itertools import count, islice
from typing import TYPE_CHECKING, overload

from envgraph.code import short_repr
from envgraph.errors import EvaluationError
from envgraph.graph import guarded
from envgraph.match import ViewMatcher
from envgraph.rewrite._match import Row
from envgraph.rewrite.events._event_rules import Activation, EventRule

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

_ROUND = 20
"""So many of the last firings are named when event rules go round."""


class ConflictSet:
    """All event rules of an engine, and their conflict set. A `Follower` of the model, after the matcher.

    Invariant: the conflict set is a heap by the order of firing; activations that are not `live` are no longer part of
    it.
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
        """Those that are not cancelled."""
        return tuple(self._rules)

    def add(self, rule: EventRule, pattern: str, existing: bool) -> None:
        """Watch the pattern of a rule, and take in the matches that it has.

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
        """Forget a rule; once is enough."""
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
        """Add an activation."""
        rule = activation.rule
        heappush(self._heap, (-rule.priority, self._rules[rule], next(self._arrived), activation))

    def pending(self) -> Iterator[Activation]:
        """The conflict set, in the order of firing."""
        return (entry[-1] for entry in sorted(self._heap) if entry[-1].live)

    def _next(self) -> Activation | None:
        while self._heap:
            activation = heappop(self._heap)[-1]
            if activation.live:
                return activation
        return None

    def clear(self) -> None:
        """Empty the conflict set."""
        for rule in self._rules:
            rule.clear()
        self._heap.clear()

    def run(self) -> None:
        """Fire until nothing is left to fire; not while something is under way that will settle at its end.

        Raises:
            EvaluationError: more firings than the engine's step limit.
            Exception: what a job has raised.
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
                message = f"event rules do not come to rest: {limit} firings, the last ones of {names}"
                hint = "what a rule does must end what it waits for; else set `step_limit` of the engine"
                raise EvaluationError(message, hint=hint)
            activation = self._next()
            if activation is None:
                return
            if fired >= limit - _ROUND:
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
        """Fire nothing inside the block; settle at its end, if it ends well."""
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
        self.run()

    @guarded
    def muted(self) -> Iterator[None]:
        """Let changes inside the block activate nothing, and empty the conflict set."""
        self.run()
        self._muted = True
        try:
            yield
        finally:
            self._muted = False
            self.clear()

    @guarded
    def asleep(self) -> Iterator[None]:
        """Nothing fires inside the block, and what is pending stays so: it ends in the state in which it began."""
        self._held += 1
        self._asleep = True
        try:
            yield
        finally:
            self._asleep = False
            self._held -= 1

    # --- Follower

    def settle(self) -> None:
        """A savepoint or a commit follows: nothing fires before its end."""

    def released(self) -> None:
        """The outermost transaction has ended well, or the present state has become a version."""
        if not self._muted:
            self.run()

    def checked_out(self) -> None:
        """The model is in another version."""
        if not self._asleep:
            self.clear()

    def rolled_back(self) -> None:
        """What was rolled back has not arrived here."""

    def interrupted(self) -> None:
        """What the matcher tells is right."""

    def suspend(self) -> None:
        """The model is about to be loaded."""

    def loaded(self) -> None:
        """The load has ended; its net change arrives with the next one."""


def _nothing(appeared: list[Row], disappeared: list[Row]) -> None:
    """What a checkout has changed activates nothing."""


@short_repr
class Agenda(Sequence[Activation]):
    """The conflict set of an engine: what its event rules are about to do, in the order of firing. Live, and read-only.

    Outside of jobs it is empty, unless a job has raised, a rule is new, or a transaction is open.
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
        """The first twenty, a line each."""
        found = self._list()
        lines = [
            f"<agenda: {len(found)} to fire>",
            *(f"  {activation!r}" for activation in islice(found, 20)),
        ]
        return "\n".join([*lines, f"  and {len(found) - 20} more"] if len(found) > 20 else lines)
