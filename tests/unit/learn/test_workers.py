"""Worker processes whose parent is killed, or which are killed themselves."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from joblib import parallel_config

from envgraph.errors import EnvgraphError
from envgraph.learn import FamilyMember, RunResult, TrainingSettings, run_experiment
from tests.unit.learn.small_tables import random_table

FAMILY = [FamilyMember(f"E{number}", random_table(number)) for number in (1, 2, 3)]
SETTINGS = TrainingSettings(steps_per_environment=400, evaluation_episodes=20, limit=25, checkpoint=100, seeds=3)
SHARED = Path("/dev/shm")

_KILLED = """
import multiprocessing, os, signal
from envgraph.learn import run_experiment
from tests.unit.learn.test_workers import FAMILY, SETTINGS

def kill(result):
    print(["no", "one", "two"][len(multiprocessing.active_children())], "workers", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)

run_experiment(FAMILY, SETTINGS, workers=2, backend="python", found=kill)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no process can be killed outright")
def test_workers_of_a_killed_process_end_and_close_their_pipes() -> None:
    """A pipe ends when the last process that holds it ends; loky's trackers of shared memory hold standard error."""
    killed = subprocess.Popen(
        [sys.executable, "-c", _KILLED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    output, messages = killed.communicate(timeout=30)
    assert (killed.returncode, output) == (-signal.SIGKILL, "two workers\n"), messages
    assert not [path.name for path in SHARED.glob("*") if str(killed.pid) in re.split("[-_]", path.name)[:4]]


def test_a_killed_worker_is_an_error_with_a_message() -> None:
    ended: list[RunResult] = []

    def kill_one(result: RunResult) -> None:
        ended.append(result)
        if len(ended) == 1:
            os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGTERM)

    with pytest.raises(EnvgraphError, match="a worker process died"):
        run_experiment(FAMILY, SETTINGS, seeds=range(100), workers=2, backend="python", found=kill_one)
    again = run_experiment(FAMILY, SETTINGS, workers=2, backend="python", known=ended)
    assert again == run_experiment(FAMILY, SETTINGS, backend="python")


def test_an_initializer_of_the_user_is_called_in_workers(tmp_path: Path) -> None:
    with parallel_config("loky", initializer=_note, initargs=(tmp_path,)):
        run_experiment(FAMILY, SETTINGS, workers=2, backend="python", seeds=[0])
    assert any(tmp_path.iterdir())


def _note(directory: Path) -> None:
    (directory / str(os.getpid())).touch()
