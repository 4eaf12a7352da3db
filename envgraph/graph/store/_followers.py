"""The base class of listeners to changes of a model, and the list of interrupted writes that must be repaired."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class InterruptedWrites(list[Any]):
    """A list of writes that exceptions such as `KeyboardInterrupt` have interrupted, until `repair` empties it.

    Code that catches an exception in the middle of a write (`except BaseException`) first appends an entry that says
    how to end the write, and then calls `repair`. If `repair` is interrupted too, the next use of the model calls it
    again. Each entry is one of:

    - None, if a single change was interrupted;
    - a `Follower`, if it was interrupted while it updated its own data;
    - a tuple of a function and its arguments, to call again. The function must accept that its work is done partly;
    - a `Savepoint` to roll back to and close, or an int: savepoints are rolled back until this number is open;
    - a vertex of the version tree, whose state is to be checked out.

    Attributes:
        repair: see `History.repair`.
    """

    __slots__ = ("repair",)

    repair: Callable[[], None]

    def run(self, function: Callable[..., None], *arguments: object) -> None:
        """Call a function that writes; after an exception, end its work by another call, and raise the exception."""
        try:
            function(*arguments)
        except BaseException:
            self.append((function, arguments))
            self.repair()
            raise


class Follower:
    """The base class of listeners that keep their own data consistent with a model, as views do.

    A follower is notified of changes through the callbacks that it registers in the store (`Relation.added` and
    `removing`, `Store.value_added` and `value_removing`, `class_added` and `class_removing`, `retyping`). `added`
    callbacks run after a fact is inserted, `removing` callbacks before a fact is deleted. A follower records the
    changes of its own data in the journal, so that a rollback undoes them.
    """

    def process_pending(self) -> None:
        """Process all pending changes of the model. Called before a savepoint, a commit, and `History.shelve`."""

    def on_rollback(self) -> None:
        """Discard pending changes, after a rollback or redo has restored the data recorded in the journal."""

    def on_release(self) -> None:
        """Deliver waiting notifications, after the outermost savepoint is released or a commit is made."""

    def on_checkout(self) -> None:
        """Discard pending changes, and notify any subscribers, after a checkout has restored the recorded data."""

    def on_interruption(self) -> None:
        """Mark the follower's own data as unreliable, after an exception has interrupted a change of the model.

        The change may have been made or not, and the follower may have been notified or not.
        """

    def on_load_start(self) -> None:
        """Prepare for a load of the model, whose changes are not notified to the follower."""

    def on_load_end(self) -> None:
        """Recompute the follower's own data, if necessary, at the end of a load, also after an exception."""


NodeCallback = Callable[[int], object]
ValueCallback = Callable[[int, Any], object]
