"""The protocol of listeners to changes of a model, and the list of interrupted writes that must be repaired."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol


class Interrupted(list[Any]):
    """A list of writes that exceptions such as `KeyboardInterrupt` have interrupted, until `repair` empties it.

    Code that catches an exception in the middle of a write (`except BaseException`) first appends how to end the write,
    and then calls `repair`. If `repair` is interrupted too, the next use of the model calls it again.
    Each entry is one of:

    - None, if a single change was interrupted, or a `Follower` while it handled the change;
    - a function and its arguments, which may be called if its work is already done fully, partly or not at all;
    - a savepoint to roll back to and close, or an int, the number of savepoints to leave open;
    - a vertex of the version tree to check out.

    Attributes:
        repair: see `History.repair`.
    """

    __slots__ = ("repair",)

    repair: Callable[[], None]


class Follower(Protocol):
    """A listener that keeps its own data consistent with a model, as views do.

    A follower is notified of changes through the callbacks that it registers in the store (`Relation.added` and
    `removing`, `Store.value_added` and `value_removing`, `class_added` and `class_removing`, `retyping`). `added`
    callbacks run after a fact is inserted, `removing` callbacks before a fact is deleted. A follower records the
    changes of its own data in the journal, so that a rollback undoes them.
    """

    def settle(self) -> None:
        """Process all pending changes now, because a savepoint or a commit follows."""

    def rolled_back(self) -> None:
        """Discard all pending changes after a rollback, which has already restored the data recorded in the journal."""

    def released(self) -> None:
        """Handle the successful end of the outermost transaction, or a commit of the current state."""

    def checked_out(self) -> None:
        """Discard all pending changes after a checkout, which has already replayed the data recorded in the journal."""

    def interrupted(self) -> None:
        """Handle an interrupted change of the model, which may have been made or not, and notified or not."""

    def suspend(self) -> None:
        """Prepare for a load of the model, during which no change is notified."""

    def loaded(self) -> None:
        """Handle the end of a load of the model."""


NodeHook = Callable[[int], object]
ValueHook = Callable[[int, Any], object]
