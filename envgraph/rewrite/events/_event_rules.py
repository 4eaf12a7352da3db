"""Event rules: what is done when matches appear, disappear or change; and the conflict set of what is still to do.

The matches of an event rule's pattern are watched. At the end of every outermost transaction, at a commit and when
asked to settle, the net change of the matches becomes *activations*:

- `appear`: a match is new;
- `disappear`: a match is gone whose appearance was handled: its `appear` has fired, or there is no such job;
- `update`: a match is gone and another one with the same key is new, in one net change. A key is a set of variables.

They fire one after the other: the highest priority first, then the rule that was registered first, then the activation
that came first (of one net change: what is gone, what has changed, what is new). Each firing is a transaction; its net
change is looked at before the next one. So an activation goes without firing when there is no reason for it any more:

- an `appear` whose match is gone; a `disappear` whose match is back;
- an `update` whose match is back as it was. If it changes again, there is one update, from the first to the last; if it
  goes, a `disappear` of the first, which is the last that a job was notified of.

A job that raises has done nothing, is not tried again, and ends the settling; what is left stays in the conflict set
until something settles again. Changes that are rolled back never arrive here. A checkout delivers nothing and empties
the conflict set: the other version has been settled when it was made.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from envgraph.code import short_repr
from envgraph.errors import InvalidArgument
from envgraph.match import Subscription
from envgraph.pattern import Pattern
from envgraph.rewrite._match import Match, Row, Shape
from envgraph.rewrite.events._jobs import BoundJob, Event

if TYPE_CHECKING:
    from envgraph.rewrite.events._agenda import ConflictSet


@short_repr
class Activation:
    """Something that an event rule is about to do; `old` is the match before an update, else None."""

    __slots__ = ("event", "live", "match", "old", "rule")

    def __init__(self, rule: EventRule, event: Event, match: Match, old: Match | None) -> None:
        self.rule = rule
        self.event = event
        self.match = match
        self.old = old
        self.live = True

    def __repr__(self) -> str:
        before = "" if self.old is None else f" from {self.old!r}"
        return f"<{self.event} {self.rule.name}: {self.match!r}{before}>"


@short_repr
class EventRule:
    """What `Engine.on` has registered; as a context manager it is cancelled at the end of the block.

    Invariants: `_here` holds the pending `appear` and `update` activations by the match that is there now, `_moved`
    the updates by the match that was there before, `_gone` the `disappear`s. `_failed` are present matches whose
    `appear` has raised. Every other present match counts as handled.

    Attributes:
        name: for messages.
        pattern: qualified name of what is watched.
        priority: higher ones fire first.
        calls: qualified names of its jobs that are rules, groups or units.
    """

    def __init__(
        self,
        conflicts: ConflictSet,
        name: str,
        shape: Shape,
        jobs: Mapping[Event, BoundJob],
        priority: int,
        key: tuple[int, ...],
        calls: Collection[str],
    ) -> None:
        self.name = name
        self.pattern = shape.definition
        self.priority = priority
        self.jobs = jobs
        self.calls = calls
        self._conflicts = conflicts
        self._shape = shape
        self._key = key
        self._here: dict[Row, Activation] = {}
        self._moved: dict[Row, Activation] = {}
        self._gone: dict[Row, Activation] = {}
        self._failed: set[Row] = set()
        self.subscription: Subscription | None = None

    @property
    def activations(self) -> tuple[Activation, ...]:
        """What this rule is about to do, in the order of the conflict set."""
        return tuple(activation for activation in self._conflicts.pending() if activation.rule is self)

    @property
    def active(self) -> bool:
        """False once it is cancelled."""
        return self.subscription is not None

    def cancel(self) -> None:
        """Do nothing any more; activations of this rule are dropped. The pattern stays watched."""
        self._conflicts.remove(self)
        self.clear()

    def __enter__(self) -> EventRule:
        return self

    def __exit__(self, *_: object) -> None:
        self.cancel()

    def __repr__(self) -> str:
        return f"<event rule {self.name} on {self.pattern}{'' if self.active else ', cancelled'}>"

    # --- what the matches do

    def changed(self, appeared: Sequence[Row], disappeared: Sequence[Row]) -> None:
        """Take in a net change."""
        pairs, new, old = self._paired(appeared, disappeared)
        for row in old:
            self._left(row)
        for before, after in pairs:
            self._replaced(before, after)
        for row in new:
            self.came(row)

    def _paired(
        self, appeared: Sequence[Row], disappeared: Sequence[Row]
    ) -> tuple[list[tuple[Row, Row]], Sequence[Row], Sequence[Row]]:
        if "update" not in self.jobs:
            return [], appeared, disappeared
        return paired(appeared, disappeared, self._key)

    def came(self, row: Row) -> None:
        """A match that was not there."""
        back = self._gone.pop(row, None)
        if back is not None:
            back.live = False
            return
        update = self._moved.get(row)
        if update is not None:
            self._drop(update)
            self.came(update.match.row)
        elif "appear" in self.jobs:
            self._here[row] = self._push("appear", row, None)

    def _left(self, row: Row) -> None:
        known = self._known(row)
        if known is not None:
            self._lost(known)

    def _replaced(self, before: Row, after: Row) -> None:
        known = self._known(before)
        if known is None:
            self.came(after)
        elif after in self._gone or after in self._moved:
            self._lost(known)
            self.came(after)
        elif known != after:
            self._here[after] = self._moved[known] = self._push("update", after, known)

    def _known(self, row: Row) -> Row | None:
        """For a match that has gone, what jobs last knew: the match, what it was before an update, or nothing."""
        if row in self._failed:
            self._failed.remove(row)
            return None
        pending = self._here.get(row)
        if pending is None:
            return row
        self._drop(pending)
        return None if pending.old is None else pending.old.row

    def _lost(self, row: Row) -> None:
        if "disappear" in self.jobs:
            self._gone[row] = self._push("disappear", row, None)

    def _push(self, event: Event, row: Row, old: Row | None) -> Activation:
        model = self._conflicts.engine.model
        before = None if old is None else Match(model, self._shape, old)
        activation = Activation(self, event, Match(model, self._shape, row), before)
        self._conflicts.push(activation)
        return activation

    def _drop(self, activation: Activation) -> None:
        activation.live = False
        row, old = activation.match.row, activation.old
        del (self._gone if activation.event == "disappear" else self._here)[row]
        if old is not None:
            del self._moved[old.row]

    # --- firing

    def take(self, activation: Activation) -> None:
        """The activation is about to fire: its match counts as handled."""
        self._drop(activation)

    def failed(self, activation: Activation) -> None:
        """The job has raised."""
        if activation.event == "appear":
            self._failed.add(activation.match.row)

    def clear(self) -> None:
        """Forget everything that is pending; what is there counts as handled."""
        for pending in (self._here, self._gone):
            for activation in pending.values():
                activation.live = False
            pending.clear()
        self._moved.clear()
        self._failed.clear()


def paired(
    appeared: Sequence[Row], disappeared: Sequence[Row], key: Sequence[int]
) -> tuple[list[tuple[Row, Row]], Sequence[Row], Sequence[Row]]:
    """Updates as matches before and after, what merely came, what merely went.

    Of several matches with one key, the first to go meets the first to come.

    >>> paired([("a", 2), ("c", 1)], [("a", 1), ("b", 1)], [0])
    ([(('a', 1), ('a', 2))], [('c', 1)], [('b', 1)])
    """
    if not appeared or not disappeared:
        return [], appeared, disappeared
    waiting: dict[Hashable, list[Row]] = {}
    for row in reversed(disappeared):
        waiting.setdefault(tuple([row[place] for place in key]), []).append(row)
    pairs: list[tuple[Row, Row]] = []
    new: list[Row] = []
    for row in appeared:
        found = waiting.get(tuple([row[place] for place in key]))
        if found:
            pairs.append((found.pop(), row))
        else:
            new.append(row)
    before = {one for one, _ in pairs}
    return pairs, new, [row for row in disappeared if row not in before]


def update_key(pattern: Pattern | None, shape: Shape, key: Iterable[str] | None) -> tuple[int, ...]:
    """The places of the variables by which two matches are the same thing, before and after an update.

    Args:
        pattern: may say so by `@FunctionalDependency`; None for the left side of a rule.
        shape: variables and types.
        key: names, or None for what the pattern says, else the variables that stand for objects.

    Raises:
        InvalidArgument: an unknown variable, or a key of all variables: two different matches never share it.
    """
    if isinstance(key, str):
        raise InvalidArgument(f"`key` takes several names: write ({key!r},)")
    names = tuple(key) if key is not None else _dependency(pattern)
    if names is None:
        names = tuple(name for place, name in enumerate(shape.names) if shape.is_object(place))
    places = tuple(shape.position(name) for name in dict.fromkeys(names))
    if len(places) == len(shape.names):
        raise InvalidArgument(
            f"no match of `{shape.definition}` is ever updated: all its variables belong to the key; give `key`"
        )
    return places


def _dependency(pattern: Pattern | None) -> tuple[str, ...] | None:
    """The `forEach` of the first `@FunctionalDependency`."""
    for annotation in () if pattern is None else pattern.annotations:
        if annotation.name == "FunctionalDependency":
            values: list[object] = [value for name, value in annotation.named if name == "forEach"]
            groups = (value if isinstance(value, tuple) else (value,) for value in values)
            return tuple(str(name) for group in groups for name in group)
    return None
