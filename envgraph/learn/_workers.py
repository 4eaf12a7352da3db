"""Run tasks in worker processes that end with their parent, and report a worker that dies as an error."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import parent_process
from threading import Thread
from typing import Any, TypeVar

from envgraph.errors import EnvgraphError

T = TypeVar("T")

_CHECK_INTERVAL = 0.2
"""Seconds between two checks that the parent is alive; a check takes a microsecond."""


def run_in_workers(
    function: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    workers: int,
    *,
    threads: bool = False,
    hint: str = "use fewer `workers`, which need less memory",
) -> Iterator[T]:
    """Yield the result of the function for each tuple of arguments, in the order in which the calls end.

    With one worker, the calls run in this process.

    Raises:
        EnvgraphError: a worker process died. `hint` is the advice that the error shows.
    """
    from joblib import Parallel, delayed
    from joblib.parallel import get_active_backend

    if workers == 1:
        yield from (function(*task) for task in tasks)
        return
    options: dict[str, Any] = {"n_jobs": workers, "prefer": "threads" if threads else "processes"}
    if "initializer" not in getattr(get_active_backend()[0], "backend_kwargs", ()):
        options["initializer"] = end_with_parent  # keeps the user's initializer of `parallel_config`
    parallel = partial(Parallel, **options)
    try:
        try:
            pool = parallel(return_as="generator_unordered")
        except ValueError:  # Ray returns only whole lists: ask for as many tasks as run at a time
            for first in range(0, len(tasks), workers):
                yield from parallel()(delayed(function)(*task) for task in tasks[first : first + workers])
        else:
            yield from pool(delayed(function)(*task) for task in tasks)
    except BrokenProcessPool as error:
        message = "a worker process died, perhaps because memory ran out"
        raise EnvgraphError(message, hint) from error


def end_with_parent() -> None:
    """Start a thread that ends this worker process soon after its parent, even if the parent is killed.

    A worker of a cluster has no parent that Python knows, so it is not ended. The kernel's signal for a dead parent
    (`PR_SET_PDEATHSIG`) does not help: it is sent when the thread that started the worker ends.
    """
    parent = parent_process()
    if parent is not None:
        Thread(target=_exit_after_parent, args=(parent.pid,), daemon=True).start()


def _exit_after_parent(parent: int | None) -> None:
    while os.getppid() == parent:
        time.sleep(_CHECK_INTERVAL)
    os._exit(1)  # the main thread may wait for ever: for a lock or a pipe of the parent
