"""Delay Ctrl-C in places where no code can catch its exception. Elsewhere `History.repair` handles exceptions."""

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

_signal_module: Final[Any] = import_module("_signal")  # the C functions behind `signal`, which are ten times as fast
_SIGINT: Final = int(signal.SIGINT)
_DEFAULT_HANDLER: Final = signal.default_int_handler
_DELAYING_FILES: Final = (contextlib.__file__, __file__)
"""The files in whose functions Ctrl-C is delayed."""


def guarded_contextmanager(function: Callable[P, Iterator[T]]) -> Callable[P, AbstractContextManager[T]]:
    """Decorate a generator function as `contextlib.contextmanager` does, and delay Ctrl-C as `delay_interrupts`
    describes.
    """

    @contextmanager
    @wraps(function)
    def guarded(*arguments: P.args, **named: P.kwargs) -> Iterator[T]:
        outermost = delay_interrupts()
        try:
            yield from function(*arguments, **named)
        finally:
            if outermost:
                stop_delaying_interrupts()

    return guarded


class _DelayingHandler:
    """The handler of Ctrl-C that `delay_interrupts` installs. `waiting` is True if Ctrl-C was pressed and is
    delayed.
    """

    __slots__ = ("waiting",)

    def __init__(self) -> None:
        self.waiting = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self.waiting or frame is None or frame.f_code.co_filename not in _DELAYING_FILES:
            self.waiting = False
            _DEFAULT_HANDLER(number, frame)
        self.waiting = True


_delaying_handler: Final = _DelayingHandler()


def delay_interrupts() -> bool:
    """Delay Ctrl-C in the code between a `with` statement and its generator, until `stop_delaying_interrupts` is
    called.

    Python handles signals where a function begins, such as `__exit__`. A KeyboardInterrupt there would skip the rest of
    the generator. So Ctrl-C waits for the end of the block at these places, and takes effect at once anywhere else.

    Return False, and change nothing, if a guarded block is running already, if Ctrl-C has a handler other than
    Python's, or outside the main thread. Else return True.
    """
    if _signal_module.getsignal(_SIGINT) is not _DEFAULT_HANDLER:
        return False
    try:
        _signal_module.signal(_SIGINT, _delaying_handler)
    except ValueError:  # not the main thread
        return False
    return True


def stop_delaying_interrupts() -> None:
    """Restore the usual handler of Ctrl-C, and raise KeyboardInterrupt if Ctrl-C was pressed and delayed."""
    if _signal_module.getsignal(_SIGINT) is _delaying_handler:
        _signal_module.signal(_SIGINT, _DEFAULT_HANDLER)
    if _delaying_handler.waiting:
        _delaying_handler.waiting = False
        raise KeyboardInterrupt


@contextmanager
def defer_interrupts() -> Iterator[Callable[[], None]]:
    """Delay Ctrl-C until the end of a `with` block or the next call of the yielded function.

    Then KeyboardInterrupt is raised. A second Ctrl-C takes effect at once. Nothing is changed if Ctrl-C has a handler
    other than Python's, and outside the main thread.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before not in (
        _DEFAULT_HANDLER,
        _delaying_handler,
    ):
        yield lambda: None
        return
    waiting = False

    def wait(number: int, frame: FrameType | None) -> None:
        nonlocal waiting
        if waiting:
            _DEFAULT_HANDLER(number, frame)
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
