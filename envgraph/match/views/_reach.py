"""Transitive closure by demand: what is reached from those starts that the rest of a body asks for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import filterfalse
from typing import Any, Final, Protocol

from envgraph.graph import SET, Store
from envgraph.match._components import reachable_sets
from envgraph.match.views._operators import Operator, Rows
from envgraph.match.views._sets import Groups, MatchSet

FEW: Final = 12
"""Starts that are searched one by one; more share the strongly connected components."""

Reached = dict[Any, None]
"""What is reached, in the order in which it was found. Never changed, only replaced."""

NOTHING: Final[Reached] = {}

Difference = tuple[list[Any], list[Any]]
"""What was reached and is no more, and what is reached and was not."""

SPARSE: Final = 8
"""Pairs for each node up to which it is also kept from which starts a node is reached."""


class Steps(Protocol):
    """The edges that a closure follows.

    Attributes:
        next: where one step leads.
    """

    next: Callable[[Any], Iterable[Any]]

    def has(self, node: Any, other: Any) -> bool:
        """Whether there is a step."""


class LinkSteps:
    """Links of a reference, in one direction."""

    def __init__(self, column: Sequence[Sequence[int]]) -> None:
        self.next: Callable[[int], Iterable[int]] = column.__getitem__

    def has(self, node: int, other: int) -> bool:
        """Whether there is a link."""
        return other in self.next(node)


class RowSteps:
    """Rows of a binary view, in one direction."""

    def __init__(self, source: Rows, forward: bool) -> None:
        near, far = (0, 1) if forward else (1, 0)
        table = source.group((near,), far).table
        self.next: Callable[[Any], Iterable[Any]] = table.__getitem__

    def has(self, node: Any, other: Any) -> bool:
        """Whether there is a row."""
        return other in self.next(node)


class Reach(Operator):
    """For each start what is reached by one or more steps; with `reflexive`, the start itself, too.

    Args:
        name: unique.
        store: of the model.
        starts: the starts that are asked for, a unary relation.
        steps: the edges, in the direction in which they are followed.
        forward: whether starts are sources; else they are targets.
        reflexive: for `*`.
    """

    def __init__(
        self, name: str, store: Store, starts: Rows, steps: Steps, forward: bool, reflexive: bool
    ) -> None:
        super().__init__(name, store)
        self.starts = starts
        self.forward = forward
        self.reflexive = reflexive
        self.reached: dict[Any, Reached] = {}
        self.begun = MatchSet(store)
        self._inverse: Groups | None = None
        self._steps = steps
        self._gained: list[tuple[Any, Any]] = []
        self._lost: list[tuple[Any, Any]] = []
        self._asked: dict[Any, int] = {}

    @property
    def pending(self) -> bool:
        return bool(self._gained or self._lost or self._asked)

    def forget(self) -> None:
        self._gained.clear()
        self._lost.clear()
        self._asked.clear()

    def size(self) -> float:
        return float(sum(len(self.reached[start]) for (start,) in self.begun))

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """What each start reaches, for counting."""
        assert positions == ((0,) if self.forward else (1,))
        return self.reached

    # --- what it hears

    def ask(self, start: Any) -> None:
        """Somebody asks what a start reaches."""
        self._asked[start] = self._asked.get(start, 0) + 1

    def unask(self, start: Any) -> None:
        """Nobody asks any more."""
        self._asked[start] = self._asked.get(start, 0) - 1

    def gain(self, source: Any, target: Any) -> None:
        """There is a new step."""
        self._gained.append((source, target) if self.forward else (target, source))

    def lose(self, source: Any, target: Any) -> None:
        """A step goes."""
        self._lost.append((source, target) if self.forward else (target, source))

    # --- what it answers

    def pairs(self) -> Iterator[tuple[Any, Any]]:
        """Sources and targets."""
        for (start,) in self.begun:
            for other in self.reached[start]:
                yield (start, other) if self.forward else (other, start)

    def starts_to(self, other: Any) -> list[Any]:
        """The starts that reach something."""
        return [start for (start,) in self.begun if other in self.reached[start]]

    # --- keeping it current

    def process(self) -> None:
        steps = self._steps
        lost = [edge for edge in dict.fromkeys(self._lost) if not steps.has(*edge)]
        gained = [edge for edge in dict.fromkeys(self._gained) if steps.has(*edge)]
        asked = self._asked
        self._lost, self._gained, self._asked = [], [], {}
        for start, change in asked.items():
            if change < 0:
                old = self.reached[start]
                self._replace(start, old, NOTHING, (list(old), []))
                self.begun.vanish((start,))
        if lost or gained:
            self._follow(lost, gained)
        fresh = [start for start, change in asked.items() if change > 0]
        found = self._solve(fresh)
        for start in fresh:
            self.begun.appear((start,))
            old, new = self.reached.get(start, NOTHING), found[start]
            self._replace(start, old, new, _difference(old, new))

    def _follow(self, lost: list[tuple[Any, Any]], gained: list[tuple[Any, Any]]) -> None:
        """Bring all starts up to date with changed steps."""
        shrunk: list[Any] = []
        changes: list[tuple[Any, Reached]] = []
        first, common = None, NOTHING
        for start in self._concerned(lost, gained):
            old = self.reached[start]
            if any((node == start or node in old) and other in old for node, other in lost):
                shrunk.append(start)
                continue
            # Starts that reach each other reach the same, and share it: what hangs together costs no more than its
            # nodes. Only the last that was extended is tried, which finds most.
            if first in old and start in common:
                new = common
            else:
                new = self._extended(start, old, gained)
                if new is not old:
                    first, common = start, new
            if new is not old:
                changes.append((start, new))
        changes.extend(self._solve(shrunk).items())
        differences: dict[tuple[int, int], Difference] = {}
        for start, new in changes:
            old = self.reached[start]
            pair = (
                id(old),
                id(new),
            )  # what is new stays alive in `changes`, what is old until its last start's turn
            if pair not in differences:
                differences[pair] = _difference(old, new)
            if any(differences[pair]):
                self._replace(start, old, new, differences[pair])

    def _concerned(self, lost: list[tuple[Any, Any]], gained: list[tuple[Any, Any]]) -> list[Any]:
        """The starts that reach the near end of a changed step; all of them, if that is not kept."""
        if self._inverse is None:
            return [start for (start,) in self.begun]
        found: dict[Any, None] = {}
        for node, _ in (*lost, *gained):
            found.update(dict.fromkeys(self._inverse.table[node]))
            if (node,) in self.begun.position:
                found[node] = None
        return list(found)

    def _extended(self, start: Any, old: Reached, gained: list[tuple[Any, Any]]) -> Reached:
        """What is reached with new steps, too, from what was reached already; the old dict if that is all."""
        new, growing = old, True
        while growing:
            growing = False
            for node, other in gained:
                if other not in new and (node == start or node in new):
                    new = dict(new) if new is old else new
                    self._search(other, new)
                    growing = True
        return new

    def _search(self, start: Any, seen: Reached) -> None:
        """Add a node and all that it reaches."""
        seen[start] = None
        self._spread([start], seen)

    def _solve(self, starts: Sequence[Any]) -> dict[Any, Reached]:
        """What the starts reach."""
        if len(starts) > FEW:
            return reachable_sets(starts, self._steps.next, self.reflexive)
        return {start: self._reach(start) for start in starts}

    def _reach(self, start: Any) -> Reached:
        seen: Reached = {start: None} if self.reflexive else {}
        self._spread([start], seen)
        return seen

    def _spread(self, todo: list[Any], seen: Reached) -> None:
        """Add everything that steps lead to."""
        following, push = self._steps.next, todo.append
        for node in todo:
            for other in following(node):
                if other not in seen:
                    seen[other] = None
                    push(other)

    def _replace(self, start: Any, old: Reached, new: Reached, difference: Difference) -> None:
        gone, come = difference
        if self.removing is not None:
            self._tell(self.removing, start, gone)
        if self.store.recording:
            self.store.journal.extend((self.reached, start, old, SET))
        self.reached[start] = new
        if self._inverse is not None:
            for other in gone:
                self._inverse.drop((other, start))
            for other in come:
                self._inverse.add((other, start))
        if self.added is not None:
            self._tell(self.added, start, come)

    def _tell(self, hook: Any, start: Any, others: Iterable[Any]) -> None:
        for other in others:
            if self.forward:
                hook(start, other)
            else:
                hook(other, start)

    def fill(self) -> None:
        self.reached.clear()
        self.begun.replace(list(self.starts.rows))
        self.reached.update(self._solve([start for (start,) in self.begun]))
        nodes = {node for each in {id(r): r for r in self.reached.values()}.values() for node in each}
        if len(self.begun) > FEW and self.size() <= SPARSE * (len(self.begun) + len(nodes)):
            self._inverse = Groups(self.store, (0,), 1)
            self._inverse.fill([(other, start) for (start,) in self.begun for other in self.reached[start]])

    def check(self) -> None:
        """Assert that everything is as a new search finds it."""
        assert set(self.begun) == set(self.starts.rows), self.name
        for (start,) in self.begun:
            assert self.reached[start].keys() == self._reach(start).keys(), self.name
        if self._inverse is not None:
            self._inverse.check([(other, start) for (start,) in self.begun for other in self.reached[start]])


def _difference(old: Reached, new: Reached) -> Difference:
    return list(filterfalse(new.__contains__, old)), list(filterfalse(old.__contains__, new))
