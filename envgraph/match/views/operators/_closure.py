"""Transitive closure from selected starts: operators with the nodes that each start reaches, or the nodes on cycles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import filterfalse
from typing import Any, Final

from envgraph.errors import EvaluationError
from envgraph.graph import SET, Store
from envgraph.match._components import Reached, Tree, reachable_sets
from envgraph.match._costs import VIEWS
from envgraph.match.views.operators._operators import Operator, Rows
from envgraph.match.views.operators._sets import MatchSet, Row, become
from envgraph.metamodel import components

NOTHING: Final[Reached] = {}
ABSENT: Final = object()

Step = tuple[Any, Any]
"""An edge, directed away from the start."""

Patch = tuple[Any, Reached, Reached, Reached]
"""A start, the nodes cut from its tree, the nodes with a new parent, and the added nodes, which may have been cut."""

Difference = tuple[list[Any], list[Any]]
"""The nodes that are no longer reached, and the newly reached nodes."""


class Steps:
    """The edges that a closure follows, as two tables: the successors and the predecessors of each node.

    Attributes:
        next: returns the successors of a node.
        before: returns the predecessors of a node.
    """

    def __init__(self, after: Any, before: Any) -> None:
        self.next: Callable[[Any], Iterable[Any]] = after.__getitem__
        self.before: Callable[[Any], Iterable[Any]] = before.__getitem__
        self._after = after

    def nodes(self) -> Sequence[Any]:
        """Return all nodes that have successors, and perhaps nodes without successors."""
        return list(self._after) if isinstance(self._after, dict) else range(len(self._after))

    def has(self, node: Any, other: Any) -> bool:
        """Return True if an edge leads from `node` to `other`."""
        return other in self.next(node)


class ClosureOperator(Operator):
    """An operator with the nodes reached from each start by one or more edges; if `reflexive`, also the start itself.

    Args:
        name: unique in the network.
        store: the store of the model.
        starts: the requested starts, a unary relation.
        steps: the edges, in the direction in which they are followed.
        forward: True if starts are sources; False if they are targets, from which edges are followed backwards.
        reflexive: True for `*`.
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
        self._steps = steps
        self._gained: list[Step] = []
        self._lost: list[Step] = []
        self._asked: dict[Any, int] = {}
        self._owned: dict[
            Any, int
        ] = {}  # the store's epoch in which a tree was last copied: in this epoch it is changed in place

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
        """Return for each start the nodes that it reaches. `positions` must be the position of the start."""
        assert positions == ((0,) if self.forward else (1,))
        return self.reached

    # --- notifications

    def ask(self, start: Any) -> None:
        """Queue the addition of a start; `process` will search for the nodes that it reaches."""
        self._asked[start] = self._asked.get(start, 0) + 1

    def unask(self, start: Any) -> None:
        """Queue the removal of a start; `process` will delete its pairs."""
        self._asked[start] = self._asked.get(start, 0) - 1

    def gain(self, source: Any, target: Any) -> None:
        """Queue an inserted edge for `process`."""
        self._gained.append((source, target) if self.forward else (target, source))

    def lose(self, source: Any, target: Any) -> None:
        """Queue a deleted edge for `process`."""
        self._lost.append((source, target) if self.forward else (target, source))

    # --- queries

    def pairs(self) -> Iterator[tuple[Any, Any]]:
        """Yield all pairs of a source and a target that it reaches."""
        for (start,) in self.begun:
            for other in self.reached[start]:
                yield (start, other) if self.forward else (other, start)

    def starts_to(self, other: Any) -> list[Any]:
        """Return the starts that reach a node."""
        return [start for (start,) in self.begun if other in self.reached[start]]

    # --- updates

    def process(self) -> None:
        lost, gained, asked = self._lost[:], self._gained[:], self._asked
        self._lost.clear()
        self._gained.clear()
        self._asked = {}
        if lost and gained:  # otherwise each edge has changed only once
            has = self._steps.has
            lost = [edge for edge in dict.fromkeys(lost) if not has(*edge)]
            gained = [edge for edge in dict.fromkeys(gained) if has(*edge)]
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

    def _follow(self, lost: list[Step], gained: list[Step]) -> None:
        """Update the reached nodes of all starts after edges were deleted and inserted, and call the consumers."""
        anew: list[Any] = []
        patches: list[Patch] = []
        changes: list[tuple[Any, Reached]] = []
        share = len(self.begun) > VIEWS.few_starts
        first, common = None, NOTHING
        for start in self._concerned(lost, gained):
            old = self.reached[start]
            loss = self._cut(start, old, lost)
            if loss is None:
                anew.append(start)
                continue
            cut, reattached = loss
            # Starts that reach each other share one set. Only the last extended set is tried, which finds most cases.
            if start in common and first in old and first not in cut:
                changes.append((start, common))
                continue
            come = self._come(start, old, cut, gained) if gained else NOTHING
            if share and (type(old) is not Tree or self._round(start, come)):
                if cut or come:
                    new = dict.fromkeys(old if not cut else filterfalse(cut.__contains__, old))
                    new.update(dict.fromkeys(come))
                    changes.append((start, new))
                    if come:
                        first, common = start, new
            elif cut or reattached or come:
                patches.append((start, cut, reattached, come))
        for each in patches:
            self._apply(*each)
        if anew:
            changes.extend(self._solve(anew).items())
        if changes:
            self._change(changes)

    def _change(self, changes: list[tuple[Any, Reached]]) -> None:
        """Replace the reached nodes of each given start by new ones, journal this, and call the consumers."""
        differences: dict[tuple[int, int], Difference] = {}
        for start, new in changes:
            old = self.reached[start]
            # Ids stay unique: `changes` keeps new sets alive; an old set lives until its last start is processed.
            pair = (id(old), id(new))
            if pair not in differences:
                differences[pair] = _difference(old, new)
            self._replace(start, old, new, differences[pair])

    def _cut(self, start: Any, old: Reached, lost: list[Step]) -> tuple[Reached, Reached] | None:
        """Return the nodes that deleted edges cut from the tree of a start, and the nodes that other edges reattach.

        Reattached nodes are mapped to their new parents. Return None if a node's parent is unknown, so that only a new
        search can decide. Only nodes below a deleted tree edge are checked (Even and Shiloach, An On-Line Edge-Deletion
        Problem, 1981, without levels).
        """
        cut: Reached = {}
        for node, other in lost:
            by = old.get(other, ABSENT)
            if by == node:
                cut[other] = None
            elif by is None and node in old and not (self.reflexive and other == start):
                return None  # an edge from the start was never the only way to such a node
        if not cut:
            return NOTHING, NOTHING
        following, before = self._steps.next, self._steps.before
        todo = list(cut)
        for node in todo:
            # Children of the start are children of the root, even if a cycle leads back to the start.
            if node != start:
                for other in following(node):
                    if other not in cut:
                        by = old.get(other, ABSENT)
                        if by == node:
                            cut[other] = None
                            todo.append(other)
                        elif by is None and not (self.reflexive and other == start):
                            return None
        reattached: Reached = {}
        saved = []
        for node in todo:
            for by in before(node):
                if by == start or (by in old and by not in cut):
                    reattached[node] = by
                    del cut[node]
                    saved.append(node)
                    break
        for node in saved:
            for other in following(node):
                if other in cut:
                    reattached[other] = node
                    del cut[other]
                    saved.append(other)
        return cut, reattached

    def _come(self, start: Any, old: Reached, cut: Reached, gained: list[Step]) -> Reached:
        """Return the nodes that inserted edges connect with a start, with their parents; some may be in `cut`."""
        come: Reached = {}
        following, growing = self._steps.next, True
        while growing:
            growing = False
            for near, far in gained:
                if (far in old and far not in cut) or far in come:
                    continue
                if near == start or (near in old and near not in cut) or near in come:
                    growing = True
                    come[far] = near
                    todo = [far]
                    for node in todo:
                        for other in following(node):
                            if (other not in old or other in cut) and other not in come:
                                come[other] = node
                                todo.append(other)
        return come

    def _round(self, start: Any, come: Reached) -> bool:
        """Return True if an edge leads from one of the newly reached nodes (`come`) back to the start."""
        following = self._steps.next
        return any(start in following(node) for node in come)

    def _apply(self, start: Any, cut: Reached, reattached: Reached, come: Reached) -> None:
        """Remove `cut` from the tree of a start, add `reattached` and `come` with their parents; call the consumers.

        A tree is copied once after each savepoint or version, then changed in place. Undoing restores the old tree.
        """
        old = self.reached[start]
        gone: Collection[Any] = cut
        fresh: Collection[Any] = come
        if cut and come:
            gone = [node for node in cut if node not in come]
            fresh = [node for node in come if node not in cut]
        if self.removing is not None and gone:
            self._notify(self.removing, start, gone)
        if self._owned.get(start) == self.store.epoch:
            new = old
        else:
            new = Tree(old)
            if self.store.recording:
                self.store.journal.extend((self.reached, start, old, SET))
            self.reached[start] = new
            self._owned[start] = self.store.epoch
        for node in cut:
            del new[node]
        new |= reattached
        new |= come
        if self.added is not None and fresh:
            self._notify(self.added, start, fresh)

    def _concerned(self, lost: list[Step], gained: list[Step]) -> Collection[Any]:
        """Return the starts that may have reached a changed edge; all starts if a search for them takes too long."""
        before, most = self._steps.before, len(self.begun) // VIEWS.part
        if len(self.begun) > VIEWS.few_starts:
            gone: dict[Any, list[Any]] = {}
            for node, other in lost:
                gone.setdefault(other, []).append(node)
            seen = dict.fromkeys(node for node, _ in (*lost, *gained))
            todo = list(seen)
            for node in todo:
                for other in (*before(node), *gone.get(node, ())):
                    if other not in seen:
                        seen[other] = None
                        todo.append(other)
                if len(seen) > most:
                    break
            else:
                return [node for node in todo if (node,) in self.begun.position]
        return [start for (start,) in self.begun]

    def _solve(self, starts: Sequence[Any]) -> dict[Any, Reached]:
        """Search anew from each of some starts, and return the nodes that it reaches, by start."""
        if len(starts) > VIEWS.few_starts:
            return reachable_sets(starts, self._steps.next, self.reflexive)
        return {start: self._reach(start) for start in starts}

    def _reach(self, start: Any) -> Reached:
        """Search from one start, and return the reached nodes with their parents in the search tree."""
        seen = Tree({start: None} if self.reflexive else ())
        following, todo = self._steps.next, [start]
        for node in todo:
            for other in following(node):
                if other not in seen:
                    seen[other] = node
                    todo.append(other)
        return seen

    def _replace(self, start: Any, old: Reached, new: Reached, difference: Difference) -> None:
        """Replace the reached nodes of one start, journal this, and call the consumers for removed and added nodes."""
        gone, come = difference
        if self.removing is not None:
            self._notify(self.removing, start, gone)
        if self.store.recording:
            self.store.journal.extend((self.reached, start, old, SET))
        self.reached[start] = new
        self._owned[start] = self.store.epoch if type(new) is Tree else -1
        if self.added is not None:
            self._notify(self.added, start, come)

    def _notify(self, hook: Any, start: Any, others: Iterable[Any]) -> None:
        """Call a hook once for each of some other nodes, with the start and this node in the order source, target."""
        for other in others:
            if self.forward:
                hook(start, other)
            else:
                hook(other, start)

    def check_pairs(self, most: float) -> None:
        """Search from all starts, and raise an `EvaluationError` if more than `most` pairs are found."""
        for (start,) in self.starts.rows:
            most -= len(self._reach(start))
            if most < 0:
                raise EvaluationError(f"`{self.name}` has too many pairs")

    def fill(self) -> None:
        self._owned.clear()
        starts = list(self.starts.rows)
        become(self.store, self.reached, self._solve([start for (start,) in starts]), NOTHING)
        self.begun.replace(starts)

    def check(self) -> None:
        """Assert that starts and reached nodes equal those of a new search, and that all tree edges exist."""
        assert set(self.begun) == set(self.starts.rows), self.name
        for (start,) in self.begun:
            reached = self.reached[start]
            assert reached.keys() == self._reach(start).keys(), self.name
            assert all(self._is_connected(node, start, reached) for node in reached), self.name

    def _is_connected(self, node: Any, start: Any, reached: Reached) -> bool:
        """Return True if all recorded edges on the tree path from the start to a node still exist."""
        passed = {node}
        while True:
            by = reached[node]
            if by is None:
                return True
            if not self._steps.has(by, node):
                return False
            if by == start:
                return True
            if by in passed:
                return False
            passed.add(by)
            node = by


