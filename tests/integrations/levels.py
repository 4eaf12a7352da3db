"""The example in the documentation that trains on levels backwards; `make test-integrations` runs it."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib")

BACKWARDS = Path(__file__).parents[2] / "docs" / "examples" / "backwards.py"


def test_it_learns_levels_from_their_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("two.xsb").write_text("######\n#@ $.#\n######\n\n#######\n#   # #\n# $  .#\n#@    #\n#######\n", "utf-8")
    run = partial(subprocess.run, capture_output=True, text=True, check=True)
    run([sys.executable, "-m", "envgraph", "import", "two.xsb", "--to", "family"])
    said = run([sys.executable, str(BACKWARDS), "two", "2", "24000", "32"]).stdout.splitlines()
    assert said[0] == "2 members, 6 starts"
    assert said[-1] == "solved in at least 5 of 10 episodes: 2 of 2 members, E1 E2"
