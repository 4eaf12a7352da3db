"""The tutorials, from an empty folder to trained agents; `make test-integrations` installs and runs them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.integrations.documented import run_section

pytest.importorskip("stable_baselines3")  # modules are imported in `make test`, too, for their doctests

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")


def test_the_agent_of_the_beach_solves_beaches_that_it_has_never_seen() -> None:
    names: dict[str, object] = {}
    said = run_section("tutorials/maze.md", names)
    assert said[-1].startswith("Beach: 400 environments\n")
    found = names["found"]
    assert isinstance(found, dict)
    shares = {label: result.success.mean() for label, result in found.items()}
    assert shares["random actions"] < 0.15 and shares["one beach"] < 0.2 and shares["320 beaches"] > 0.85


def test_the_curriculum_of_the_maze_teaches_tables_and_networks() -> None:
    said = run_section("tutorials/curriculum.md", {})
    assert said[-1] == "curriculum 1.0\ntarget alone 0.0\n" and len(said) == 5