class CircleOperator(Rows):
    """An operator with the nodes on cycles: nodes from which one or more edges lead back to the node itself."""

    def __init__(self, name: str, store: Store, steps: Steps) -> None:
        super().__init__(name, store)
        self._steps = steps
        self._changed: dict[Step, None] = {}

    @property
    def pending(self) -> bool:
        return bool(self._changed)

    def forget(self) -> None:
        self._changed.clear()

    def gain(self, source: Any, target: Any) -> None:
        """Queue an inserted or deleted edge for `process`."""
        self._changed[source, target] = None

    lose = gain

    def process(self) -> None:
        changed = list(self._changed)
        self._changed.clear()
        # Every cycle through a changed edge is reachable from the target of the edge.
        for row, is_on in list(self._classified([step[1] for step in changed if self._may_change(*step)])):
            if is_on != (row in self.rows.position):
                (self.appear if is_on else self.vanish)(row)

    def _may_change(self, source: Any, target: Any) -> bool:
        """Return True if the past insertion or deletion of an edge may have created or broken cycles."""
        if self._steps.has(source, target):
            return self._reaches(target, source)
        on = self.rows.position
        return (source,) in on and (target,) in on and (source == target or not self._reaches(source, target))

    def _reaches(self, source: Any, target: Any) -> bool:
        """Return True if zero or more edges lead from source to target; search from both ends alternately."""
        ahead, behind = {source: None}, {target: None}
        both = zip(
            _nodes_from(ahead, self._steps.next), _nodes_from(behind, self._steps.before), strict=False
        )
        return any(one in behind or other in ahead for one, other in both)

    def _classified(self, starts: Sequence[Any]) -> Iterator[tuple[Row, bool]]:
        """Yield the row of each start and each node that a start reaches, and True if it is on a cycle, else False."""
        for nodes, exits in components(starts, self._steps.next):
            is_on = len(nodes) > 1 or nodes[0] in exits
            yield from (((node,), is_on) for node in nodes)

    def circles(self) -> list[Row]:
        """Search the whole graph, and return the rows of all nodes on cycles."""
        return [row for row, is_on in self._classified(self._steps.nodes()) if is_on]

    def fill(self) -> None:
        self.set_rows(self.circles())


def _nodes_from(known: dict[Any, None], following: Callable[[Any], Iterable[Any]]) -> Iterator[Any]:
    """Yield the nodes in `known`, then all nodes reachable from them, nearest first; add the latter to `known`."""
    todo = list(known)
    for node in todo:
        yield node
        for other in following(node):
            if other not in known:
                known[other] = None
                todo.append(other)


def _difference(old: Reached, new: Reached) -> Difference:
    """Return the nodes only in the old set, and the nodes only in the new set."""
    return list(filterfalse(new.__contains__, old)), list(filterfalse(old.__contains__, new))
