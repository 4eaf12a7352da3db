"""Generating and training on a real local Ray and Dask: `make test-cluster`, which installs them, runs this file.

It is no `test_*.py`: `make test` needs neither of them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest
from joblib import parallel_config

from envgraph.cli import main
from envgraph.learn import Experiment, FamilyMember, RunResult, TrainingSettings, run_experiment
from envgraph.search import open_family, write_family
from tests.unit.learn.small_tables import random_table

FAMILY = [FamilyMember(f"E{number}", random_table(number)) for number in (1, 2, 3)]
SETTINGS = TrainingSettings(steps_per_environment=400, evaluation_episodes=20, limit=25, checkpoint=100, seeds=3)


@contextmanager
def on_ray() -> Iterator[None]:
    import ray
    from ray.util.joblib import register_ray

    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        register_ray()
        with parallel_config("ray"):
            yield
    finally:
        ray.shutdown()


@contextmanager
def on_dask() -> Iterator[None]:
    from dask.distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster),
        parallel_config("dask"),
    ):
        yield


@pytest.mark.filterwarnings("default")  # theirs, not ours to fix
@pytest.mark.parametrize("cluster", [on_ray, on_dask])
def test_a_cluster_gives_what_one_process_gives(cluster: object) -> None:
    alone = run_experiment(FAMILY, SETTINGS, backend="python")
    ended: list[RunResult] = []
    with cluster():  # type: ignore[operator]
        found = run_experiment(FAMILY, SETTINGS, workers=2, backend="python", found=ended.append)
        resumed = run_experiment(FAMILY, SETTINGS, workers=2, backend="python", known=ended[:7])
    assert isinstance(found, Experiment) and found == resumed == alone
    assert sorted(map(str, ended)) == sorted(map(str, found.runs))


@contextmanager
def on_scheduler(kind: str) -> Iterator[str]:
    """Yield the address of a scheduler for `--cluster`."""
    if kind == "ray":
        yield "ray"
        return
    from dask.distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address.replace("tcp:", "dask:")


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("kind", ["dask", "ray"])
@pytest.mark.parametrize("what", ["samples", "evolution", "learners"])
def test_generate_on_a_cluster_gives_the_bytes_of_one_process(kind: str, what: str, tmp_path: Path) -> None:
    chance = 'measures.chance={ kind = "random_success", otherwise = 0.0 }'
    options = {
        "samples": ["burning_forest/paper.toml", "--samples", "40", "--set", chance],
        "evolution": ["burning_forest/paper.toml", "--generations", "3"],
        "learners": ["burning_forest", "--set", "objective.effort=2_000_000"],
    }[what]
    with on_scheduler(kind) as address:
        for place, where in (("alone", []), ("cluster", ["--cluster", address])):
            command = ["generate", *options, "--seed", "3", "--directory", str(tmp_path / place), "--name", "run"]
            with patch.object(sys, "argv", ["envgraph", *command, *where]):
                assert main() == 0
    alone, cluster = (tmp_path / place / "run" / "run.sqlite" for place in ("alone", "cluster"))
    assert write_family(open_family(alone)) == write_family(open_family(cluster))
