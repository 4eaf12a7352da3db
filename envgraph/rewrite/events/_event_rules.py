"""Event rules: jobs that are executed when matches appear, disappear or are updated.

The pattern of an event rule is watched. At the end of every outermost transaction, at a commit and by `settle`, the
net change of its matches becomes *activations*:

- `appear`: a match is new;
- `disappear`: a match disappeared whose appearance was handled: its `appear` has fired, or there is no such job;
- `update`: in one net change, a match disappeared and another one with the same key (a set of variables) is new.

Activations fire one after the other: first by highest priority, then by the order in which rules were registered, then
by age (in one net change: `disappear`, `update`, `appear`). Each firing is a transaction, and its net change is handled
before the next firing. An activation is dropped without firing if its reason no longer exists:

- an `appear` whose match disappeared; a `disappear` whose match is back;
- an `update` whose match is as before. If the match changes again, there is one update from the first to the last
  match. If it disappears, there is a `disappear` of the first match, the last that a job was notified of.

The changes of a job that raises an exception are undone, the job is not repeated, and the settling ends. Other
activations stay in the conflict set until the next settling. Rolled back changes cause no activations. A checkout
causes none either and empties the conflict set, because the other version was settled when it was created.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from envgraph.code import shorten_repr
from envgraph.errors import InvalidArgument
from envgraph.match import Subscription
from envgraph.pattern import Pattern
from envgraph.rewrite._matches import Match, Row, Shape
from envgraph.rewrite.events._jobs import BoundJob, Event

if TYPE_CHECKING:
    from envgraph.rewrite.events._agenda import ConflictSet


@shorten_repr
class Activation:
    """A pending job of an event rule at a match; `old` is the match before an update, else None.

    `live` is False if the activation was dropped or has fired.
    """

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


@shorten_repr
class EventRule:
    """An event rule registered by `Engine.on`. As a context manager it is cancelled at the end of the block.

    Invariants: `_appear_or_update` contains the pending `appear` and `update` activations by their current match,
    `_updates_by_old` the updates by the match before, `_disappears` the `disappear` activations. `_failed` contains
    current matches whose `appear` job has raised an exception. All other current matches are handled.

    Attributes:
        name: name for messages.
        pattern: qualified name of the watched pattern.
        priority: rules with higher priorities fire first.
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
        self._appear_or_update: dict[Row, Activation] = {}
        self._updates_by_old: dict[Row, Activation] = {}
        self._disappears: dict[Row, Activation] = {}
        self._failed: set[Row] = set()
        self.subscription: Subscription | None = None

    @property
    def activations(self) -> tuple[Activation, ...]:
        """Return the pending activations of this rule, in the order of firing."""
        return tuple(activation for activation in self._conflicts.pending_activations() if activation.rule is self)

    @property
    def active(self) -> bool:
        """Return True until the rule is cancelled."""
        return self.subscription is not None

    def cancel(self) -> None:
        """Cancel the rule and drop its pending activations. The pattern remains watched."""
        self._conflicts.remove_rule(self)
        self.drop_all()

    def __enter__(self) -> EventRule:
        return self

    def __exit__(self, *_: object) -> None:
        self.cancel()

    def __repr__(self) -> str:
        return f"<event rule {self.name} on {self.pattern}{'' if self.active else ', cancelled'}>"

    # --- net changes of matches

    def on_change(self, appeared: Sequence[Row], disappeared: Sequence[Row]) -> None:
        """Add activations for a net change of the matches, and drop pending ones whose reason no longer exists."""
        pairs, new, old = (
            pair_updates(appeared, disappeared, self._key) if "update" in self.jobs else ([], appeared, disappeared)
        )
        for row in old:
            known = self._last_notified(row)
            if known is not None:
                self._add_disappear(known)
        for before, after in pairs:
            self._on_update(before, after)
        for row in new:
            self.on_appear(row)

    def on_appear(self, row: Row) -> None:
        """Add an `appear` activation for a match. If it has a pending `disappear`, only drop this activation.

        If it is the old match of a pending `update`, drop the update and add an activation for the new match of the
        update.
        """
        back = self._disappears.pop(row, None)
        if back is not None:
            back.live = False
            return
        update = self._updates_by_old.get(row)
        if update is not None:
            self.drop_activation(update)
            self.on_appear(update.match.row)
        elif "appear" in self.jobs:
            self._appear_or_update[row] = self._activate("appear", row, None)

    def _on_update(self, before: Row, after: Row) -> None:
        known = self._last_notified(before)
        if known is None:
            self.on_appear(after)
        elif after in self._disappears or after in self._updates_by_old:
            self._add_disappear(known)
            self.on_appear(after)
        elif known != after:
            self._appear_or_update[after] = self._updates_by_old[known] = self._activate("update", after, known)

    def _last_notified(self, row: Row) -> Row | None:
        """Return the match that jobs were last notified of, for a match that disappeared; drop its pending activation.

        This is the match itself, or the match before a pending update. Return None if no job was notified.
        """
        if row in self._failed:
            self._failed.remove(row)
            return None
        pending = self._appear_or_update.get(row)
        if pending is None:
            return row
        self.drop_activation(pending)
        return None if pending.old is None else pending.old.row

    def _add_disappear(self, row: Row) -> None:
        if "disappear" in self.jobs:
            self._disappears[row] = self._activate("disappear", row, None)

    def _activate(self, event: Event, row: Row, old: Row | None) -> Activation:
        model = self._conflicts.engine.model
        before = None if old is None else Match(model, self._shape, old)
        activation = Activation(self, event, Match(model, self._shape, row), before)
        self._conflicts.add_activation(activation)
        return activation

    def drop_activation(self, activation: Activation) -> None:
        """Remove an activation. Its match counts as handled from now on."""
        activation.live = False
        row, old = activation.match.row, activation.old
        del (self._disappears if activation.event == "disappear" else self._appear_or_update)[row]
        if old is not None:
            del self._updates_by_old[old.row]

    # --- firing

    def on_failure(self, activation: Activation) -> None:
        """Record the match of an `appear` job that has raised an exception. Do nothing for other jobs."""
        if activation.event == "appear":
            self._failed.add(activation.match.row)

    def drop_all(self) -> None:
        """Drop all pending activations. All current matches count as handled from now on."""
        for pending in (self._appear_or_update, self._disappears):
            for activation in pending.values():
                activation.live = False
            pending.clear()
        self._updates_by_old.clear()
        self._failed.clear()


