"""Savepoints, loads and checkouts of a model, and the repair of interrupted writes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import length_hint
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph.history._delayed_interrupts import (
    delay_interrupts,
    guarded_contextmanager,
    stop_delaying_interrupts,
)
from envgraph.graph.history._version_tree import Version, VersionTree, VersionVertex
from envgraph.graph.store._derived_data import recompute_derived_data
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import (
    Journal,
    settle_last_entry,
    undo_after_exception,
    undo_and_invert,
    undo_entries,
)

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


class Savepoint:
    """A position in the journal to which the model can be rolled back. `History.savepoint` creates it."""

    __slots__ = ("_mark", "_next_id", "_total")

    def __init__(self, mark: int, next_id: int, total: int) -> None:
        self._mark = mark
        self._next_id = next_id
        self._total = total


class UndoneChanges:
    """Changes that were undone and can be redone any number of times. `History.undo_to` creates it."""

    __slots__ = ("_entries", "_next_id", "_total")

    def __init__(self, entries: Journal, next_id: int, total: int) -> None:
        self._entries = entries
        self._next_id = next_id
        self._total = total


_TRANSACTION_KINDS: Final = {Savepoint, int}
_WRITE_KINDS: Final = {type(None), tuple, VersionVertex}


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
        self._open_savepoints: list[Savepoint] = []
        self._interrupted_rollback: tuple[int, Iterator[Any]] | None = None
        self._interrupted_inverse: Journal | None = None
        self._is_repairing = False
        store.interrupted_writes.repair = self.repair

    def _repaired_store(self) -> Store:
        """Repair interrupted writes, and return the store."""
        if self._store.interrupted_writes:
            self.repair()
        return self._store

    # --- savepoints

    def savepoint(self) -> Savepoint:
        """Open a savepoint. Savepoints nest; close the innermost first, with `rollback`, `release` or `undo_to`.

        Raises:
            TransactionError: the model is loading.
        """
        store = self._repaired_store()
        if self._store.loading:
            raise TransactionError("a savepoint cannot be opened while the model is loading: open it after the load")
        for follower in store.followers:
            follower.process_pending()
        savepoint = Savepoint(len(store.journal), store.next_id, store.hash_sum)
        try:
            store.recording = True  # from now on changes can be undone
            store.epoch += 1
            self._open_savepoints.append(savepoint)
        except BaseException:
            store.interrupted_writes.append(savepoint)
            self.repair()
            raise
        return savepoint

    def rollback(self, savepoint: Savepoint) -> None:
        """Restore the state at the innermost savepoint exactly (ids, order, hash), and close the savepoint.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        store = self._repaired_store()
        self._check_innermost(savepoint)
        try:
            changed = self._roll_back_to(savepoint)
        except BaseException:
            store.interrupted_writes.extend((None, savepoint))
            self.repair()
            raise
        if changed:
            store.start_unknown_revision()

    def _roll_back_to(self, savepoint: Savepoint) -> bool:
        """Roll back to a savepoint and close it with all savepoints inside it. Return True if the model has changed."""
        store, stack = self._store, self._open_savepoints
        changed = len(store.journal) > savepoint._mark
        if changed:
            self._undo_from(savepoint._mark)
        while stack.pop() is not savepoint:  # after an interruption, savepoints inside it may be open too
            pass
        if changed:
            self._restore_counters(savepoint._next_id, savepoint._total)
        if not stack:
            self._free_unused()
        return changed

    def _undo_from(self, mark: int) -> None:
        """Undo the entries of the journal from index `mark` on, and remove them from the journal."""
        journal = self._store.journal
        entries = journal[mark:]
        backwards = reversed(entries)
        self._interrupted_rollback = mark, backwards
        undo_entries(backwards)
        journal[mark:], self._interrupted_rollback = (), None

    def unwind(self, depth: int) -> None:
        """Roll back the innermost savepoints, and undo their changes, until at most `depth` savepoints are open."""
        self._repaired_store()
        if len(self._open_savepoints) > depth:
            del self._open_savepoints[depth + 1 :]
            self.rollback(self._open_savepoints[depth])

    def undo_to(self, savepoint: Savepoint) -> UndoneChanges:
        """Roll back to the innermost savepoint, close it, and return the undone changes, which `redo` can redo.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        store = self._repaired_store()
        for follower in store.followers:
            follower.process_pending()
        self._check_innermost(savepoint)
        try:
            inverse: Journal = []
            self._interrupted_inverse = inverse
            undo_and_invert(reversed(store.journal[savepoint._mark :]), inverse)
            shelf = UndoneChanges(inverse, store.next_id, store.hash_sum)
            store.journal[savepoint._mark :], self._interrupted_inverse = (), None
            self._open_savepoints.pop()
            self._restore_counters(savepoint._next_id, savepoint._total)
            if not self._open_savepoints:
                self._free_unused()
        except BaseException:
            store.interrupted_writes.extend((None, savepoint))
            self.repair()
            raise
        store.start_unknown_revision()
        return shelf

    def redo(self, undone: UndoneChanges) -> Savepoint:
        """Open a savepoint, redo the changes of a shelf exactly (ids, order, hash), and return the savepoint.

        The current state must be the state at the savepoint that was given to `undo_to`. This is not checked.
        """
        savepoint, store = self.savepoint(), self._store
        try:
            undo_and_invert(reversed(undone._entries), store.journal)
            self._restore_counters(undone._next_id, undone._total)
        except BaseException:
            store.interrupted_writes.extend((None, savepoint))
            self.repair()
            raise
        store.start_unknown_revision()
        return savepoint

    def _restore_counters(self, next_id: int, total: int) -> None:
        store = self._store
        store.next_id = next_id
        store.hash_sum = total
        store.epoch += 1
        store.start_unknown_revision()
        for follower in store.followers[:]:
            follower.on_rollback()

    def release(self, savepoint: Savepoint) -> None:
        """Close the innermost savepoint and keep the changes made since. Notify followers if it was the outermost one.

        Raises:
            TransactionError: `savepoint` is not the innermost open savepoint.
        """
        self._repaired_store()
        self._check_innermost(savepoint)
        self._open_savepoints.pop()
        if not self._open_savepoints:
            self._free_unused()
            self._notify_released()

    def _notify_released(self) -> None:
        for follower in self._store.followers[:]:
            follower.on_release()

    def _check_innermost(self, savepoint: Savepoint) -> None:
        if not self._open_savepoints or self._open_savepoints[-1] is not savepoint:
            raise TransactionError(
                "a savepoint inside this one is still open: close it first"
                if savepoint in self._open_savepoints
                else "the savepoint is closed already, or belongs to another model"
            )

    @contextmanager
    def transaction(self) -> Iterator[Savepoint]:
        """Open a savepoint for a `with` block. If an exception leaves the block, undo the changes, else keep them."""
        depth, savepoint = self.savepoint_depth, None
        outermost = (
            not depth and delay_interrupts()
        )  # same as `guarded_contextmanager`, inlined because transactions are frequent
        try:
            savepoint = self.savepoint()
            yield savepoint
            self.release(savepoint)
        except BaseException:
            # If `release` raises because of a listener, the savepoint is closed already and repair does nothing.
            self._store.interrupted_writes.append(depth if savepoint is None else savepoint)
            self._store.interrupted_writes.repair()
            raise
        finally:
            if outermost:
                stop_delaying_interrupts()

    @guarded_contextmanager
    def transaction_unless_loading(self) -> Iterator[None]:
        """Run a `with` block as a transaction, or without one (nothing is undone) while the model is loading."""
        if self._store.loading:
            yield
        else:
            with self.transaction():
                yield

    @property
    def savepoint_depth(self) -> int:
        """Return the number of open savepoints."""
        self._repaired_store()
        return len(self._open_savepoints)

    # --- loading

    @guarded_contextmanager
    def load(self) -> Iterator[None]:
        """Build the model in a `with` block without a journal. The changes cannot be undone, even after an exception.

        Followers are not notified of the changes, only of the start and the end of the load.

        Raises:
            TransactionError: a savepoint is open, a version is in use, or the model is loading already.
        """
        self._repaired_store()
        self._free_unused()
        self._check_outside_transaction("load")
        if self.versions.used_count:
            raise TransactionError(
                "a model with versions cannot be loaded without a journal: load before the first commit"
            )
        store = self._store

        def end_loading() -> None:
            store.loading = False
            for follower in store.followers:
                follower.on_load_end()
            store.start_unknown_revision()

        try:
            for follower in store.followers:
                follower.on_load_start()
            store.loading = True
            yield
            end_loading()
        except BaseException:
            end_loading()
            raise

    # --- versions

    def version(self) -> Version | None:
        """Return the version of the current state, or None if the state is not committed or a savepoint is open."""
        self._repaired_store()
        if self._open_savepoints:
            return None
        self._free_unused()
        return self.versions.current_version

    def commit(self) -> Version:
        """Create a version of the current state, or return the last one if nothing has changed. Notify followers.

        Raises:
            TransactionError: a savepoint is open, or the model is loading.
        """
        store = self._repaired_store()
        self._check_outside_transaction("commit")
        self._free_unused()
        for follower in store.followers:
            follower.process_pending()
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
            raise InvalidArgument(f"`version` is {version!r}, but must be a version that `commit` has returned")
        if version.model is not self.versions.model():
            raise TransactionError(f"{version!r} is a version of another model")
        store = self._repaired_store()
        self._check_outside_transaction("check out")
        self._free_unused()
        assert self.versions.current is not None, "a version is held, so the present state has a place in the tree"
        if store.journal and not discard:
            raise TransactionError(
                "the model has uncommitted changes: commit them, or check out with discard=True to lose them"
            )
        if not store.journal and self.versions.current is version._vertex:
            return
        try:
            self._check_out(version._vertex)
        except BaseException:
            store.interrupted_writes.extend((None, version._vertex))
            self.repair()
            raise
        store.start_unknown_revision()

    def _check_out(self, goal: VersionVertex) -> None:
        store, start = self._store, self.versions.current
        assert start is not None
        if store.journal:
            self._undo_from(0)
        self.versions.move_to(goal)
        store.next_id = goal.next_id
        store.hash_sum = goal.total
        store.epoch += 1
        store.start_unknown_revision()
        self.versions.prune(start)
        for follower in store.followers[:]:
            follower.on_checkout()

    @property
    def is_idle(self) -> bool:
        """Return True if no savepoint is open, no version is in use, and the model is not loading."""
        self._repaired_store()
        self._free_unused()
        return not self._open_savepoints and not self.versions.used_count and not self._store.loading

    def _check_outside_transaction(self, action: str) -> None:
        if self._open_savepoints:
            raise TransactionError(
                f"cannot {action} inside a transaction: close the open savepoints ({len(self._open_savepoints)}) first"
            )
        if self._store.loading:
            raise TransactionError(f"cannot {action} while the model is loading")

    def _free_unused(self) -> None:
        """Free unused versions. Without open savepoints and versions in use, stop recording and clear the journal."""
        try:
            versions = self.versions
            if versions.unused_references:
                versions.free_unused()
            if not versions.used_count and not self._open_savepoints and self._store.recording:
                versions.current = None
                self._store.recording = False
                self._store.journal.clear()
        except BaseException:
            self._store.interrupted_writes.append(None)
            raise

    # --- after an exception

    def repair(self) -> None:
        """Complete or undo all interrupted writes; see `Interrupted`. Do nothing if a repair is running.

        First the last entries of the journal are repaired, then derived data are recomputed. Then writes are completed,
        transactions are rolled back, and checkouts are completed.
        """
        if self._is_repairing:
            return
        store = self._store
        revision = store.revision
        try:
            self._is_repairing = True
            self._repair_interrupted_writes()
            self._is_repairing = False
        except BaseException:
            self._is_repairing = False
            store.interrupted_writes.append(None)
            raise
        if store.revision != revision:
            store.start_unknown_revision()

    def _repair_interrupted_writes(self) -> None:
        store, goals = self._store, self._store.interrupted_writes
        kinds = {type(goal) for goal in goals}
        if kinds - _TRANSACTION_KINDS:
            self._repair_journal()
            for follower in store.followers[:]:
                follower.on_interruption()
        writes = kinds & _WRITE_KINDS
        if writes:
            recompute_derived_data(store)
        for goal in goals:
            if isinstance(goal, tuple):
                write, arguments = goal
                write(*arguments)
        for goal in goals:
            if isinstance(goal, Savepoint) and goal in self._open_savepoints:
                self._roll_back_to(goal)
            elif isinstance(goal, int) and len(self._open_savepoints) > goal:
                self._roll_back_to(self._open_savepoints[goal])
            elif isinstance(goal, VersionVertex):
                self._check_out(goal)
        if writes:
            store.recording = True  # until `_free_unused` finds that no savepoint or version is left
            self.versions.recount_and_prune()
            self._free_unused()
        goals.clear()

    def _repair_journal(self) -> None:
        """Make the journal consistent after an exception, so that the repair can continue.

        An interrupted redo, or reversal of changes between versions, is undone. After an interrupted rollback only the
        entries that are not undone yet are kept.
        """
        journal = self._store.journal
        undo_after_exception(self._interrupted_inverse or [], 0)
        self.versions.redo_interrupted_reversal()
        if self._interrupted_rollback is not None:
            mark, backwards = self._interrupted_rollback
            del journal[mark + length_hint(backwards) + 4 :]
            self._interrupted_rollback = None
        settle_last_entry(journal)

    def check_integrity(self) -> None:
        """Assert that the journal has no unneeded or incomplete entries, and that the version tree is consistent."""
        assert self._store.recording or not (self._store.journal or self.versions.used_count or self._open_savepoints)
        assert len(self._store.journal) % 4 == 0
        self.versions.check_integrity()
