"""Training on a real local Ray and a real local Dask: `make test-cluster`, which installs them, runs this file.

It is no `test_*.py`: `make test` needs neither of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from joblib import parallel_config

from envgraph.learn import Experiment, FamilyMember, RunResult, TrainingSettings, run_experiment
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
