"""Hypothesis profiles: `default` repeats the same examples, `nightly` looks for new ones."""

import gc
import os
import shutil
import signal
import sys
import tempfile
from datetime import timedelta
from hashlib import sha256
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# No deadline: the first example pays for imports and generated code. The limit per test is pytest's business.
settings.register_profile("default", max_examples=15, derandomize=True, database=None, deadline=None, print_blob=True)
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


def pytest_configure(config: pytest.Config) -> None:
    """Ctrl-C can be tested in a job of the background too, where shells have it ignored.

    Tables of states and of grammars are kept for this run of the tests alone, the next one may be of another version;
    the processes of a run share them. Most of what tests make is freed without the garbage collector.
    """
    gc.set_threshold(200_000)
    if _is_first(config):
        os.environ["ENVGRAPH_CACHE"] = tempfile.mkdtemp(prefix="envgraph-cache-")
        by_day = not config.getoption("--hypothesis-profile")  # the programs of a night are new ones
        if by_day and hasattr(config, "cache"):  # else `-p no:cacheprovider`
            _keep_machine_code(config.cache.mkdir("machine-code"))
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_runtest_teardown() -> None:
    """Set the usual handler of Ctrl-C again: a test that interrupts a block everywhere may leave that of the block.

    Programs and families that later calls of `make` would share are dropped, because tests replace what makes them.
    """
    shared = sys.modules.get("envgraph.search.families._lazy_family")
    if shared is not None:
        shared._shared_families.clear()
        shared._shared_program.cache_clear()
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure(config: pytest.Config) -> None:
    """Nothing is left behind."""
    if _is_first(config):
        shutil.rmtree(os.environ["ENVGRAPH_CACHE"], ignore_errors=True)


def _keep_machine_code(folder: Path) -> None:
    """Let the next run load what this one compiles, unless what compiles is changed; `--cache-clear` deletes it.

    Machine code is found by the text that it was compiled from, and by the version of numba. What is found by less than
    that, such as the options for numba, is in the files whose checksum names the directory.
    """
    compiling = sorted((Path(__file__).parents[1] / "envgraph" / "env" / "compiled").glob("*.py"))
    version = folder / sha256(b"".join(file.read_bytes() for file in compiling)).hexdigest()[:32]
    for other in folder.iterdir():
        if other != version:
            shutil.rmtree(other, ignore_errors=True)
    version.mkdir(exist_ok=True)
    Path(os.environ["ENVGRAPH_CACHE"], "programs").symlink_to(version)


def _is_first(config: pytest.Config) -> bool:
    """Whether this is the process that starts the others, which get its environment."""
    return not hasattr(config, "workerinput")


def pytest_collection_finish() -> None:
    """Modules and tests are here to stay: the garbage collector need not look at them."""
    gc.collect()
    gc.freeze()
