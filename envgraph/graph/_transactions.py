"""Transactions and loads: what happens to a model as a whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from envgraph.graph._history import Savepoint, Shelf
from envgraph.graph._interrupts import guard, guarded, unguard
from envgraph.graph._versions import Version

if TYPE_CHECKING:
    from envgraph.graph._model import Model


def savepoint(model: Model) -> Savepoint:
    """Open a savepoint; they nest. Close it with `rollback` or `release`, innermost first.

    Raises:
        TransactionError: the model is loading.
    """
    return model._history.savepoint()


def rollback(model: Model, savepoint: Savepoint) -> None:
    """Restore the state at the innermost savepoint exactly (ids, order, hash), and close it.

    Raises:
        TransactionError: it is not the innermost open one.
    """
    model._history.rollback(savepoint)


def shelve(model: Model, savepoint: Savepoint) -> Shelf:
    """As `rollback`, and return what was undone, for `resume`.

    Raises:
        TransactionError: it is not the innermost open one.
    """
    return model._history.shelve(savepoint)


def resume(model: Model, shelf: Shelf) -> Savepoint:
    """Open a savepoint and make the changes of a shelf again, exactly (ids, order, hash).

    The state must be the one at the savepoint that was shelved: that is not checked.
    """
    return model._history.resume(shelf)


def release(model: Model, savepoint: Savepoint) -> None:
    """Close the innermost savepoint and keep what was changed since.

    Raises:
        TransactionError: it is not the innermost open one.
    """
    model._history.release(savepoint)


def unwind(model: Model, depth: int = 0) -> None:
    """Roll back until only so many savepoints are open.

    Ctrl-C may come before what `savepoint` returns has reached anybody. Then only this closes it.
    """
    model._history.unwind(depth)


@contextmanager
def transaction(model: Model) -> Iterator[Savepoint]:
    """Everything inside happens, or, if an exception leaves the block, nothing of it."""
    depth, savepoint = model._history.depth, None
    outermost = not depth and guard()  # as `guarded` does, written out because transactions are many
    try:
        savepoint = model._history.savepoint()
        yield savepoint
        model._history.release(savepoint)
    except BaseException:
        # Nothing to do if a listener raises: the transaction has ended by then.
        model.store.interrupted.append(depth if savepoint is None else savepoint)
        model.store.interrupted.repair()
        raise
    finally:
        if outermost:
            unguard()


@guarded
def all_or_nothing(model: Model) -> Iterator[None]:
    if model._history.loading:
        yield
    else:
        with model.transaction():
            yield


@guarded
def loading(model: Model) -> Iterator[None]:
    """Build a model without a journal and without notifying listeners of each change.

    The listeners hear `restored` at the end.

    Raises:
        TransactionError: a savepoint is open or a version is held; or, inside the block, a savepoint is asked for.
    """
    history, store = model._history, model.store
    if history.loading:
        history.begin_loading()  # refuses
    listeners = store.listeners[:]

    def end() -> None:
        history.end_loading()
        store.listeners[:] = [*listeners, *(each for each in store.listeners if each not in listeners)]
        store.restored()

    try:
        history.begin_loading()
        store.listeners.clear()
        yield
        end()
    except BaseException:
        end()
        raise


def commit(model: Model) -> Version:
    """Name the present state. The version lives as long as somebody holds it.

    Raises:
        TransactionError: a savepoint is open.
    """
    return model._history.commit()


def checkout(model: Model, version: Version, *, discard: bool = False) -> None:
    """Put the model into a committed state, exactly as it was then: ids, order, hash.

    Args:
        version: a version of this model.
        discard: lose uncommitted changes instead of refusing.

    Raises:
        InvalidArgument: that is no version.
        TransactionError: a version of another model, an open savepoint, or uncommitted changes.
    """
    model._history.checkout(version, discard)
