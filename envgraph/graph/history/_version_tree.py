"""The tree of a model's versions, whose edges are the changes between them."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from operator import length_hint
from typing import TYPE_CHECKING, Any, NoReturn

from envgraph.code import shorten_repr
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import (
    Journal,
    net_journal,
    undo_after_exception,
    undo_and_invert,
    undo_entries,
)

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


_LONG = 256
"""Spliced segments with more items than this (four an entry) are reduced to their net changes."""


@shorten_repr
class Version:
    """A committed state of a model, created by `Model.commit`. It can be checked out as long as a program refers to it.

    A version needs memory only for the changes since the version before. The memory is freed when no references are
    left.

    Attributes:
        model: the model of which this is a state.
        number: 1 for the model's first version, and so on.
    """

    __slots__ = ("__weakref__", "_vertex", "model")

    def __init__(self, model: Model, vertex: VersionVertex) -> None:
        self.model = model
        self._vertex = vertex

    @property
    def number(self) -> int:
        """Return the number of the commit, from 1."""
        return self._vertex.number

    def __copy__(self) -> Version:
        return self

    def __deepcopy__(self, _: object) -> Version:
        """Return the same version, because a copy of the model has no versions."""
        return self

    def __reduce__(self) -> NoReturn:
        raise TypeError("a version cannot be pickled: check it out, and send its model")

    def __repr__(self) -> str:
        return f"<Version {self.number} of {self.model.name}>"


class VersionVertex:
    """A state in the tree of versions.

    Attributes:
        parent: the state at the other end of `segment`, or None for a root.
        children: the vertices with this parent, except a vertex under construction; a dict, because its order is fixed.
        segment: journal entries between this state and its parent. If `leads_to_parent` is True, undoing them leads
            from here to the parent, because the vertex is on the path from the root to the current state. Else it leads
            down to here.
        reverse_segment: entries that lead the other way, cached if the segment was undone unchanged; else None.
        depth: a number that increases from parent to child.
        has_freed_changes: True if the segment includes changes of freed versions, so it may write a cell more than
            once.
        reduced_length: the length of the segment when it was last reduced to one write for each cell.
        handle: a weak reference to the `Version` that is in use, or a dead reference, or None.
    """

    __slots__ = (
        "children",
        "depth",
        "handle",
        "has_freed_changes",
        "leads_to_parent",
        "next_id",
        "number",
        "parent",
        "reduced_length",
        "reverse_segment",
        "segment",
        "total",
    )

    def __init__(self, number: int, parent: VersionVertex | None, segment: Journal, next_id: int, total: int) -> None:
        self.number = number
        self.parent = parent
        self.children: dict[VersionVertex, None] = {}
        self.segment = segment
        self.reverse_segment: Journal | None = None
        self.leads_to_parent = True
        self.has_freed_changes = False
        self.reduced_length = 0
        self.depth: int = 0 if parent is None else parent.depth + 1
        self.next_id = next_id
        self.total = total
        self.handle: VersionReference | None = None

    @property
    def needs_reduction(self) -> bool:
        """Return True if the segment contains changes of freed versions and has doubled since its last reduction."""
        return self.has_freed_changes and len(self.segment) > 2 * self.reduced_length + 16 * _LONG

    @property
    def is_in_use(self) -> bool:
        """Return True if a program still refers to the `Version` object of this state."""
        return self.handle is not None and self.handle() is not None


class VersionReference(weakref.ref[Version]):
    """A weak reference to a `Version` object. It knows the vertex, which its callback needs."""

    __slots__ = ("vertex",)

    vertex: VersionVertex


class VersionTree:
    """The states of a model that can be checked out, and the changes between them.

    A version is in use while a program refers to its `Version` object. Unused versions are freed by calls of
    `free_unused`, never inside callbacks of the interpreter. Freeing affects only memory.

    Attributes:
        model: a weak reference to the model.
        current: the vertex of the state at which the journal starts, or None if no version is in use.
        used_count: the number of versions in use at the last check.
        unused_references: weak references to the versions that have become unused since the last check.
        reversal: during the reversal of a segment: its length, an iterator of its remaining items, and the entries that
            redo it. Otherwise None.
        interrupted_inverse: entries that redo the undone part of a segment after an interruption.
    """

    def __init__(self, model: Model, store: Store) -> None:
        self.model = weakref.ref(model)
        self._store = store
        self._commits = 0
        self.current: VersionVertex | None = None
        self.used_count = 0
        self.unused_references: list[VersionReference] = []
        self.reversal: tuple[int, Iterator[Any], Journal] | None = None
        self.interrupted_inverse: Journal = []

    @property
    def has_uncommitted_changes(self) -> bool:
        """Return True if there are uncommitted changes, or if no version is in use."""
        return self.current is None or bool(self._store.journal)

    @property
    def current_version(self) -> Version | None:
        """Return the version that equals the current state, or None if `has_uncommitted_changes` is True."""
        return None if self.current is None or self.has_uncommitted_changes else self._version_of(self.current)

    def commit(self) -> Version:
        """Create a version of the current state and empty the journal. Without changes return the last version."""
        store = self._store
        before = self.current
        if before is not None and not self.has_uncommitted_changes:
            return self._version_of(before)
        segment = store.journal[:] if before is not None else []
        vertex = VersionVertex(self._commits + 1, before, segment, store.next_id, store.hash_sum)
        try:
            store.recording = True  # from now on changes can be undone
            store.epoch += 1
            if before is not None:
                before.children[vertex] = None
            self._commits = vertex.number
            store.journal[:], self.current = (), vertex
            handle = self._version_of(vertex)
            if before is not None:
                self.prune(before)
        except BaseException:
            store.interrupted_writes.append(None)
            self._store.interrupted_writes.repair()
            raise
        if before is not None:
            self._reduce_segments(vertex)
        return handle

    def move_to(self, goal: VersionVertex) -> None:
        """Move the model to the state of `goal` along the tree. Uncommitted changes must be undone already."""
        assert self.current is not None
        up, down = _path_between(self.current, goal)
        for vertex in up:
            self._reverse_segment(vertex, vertex.parent)
        for vertex in reversed(down):
            self._reverse_segment(vertex, vertex)

    def _reverse_segment(self, vertex: VersionVertex, end: VersionVertex | None) -> None:
        """Undo the segment of a vertex, and replace it by the segment that redoes the changes.

        Args:
            vertex: the vertex whose segment is undone.
            end: the vertex whose state is reached, the new `current`.
        """
        segment, inverse = vertex.segment, vertex.reverse_segment
        backwards = reversed(segment)
        if inverse is None:
            inverse = []
            self.reversal = len(segment), backwards, inverse
            undo_and_invert(backwards, inverse)
        else:
            self.reversal = len(segment), backwards, inverse
            undo_entries(backwards)
        back: Journal | None = segment
        reduced = vertex.reduced_length
        if vertex.has_freed_changes and len(inverse) > _LONG:
            inverse, back = net_journal(inverse), None
            reduced = len(inverse)
        (
            vertex.segment,
            vertex.reverse_segment,
            vertex.leads_to_parent,
            vertex.has_freed_changes,
            vertex.reduced_length,
            self.current,
            self.reversal,
        ) = (inverse, back, not vertex.leads_to_parent, False, reduced, end, None)

    def redo_interrupted_reversal(self) -> None:
        """Redo the undone part of a segment whose reversal was interrupted by an exception."""
        if self.reversal is not None:
            length, backwards, inverse = self.reversal
            self.interrupted_inverse, self.reversal = inverse[: length - length_hint(backwards)], None
        undo_after_exception(self.interrupted_inverse, 0)

    # --- versions in use

    def _version_of(self, vertex: VersionVertex) -> Version:
        handle = None if vertex.handle is None else vertex.handle()
        if handle is None:
            model = self.model()
            assert model is not None
            handle = Version(model, vertex)
            try:
                vertex.handle = VersionReference(handle, self.unused_references.append)
                vertex.handle.vertex = vertex
                self.used_count += 1
            except BaseException:
                self._store.interrupted_writes.append(None)
                raise
        return handle

    def free_unused(self) -> None:
        """Free the versions that have become unused since the last call: prune their vertices from the tree."""
        while self.unused_references:
            handle = self.unused_references.pop()
            self.used_count -= 1
            self.prune(handle.vertex)

    def recount_and_prune(self) -> None:
        """Recount the versions in use, and prune the whole tree of unneeded vertices, after an interruption."""
        vertices = [] if self.current is None else [self.current]
        while vertices and vertices[0].parent is not None:
            vertices[0] = vertices[0].parent
        for vertex in vertices:
            vertices.extend(vertex.children)
            if vertex.handle is not None:
                vertex.handle.vertex = vertex  # an interruption may have come before this assignment
        waiting = {handle.vertex for handle in self.unused_references}
        self.used_count = sum(vertex.is_in_use for vertex in vertices) + len(self.unused_references)
        for vertex in vertices:
            if vertex not in waiting:
                self.prune(vertex)

    def prune(self, vertex: VersionVertex | None) -> None:
        """Remove a vertex from the tree if its version is unused, it is not current, and it has at most one child.

        If it has a child, the child takes over its changes. If it has none, its ancestors are pruned in the same way.
        """
        while vertex is not None and vertex is not self.current and not vertex.is_in_use:
            parent = vertex.parent
            if len(vertex.children) > 1:
                return
            if vertex.children:
                _remove_inner_vertex(vertex, next(iter(vertex.children)))
                return
            if parent is not None:
                parent.children.pop(vertex, None)
            vertex.parent = None
            vertex = parent

    def _reduce_segments(self, current: VersionVertex) -> None:
        """Reduce the last two segments to net changes if they are too long, by undoing and redoing them."""
        path = [current] if current.parent is None else [current, current.parent]
        while path and not path[-1].needs_reduction:
            path.pop()
        if path:
            try:
                for vertex in path:
                    self._reverse_segment(vertex, vertex.parent)
                self.move_to(current)
            except BaseException:
                self._store.interrupted_writes.extend((None, current))
                self._store.interrupted_writes.repair()
                raise

    def check_integrity(self) -> None:
        """Assert that the tree is consistent and contains no vertex that could have been freed."""
        path = []
        vertex = self.current
        while vertex is not None:
            path.append(vertex)
            vertex = vertex.parent
        held = 0
        found = path[-1:]
        for vertex in found:
            found.extend(vertex.children)
            held += vertex.is_in_use
            self._check_vertex(vertex, vertex in path)
        assert held <= self.used_count <= held + len(self.unused_references)

    def _check_vertex(self, vertex: VersionVertex, on_path: bool) -> None:
        assert vertex.leads_to_parent == on_path or vertex.parent is None
        assert len(vertex.segment) % 4 == 0
        needed = vertex.is_in_use or len(vertex.children) > 1 or vertex is self.current
        assert needed or self.unused_references, "a vertex that nobody needs"
        for child in vertex.children:
            assert child.parent is vertex
            assert child.depth > vertex.depth


def _path_between(start: VersionVertex, goal: VersionVertex) -> tuple[list[VersionVertex], list[VersionVertex]]:
    """Return the two paths between vertices: from `start` up to the lowest common ancestor, and from `goal` up to it.

    Both lists are in bottom-up order, without the ancestor.
    """
    up: list[VersionVertex] = []
    down: list[VersionVertex] = []
    while start is not goal:
        if start.depth >= goal.depth:
            up.append(start)
            assert start.parent is not None
            start = start.parent
        else:
            down.append(goal)
            assert goal.parent is not None
            goal = goal.parent
    return up, down


def _remove_inner_vertex(vertex: VersionVertex, child: VersionVertex) -> None:
    """Remove a vertex that has exactly one child from the tree. Its segment is joined to the segment of the child.

    If the vertex is a root, its child becomes a root without a segment. The function may be called again after an
    interruption.
    """
    parent = vertex.parent
    if child.parent is vertex:
        # The vertex is not current, so both segments have the same direction. Undoing reads entries backwards.
        assert parent is None or child.leads_to_parent == vertex.leads_to_parent
        first, second = (vertex, child) if child.leads_to_parent else (child, vertex)
        spliced = parent is not None
        whole = first.segment if spliced else []
        reduced = max(child.reduced_length, vertex.reduced_length)
        rest = second.segment if spliced else []
        whole += rest
        child.segment, child.reverse_segment, child.parent, child.has_freed_changes, child.reduced_length = (
            whole,
            None,
            parent,
            spliced,
            reduced,
        )
    if parent is not None:
        parent.children[child] = None
        parent.children.pop(vertex, None)
    vertex.parent = None
    vertex.children.clear()
