"""README's own street, which has no agent and says nothing about drawing, from the command line to the page."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from envgraph.cli import main

FILES = {
    "street.metamodel": "metamodel street  class Street { contains Lamp[*] lamps }  class Lamp  class Lit extends Lamp",
    "street.model": """import "street.metamodel"
        model street : street { main : Street { lamps = grid lamp { legend o = Lamp  rows "oooooooo" } } }""",
    "street.query": "pattern lit(lamp : Lit) { Lit(lamp); }",
    "street.rules": "derive switch = retype among { Lamp, Lit };",
    "family.toml": """
        model = "street.model"
        imports = ["street.query", "street.rules"]
        measures.light = { kind = "count", of = "lit" }
        diversity = { kind = "binned_entropy", range = [0, 8] }
        mutation.rules = ["switch"]""",
}


def write_street(directory: Path) -> Path:
    """Write the files; the family file."""
    for name, text in FILES.items():
        (directory / name).write_text(text)
    return directory / "family.toml"


def test_a_street_is_shown_exported_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *arguments])
        assert main() == 0
        return capsys.readouterr().out

    run("generate", str(write_street(tmp_path)), "--name", "street", "--generations", "2")
    shown = run("show", "street")
    assert "│ main : Street" in shown
    assert "bits" in shown.splitlines()[0]
    assert ".000" not in shown.split("\n", 1)[1]
    assert run("export", "street", "--format", "svg").count("main : Street") == 6
    run("report", "street", "-o", "street.html")
    page = (tmp_path / "street.html").read_text()
    assert page.count("main : Street") == 6
    assert page.count("<svg") == page.count('role="img"') == page.count("aria-label=") == 8
    assert " bits" in page
