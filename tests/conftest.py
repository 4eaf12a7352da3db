"""Hypothesis profiles: `default` repeats the same examples, `nightly` looks for new ones."""

import gc
import os
import shutil
import signal
import tempfile
from datetime import timedelta

from hypothesis import HealthCheck, settings

# No deadline: the first example pays for imports and generated code. The limit per test is pytest's business.
settings.register_profile(
    "default", max_examples=50, derandomize=True, database=None, deadline=None, print_blob=True
)
settings.register_profile(
    "nightly",
    derandomize=False,
    max_examples=5_000,
    stateful_step_count=200,
    deadline=timedelta(minutes=10),  # of a machine that may have other things to do
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)
# An explicit --hypothesis-profile is loaded after this.
settings.load_profile("default")


_CACHE = tempfile.mkdtemp(prefix="envgraph-cache-")


def pytest_configure() -> None:
    """Ctrl-C can be tested in a job of the background too, where shells have it ignored.

    Tables of states are kept for this run of the tests alone: the next one may be of another version.
    """
    os.environ["ENVGRAPH_CACHE"] = _CACHE
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    """Nothing is left behind."""
    shutil.rmtree(_CACHE, ignore_errors=True)


def pytest_collection_finish() -> None:
    """Modules and tests are here to stay: the garbage collector need not look at them, nor so often at the rest."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)
