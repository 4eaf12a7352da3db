"""Run tasks in worker processes, on this machine or on a cluster, and report a worker that dies as an error."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import starmap
from multiprocessing import parent_process
from threading import Thread
from typing import Any, TypeVar

from envgraph.errors import EnvgraphError, InvalidArgument

T = TypeVar("T")

_CONNECTION_TIMEOUT = 10
"""Seconds to wait for a cluster to answer."""

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


@contextmanager
def cluster_workers(address: str | None, workers: int) -> Iterator[int]:
    """Return a context in which `run_in_workers` uses a cluster. It yields the number of the cluster's workers.

    Args:
        address: `dask://HOST:PORT` of a scheduler; `ray://HOST:PORT`, or `ray` for the cluster that this machine
            belongs to, or else for the cores of this machine. None: no cluster.
        workers: the number to yield without a cluster.

    Raises:
        InvalidArgument: the address is of neither kind, Dask or Ray is not installed, or nothing answers there.
    """
    if address is None:
        yield workers
        return
    kind = address.partition(":")[0]
    connect = {"dask": _connect_dask, "ray": _connect_ray}.get(kind)
    if connect is None:
        hint = "write `dask://HOST:PORT`, `ray://HOST:PORT` or `ray`"
        raise InvalidArgument(f"`{address}` is no address of a cluster", hint)
    with ExitStack() as stack:
        try:
            found = connect(address, stack)
        except ImportError as error:
            raise InvalidArgument(f"`{kind}` is not installed", f'`pip install "envgraph[{kind}]"`') from error
        except (OSError, ValueError, ConnectionError) as error:
            raise InvalidArgument(f"no cluster answers at `{address}`: {error}") from error
        yield max(1, found)


def _connect_dask(address: str, stack: ExitStack) -> int:
    from dask.distributed import Client
    from joblib import parallel_config

    client = stack.enter_context(Client(address.replace("dask:", "tcp:", 1), timeout=_CONNECTION_TIMEOUT))
    stack.enter_context(parallel_config("dask"))
    return sum(client.nthreads().values())


def _connect_ray(address: str, stack: ExitStack) -> int:
    import ray
    from joblib import parallel_config
    from ray.util.joblib import register_ray

    ray.init(None if address == "ray" else address, include_dashboard=False, log_to_driver=False)
    stack.callback(ray.shutdown)
    register_ray()
    stack.enter_context(parallel_config("ray"))
    return int(ray.cluster_resources().get("CPU", 1))


def ordered_starmap(workers: int) -> Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterable[Any]]:
    """Return a `starmap` for functions that spend their time outside Python: on the cluster in use, else in threads."""
    from joblib import Parallel, delayed
    from joblib.parallel import get_active_backend

    if workers == 1:
        return starmap
    if type(get_active_backend()[0]).__module__ == "joblib._parallel_backends":  # this machine
        pool = ThreadPoolExecutor(workers)
        return lambda function, tasks: pool.map(function, *zip(*tasks, strict=True))
    return lambda function, tasks: Parallel(n_jobs=workers)(delayed(function)(*one) for one in tasks)


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
