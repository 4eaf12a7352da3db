"""Audits on the command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main
from tests.profile import AT_NIGHT

Call = Callable[..., str]


@pytest.fixture
def envgraph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs a command in an empty directory; what it prints, or, where it is to fail, all that it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: object, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *map(str, arguments)])
        found = main()
        out, err = capsys.readouterr()
        assert found == code, out + err
        return out if code == 0 else out + err

    return run


def test_invalid_arguments_are_reported_before_any_file_is_written(envgraph: Call, tmp_path: Path) -> None:
    assert "did you mean `PLR, MaxMC`?" in envgraph("audit", "network", "--methods", "PLR, MaxCM", code=1)
    assert "use a bundled domain with one: `burning_forest`" in envgraph("audit", "railway", code=1)
    assert "did you mean `network`?" in envgraph("audit", "netwrok", code=1)
    assert "have the same name" in envgraph("audit", "network", "network", code=1)
    assert "did you mean `held_out`?" in envgraph("audit", "network", "--set", "audit.hold_out=3", code=1)
    assert not [*tmp_path.iterdir()]


def test_check_reports_errors_in_the_audit_table(envgraph: Call, tmp_path: Path) -> None:
    envgraph("new", "street")
    family = tmp_path / "street" / "family.toml"
    family.write_text(family.read_text() + '\n[audit]\nsees = ["nothing"]\n')
    said = envgraph("check", "street", code=1)
    assert "unknown pattern `nothing`" in said
    assert '| sees = ["nothing"]' in said


@AT_NIGHT
def test_an_audit_resumes_and_does_not_depend_on_the_number_of_workers(envgraph: Call, tmp_path: Path) -> None:
    few = ("--seeds", 2, "--steps", 40_000, "--methods", "DR, solvable only; PLR, MaxMC; SFL, 4 rollouts")
    small = [word for key in ("levels=200", "held_out=20", "probed=20") for word in ("--set", f"audit.{key}")]
    envgraph("audit", "network", *few, *small, "-d", "one")
    printed = envgraph("audit", "network", *few, *small, "-d", "two", "--workers", 2, "--format", "json")
    for name in ("claims", "methods", "runs", "curves", "levels", "rankings"):
        one, two = (tmp_path / place / f"{name}.csv" for place in ("one", "two"))
        assert one.read_text() == two.read_text()
    assert (tmp_path / "one" / "audit.html").read_text() == (tmp_path / "two" / "audit.html").read_text()
    for path in [*(tmp_path / "two" / "Routing" / "runs").iterdir()][:3]:
        path.unlink()
    again = envgraph("audit", "network", *few, *small, "-d", "two", "--format", "json")
    assert json.loads(again) == json.loads(printed)
    assert "contains another audit" in envgraph("audit", "network", "--steps", 50_000, *small, "-d", "two", code=1)
