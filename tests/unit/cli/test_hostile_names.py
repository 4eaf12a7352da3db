"""Names that a terminal, a browser or a spreadsheet would obey, through the commands that show them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from envgraph.cli import main
from envgraph.search import generate, write_family

EVIL = "\x1b]0;own\x07<script>alert('&\")</script>\x9b31m\n\u202e"
FORMULA = "=cmd|' /C calc'!A0"

Shown = Callable[..., str]


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shown:
    """Runs a command; what it prints, on either stream, holds no character that a terminal would obey."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *arguments])
        try:
            ended = main()
        except SystemExit as stop:
            ended = int(stop.code or 0)
        out, err = capsys.readouterr()
        assert ended == code, err
        assert all(c.isprintable() or c == "\n" for c in out + err), repr(out + err)
        return out + err

    return run


@pytest.fixture
def town(tmp_path: Path) -> None:
    (tmp_path / "town.metamodel").write_text(
        "metamodel town  class Town { contains House[*] houses }  class House { string name }  class Mill extends House"
    )
    (tmp_path / "town.query").write_text(
        'import "town.metamodel"\npattern house(h : House, n : string) { House.name(h, n); }\n'
    )
    (tmp_path / "town.rules").write_text(
        'import "town.metamodel"\n'
        "rule call { lhs { h : House; t : Town; } modify { create t -houses-> new : House { name = h.name }; } }\n"
        "derive build = retype among { House, Mill };\n"
    )
    model = {
        "format": "envgraph-model-1",
        "metamodel": "town",
        "name": EVIL,
        "objects": [
            {"id": 0, "class": "Town", "name": "t", "features": {"houses": [1]}},
            {"id": 1, "class": "House", "name": EVIL, "features": {"name": EVIL}},
        ],
    }
    (tmp_path / "town.json").write_text(json.dumps(model))


def test_models_are_shown_without_control_characters(town: None, shown: Shown) -> None:
    for format in ("text", "json"):
        text = shown("match", "town.json", "town.query", "house", "--format", format)
        assert "script" in text
        assert "script" in shown("apply", "town.json", "town.rules", "call", "--format", format)
    assert json.loads(shown("match", "town.json", "town.query", "house", "--format", "json"))[0]["n"] == EVIL
    assert "script" in shown("why-not", "town.json", "town.query", "house")
    assert "house" in shown("explain", "town.json", "town.query", "house")
    assert "is not a file" in shown("match", EVIL, EVIL, "house", code=1)
    assert "no object" in shown("match", "town.json", "town.query", "house", "-w", f"h={EVIL[::-1]}", code=1)


@pytest.fixture(scope="module")
def evolved(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A family as JSON."""
    return write_family(
        generate(
            "burning_forest/paper.toml",
            tmp_path_factory.mktemp("run") / "run.sqlite",
            generations=0,
            population=3,
        )
    )


@pytest.fixture
def family(tmp_path: Path, evolved: str) -> None:
    """A family file whose members, measure and texts have such names."""
    data = json.loads(evolved)
    [toml] = [name for name in data["texts"] if name.endswith(".toml")]
    quoted = json.dumps(EVIL)
    text = data["texts"][toml].replace("measures.complexity", f"measures.{quoted}")
    data["texts"][toml] = text.replace('= "complexity"', f"= {quoted}")
    data["name"] = EVIL
    for member, name in zip(data["members"], (EVIL, FORMULA, "E3"), strict=True):
        member["name"] = name
        member["measures"] = {EVIL: member["measures"]["complexity"]}
    (tmp_path / "family.json").write_text(json.dumps(data))


def test_families_are_shown_without_control_characters(family: None, shown: Shown, tmp_path: Path) -> None:
    for format in ("text", "json"):
        assert "script" in shown("show", "family.json", "--format", format)
    for format in ("family", "ga4cl", "svg"):
        shown("export", "family.json", "--format", format)
    shown("show", "family.json", "--variant", EVIL[::-1], code=1)


def test_pictures_and_pages_hold_names_as_text(family: None, shown: Shown, tmp_path: Path) -> None:
    shown("export", "family.json", "--format", "svg", "-o", "family.svg")
    picture = (tmp_path / "family.svg").read_text()
    assert "<script" not in picture
    assert "<script>" in "".join(ElementTree.fromstring(picture).itertext())
    shown("report", "family.json", "-o", "family.html")
    page = (tmp_path / "family.html").read_text()
    assert page.count("<script") == page.count('<script id="sorting">') == 1
    assert "&lt;script&gt;" in page
    assert all(c.isprintable() or c in "\n\u2009" for c in page)


def test_exported_packages_hold_names_as_text(family: None, shown: Shown, tmp_path: Path) -> None:
    shown("export", "family.json", "--format", "python", "-o", "fires")
    files = [path for path in (tmp_path / "fires").rglob("*") if path.suffix in (".py", ".md", ".toml", ".json")]
    assert len(files) == 6
    for path in files:
        text = path.read_text("utf-8")
        assert all(c.isprintable() or c == "\n" for c in text), path
    page = (tmp_path / "fires" / "README.md").read_text("utf-8")
    assert "<script" not in page.replace("\\<script", "")
    made = "import fires; print([int(fires.make(name).reset(seed=0)[0]) for name in fires.MEMBERS])"
    run = [sys.executable, "-c", made]
    done = subprocess.run(run, cwd=tmp_path / "fires" / "src", capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("[0, 0, 0]\n", "")


def test_csv_results_escape_formulas_and_are_read_back(family: None, shown: Shown, tmp_path: Path) -> None:
    shown("train", "family.json", "--steps", "50", "--seeds", "1")
    files = list((tmp_path / "family").rglob("*.csv"))
    assert len(files) == 6
    text = "".join(file.read_text() for file in files)
    assert FORMULA in text
    assert not [line for line in text.splitlines() for cell in line.split(",") if cell.startswith(("=", "@"))]
    assert FORMULA in shown("report", "family.json", "-o", "page.html")
