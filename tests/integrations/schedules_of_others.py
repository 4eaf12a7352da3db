"""Schedules in Stable-Baselines3, Syllabus and RLlib, as documented: `make test-integrations` installs and runs them.

It is no `test_*.py`: `make test` needs none of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import envgraph
from envgraph.env.schedules import Outcomes, Weighted, named_schedule
from envgraph.search import generate, write_family
from tests.integrations.documented import run_section

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


@pytest.mark.parametrize(
    ("package", "first", "last"),
    [
        ("stable_baselines3", "# Schedules in other code bases", "**[Syllabus]"),
        ("syllabus", "**[Syllabus]", "**RLlib.**"),
        ("ray.rllib", "**RLlib.**", "`envgraph train --controls plr"),
    ],
    ids=["stable_baselines3", "syllabus", "rllib"],  # `make test-integrations` runs the last one by its name
)
def test_a_schedule_says_what_is_played(
    package: str, first: str, last: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the page says, after what it has said before: a family, and an environment that goes by a schedule."""
    pytest.importorskip(package, exc_type=ImportError)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"names": ["E1", "E2", "E3"]}
    run_section("python/schedules.md", names)
    told: set[int] = set()
    tell = Weighted.tell

    def noted(self: Weighted, outcomes: Outcomes) -> None:
        told.update(outcomes.members.tolist())
        tell(self, outcomes)

    monkeypatch.setattr(Weighted, "tell", noted)
    run_section("howto/schedules-elsewhere.md", {**names, "named_schedule": named_schedule}, first, last)
    assert told == {0, 1, 2}


def test_rllib_learns_with_the_documented_masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray.rllib", exc_type=ImportError)
    import gymnasium

    monkeypatch.chdir(tmp_path)
    family = generate("burning_forest/paper.toml", Path("run.sqlite"), seed=2, generations=30)
    Path("family.json").write_text(write_family(family))
    names = {"envgraph": envgraph, "np": np, "gymnasium": gymnasium}
    assert run_section("howto/rllib.md", names) == ["True\n"]
