"""Savepoints, and the tree of versions."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from operator import length_hint
from typing import TYPE_CHECKING, Any, Final, NoReturn

from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph._journal import Journal, invert, net_changes, settle, take_back, undo
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
        children: states whose parent this is, but for one that is being made; a dict for its order.
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
    """Tells whether somebody holds a version; what is called when nobody does is told this, not the version."""

    __slots__ = ("vertex",)

    vertex: Vertex


_TRANSACTIONS: Final = {Savepoint, int}
_WRITES: Final = {type(None), tuple, Vertex}


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
        self._released: list[Handle] = []
        self._reverting: tuple[int, Iterator[Any]] | None = None
        self._inverse: Journal | None = None
        self._repairing = False
        store.interrupted.repair = self.repair

    # --- savepoints

    def savepoint(self) -> Savepoint:
        """Open a savepoint inside those that are open."""
        store = self._store
        if store.interrupted:
            self.repair()
        if self._store.loading:
            raise TransactionError("a model that is loading has no journal to roll back")
        for follower in store.followers:
            follower.settle()
        savepoint = Savepoint(len(store.journal), store.next_id, store.total)
        try:
            self._record()
            self._stack.append(savepoint)
        except BaseException:
            store.interrupted.append(savepoint)
            self.repair()
            raise
        return savepoint

    def _record(self) -> None:
        """From now on there is a state to go back to."""
        store = self._store
        store.recording = True
        store.epoch += 1

    def rollback(self, savepoint: Savepoint) -> None:
        """Back to the state at the innermost savepoint, and close it."""
        store = self._store
        if store.interrupted:
            self.repair()
        self._check_innermost(savepoint)
        try:
            changed = self._roll_back(savepoint)
        except BaseException:
            store.interrupted.extend((None, savepoint))
            self.repair()
            raise
        if changed:
            store.restored()

    def _roll_back(self, savepoint: Savepoint) -> bool:
        """Roll back to a savepoint, whatever is open inside it; whether anything had changed."""
        store, stack = self._store, self._stack
        changed = len(store.journal) > savepoint._mark
        if changed:
            self._revert(savepoint._mark)
        del stack[stack.index(savepoint) :]
        if changed:
            self._replayed(savepoint._next_id, savepoint._total)
        if not stack:
            self._settle()
        return changed

    def _revert(self, mark: int) -> None:
        """Undo and drop the entries of the journal from `mark` on."""
        journal = self._store.journal
        entries = journal[mark:]
        backwards = reversed(entries)
        self._reverting = mark, backwards
        undo(backwards)
        journal[mark:], self._reverting = (), None

    def unwind(self, depth: int) -> None:
        """Roll back until so many savepoints are open."""
        if self._store.interrupted:
            self.repair()
        if len(self._stack) > depth:
            del self._stack[depth + 1 :]
            self.rollback(self._stack[depth])

    def shelve(self, savepoint: Savepoint) -> Shelf:
        """As `rollback`, and what was taken back can be resumed."""
        store = self._store
        if store.interrupted:
            self.repair()
        for follower in store.followers:
            follower.settle()
        self._check_innermost(savepoint)
        try:
            inverse: Journal = []
            self._inverse = inverse
            invert(store.journal[savepoint._mark :], inverse)
            shelf = Shelf(inverse, store.next_id, store.total)
            store.journal[savepoint._mark :], self._inverse = (), None
            self._stack.pop()
            self._replayed(savepoint._next_id, savepoint._total)
            if not self._stack:
                self._settle()
        except BaseException:
            store.interrupted.extend((None, savepoint))
            self.repair()
            raise
        store.restored()
        return shelf

    def resume(self, shelf: Shelf) -> Savepoint:
        """Make the changes of a shelf inside a new savepoint; the state is the one in which they were made."""
        savepoint, store = self.savepoint(), self._store
        try:
            invert(shelf._entries, store.journal)
            self._replayed(shelf._next_id, shelf._total)
        except BaseException:
            store.interrupted.extend((None, savepoint))
            self.repair()
            raise
        store.restored()
        return savepoint

    def _replayed(self, next_id: int, total: int) -> None:
        store = self._store
        store.next_id = next_id
        store.total = total
        store.epoch += 1
        store.revision += 1
        for follower in store.followers[:]:
            follower.rolled_back()

    def release(self, savepoint: Savepoint) -> None:
        """Close the innermost savepoint and keep the changes."""
        if self._store.interrupted:
            self.repair()
        self._check_innermost(savepoint)
        self._stack.pop()
        if not self._stack:
            self._settle()
            self._tell_released()

    def _tell_released(self) -> None:
        for follower in self._store.followers[:]:
            follower.released()

    def _check_innermost(self, savepoint: Savepoint) -> None:
        if not self._stack or self._stack[-1] is not savepoint:
            raise TransactionError(
                "a savepoint inside this one is still open: close it first"
                if savepoint in self._stack
                else "the savepoint is closed already, or belongs to another model"
            )

    @property
    def depth(self) -> int:
        """How many savepoints are open."""
        if self._store.interrupted:
            self.repair()
        return len(self._stack)

    # --- loading

    @property
    def loading(self) -> bool:
        """Whether the model is being built without a journal."""
        return self._store.loading

    def begin_loading(self) -> None:
        """Stop recording; nothing that is done from now on can be undone."""
        if self._store.interrupted:
            self.repair()
        self._settle()
        self._refuse_inside("load")
        if self._held:
            raise TransactionError(
                "a model with versions cannot load without its journal: load before the first commit"
            )
        for follower in self._store.followers:
            follower.suspend()
        self._store.loading = True

    def end_loading(self) -> None:
        """Allow savepoints again."""
        self._store.loading = False
        for follower in self._store.followers:
            follower.loaded()

    # --- versions

    @property
    def changed(self) -> bool:
        """Whether the state differs from the current version by recorded changes, or no version describes it."""
        return self._current is None or bool(self._store.journal)

    def version(self) -> Version | None:
        """The version that the model is in, or None after uncommitted changes."""
        if self._store.interrupted:
            self.repair()
        if self._stack:
            return None
        self._settle()
        return None if self._current is None or self.changed else self._handle(self._current)

    def commit(self) -> Version:
        """Name the present state; without changes since the last version, that one."""
        if self._store.interrupted:
            self.repair()
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
        segment = store.journal[:] if before is not None else []
        vertex = Vertex(self._commits + 1, before, segment, store.next_id, store.total)
        try:
            self._record()
            if before is not None:
                before.children[vertex] = None
            self._commits = vertex.number
            store.journal[:], self._current = (), vertex
            handle = self._handle(vertex)
            if before is not None:
                self._prune(before)
        except BaseException:
            store.interrupted.append(None)
            self.repair()
            raise
        if before is not None:
            self._reduce(vertex)
        return handle

    def checkout(self, version: Version, discard: bool) -> None:
        """Go to another version along the tree."""
        if not isinstance(version, Version):
            raise InvalidArgument(f"a version is what `commit` gives, not {version!r}")
        if version.model is not self._model():
            raise TransactionError(f"{version!r} is a version of another model")
        store = self._store
        if store.interrupted:
            self.repair()
        self._refuse_inside("check out")
        self._settle()
        assert self._current is not None, "a version is held, so the present state has a place in the tree"
        if store.journal and not discard:
            raise TransactionError(
                "the model has uncommitted changes: commit them, or check out with discard=True to lose them"
            )
        if not store.journal and self._current is version._vertex:
            return
        try:
            self._check_out(version._vertex)
        except BaseException:
            store.interrupted.extend((None, version._vertex))
            self.repair()
            raise
        store.restored()

    def _check_out(self, goal: Vertex) -> None:
        store, start = self._store, self._current
        assert start is not None
        if store.journal:
            self._revert(0)
        self._walk(goal)
        store.next_id = goal.next_id
        store.total = goal.total
        store.epoch += 1
        store.revision += 1
        self._prune(start)
        for follower in store.followers[:]:
            follower.checked_out()

    def _walk(self, goal: Vertex) -> None:
        assert self._current is not None
        up, down = _path(self._current, goal)
        for vertex in up:
            self._turn(vertex, vertex.parent)
        for vertex in reversed(down):
            self._turn(vertex, vertex)

    def _turn(self, vertex: Vertex, end: Vertex | None) -> None:
        """Undo the segment of a vertex, which leads to one of its ends."""
        inverse: Journal = []
        self._inverse = inverse
        invert(vertex.segment, inverse)
        net = vertex.spliced and len(inverse) > _LONG
        segment, upwards = net_changes(inverse) if net else inverse, not vertex.upwards
        reduced = len(segment) if net else vertex.reduced
        (vertex.segment, vertex.upwards, vertex.spliced, vertex.reduced, self._current, self._inverse) = (
            segment,
            upwards,
            False,
            reduced,
            end,
            None,
        )

    @property
    def idle(self) -> bool:
        """Whether nothing is under way: no savepoint is open, nobody holds a version, and it is not loading."""
        if self._store.interrupted:
            self.repair()
        self._settle()
        return not self._stack and not self._held and not self._store.loading

    def _refuse_inside(self, action: str) -> None:
        if self._stack:
            raise TransactionError(
                f"cannot {action} inside a transaction: {len(self._stack)} savepoints are open"
            )
        if self._store.loading:
            raise TransactionError(f"cannot {action} while the model is loading")

    # --- who holds what

    def _handle(self, vertex: Vertex) -> Version:
        handle = None if vertex.handle is None else vertex.handle()
        if handle is None:
            model = self._model()
            assert model is not None
            handle = Version(model, vertex)
            try:
                vertex.handle = Handle(handle, self._released.append)
                vertex.handle.vertex = vertex
                self._held += 1
            except BaseException:
                self._store.interrupted.append(None)
                raise
        return handle

    def _settle(self) -> None:
        """Free what nobody holds any more, and stop recording when nobody can go anywhere."""
        try:
            while self._released:
                handle = self._released.pop()
                self._held -= 1
                self._prune(handle.vertex)
            if not self._held and not self._stack and self._store.recording:
                self._current = None
                self._store.recording = False
                self._store.journal.clear()
        except BaseException:
            self._store.interrupted.append(None)
            raise

    def _tidy(self) -> None:
        """Look at all vertices, after an interruption: which are held, and which nobody needs."""
        vertices = [] if self._current is None else [self._current]
        while vertices and vertices[0].parent is not None:
            vertices[0] = vertices[0].parent
        for vertex in vertices:
            vertices.extend(vertex.children)
            if vertex.handle is not None:
                vertex.handle.vertex = vertex  # if it was interrupted before it knew
        waiting = {handle.vertex for handle in self._released}
        self._held = sum(vertex.held for vertex in vertices) + len(self._released)
        for vertex in vertices:
            if vertex not in waiting:
                self._prune(vertex)
        self._settle()

    def _reduce(self, current: Vertex) -> None:
        """Shorten the last two segments, if long, by walking them there and back."""
        path = [current] if current.parent is None else [current, current.parent]
        while path and not path[-1].overgrown:
            path.pop()
        if path:
            try:
                for vertex in path:
                    self._turn(vertex, vertex.parent)
                self._walk(current)
            except BaseException:
                self._store.interrupted.extend((None, current))
                self.repair()
                raise

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

    # --- after an exception

    def repair(self) -> None:
        """Make good what exceptions have left half done; see `Interrupted`.

        What is in doubt in the journal is settled, what follows from other data is made anew, and then writes are
        finished, transactions rolled back, and checkouts finished.
        """
        if self._repairing:
            return
        store = self._store
        revision = store.revision
        try:
            self._repairing = True
            self._repair()
            self._repairing = False
        except BaseException:
            self._repairing = False
            store.interrupted.append(None)
            raise
        if store.revision != revision:
            store.restored()

    def _repair(self) -> None:
        store, goals = self._store, self._store.interrupted
        kinds = {type(goal) for goal in goals}
        if kinds - _TRANSACTIONS:
            self._settle_journal()
            for follower in store.followers[:]:
                follower.interrupted()
        torn = kinds & _WRITES
        if torn:
            store.derive()
        for goal in goals:
            if isinstance(goal, tuple):
                write, arguments = goal
                write(*arguments)
        for goal in goals:
            if isinstance(goal, Savepoint) and goal in self._stack:
                self._roll_back(goal)
            elif isinstance(goal, int) and len(self._stack) > goal:
                self._roll_back(self._stack[goal])
            elif isinstance(goal, Vertex):
                self._check_out(goal)
        if torn:
            store.recording = True  # until it turns out that nobody can go back
            self._tidy()
        goals.clear()

    def _settle_journal(self) -> None:
        """Nothing is in doubt: an interrupted replay is undone, an interrupted rollback has just so much left to do."""
        journal = self._store.journal
        take_back(self._inverse or [], 0)
        if self._reverting is not None:
            mark, backwards = self._reverting
            del journal[mark + length_hint(backwards) + 4 :]
            self._reverting = None
        settle(journal)

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
        child.segment, child.parent, child.spliced, child.reduced = whole, parent, spliced, reduced
    if parent is not None:
        parent.children[child] = None
        parent.children.pop(vertex, None)
    vertex.parent = None
    vertex.children.clear()
