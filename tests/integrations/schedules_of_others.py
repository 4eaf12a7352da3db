"""Schedules in Stable-Baselines3, Syllabus and RLlib, as documented: `make test-integrations` installs and runs them.

It is no `test_*.py`: `make test` needs none of them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.env.schedules import Outcomes, Weighted
from tests.integrations.documented import run_section

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
    success, members = run_section("howto/stable-baselines3.md", {})
    assert success == "1.0\n" and "E5" in members
    assert told == set(range(6))


@pytest.mark.parametrize(
    ("package", "heading", "last"),
    [("syllabus", "## Syllabus", "## RLlib"), ("ray.rllib", "## RLlib", "")],
    ids=["syllabus", "rllib"],  # `make test-integrations` runs the last one by its name
)
def test_a_schedule_says_what_is_played(package: str, heading: str, last: str, told: set[int]) -> None:
    """What the page says, after its first section: a family, and an environment that goes by a schedule."""
    pytest.importorskip(package, exc_type=ImportError)
    names: dict[str, object] = {}
    run_section(ELSEWHERE, names, last="## Syllabus")
    assert told == set()
    run_section(ELSEWHERE, names, heading, last)
    assert told == {0, 1, 2}


def test_rllib_learns_with_the_documented_masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray.rllib", exc_type=ImportError)
    monkeypatch.chdir(tmp_path)
    assert run_section("howto/rllib.md", {}) == ["True\n"]
