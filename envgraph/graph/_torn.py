"""What an interruption, such as Ctrl-C, has left half done, and how that is finished."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Step = tuple[Callable[..., object], tuple[Any, ...]]
"""A function that finishes something, however far that has come, and its arguments."""


class Torn(list[Step]):
    """Steps that finish what was interrupted, the innermost first; empty but for the time between the two.

    Whoever catches an interruption (`except BaseException`) adds a step before anything else. A step may be interrupted
    as well: it stays until it is done, and what it adds comes before it. Steps may be made twice.
    """

    __slots__ = ("_finishing",)

    def __init__(self) -> None:
        super().__init__()
        self._finishing = False

    @property
    def finishing(self) -> bool:
        """Whether steps are being made."""
        return self._finishing

    def finish(self) -> None:
        """Make all steps; nothing if this is one of them."""
        if self._finishing:
            return
        self._finishing = True
        try:
            while self:
                known = len(self)
                try:
                    function, arguments = self[0]
                    function(*arguments)
                    del self[0]
                except BaseException:
                    self[:] = self[known:] + self[:known]
                    raise
        finally:
            self._finishing = False
