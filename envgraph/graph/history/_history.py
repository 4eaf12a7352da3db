"""Savepoints, loads and checkouts of a model, and the repair of interrupted writes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import length_hint
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph.history._interrupts import guard, guarded, unguard
from envgraph.graph.history._versions import Version, VersionTree, Vertex
from envgraph.graph.store._derived import derive
from envgraph.graph.store._journal import Journal, invert, settle, take_back, undo
from envgraph.graph.store._store import Store

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


class Savepoint:
    """A position in the journal to which the model can be rolled back. `History.savepoint` creates it."""

    __slots__ = ("_mark", "_next_id", "_total")

    def __init__(self, mark: int, next_id: int, total: int) -> None:
        self._mark = mark
        self._next_id = next_id
        self._total = total


class Shelf:
    """Changes that were undone and can be redone any number of times. `History.shelve` creates it."""

    __slots__ = ("_entries", "_next_id", "_total")

    def __init__(self, entries: Journal, next_id: int, total: int) -> None:
        self._entries = entries
        self._next_id = next_id
        self._total = total


_TRANSACTIONS: Final = {Savepoint, int}
_WRITES: Final = {type(None), tuple, Vertex}


class History:
    """The owner of a model's journal, its open savepoints and its versions.

    Invariants: the store records changes exactly if a savepoint is open or a version was in use at the last check. The
    journal contains the changes since `versions.current`, or since the outermost savepoint if `versions.current` is
    None.

    Attributes:
        versions: the tree of the states that can be checked out.
    """

    def __init__(self, model: Model, store: Store) -> None:
        self._store = store
        self.versions = VersionTree(model, store)
        self._stack: list[Savepoint] = []
        self._reverting: tuple[int, Iterator[Any]] | None = None
        self._inverse: Journal | None = None
        self._repairing = False
        store.interrupted.repair = self.repair

    def _mended(self) -> Store:
        """Repair interrupted writes, and return the store."""
        if self._store.interrupted:
            self.repair()
        return self._store

    # --- savepoints

    def savepoint(self) -> Savepoint:
        """Open a savepoint. Savepoints nest; close the innermost first, with `rollback`, `release` or `shelve`.

        Raises:
            TransactionError: the model is loading.
        """
        store = self._mended()
        if self._store.loading:
            raise TransactionError(
                "a savepoint cannot be opened while the model is loading: open it after the load"
            )
        for follower in store.followers:
            follower.settle()
        savepoint = Savepoint(len(store.journal), store.next_id, store.total)
        try:
            store.recording = True  # from now on changes can be undone
            store.epoch += 1
            self._stack.append(savepoint)
        except BaseException:
            store.interrupted.append(savepoint)
            self.repair()
            raise
        return savepoint

    def rollback(self, savepoint: Savepoint) -> None:
        """Restore the state at the innermost savepoint exactly (ids, order, hash), and close the savepoint.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        store = self._mended()
        self._check_innermost(savepoint)
        try:
            changed = self._roll_back(savepoint)
        except BaseException:
            store.interrupted.extend((None, savepoint))
            self.repair()
            raise
        if changed:
            store.replaced()

    def _roll_back(self, savepoint: Savepoint) -> bool:
        """Roll back to a savepoint and close it with all savepoints inside it. Return True if the model has changed."""
        store, stack = self._store, self._stack
        changed = len(store.journal) > savepoint._mark
        if changed:
            self._revert(savepoint._mark)
        while stack.pop() is not savepoint:  # after an interruption, savepoints inside it may be open too
            pass
        if changed:
            self._replayed(savepoint._next_id, savepoint._total)
        if not stack:
            self._settle()
        return changed

    def _revert(self, mark: int) -> None:
        """Undo the entries of the journal from index `mark` on, and remove them from the journal."""
        journal = self._store.journal
        entries = journal[mark:]
        backwards = reversed(entries)
        self._reverting = mark, backwards
        undo(backwards)
        journal[mark:], self._reverting = (), None

    def unwind(self, depth: int) -> None:
        """Roll back the innermost savepoints, and undo their changes, until at most `depth` savepoints are open."""
        self._mended()
        if len(self._stack) > depth:
            del self._stack[depth + 1 :]
            self.rollback(self._stack[depth])

    def shelve(self, savepoint: Savepoint) -> Shelf:
        """Roll back to the innermost savepoint, close it, and return the undone changes, which `resume` can redo.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        store = self._mended()
        for follower in store.followers:
            follower.settle()
        self._check_innermost(savepoint)
        try:
            inverse: Journal = []
            self._inverse = inverse
            invert(reversed(store.journal[savepoint._mark :]), inverse)
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
        store.replaced()
        return shelf

    def resume(self, shelf: Shelf) -> Savepoint:
        """Open a savepoint, redo the changes of a shelf exactly (ids, order, hash), and return the savepoint.

        The current state must be the state at the savepoint that was given to `shelve`. This is not checked.
        """
        savepoint, store = self.savepoint(), self._store
        try:
            invert(reversed(shelf._entries), store.journal)
            self._replayed(shelf._next_id, shelf._total)
        except BaseException:
            store.interrupted.extend((None, savepoint))
            self.repair()
            raise
        store.replaced()
        return savepoint

    def _replayed(self, next_id: int, total: int) -> None:
        store = self._store
        store.next_id = next_id
        store.total = total
        store.epoch += 1
        store.replaced()
        for follower in store.followers[:]:
            follower.rolled_back()

    def release(self, savepoint: Savepoint) -> None:
        """Close the innermost savepoint and keep the changes made since. Notify followers if it was the outermost one.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        self._mended()
        self._check_innermost(savepoint)
        self._stack.pop()
        if not self._stack:
            self._settle()
            self._notify_released()

    def _notify_released(self) -> None:
        for follower in self._store.followers[:]:
            follower.released()

    def _check_innermost(self, savepoint: Savepoint) -> None:
        if not self._stack or self._stack[-1] is not savepoint:
            raise TransactionError(
                "a savepoint inside this one is still open: close it first"
                if savepoint in self._stack
                else "the savepoint is closed already, or belongs to another model"
            )

    @contextmanager
    def transaction(self) -> Iterator[Savepoint]:
        """Open a savepoint for a `with` block. If an exception leaves the block, undo the changes, else keep them."""
        depth, savepoint = self.depth, None
        outermost = not depth and guard()  # same as `guarded`, inlined because transactions are frequent
        try:
            savepoint = self.savepoint()
            yield savepoint
            self.release(savepoint)
        except BaseException:
            # If `release` raises because of a listener, the savepoint is closed already and repair does nothing.
            self._store.interrupted.append(depth if savepoint is None else savepoint)
            self._store.interrupted.repair()
            raise
        finally:
            if outermost:
                unguard()

    @guarded
    def all_or_nothing(self) -> Iterator[None]:
        """Run a `with` block as a transaction, or without one (nothing is undone) while the model is loading."""
        if self._store.loading:
            yield
        else:
            with self.transaction():
                yield

    @property
    def depth(self) -> int:
        """Return the number of open savepoints."""
        self._mended()
        return len(self._stack)

    # --- loading

    @guarded
    def load(self) -> Iterator[None]:
        """Build the model in a `with` block without a journal. The changes cannot be undone, even after an exception.

        Followers are not notified of the changes, only of the start and the end of the load.

        Raises:
            TransactionError: a savepoint is open, a version is in use, or the model is loading already.
        """
        self._mended()
        self._settle()
        self._refuse_inside("load")
        if self.versions.held:
            raise TransactionError(
                "a model with versions cannot be loaded without a journal: load before the first commit"
            )
        store = self._store

        def end() -> None:
            store.loading = False
            for follower in store.followers:
                follower.loaded()
            store.replaced()

        try:
            for follower in store.followers:
                follower.suspend()
            store.loading = True
            yield
            end()
        except BaseException:
            end()
            raise

    # --- versions

    def version(self) -> Version | None:
        """Return the version of the current state, or None if the state is not committed or a savepoint is open."""
        self._mended()
        if self._stack:
            return None
        self._settle()
        return self.versions.present

    def commit(self) -> Version:
        """Create a version of the current state, or return the last one if nothing has changed. Notify followers.

        Raises:
            TransactionError: a savepoint is open, or the model is loading.
        """
        store = self._mended()
        self._refuse_inside("commit")
        self._settle()
        for follower in store.followers:
            follower.settle()
        version = self.versions.commit()
        self._notify_released()
        return version

    def checkout(self, version: Version, discard: bool) -> None:
        """Restore the state of another version, and notify followers. Do nothing if the model is in this state already.

        Args:
            version: a version of this model.
            discard: undo uncommitted changes instead of raising TransactionError.
        """
        if not isinstance(version, Version):
            raise InvalidArgument(
                f"`version` is {version!r}, but must be a version that `commit` has returned"
            )
        if version.model is not self.versions.model():
            raise TransactionError(f"{version!r} is a version of another model")
        store = self._mended()
        self._refuse_inside("check out")
        self._settle()
        assert self.versions.current is not None, (
            "a version is held, so the present state has a place in the tree"
        )
        if store.journal and not discard:
            raise TransactionError(
                "the model has uncommitted changes: commit them, or check out with discard=True to lose them"
            )
        if not store.journal and self.versions.current is version._vertex:
            return
        try:
            self._check_out(version._vertex)
        except BaseException:
            store.interrupted.extend((None, version._vertex))
            self.repair()
            raise
        store.replaced()

    def _check_out(self, goal: Vertex) -> None:
        store, start = self._store, self.versions.current
        assert start is not None
        if store.journal:
            self._revert(0)
        self.versions.walk(goal)
        store.next_id = goal.next_id
        store.total = goal.total
        store.epoch += 1
        store.replaced()
        self.versions.prune(start)
        for follower in store.followers[:]:
            follower.checked_out()

    @property
    def idle(self) -> bool:
        """Return True if no savepoint is open, no version is in use, and the model is not loading."""
        self._mended()
        self._settle()
        return not self._stack and not self.versions.held and not self._store.loading

    def _refuse_inside(self, action: str) -> None:
        if self._stack:
            raise TransactionError(
                f"cannot {action} inside a transaction: close the open savepoints ({len(self._stack)}) first"
            )
        if self._store.loading:
            raise TransactionError(f"cannot {action} while the model is loading")

    def _settle(self) -> None:
        """Free unused versions. Without open savepoints and versions in use, stop recording and clear the journal."""
        try:
            versions = self.versions
            if versions.released:
                versions.free()
            if not versions.held and not self._stack and self._store.recording:
                versions.current = None
                self._store.recording = False
                self._store.journal.clear()
        except BaseException:
            self._store.interrupted.append(None)
            raise

    # --- after an exception

    def repair(self) -> None:
        """Complete or undo all interrupted writes; see `Interrupted`. Do nothing if a repair is running.

        First the last entries of the journal are repaired, then derived data are recomputed. Then writes are completed,
        transactions are rolled back, and checkouts are completed.
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
            store.replaced()

    def _repair(self) -> None:
        store, goals = self._store, self._store.interrupted
        kinds = {type(goal) for goal in goals}
        if kinds - _TRANSACTIONS:
            self._settle_journal()
            for follower in store.followers[:]:
                follower.interrupted()
        writes = kinds & _WRITES
        if writes:
            derive(store)
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
        if writes:
            store.recording = True  # until `_settle` finds that no savepoint or version is left
            self.versions.tidy()
            self._settle()
        goals.clear()

    def _settle_journal(self) -> None:
        """Make the journal consistent after an exception, so that the repair can continue.

        An interrupted redo, or reversal of changes between versions, is undone. After an interrupted rollback only the
        entries that are not undone yet are kept.
        """
        journal = self._store.journal
        take_back(self._inverse or [], 0)
        self.versions.take_back()
        if self._reverting is not None:
            mark, backwards = self._reverting
            del journal[mark + length_hint(backwards) + 4 :]
            self._reverting = None
        settle(journal)

    def check_integrity(self) -> None:
        """Assert that the journal has no unneeded or incomplete entries, and that the version tree is consistent."""
        assert self._store.recording or not (self._store.journal or self.versions.held or self._stack)
        assert len(self._store.journal) % 4 == 0
        self.versions.check_integrity()
