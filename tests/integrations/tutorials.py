"""The tutorials, from an empty folder to trained agents; `make test-integrations` installs and runs them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.integrations.documented import run_section
from tests.unit.test_docs import ROOT, blocks

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
    # The edits that section 6 of the other tutorial asks for.
    for name, line, other in (
        ("beach.environment", "    observe around crab 5 x 5\n", ""),
        ("family.toml", "samples.count = 400", 'objective = { kind = "learning" }'),
    ):
        text = Path(name).read_text("utf-8")
        assert line in text
        Path(name).write_text(text.replace(line, other), "utf-8")
    words = [sys.executable, "-m", "envgraph", "generate", ".", "--name", "curriculum"]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    shown = [block.text for block in blocks(ROOT / "docs/tutorials/curriculum.md") if block.text.startswith("Beach")]
    assert printed == shown[0]
    words = [*words[:3], "train", "curriculum", "--seeds", "100", "--seed-offset", "1000"]
    best = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()[0]
    assert best.endswith("the curriculum E1-E6, 100 % of 100 agents; next backplay, 4 %.")


def test_the_curriculum_of_the_maze_teaches_tables_and_networks() -> None:
    said = run_section("tutorials/curriculum.md", {}, last="## 6. A target")
    assert said[-1] == "curriculum 1.0\ntarget alone 0.0\n" and len(said) == 5