def pair_updates(
    appeared: Sequence[Row], disappeared: Sequence[Row], key: Sequence[int]
) -> tuple[list[tuple[Row, Row]], Sequence[Row], Sequence[Row]]:
    """Split a net change into updates (pairs of matches before and after), new matches and disappeared matches.

    If several matches have the same key, they are paired in their order.

    >>> pair_updates([("a", 2), ("c", 1)], [("a", 1), ("b", 1)], [0])
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
    """Return the indexes of the key variables, by which the matches before and after an update are paired.

    Args:
        pattern: the pattern, whose annotation may define a key; or None.
        shape: shape of its matches.
        key: names, or None for the key of the annotation, or else all variables that are bound to objects.

    Raises:
        InvalidArgument: a variable is unknown, or the key contains all variables, so that two matches never share it.
    """
    if isinstance(key, str):
        raise InvalidArgument(f"`key` takes several names: write ({key!r},)")
    names = tuple(key) if key is not None else _dependency_key(pattern)
    if names is None:
        names = tuple(name for place, name in enumerate(shape.names) if shape.is_object(place))
    places = tuple(shape.position(name) for name in dict.fromkeys(names))
    if len(places) == len(shape.names):
        raise InvalidArgument(
            f"the key of `{shape.definition}` contains all variables, so no match is updated; pass a smaller `key`"
        )
    return places


def _dependency_key(pattern: Pattern | None) -> tuple[str, ...] | None:
    """Return the variables after `forEach` in the first `@FunctionalDependency` of a pattern, or None."""
    for annotation in () if pattern is None else pattern.annotations:
        if annotation.name == "FunctionalDependency":
            values: list[object] = [value for name, value in annotation.named if name == "forEach"]
            groups = (value if isinstance(value, tuple) else (value,) for value in values)
            return tuple(str(name) for group in groups for name in group)
    return None
