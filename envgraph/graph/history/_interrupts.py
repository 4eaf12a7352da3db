"""Ctrl-C at a place of our choice: for exceptions anywhere else there is `History.repair`."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import wraps
from importlib import import_module
from types import FrameType
from typing import Any, Final, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_signals: Final[Any] = import_module(
    "_signal"
)  # what `signal` is made of: its functions take ten times as long
_SIGINT: Final = int(signal.SIGINT)
_USUAL: Final = signal.default_int_handler
_WITH: Final = (contextlib.__file__, __file__)
"""Where Ctrl-C waits."""


def guarded(function: Callable[P, Iterator[T]]) -> Callable[P, AbstractContextManager[T]]:
    """As `contextlib.contextmanager`, for generators that Ctrl-C must not keep from being resumed: see `guard`."""

    @contextmanager
    @wraps(function)
    def made(*arguments: P.args, **named: P.kwargs) -> Iterator[T]:
        outermost = guard()
        try:
            yield from function(*arguments, **named)
        finally:
            if outermost:
                unguard()

    return made


class _Guard:
    """What Ctrl-C does inside a guarded block; `waiting` if it has come."""

    __slots__ = ("waiting",)

    def __init__(self) -> None:
        self.waiting = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.waiting or frame is None or frame.f_code.co_filename not in _WITH:
            self.waiting = False
            _USUAL(number, frame)
        self.waiting = True


_guard: Final = _Guard()


def guard() -> bool:
    """Ctrl-C does not come between a `with` statement and its generator until `unguard`; False if nothing is different.

    Python looks for signals where a function begins, such as `__exit__`; what the block should have ended would go on.
    There Ctrl-C waits for the end of the block; anywhere else it takes effect at once. Nothing is different inside
    another guarded block, where Ctrl-C does something else than to raise `KeyboardInterrupt`, and in other threads than
    the main one.
    """
    if _signals.getsignal(_SIGINT) is not _USUAL:
        return False
    try:
        _signals.signal(_SIGINT, _guard)
    except ValueError:  # another thread
        return False
    return True


def unguard() -> None:
    """Ctrl-C has its usual effect again, and now if it has waited."""
    if _signals.getsignal(_SIGINT) is _guard:
        _signals.signal(_SIGINT, _USUAL)
    if _guard.waiting:
        _guard.waiting = False
        raise KeyboardInterrupt


@contextmanager
def deferred() -> Iterator[Callable[[], None]]:
    """Ctrl-C does not break into what happens inside the block.

    It takes effect in the next call of the function that is given, or at the end of the block; the second one takes
    effect at once. Where Ctrl-C does something else than to raise `KeyboardInterrupt`, or in other threads than the
    main one, nothing is different.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before not in (_USUAL, _guard):
        yield lambda: None
        return
    waiting = False

    def wait(number: int, frame: FrameType | None) -> None:
        nonlocal waiting
        if waiting:
            _USUAL(number, frame)
        waiting = True

    def check() -> None:
        if waiting:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, wait)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()
