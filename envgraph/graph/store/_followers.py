"""Followers of the changes of a model, and the note of what exceptions leave half done."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol


class Interrupted(list[Any]):
    """What exceptions have left half done, such as that of Ctrl-C; empty but for the time until it is made good.

    Whoever catches an exception in the middle of a write (`except BaseException`) adds how it is to be ended, before
    anything else is called, and then calls `repair`. If that is interrupted, too, the next use of the model does it.
    What is added is one of:

    - None, if it was a single change, and what follows the model (a `Follower`), if it was what that does;
    - a function and its arguments, which may be called when some, all or none of it is done already;
    - a savepoint to roll back to and close, or (an int) how many to leave open;
    - a version to go to.

    Attributes:
        repair: see `History.repair`.
    """

    __slots__ = ("repair",)

    repair: Callable[[], None]


class Follower(Protocol):
    """What keeps something current with a model, such as views do.

    It is notified of changes through the functions that it registers in the store (`Relation.added` and `removing`,
    `Store.value_added` and `value_removing`, `class_added` and `class_removing`, `retyping`): `added` after the fact
    has been inserted, `removing` before it is deleted. What it does then is recorded in the journal, so that a
    rollback undoes it.
    """

    def settle(self) -> None:
        """Work off what is pending: a savepoint or a commit follows."""

    def rolled_back(self) -> None:
        """A rollback has restored everything that was recorded: what is pending is void."""

    def released(self) -> None:
        """The outermost transaction has ended well, or the present state has become a version."""

    def checked_out(self) -> None:
        """The model is in another version, and what was recorded has been replayed: what is pending is void."""

    def interrupted(self) -> None:
        """A change has been interrupted, before or after the notification or meanwhile: it may be made or not."""

    def suspend(self) -> None:
        """The model is about to be loaded: nobody will be notified of changes."""

    def loaded(self) -> None:
        """The load has ended."""


NodeHook = Callable[[int], object]
ValueHook = Callable[[int, Any], object]
