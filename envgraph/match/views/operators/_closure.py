"""Transitive closure from selected starts: operators with the nodes that each start reaches, or the nodes on cycles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import filterfalse
from typing import Any, Final

from envgraph.errors import EvaluationError
from envgraph.graph import ASSIGNED, Store
from envgraph.match._match_costs import VIEWS
from envgraph.match._reached_sets import ReachedNodes, ReachTree, reachable_sets
from envgraph.match.views.operators._materialized_view import Operator, RowOperator
from envgraph.match.views.operators._row_set import MatchSet, Row, set_contents
from envgraph.metamodel import strong_components

NOTHING: Final[ReachedNodes] = {}
ABSENT: Final = object()

ClosureEdge = tuple[Any, Any]
"""An edge, directed away from the start."""

Patch = tuple[Any, ReachedNodes, ReachedNodes, ReachedNodes]
"""A start, the nodes cut from its tree, the nodes with a new parent, and the added nodes, which may have been cut."""

Difference = tuple[list[Any], list[Any]]
"""The nodes that are no longer reached, and the newly reached nodes."""


class EdgeTables:
    """The edges that a closure follows, as two tables: the successors and the predecessors of each node.

    Attributes:
        successors: returns the successors of a node.
        predecessors: returns the predecessors of a node.
    """

    def __init__(self, after: Any, before: Any) -> None:
        self.successors: Callable[[Any], Iterable[Any]] = after.__getitem__
        self.predecessors: Callable[[Any], Iterable[Any]] = before.__getitem__
        self._after = after

    def nodes(self) -> Sequence[Any]:
        """Return all nodes that have successors, and perhaps nodes without successors."""
        return list(self._after) if isinstance(self._after, dict) else range(len(self._after))

    def has_edge(self, node: Any, other: Any) -> bool:
        """Return True if an edge leads from `node` to `other`."""
        return other in self.successors(node)


class ClosureOperator(Operator):
    """An operator with the nodes reached from each start by one or more edges; if `reflexive`, also the start
    itself.

    Args:
        name: unique in the network.
        store: the store of the model.
        starts: the requested starts, a unary relation.
        steps: the edges, in the direction in which they are followed.
        forward: True if starts are sources; False if they are targets, from which edges are followed backwards.
        reflexive: True for `*`.
    """

    def __init__(
        self, name: str, store: Store, starts: RowOperator, steps: EdgeTables, forward: bool, reflexive: bool
    ) -> None:
        super().__init__(name, store)
        self.starts = starts
        self.is_forward = forward
        self.is_reflexive = reflexive
        self.reached: dict[Any, ReachedNodes] = {}
        self.present_starts = MatchSet(store)
        self._steps = steps
        self._gained: list[ClosureEdge] = []
        self._lost: list[ClosureEdge] = []
        self._asked: dict[Any, int] = {}
        self._owned: dict[
            Any, int
        ] = {}  # the store's epoch in which a tree was last copied: in this epoch it is changed in place

    @property
    def is_pending(self) -> bool:
        return bool(self._gained or self._lost or self._asked)

    def discard_pending(self) -> None:
        self._gained.clear()
        self._lost.clear()
        self._asked.clear()

    def size(self) -> float:
        return float(sum(len(self.reached[start]) for (start,) in self.present_starts))

    def group_table(self, positions: tuple[int, ...]) -> Mapping[Any, Collection[Any]]:
        """Return for each start the nodes that it reaches. `positions` must be the position of the start."""
        assert positions == ((0,) if self.is_forward else (1,))
        return self.reached

    # --- notifications

    def on_start_added(self, start: Any) -> None:
        """Queue the addition of a start; `process` will search for the nodes that it reaches."""
        self._asked[start] = self._asked.get(start, 0) + 1

    def on_start_removed(self, start: Any) -> None:
        """Queue the removal of a start; `process` will delete its pairs."""
        self._asked[start] = self._asked.get(start, 0) - 1

    def on_edge_inserted(self, source: Any, target: Any) -> None:
        """Queue an inserted edge for `process`."""
        self._gained.append((source, target) if self.is_forward else (target, source))

    def on_edge_deleted(self, source: Any, target: Any) -> None:
        """Queue a deleted edge for `process`."""
        self._lost.append((source, target) if self.is_forward else (target, source))

    # --- queries

    def pairs(self) -> Iterator[tuple[Any, Any]]:
        """Yield all pairs of a source and a target that it reaches."""
        for (start,) in self.present_starts:
            for other in self.reached[start]:
                yield (start, other) if self.is_forward else (other, start)

    def starts_to(self, other: Any) -> list[Any]:
        """Return the starts that reach a node."""
        return [start for (start,) in self.present_starts if other in self.reached[start]]

    # --- updates

    def process(self) -> None:
        lost, gained, asked = self._lost[:], self._gained[:], self._asked
        self._lost.clear()
        self._gained.clear()
        self._asked = {}
        if lost and gained:  # otherwise each edge has changed only once
            has = self._steps.has_edge
            lost = [edge for edge in dict.fromkeys(lost) if not has(*edge)]
            gained = [edge for edge in dict.fromkeys(gained) if has(*edge)]
        for start, change in asked.items():
            if change < 0:
                old = self.reached[start]
                self._replace(start, old, NOTHING, (list(old), []))
                self.present_starts.delete_row((start,))
        if lost or gained:
            self._update_starts(lost, gained)
        fresh = [start for start, change in asked.items() if change > 0]
        found = self._solve(fresh)
        for start in fresh:
            self.present_starts.insert_row((start,))
            old, new = self.reached.get(start, NOTHING), found[start]
            self._replace(start, old, new, _difference(old, new))

    def _update_starts(self, deleted: list[ClosureEdge], inserted: list[ClosureEdge]) -> None:
        """Update the reached nodes of all starts after edges were deleted and inserted, and call the consumers."""
        anew: list[Any] = []
        patches: list[Patch] = []
        changes: list[tuple[Any, ReachedNodes]] = []
        share = len(self.present_starts) > VIEWS.few_starts
        first, common, successors = None, NOTHING, self._steps.successors
        for start in self._affected_starts(deleted, inserted):
            old = self.reached[start]
            loss = self._deletion_effect(start, old, deleted)
            if loss is None:
                anew.append(start)
                continue
            cut, reattached = loss
            # Starts that reach each other share one set. Only the last extended set is tried, which finds most cases.
            if start in common and first in old and first not in cut:
                changes.append((start, common))
                continue
            come = self._insertion_effect(start, old, cut, inserted) if inserted else NOTHING
            # In a tree an edge from a new node back to the start closes a cycle.
            if share and (type(old) is not ReachTree or any(start in successors(node) for node in come)):
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
            self._replace_all(changes)

    def _replace_all(self, changes: list[tuple[Any, ReachedNodes]]) -> None:
        """Replace the reached nodes of each given start by new ones, journal this, and call the consumers."""
        differences: dict[tuple[int, int], Difference] = {}
        for start, new in changes:
            old = self.reached[start]
            # Ids stay unique: `changes` keeps new sets alive; an old set lives until its last start is processed.
            pair = (id(old), id(new))
            if pair not in differences:
                differences[pair] = _difference(old, new)
            self._replace(start, old, new, differences[pair])

    def _deletion_effect(
        self, start: Any, old: ReachedNodes, deleted: list[ClosureEdge]
    ) -> tuple[ReachedNodes, ReachedNodes] | None:
        """Return the nodes that deleted edges cut from the tree of a start, and the nodes that other edges reattach.

        Reattached nodes are mapped to their new parents. Return None if a node's parent is unknown, so that only a new
        search can decide. Only nodes below a deleted tree edge are checked (Even and Shiloach, An On-Line Edge-Deletion
        Problem, 1981, without levels).
        """
        cut: ReachedNodes = {}
        for node, other in deleted:
            by = old.get(other, ABSENT)
            if by == node:
                cut[other] = None
            elif by is None and node in old and not (self.is_reflexive and other == start):
                return None  # an edge from the start was never the only way to such a node
        if not cut:
            return NOTHING, NOTHING
        following, before = self._steps.successors, self._steps.predecessors
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
                        elif by is None and not (self.is_reflexive and other == start):
                            return None
        reattached: ReachedNodes = {}
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

    def _insertion_effect(
        self, start: Any, old: ReachedNodes, cut: ReachedNodes, inserted: list[ClosureEdge]
    ) -> ReachedNodes:
        """Return the nodes that inserted edges connect with a start, with their parents; some may be in `cut`."""
        come: ReachedNodes = {}
        following, growing = self._steps.successors, True
        while growing:
            growing = False
            for near, far in inserted:
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

    def _apply(self, start: Any, cut: ReachedNodes, reattached: ReachedNodes, added: ReachedNodes) -> None:
        """Remove `cut` from the tree of a start, add `reattached` and `added` with their parents; call the consumers.

        A tree is copied once after each savepoint or version, then changed in place. Undoing restores the old tree.
        """
        old = self.reached[start]
        gone: Collection[Any] = cut
        fresh: Collection[Any] = added
        if cut and added:
            gone = [node for node in cut if node not in added]
            fresh = [node for node in added if node not in cut]
        if self.on_deleting is not None and gone:
            self._notify(self.on_deleting, start, gone)
        if self._owned.get(start) == self.store.epoch:
            new = old
        else:
            new = ReachTree(old)
            if self.store.recording:
                self.store.journal.extend((self.reached, start, old, ASSIGNED))
            self.reached[start] = new
            self._owned[start] = self.store.epoch
        for node in cut:
            del new[node]
        new |= reattached
        new |= added
        if self.on_inserted is not None and fresh:
            self._notify(self.on_inserted, start, fresh)

    def _affected_starts(self, deleted: list[ClosureEdge], inserted: list[ClosureEdge]) -> Collection[Any]:
        """Return the starts that may have reached a changed edge; all starts if a search for them takes too long."""
        before, most = self._steps.predecessors, len(self.present_starts) // VIEWS.part
        if len(self.present_starts) > VIEWS.few_starts:
            gone: dict[Any, list[Any]] = {}
            for node, other in deleted:
                gone.setdefault(other, []).append(node)
            seen = dict.fromkeys(node for node, _ in (*deleted, *inserted))
            todo = list(seen)
            for node in todo:
                for other in (*before(node), *gone.get(node, ())):
                    if other not in seen:
                        seen[other] = None
                        todo.append(other)
                if len(seen) > most:
                    break
            else:
                return [node for node in todo if (node,) in self.present_starts.position]
        return [start for (start,) in self.present_starts]

    def _solve(self, starts: Sequence[Any]) -> dict[Any, ReachedNodes]:
        """Search anew from each of some starts, and return the nodes that it reaches, by start."""
        if len(starts) > VIEWS.few_starts:
            return reachable_sets(starts, self._steps.successors, self.is_reflexive)
        return {start: self._reach(start) for start in starts}

    def _reach(self, start: Any) -> ReachedNodes:
        """Search from one start, and return the reached nodes with their parents in the search tree."""
        seen = ReachTree({start: None} if self.is_reflexive else ())
        following, todo = self._steps.successors, [start]
        for node in todo:
            for other in following(node):
                if other not in seen:
                    seen[other] = node
                    todo.append(other)
        return seen

    def _replace(self, start: Any, old: ReachedNodes, new: ReachedNodes, difference: Difference) -> None:
        """Replace the reached nodes of one start, journal this, and call the consumers for removed and added nodes."""
        gone, come = difference
        if self.on_deleting is not None:
            self._notify(self.on_deleting, start, gone)
        if self.store.recording:
            self.store.journal.extend((self.reached, start, old, ASSIGNED))
        self.reached[start] = new
        self._owned[start] = self.store.epoch if type(new) is ReachTree else -1
        if self.on_inserted is not None:
            self._notify(self.on_inserted, start, come)

    def _notify(self, hook: Any, start: Any, others: Iterable[Any]) -> None:
        """Call a hook once for each of some other nodes, with the start and this node in the order source, target."""
        for other in others:
            if self.is_forward:
                hook(start, other)
            else:
                hook(other, start)

    def check_pair_limit(self, max_pairs: float) -> None:
        """Search from all starts, and raise an `EvaluationError` if more than `max_pairs` pairs are found."""
        for (start,) in self.starts.rows:
            max_pairs -= len(self._reach(start))
            if max_pairs < 0:
                raise EvaluationError(f"`{self.name}` has too many pairs")

    def recompute(self) -> None:
        self._owned.clear()
        starts = list(self.starts.rows)
        set_contents(self.store, self.reached, self._solve([start for (start,) in starts]), NOTHING)
        self.present_starts.replace(starts)

    def check_rows(self) -> None:
        """Assert that starts and reached nodes equal those of a new search, and that all tree edges exist."""
        assert set(self.present_starts) == set(self.starts.rows), self.name
        for (start,) in self.present_starts:
            reached = self.reached[start]
            assert reached.keys() == self._reach(start).keys(), self.name
            assert all(self._is_connected(node, start, reached) for node in reached), self.name

    def _is_connected(self, node: Any, start: Any, reached: ReachedNodes) -> bool:
        """Return True if all recorded edges on the tree path from the start to a node still exist."""
        passed = {node}
        while True:
            by = reached[node]
            if by is None:
                return True
            if not self._steps.has_edge(by, node):
                return False
            if by == start:
                return True
            if by in passed:
                return False
            passed.add(by)
            node = by


class CycleOperator(RowOperator):
    """An operator with the nodes on cycles: nodes from which one or more edges lead back to the node itself."""

    def __init__(self, name: str, store: Store, steps: EdgeTables) -> None:
        super().__init__(name, store)
        self._steps = steps
        self._make_change_hook: dict[ClosureEdge, None] = {}

    @property
    def is_pending(self) -> bool:
        return bool(self._make_change_hook)

    def discard_pending(self) -> None:
        self._make_change_hook.clear()

    def on_edge_inserted(self, source: Any, target: Any) -> None:
        """Queue an inserted or deleted edge for `process`."""
        self._make_change_hook[source, target] = None

    on_edge_deleted = on_edge_inserted

    def process(self) -> None:
        changed = list(self._make_change_hook)
        self._make_change_hook.clear()
        # Every cycle through a changed edge is reachable from the target of the edge.
        for row, is_on in list(self._classify_nodes([step[1] for step in changed if self._may_change(*step)])):
            if is_on != (row in self.rows.position):
                (self.insert if is_on else self.delete)(row)

    def _may_change(self, source: Any, target: Any) -> bool:
        """Return True if the past insertion or deletion of an edge may have created or broken cycles."""
        if self._steps.has_edge(source, target):
            return self._reaches(target, source)
        on = self.rows.position
        return (source,) in on and (target,) in on and (source == target or not self._reaches(source, target))

    def _reaches(self, source: Any, target: Any) -> bool:
        """Return True if zero or more edges lead from source to target; search from both ends alternately."""
        ahead, behind = {source: None}, {target: None}
        both = zip(
            _nodes_from(ahead, self._steps.successors),
            _nodes_from(behind, self._steps.predecessors),
            strict=False,
        )
        return any(one in behind or other in ahead for one, other in both)

    def _classify_nodes(self, starts: Sequence[Any]) -> Iterator[tuple[Row, bool]]:
        """Yield the row of each start and each node that a start reaches, and True if it is on a cycle, else False."""
        for nodes, exits in strong_components(starts, self._steps.successors):
            is_on = len(nodes) > 1 or nodes[0] in exits
            yield from (((node,), is_on) for node in nodes)

    def search_cycles(self) -> list[Row]:
        """Search the whole graph, and return the rows of all nodes on cycles."""
        return [row for row, is_on in self._classify_nodes(self._steps.nodes()) if is_on]

    def recompute(self) -> None:
        self.set_rows(self.search_cycles())


def _nodes_from(known: dict[Any, None], following: Callable[[Any], Iterable[Any]]) -> Iterator[Any]:
    """Yield the nodes in `known`, then all nodes reachable from them, nearest first; add the latter to `known`."""
    todo = list(known)
    for node in todo:
        yield node
        for other in following(node):
            if other not in known:
                known[other] = None
                todo.append(other)


def _difference(old: ReachedNodes, new: ReachedNodes) -> Difference:
    """Return the nodes only in the old set, and the nodes only in the new set."""
    return list(filterfalse(new.__contains__, old)), list(filterfalse(old.__contains__, new))
