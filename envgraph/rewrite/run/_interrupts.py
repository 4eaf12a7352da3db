"""Ctrl-C at a place of our choice."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def deferred() -> Iterator[Callable[[], None]]:
    """Ctrl-C does not break into what happens inside the block, where it might leave half a change behind.

    It takes effect in the next call of the function that is given, or at the end of the block; the second one takes
    effect at once. Where Ctrl-C does something else than to raise `KeyboardInterrupt`, or in other threads than the
    main one, nothing is different.
    """
    usual = signal.default_int_handler
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not usual
    ):
        yield lambda: None
        return
    waiting = False

    def wait(number: int, frame: FrameType | None) -> None:
        nonlocal waiting
        if waiting:
            usual(number, frame)
        waiting = True

    def check() -> None:
        if waiting:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, wait)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, usual)
    check()
