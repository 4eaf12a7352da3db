"""Schedules in Stable-Baselines3, Syllabus and RLlib, as documented: `make test-integrations` installs and runs them.

It is no `test_*.py`: `make test` needs none of them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.env.schedules import Outcomes, Weighted
from tests.integrations.documented import run_example, run_section

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix

ELSEWHERE = "howto/schedules-elsewhere.md"


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """The members whose outcomes a weighted schedule is told, in a new directory."""
    found: set[int] = set()
    tell = Weighted.tell

    def noted(self: Weighted, outcomes: Outcomes) -> None:
        found.update(outcomes.members.tolist())
        tell(self, outcomes)

    monkeypatch.setattr(Weighted, "tell", noted)
    monkeypatch.chdir(tmp_path)
    return found


def test_stable_baselines3_plays_what_a_schedule_says(told: set[int]) -> None:
    pytest.importorskip("stable_baselines3", exc_type=ImportError)
    success, members, watched = run_section("howto/stable-baselines3.md", {})
    assert success == "1.0\n" and "E5" in members and watched.endswith("14 True\n")
    assert told == set(range(6))


def test_syllabus_plays_what_a_schedule_says(told: set[int]) -> None:
    pytest.importorskip("syllabus", exc_type=ImportError)
    run_section(ELSEWHERE, {}, last="```python")
    assert run_example("syllabus_members.py", "fires", "E1", "E2", "E3") == "played E1 E2 E3\n"
    assert told == {0, 1, 2}


def test_rllib_plays_what_a_schedule_says(told: set[int]) -> None:
    """The environment of the page: it goes by a schedule."""
    ray = pytest.importorskip("ray", exc_type=ImportError)
    pytest.importorskip("ray.rllib", exc_type=ImportError)
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.tune.registry import register_env

    names: dict[str, object] = {}
    run_section(ELSEWHERE, names, last="## Syllabus")
    assert told == set()
    register_env("taught", names["taught"])
    config = PPOConfig().environment("taught", env_config={"family": str(Path("runs/fires").resolve())})
    config = config.env_runners(num_env_runners=0)
    config = config.training(train_batch_size_per_learner=256, minibatch_size=64, num_epochs=1)
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)
    algorithm = config.build_algo()
    assert algorithm.train()["env_runners"]["num_episodes"] > 0
    algorithm.stop()
    ray.shutdown()
    assert told == {0, 1, 2}


def test_rllib_learns_with_the_documented_masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray.rllib", exc_type=ImportError)
    monkeypatch.chdir(tmp_path)
    assert run_section("howto/rllib.md", {}) == ["True\n"]
