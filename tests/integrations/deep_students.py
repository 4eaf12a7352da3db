"""`envgraph train --student`: PPO and DQN of Stable-Baselines3; `make test-integrations` installs and runs it."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envgraph.cli import main
from envgraph.env import Tabular
from envgraph.learn import (
    Curriculum,
    Epsilon,
    FamilyMember,
    RunResult,
    TrainingJournal,
    TrainingSettings,
    run_experiment,
)
from envgraph.search import generate

pytest.importorskip("stable_baselines3")

STUDENTS = ("sb3:ppo", "sb3:dqn")
STEPS = 303
"""No multiple of what is between two updates of either."""

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


def corridor(length: int, start: int) -> Tabular:
    """The goal is at the right end; observed are the place and a component that never changes."""
    places = np.arange(length)
    following = np.stack([np.maximum(places - 1, 0), np.minimum(places + 1, length - 1)], axis=1)[:, :, None]
    ended = (following == length - 1) & (places < length - 1)[:, None, None]
    return Tabular(
        next_state=following.astype(np.int32),
        probability=np.ones(following.shape),
        reward=ended.astype(np.float64),
        terminated=ended.astype(np.int8),
        observation=places.astype(np.int64),
        start_states=np.array([start], np.int32),
        start_probability=np.ones(1),
        n_observations=length * 2,
        observation_shape=(length, 2),
        action_names=("left", "right"),
    )


FAMILY = [FamilyMember("near", corridor(6, 4)), FamilyMember("far", corridor(6, 0))]
CURRICULA = [
    Curriculum("curriculum", "near-far", ("near", "far"), (1, 1)),
    Curriculum("control", "far", ("far",), (2,)),
    Curriculum("control", "randomised", (("near", "far"),), (2,)),
    Curriculum("control", "robust_plr", (("near", "far"), "far"), (1, 1), schedule="robust_plr"),
]


def settings(student: str) -> TrainingSettings:
    base = TrainingSettings(steps_per_environment=STEPS, limit=20, checkpoint=100, epsilon=Epsilon(decay=0.97))
    return replace(base, student=student)  # type: ignore[arg-type]


@pytest.mark.parametrize("student", STUDENTS)
def test_all_ways_have_exactly_as_many_steps_and_a_seed_gives_one_result(student: str) -> None:
    found = run_experiment(FAMILY, settings(student), CURRICULA, seeds=[0, 1])
    assert {run.steps for run in found.runs} == {2 * STEPS}
    for run in found.runs:
        curve = run.curve
        assert curve.steps[-1] == 2 * STEPS and curve.episodes[-1] == run.episodes > 2 * STEPS / 20 - 2
        if run.label in ("near-far", "far"):
            ends = {
                "near-far": (100, 200, 300, STEPS, 403, 503, 603, 606),
                "far": (*range(100, 601, 100), 606),
            }
            assert curve.steps == ends[run.label]
        assert curve.reward[-1] == curve.successes[-1] > 0, "a success is a reward of 1"
    assert all(run.success_rate == 1.0 and run.mean_length == 5.0 for run in found.runs if run.label == "near-far")
    again = run_experiment(FAMILY, settings(student), CURRICULA[:1], seeds=[1], workers=1)
    assert again.runs == tuple(run for run in found.runs if (run.label, run.seed) == ("near-far", 1))
    first, second = (run for run in found.runs if run.label == "near-far")
    assert first.curve != second.curve


def test_processes_change_no_result() -> None:
    alone, beside = (
        run_experiment(FAMILY, settings("sb3:ppo"), CURRICULA[:1], seeds=[0, 1], workers=workers) for workers in (1, 2)
    )
    assert alone == beside


@pytest.mark.parametrize("student", STUDENTS)
def test_a_resumed_training_has_the_same_results_byte_for_byte(
    student: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs" / "forest").mkdir(parents=True)
    generate("burning_forest", Path("runs/forest/run.sqlite"), generations=1, population=2)

    def train(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["envgraph", "train", "forest", *words])
        return main()

    def results() -> dict[str, bytes]:
        base = Path("runs/forest/training")
        return {str(path.relative_to(base)): path.read_bytes() for path in sorted(base.rglob("*.csv"))}

    begin = ("--student", student, "--steps", "130", "--seeds", "1", "--curricula", "full,direct")
    assert train(*begin) == 0
    said = capsys.readouterr()
    assert f"`{student}` has no table of values: `optimistic` is skipped" in said.err
    assert f"agents on E2, {student}" in said.out and "optimistic" not in said.out
    whole = results()
    assert len(whole) == 6 and all(name.startswith(student.replace(":", "-")) for name in whole)
    for name in whole:
        (Path("runs/forest/training") / name).unlink()
    with interrupted(after=3, monkeypatch=monkeypatch):
        assert train(*begin) == 130
    assert train("--resume", "--student", "tabular") == 1
    assert f"the interrupted training has other student: `{student}`, not `tabular`" in capsys.readouterr().err
    assert train("--resume") == 0
    assert results() == whole


class interrupted:
    """Ctrl-C comes when so many agents have ended."""

    def __init__(self, after: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self._left, self._patch, self._add = after, monkeypatch, TrainingJournal.add

    def __enter__(self) -> None:
        def counted(journal: TrainingJournal, part: str, target: str, result: RunResult) -> None:
            if not self._left:
                raise KeyboardInterrupt
            self._left -= 1
            self._add(journal, part, target, result)

        self._patch.setattr(TrainingJournal, "add", counted)

    def __exit__(self, *_: object) -> None:
        self._patch.setattr(TrainingJournal, "add", self._add)
