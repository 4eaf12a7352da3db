"""The examples in the documentation that train on plans of levels; `make test-integrations` runs them."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib")

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LEVELS = "######\n#@ $.#\n######\n\n#######\n#   # #\n# $  .#\n#@    #\n#######\n"


@pytest.mark.parametrize(
    ("example", "numbers", "first", "last"),
    [
        ("backwards.py", ["24000", "32"], "2 members, 5 starts", "24000 steps: 2 of 2 members are solved mostly: "),
        ("from_plans.py", ["400", "100", "8"], "2 plans, 6 actions", "400 steps: 2 of 2 members are solved mostly: "),
    ],
)
def test_it_learns_to_solve_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, example: str, numbers: list[str], first: str, last: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("two.xsb").write_text(LEVELS, "utf-8")
    run = partial(subprocess.run, capture_output=True, text=True, check=True)
    run([sys.executable, "-m", "envgraph", "import", "two.xsb", "--to", "family"])
    said = run([sys.executable, str(EXAMPLES / example), "two", "2", *numbers]).stdout.splitlines()
    assert (said[0], said[-1]) == (first, last + "E1 E2")
