"""Stop a call that runs in a thread, such as a search for matches that would take hours."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from threading import Lock, get_ident
from typing import Generic, TypeVar

Result = TypeVar("Result")


class StoppedError(Exception):
    """An error raised to stop work whose result nobody waits for any more."""


class TookTooLongError(StoppedError):
    """An error raised to stop work that took longer than its time limit."""


class StoppableCall(Generic[Result]):
    """A call of a function without arguments, which another thread can stop while it runs.

    The exception is raised inside the function between two instructions of Python, as Ctrl-C does it in the main
    thread. Models repair what it interrupts.

    >>> StoppableCall(lambda: 7)()
    7
    """

    def __init__(self, function: Callable[[], Result]) -> None:
        self._function = function
        self._lock = Lock()
        self._thread: int | None = None
        self._stopped: type[StoppedError] | None = None

    def __call__(self) -> Result:
        """Return the result of the function. Call this once.

        Raises:
            StoppedError: the call was stopped.
        """
        with self._lock:
            if self._stopped is not None:
                raise self._stopped
            self._thread = get_ident()
        try:
            return self._function()
        finally:
            try:
                with self._lock:
                    self._thread = None
                for _ in range(100):  # an exception that is under way arrives with the first repetition
                    pass
            except StoppedError:
                pass

    def stop(self, error: type[StoppedError] = StoppedError) -> None:
        """Raise an error in the call, if it runs or has not begun."""
        with self._lock:
            if self._stopped is None:
                self._stopped = error
                if self._thread is not None:
                    _raise_in_thread(self._thread, error)

    async def run_in(self, pool: Executor | None, seconds: float | None) -> Result:
        """Return the result of the function, which runs in a thread of a pool, until this task is cancelled.

        Args:
            pool: None for the default pool of asyncio.
            seconds: the time limit, from now on; None for no limit.

        Raises:
            TookTooLongError: the time is over.
            StoppedError: the call was stopped.
        """
        loop = asyncio.get_running_loop()
        timer = loop.call_later(seconds, self.stop, TookTooLongError) if seconds is not None else None
        try:
            return await loop.run_in_executor(pool, self)
        except asyncio.CancelledError:
            self.stop()
            raise
        finally:
            if timer is not None:
                timer.cancel()


def _raise_in_thread(thread: int, error: type[StoppedError]) -> None:
    """Raise an error in another thread with its next instruction.

    It cannot be taken back: without an error, CPython 3.11 would look for one at every instruction from then on, and
    never end where a profiler or tracer is set.
    """
    from ctypes import c_ulong, py_object, pythonapi  # not in the worker of a page without a server

    pythonapi.PyThreadState_SetAsyncExc(c_ulong(thread), py_object(error))
