"""The versions of a model: a tree, whose edges are the changes between them."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from operator import length_hint
from typing import TYPE_CHECKING, Any, NoReturn

from envgraph.code import short_repr
from envgraph.graph.store._journal import Journal, invert, net_changes, take_back, undo
from envgraph.graph.store._store import Store

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


_LONG = 256
"""Items (four to an entry) from which on a spliced segment is worth reducing to its net changes."""


@short_repr
class Version:
    """A committed state of a model. Holding it keeps the state reachable; made by `Model.commit`.

    A version costs its changes against the one before. It is freed when nobody holds it any more.

    Attributes:
        model: the model it is a state of.
        number: 1 for the model's first version, and so on.
    """

    __slots__ = ("__weakref__", "_vertex", "model")

    def __init__(self, model: Model, vertex: Vertex) -> None:
        self.model = model
        self._vertex = vertex

    @property
    def number(self) -> int:
        """Number of the commit, from 1."""
        return self._vertex.number

    def __copy__(self) -> Version:
        return self

    def __deepcopy__(self, _: object) -> Version:
        """The same: a copy of the model has no versions."""
        return self

    def __reduce__(self) -> NoReturn:
        raise TypeError("a version cannot be pickled: check it out, and send its model")

    def __repr__(self) -> str:
        return f"<Version {self.number} of {self.model.name}>"


class Vertex:
    """A state in the tree of versions.

    Attributes:
        parent: the state that `segment` leads from or to.
        children: states whose parent this is, but for one that is being made; a dict for its order.
        segment: entries between this state and its parent. `upwards`: undoing them leads from here to the parent (the
            vertex lies on the path from the root to the current state); else from the parent to here.
        back: entries that lead the other way, once the segment has been undone as it is; else None.
        depth: grows from parent to child.
        spliced: the segment spans versions that are gone, so it may write a place more than once.
        reduced: length of the segment when each place in it was written once.
        handle: the `Version` that somebody holds, or a dead reference.
    """

    __slots__ = (
        "back",
        "children",
        "depth",
        "handle",
        "next_id",
        "number",
        "parent",
        "reduced",
        "segment",
        "spliced",
        "total",
        "upwards",
    )

    def __init__(
        self, number: int, parent: Vertex | None, segment: Journal, next_id: int, total: int
    ) -> None:
        self.number = number
        self.parent = parent
        self.children: dict[Vertex, None] = {}
        self.segment = segment
        self.back: Journal | None = None
        self.upwards = True
        self.spliced = False
        self.reduced = 0
        self.depth: int = 0 if parent is None else parent.depth + 1
        self.next_id = next_id
        self.total = total
        self.handle: Handle | None = None

    @property
    def overgrown(self) -> bool:
        """Whether the segment has doubled since it was reduced: time to walk it there and back."""
        return self.spliced and len(self.segment) > 2 * self.reduced + 16 * _LONG

    @property
    def held(self) -> bool:
        """Whether somebody can ask for this state."""
        return self.handle is not None and self.handle() is not None


class Handle(weakref.ref[Version]):
    """Tells whether somebody holds a version; what is called when nobody does gets this, not the version."""

    __slots__ = ("vertex",)

    vertex: Vertex


class VersionTree:
    """The states of a model that somebody may go to, and what lies between them.

    What has been freed is decided at fixed points (`free`), never inside the interpreter's callbacks, and only
    affects memory.

    Attributes:
        model: whose states they are.
        current: the state from which the journal leads to the present one; None if no version describes that.
        held: how many versions somebody held at the last look.
        released: those that nobody holds any more, since then.
        turning: what is left of a segment while that is turned round, and the entries that lead back.
        inverse: entries that undo what had been undone of a segment when that was interrupted.
    """

    def __init__(self, model: Model, store: Store) -> None:
        self.model = weakref.ref(model)
        self._store = store
        self._commits = 0
        self.current: Vertex | None = None
        self.held = 0
        self.released: list[Handle] = []
        self.turning: tuple[int, Iterator[Any], Journal] | None = None
        self.inverse: Journal = []

    @property
    def changed(self) -> bool:
        """Whether the state differs from the current version by recorded changes, or no version describes it."""
        return self.current is None or bool(self._store.journal)

    @property
    def present(self) -> Version | None:
        """The version that the model is in; None if there are uncommitted changes."""
        return None if self.current is None or self.changed else self._handle(self.current)

    def commit(self) -> Version:
        """Name the present state; without changes since the last version, that one."""
        store = self._store
        before = self.current
        if before is not None and not self.changed:
            return self._handle(before)
        segment = store.journal[:] if before is not None else []
        vertex = Vertex(self._commits + 1, before, segment, store.next_id, store.total)
        try:
            store.recording = True  # from now on there is a state to go back to
            store.epoch += 1
            if before is not None:
                before.children[vertex] = None
            self._commits = vertex.number
            store.journal[:], self.current = (), vertex
            handle = self._handle(vertex)
            if before is not None:
                self.prune(before)
        except BaseException:
            store.interrupted.append(None)
            self._store.interrupted.repair()
            raise
        if before is not None:
            self._reduce(vertex)
        return handle

    def walk(self, goal: Vertex) -> None:
        """Go to a state; the changes since the current one are undone already."""
        assert self.current is not None
        up, down = _path(self.current, goal)
        for vertex in up:
            self._turn(vertex, vertex.parent)
        for vertex in reversed(down):
            self._turn(vertex, vertex)

    def _turn(self, vertex: Vertex, end: Vertex | None) -> None:
        """Undo the segment of a vertex, which leads to one of its ends; what leads back is found out once."""
        segment, inverse = vertex.segment, vertex.back
        backwards = reversed(segment)
        if inverse is None:
            inverse = []
            self.turning = len(segment), backwards, inverse
            invert(backwards, inverse)
        else:
            self.turning = len(segment), backwards, inverse
            undo(backwards)
        back: Journal | None = segment
        reduced = vertex.reduced
        if vertex.spliced and len(inverse) > _LONG:
            inverse, back = net_changes(inverse), None
            reduced = len(inverse)
        (
            vertex.segment,
            vertex.back,
            vertex.upwards,
            vertex.spliced,
            vertex.reduced,
            self.current,
            self.turning,
        ) = (inverse, back, not vertex.upwards, False, reduced, end, None)

    def take_back(self) -> None:
        """After an exception: what has been undone of a segment is made again."""
        if self.turning is not None:
            length, backwards, inverse = self.turning
            self.inverse, self.turning = inverse[: length - length_hint(backwards)], None
        take_back(self.inverse, 0)

    # --- who holds what

    def _handle(self, vertex: Vertex) -> Version:
        handle = None if vertex.handle is None else vertex.handle()
        if handle is None:
            model = self.model()
            assert model is not None
            handle = Version(model, vertex)
            try:
                vertex.handle = Handle(handle, self.released.append)
                vertex.handle.vertex = vertex
                self.held += 1
            except BaseException:
                self._store.interrupted.append(None)
                raise
        return handle

    def free(self) -> None:
        """Free what nobody holds any more."""
        while self.released:
            handle = self.released.pop()
            self.held -= 1
            self.prune(handle.vertex)

    def tidy(self) -> None:
        """Look at all vertices, after an interruption: which are held, and which nobody needs."""
        vertices = [] if self.current is None else [self.current]
        while vertices and vertices[0].parent is not None:
            vertices[0] = vertices[0].parent
        for vertex in vertices:
            vertices.extend(vertex.children)
            if vertex.handle is not None:
                vertex.handle.vertex = vertex  # if it was interrupted before it knew
        waiting = {handle.vertex for handle in self.released}
        self.held = sum(vertex.held for vertex in vertices) + len(self.released)
        for vertex in vertices:
            if vertex not in waiting:
                self.prune(vertex)

    def prune(self, vertex: Vertex | None) -> None:
        """Drop a vertex that is neither held nor current nor a fork, and what it alone kept."""
        while vertex is not None and vertex is not self.current and not vertex.held:
            parent = vertex.parent
            if len(vertex.children) > 1:
                return
            if vertex.children:
                _splice(vertex, next(iter(vertex.children)))
                return
            if parent is not None:
                parent.children.pop(vertex, None)
            vertex.parent = None
            vertex = parent

    def _reduce(self, current: Vertex) -> None:
        """Shorten the last two segments, if long, by walking them there and back."""
        path = [current] if current.parent is None else [current, current.parent]
        while path and not path[-1].overgrown:
            path.pop()
        if path:
            try:
                for vertex in path:
                    self._turn(vertex, vertex.parent)
                self.walk(current)
            except BaseException:
                self._store.interrupted.extend((None, current))
                self._store.interrupted.repair()
                raise

    def check_integrity(self) -> None:
        """Assert that the tree is connected, and holds nothing that could have been freed."""
        path = []
        vertex = self.current
        while vertex is not None:
            path.append(vertex)
            vertex = vertex.parent
        held = 0
        found = path[-1:]
        for vertex in found:
            found.extend(vertex.children)
            held += vertex.held
            self._check_vertex(vertex, vertex in path)
        assert held <= self.held <= held + len(self.released)

    def _check_vertex(self, vertex: Vertex, on_path: bool) -> None:
        assert vertex.upwards == on_path or vertex.parent is None
        assert len(vertex.segment) % 4 == 0
        needed = vertex.held or len(vertex.children) > 1 or vertex is self.current
        assert needed or self.released, "a vertex that nobody needs"
        for child in vertex.children:
            assert child.parent is vertex
            assert child.depth > vertex.depth


def _path(start: Vertex, goal: Vertex) -> tuple[list[Vertex], list[Vertex]]:
    """Vertices to leave towards the lowest common ancestor, and those to enter from there, both bottom up."""
    up: list[Vertex] = []
    down: list[Vertex] = []
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


def _splice(vertex: Vertex, child: Vertex) -> None:
    """Take a vertex with one child out of the tree; the child's segment then spans both. May be called once more."""
    parent = vertex.parent
    if child.parent is vertex:
        # The vertex is not current, so both segments lead the same way. Undoing reads backwards.
        assert parent is None or child.upwards == vertex.upwards
        first, second = (vertex, child) if child.upwards else (child, vertex)
        spliced = parent is not None
        whole = first.segment if spliced else []
        reduced = max(child.reduced, vertex.reduced)
        rest = second.segment if spliced else []
        whole += rest
        child.segment, child.back, child.parent, child.spliced, child.reduced = (
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
