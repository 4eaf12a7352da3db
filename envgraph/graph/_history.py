"""Savepoints, and the tree of versions."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, NoReturn

from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph._journal import Journal, invert, invert_net, revert
from envgraph.graph._store import Store

if TYPE_CHECKING:
    from envgraph.graph._model import Model


_LONG = 256
"""Items (four to an entry) from which on a spliced segment is worth reducing to its net changes."""


class Savepoint:
    """A place in the journal to roll back to; made by `Model.savepoint`."""

    __slots__ = ("_mark", "_next_id", "_total")

    def __init__(self, mark: int, next_id: int, total: int) -> None:
        self._mark = mark
        self._next_id = next_id
        self._total = total


class Shelf:
    """Changes that were taken back and can be made again, as often as wanted; made by `Model.shelve`."""

    __slots__ = ("_entries", "_next_id", "_total")

    def __init__(self, entries: Journal, next_id: int, total: int) -> None:
        self._entries = entries
        self._next_id = next_id
        self._total = total


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
        children: states whose parent this is; a dict for its order.
        segment: entries between this state and its parent. `upwards`: undoing them leads from here to the parent (the
            vertex lies on the path from the root to the current state); else from the parent to here.
        depth: grows from parent to child.
        spliced: the segment spans versions that are gone, so it may write a place more than once.
        reduced: length of the segment when each place in it was written once.
        handle: the `Version` that somebody holds, or a dead reference.
    """

    __slots__ = (
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
        self.upwards = True
        self.spliced = False
        self.reduced = 0
        self.depth: int = 0 if parent is None else parent.depth + 1
        self.next_id = next_id
        self.total = total
        self.handle: weakref.ref[Version] | None = None
        if parent is not None:
            parent.children[self] = None

    def turn(self) -> None:
        """Undo the segment: the model goes from one end of it to the other."""
        net = self.spliced and len(self.segment) > _LONG
        self.segment = invert_net(self.segment) if net else invert(self.segment)
        self.upwards = not self.upwards
        if net:
            self.reduced = len(self.segment)
        self.spliced = False

    @property
    def overgrown(self) -> bool:
        """Whether the segment has doubled since it was reduced: time to walk it there and back."""
        return self.spliced and len(self.segment) > 2 * self.reduced + 16 * _LONG

    @property
    def held(self) -> bool:
        """Whether somebody can ask for this state."""
        return self.handle is not None and self.handle() is not None


class History:
    """Owner of a model's journal: open savepoints, committed versions, and what may be forgotten.

    Invariants: the store records exactly while a savepoint is open or a version was held at the last look; the
    journal holds the changes since `current`, or since the outermost savepoint if no version describes the state.
    What has been freed is decided at fixed points (`_settle`), never inside the interpreter's callbacks, and only
    affects memory.
    """

    def __init__(self, model: Model, store: Store) -> None:
        self._model = weakref.ref(model)
        self._store = store
        self._stack: list[Savepoint] = []
        self._commits = 0
        self._current: Vertex | None = None
        self._held = 0
        self._released: list[Vertex] = []
        self._loading = False

    # --- savepoints

    def savepoint(self) -> Savepoint:
        """Open a savepoint inside those that are open."""
        if self._loading:
            raise TransactionError("a model that is loading has no journal to roll back")
        store = self._store
        for follower in store.followers:
            follower.settle()
        store.recording = True
        store.epoch += 1
        savepoint = Savepoint(len(store.journal), store.next_id, store.total)
        self._stack.append(savepoint)
        return savepoint

    def rollback(self, savepoint: Savepoint) -> None:
        """Back to the state at the innermost savepoint, and close it."""
        self._close(savepoint)
        store = self._store
        if len(store.journal) > savepoint._mark:
            revert(store.journal, savepoint._mark)
            self._replayed(savepoint._next_id, savepoint._total)
        if not self._stack:
            self._settle()

    def unwind(self, depth: int) -> None:
        """Roll back until so many savepoints are open: Ctrl-C may have kept one inside from being closed."""
        if len(self._stack) > depth:
            del self._stack[depth + 1 :]
            self.rollback(self._stack[depth])

    def shelve(self, savepoint: Savepoint) -> Shelf:
        """As `rollback`, and what was taken back can be resumed."""
        store = self._store
        for follower in store.followers:
            follower.settle()
        self._close(savepoint)
        undone = store.journal[savepoint._mark :]
        del store.journal[savepoint._mark :]
        shelf = Shelf(invert(undone), store.next_id, store.total)
        self._replayed(savepoint._next_id, savepoint._total)
        if not self._stack:
            self._settle()
        return shelf

    def resume(self, shelf: Shelf) -> Savepoint:
        """Make the changes of a shelf inside a new savepoint; the state is the one in which they were made."""
        savepoint = self.savepoint()
        self._store.journal.extend(invert(shelf._entries))
        self._replayed(shelf._next_id, shelf._total)
        return savepoint

    def _replayed(self, next_id: int, total: int) -> None:
        store = self._store
        store.next_id = next_id
        store.total = total
        store.epoch += 1
        store.restored()
        for follower in store.followers:
            follower.rolled_back()

    def release(self, savepoint: Savepoint) -> None:
        """Close the innermost savepoint and keep the changes."""
        self._close(savepoint)
        if not self._stack:
            self._settle()
            self._tell_released()

    def _tell_released(self) -> None:
        for follower in self._store.followers[:]:
            follower.released()

    def _close(self, savepoint: Savepoint) -> None:
        if not self._stack or self._stack[-1] is not savepoint:
            known = any(savepoint is other for other in self._stack)
            raise TransactionError(
                "a savepoint inside this one is still open: close it first"
                if known
                else "the savepoint is closed already, or belongs to another model"
            )
        self._stack.pop()

    @property
    def depth(self) -> int:
        """How many savepoints are open."""
        return len(self._stack)

    # --- loading

    @property
    def loading(self) -> bool:
        """Whether the model is being built without a journal."""
        return self._loading

    def begin_loading(self) -> None:
        """Stop recording; nothing that is done from now on can be undone."""
        self._settle()
        self._refuse_inside("load")
        if self._held:
            raise TransactionError(
                "a model with versions cannot load without its journal: load before the first commit"
            )
        for follower in self._store.followers:
            follower.suspend()
        self._loading = True

    def end_loading(self) -> None:
        """Allow savepoints again."""
        self._loading = False
        for follower in self._store.followers:
            follower.loaded()

    # --- versions

    @property
    def changed(self) -> bool:
        """Whether the state differs from the current version by recorded changes, or no version describes it."""
        return self._current is None or bool(self._store.journal)

    def version(self) -> Version | None:
        """The version that the model is in, or None after uncommitted changes."""
        if self._stack:
            return None
        self._settle()
        return None if self._current is None or self.changed else self._handle(self._current)

    def commit(self) -> Version:
        """Name the present state; without changes since the last version, that one."""
        self._refuse_inside("commit")
        self._settle()
        store = self._store
        for follower in store.followers:
            follower.settle()
        version = self._commit(store)
        self._tell_released()
        return version

    def _commit(self, store: Store) -> Version:
        before = self._current
        if before is not None and not self.changed:
            return self._handle(before)
        self._commits += 1
        segment = store.journal[:] if before is not None else []
        store.journal.clear()
        self._current = Vertex(self._commits, before, segment, store.next_id, store.total)
        store.recording = True
        store.epoch += 1
        handle = self._handle(self._current)
        if before is not None:
            self._prune(before)
            self._reduce(self._current)
        return handle

    def checkout(self, version: Version, discard: bool) -> None:
        """Go to another version along the tree."""
        if not isinstance(version, Version):
            raise InvalidArgument(f"a version is what `commit` gives, not {version!r}")
        if version.model is not self._model():
            raise TransactionError(f"{version!r} is a version of another model")
        self._refuse_inside("check out")
        self._settle()
        store = self._store
        assert self._current is not None, "a version is held, so the present state has a place in the tree"
        if store.journal:
            if not discard:
                raise TransactionError(
                    "the model has uncommitted changes: commit them, or check out with discard=True to lose them"
                )
            revert(store.journal, 0)
        elif self._current is version._vertex:
            return
        self._walk(self._current, version._vertex)

    def _walk(self, start: Vertex, goal: Vertex) -> None:
        up, down = _path(start, goal)
        for vertex in up:
            vertex.turn()
        for vertex in reversed(down):
            vertex.turn()
        self._current = goal
        self._store.epoch += 1
        self._store.next_id = goal.next_id
        self._store.total = goal.total
        self._prune(start)
        self._store.restored()
        for follower in self._store.followers:
            follower.checked_out()

    @property
    def idle(self) -> bool:
        """Whether nothing is under way: no savepoint is open, nobody holds a version, and it is not loading."""
        self._settle()
        return not self._stack and not self._held and not self._loading

    def _refuse_inside(self, action: str) -> None:
        if self._stack:
            raise TransactionError(
                f"cannot {action} inside a transaction: {len(self._stack)} savepoints are open"
            )
        if self._loading:
            raise TransactionError(f"cannot {action} while the model is loading")

    # --- who holds what

    def _handle(self, vertex: Vertex) -> Version:
        handle = None if vertex.handle is None else vertex.handle()
        if handle is None:
            model = self._model()
            assert model is not None
            released = self._released
            handle = Version(model, vertex)
            vertex.handle = weakref.ref(handle, lambda _: released.append(vertex))
            self._held += 1
        return handle

    def _settle(self) -> None:
        """Free what nobody holds any more, and stop recording when nobody can go anywhere."""
        while self._released:
            vertex = self._released.pop()
            self._held -= 1
            self._prune(vertex)
        if not self._held and not self._stack and self._store.recording:
            self._store.recording = False
            self._store.journal.clear()
            self._current = None

    def _reduce(self, current: Vertex) -> None:
        """Shorten the last two segments, if long, by walking them there and back."""
        path = [current] if current.parent is None else [current, current.parent]
        while path and not path[-1].overgrown:
            path.pop()
        for vertex in (*path, *reversed(path)):
            vertex.turn()

    def _prune(self, vertex: Vertex | None) -> None:
        """Drop a vertex that is neither held nor current nor a fork, and what it alone kept."""
        while vertex is not None and vertex is not self._current and not vertex.held:
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

    def check_integrity(self) -> None:
        """Assert that the tree hangs together, and holds nothing that could have been freed."""
        assert self._store.recording or not (self._store.journal or self._held or self._stack)
        assert len(self._store.journal) % 4 == 0
        path = []
        vertex = self._current
        while vertex is not None:
            path.append(vertex)
            vertex = vertex.parent
        held = 0
        found = path[-1:]
        for vertex in found:
            found.extend(vertex.children)
            held += vertex.held
            self._check_vertex(vertex, vertex in path)
        assert held <= self._held <= held + len(self._released)

    def _check_vertex(self, vertex: Vertex, on_path: bool) -> None:
        assert vertex.upwards == on_path or vertex.parent is None
        assert len(vertex.segment) % 4 == 0
        needed = vertex.held or len(vertex.children) > 1 or vertex is self._current
        assert needed or self._released, "a vertex that nobody needs"
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
    """Take a vertex with one child out of the tree; the child's segment then spans both."""
    parent = vertex.parent
    child.parent = parent
    if parent is None:
        child.segment = []
    else:
        # The vertex is not current, so both segments lead the same way. Undoing reads backwards.
        assert child.upwards == vertex.upwards
        if child.upwards:
            vertex.segment.extend(child.segment)
            child.segment = vertex.segment
        else:
            child.segment.extend(vertex.segment)
        child.spliced = True
        child.reduced = max(child.reduced, vertex.reduced)
        del parent.children[vertex]
        parent.children[child] = None
    vertex.parent = None
    vertex.children.clear()
