"""A file of the wrong kind: every command says what the file is, and what it wants."""

from __future__ import annotations

import shutil
import sqlite3
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from envgraph.cli import main
from envgraph.lang import bundled_domain

FILES = {
    "m.metamodel": "a metamodel",
    "m.ecore": "a metamodel",
    "other.xml": "a metamodel",
    "a.model": "a model",
    "a.xmi": "a model",
    "a.burningforest": "a model",
    "emf.model": "a model",
    "a.xsd": "an XML Schema",
    "schema.xml": "an XML Schema",
    "a.json": "a file of JSON",
    "q.query": "a file of patterns",
    "q.vql": "a file of patterns",
    "r.rules": "a file of rules",
    "e.environment": "an environment",
    "f.toml": "a family file",
    "family.json": "a family as JSON",
    "t.trace": "a trace",
    "run.sqlite": "a run store",
    "notes.txt": "of an unknown format",
    "picture.png": "of an unknown format",
}
MODELS = ("a.model", "a.xmi", "a.burningforest", "emf.model", "a.json")
DEFINITIONS = ("q.query", "q.vql", "r.rules", "e.environment")

TAKES = {
    "match FILE q.query p": ("a model (.model, .xmi, .json)", (*MODELS, "f.toml")),
    "match a.model FILE p": ("a file of patterns or rules (.query, .vql, .rules)", DEFINITIONS),
    "match a.model q.query p -m FILE": (
        "a metamodel (.metamodel, .ecore)",
        ("m.metamodel", "m.ecore", "other.xml"),
    ),
    "replay a.model r.rules FILE": ("a trace, which `envgraph apply --trace` writes", ("t.trace",)),
    "generate FILE": ("a family file", ("f.toml",)),
    "import FILE": ("a ga4cl family", ("a.json", "notes.txt")),
    "export FILE": ("a run (run.sqlite) or a family as JSON", ("run.sqlite", "family.json", "a.json")),
}


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str], str]:
    """Runs a command beside files of all kinds; what it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    forest = bundled_domain("burning_forest")
    for name in FILES:
        Path(name).touch()
    for name, of in (("m.metamodel", "burning_forest.metamodel"), ("a.model", "running_4x4.model")):
        shutil.copy(forest / of, name)
    shutil.copy("m.metamodel", "burning_forest.metamodel")
    Path("q.query").write_text('import "m.metamodel"')
    Path("a.json").write_text('{"format": "envgraph-model-1"}')
    Path("new.json").write_text('{"environments": []}')
    Path("family.json").write_text('{\n "format": "envgraph-family-1"}')
    Path("t.trace").write_text('{"format": "envgraph-trace-1"}')
    Path("a.burningforest").write_text('<!-- a model --><b:Forest xmlns:b="b"/>')
    Path("emf.model").write_text('<?xml version="1.0"?>\n<b:Forest xmlns:b="b"/>')
    Path("other.xml").write_bytes(
        '<?xml version="1.0" encoding="UTF-16"?><e:EPackage xmlns:e="http://www.eclipse.org/emf/2002/Ecore"/>'.encode(
            "utf-16"
        )
    )
    Path("schema.xml").write_text('<xs:schema\n  xmlns:xs="http://www.w3.org/2001/XMLSchema"/>')
    Path("notes.txt").write_text("hello")
    Path("picture.png").write_bytes(bytes(range(128, 256)))
    with sqlite3.connect("run.sqlite") as db:
        db.execute("CREATE TABLE setting (key)")
    db.close()

    def run(command: str) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *command.split()])
        with suppress(SystemExit):
            main()
        return "".join(capsys.readouterr())

    return run


@pytest.mark.parametrize("command", TAKES)
def test_a_file_of_the_wrong_kind_is_reported_with_the_expected_kind(call: Callable[[str], str], command: str) -> None:
    wanted, right = TAKES[command]
    for name, what in FILES.items():
        said = call(command.replace("FILE", name))
        assert (f"is {what}, not {wanted}" in said) == (name not in right), said


def test_every_command_reports_files_of_the_wrong_kind(call: Callable[[str], str]) -> None:
    definitions = "is a model, not a file of patterns or rules (.query, .vql, .rules)"
    run = "is a file of patterns, not a run (run.sqlite) or a family as JSON"
    for command, said in {
        "apply q.query r.rules r": "is a file of patterns, not a model (.model, .xmi, .json)",
        "apply a.model a.model r": definitions,
        "replay a.model a.model t.trace": definitions,
        "convert q.query new.xmi": "is a file of patterns, not a model (.model, .xmi, .json)",
        "import new.json --domain q.query": "is a file of patterns, not a family file",
        "train q.query": run,
        "report q.query": run,
        "show q.query": "is not a run, model or metamodel; use `envgraph check q.query` to check it",
        "show f.toml": "is a family file, not a run (run.sqlite) or a family as JSON",
    }.items():
        assert said in call(command)


def test_an_xmi_model_is_recognized_by_its_root_element(call: Callable[[str], str]) -> None:
    for name in ("a.burningforest", "emf.model"):
        said = call(f"check {name} -m m.metamodel")
        assert "has no namespace `b`" in said and f"{name}:" in said
        assert "hint: give a metamodel with this namespace too; the given one has `burning_forest`" in said
        assert "no metamodel with the namespace `b` is given" in call(f"check {name}")
    Path("plain.xml").write_text("<forests/>")
    assert 'declares no namespace: write `xmlns:m="burning_forest"` in the first tag' in call(
        "check plain.xml m.metamodel"
    )
    for name in ("a.xsd", "schema.xml"):
        said = call(f"check {name}")
        assert f"{name}:1:1: `{name}` is an XML Schema, not a file in a language of envgraph" in said
        assert "hint: convert it to an `.ecore` file first, for example with EMF" in said
    assert "`family.json` is a family as JSON, not a file in a language of envgraph" in call("check family.json")
    assert "`run.sqlite` is a run store, not a file in a language of envgraph" in call("check run.sqlite")
    assert "`picture.png` is not a file in a language of envgraph" in call("check picture.png")
    assert "`picture.png` is not a file in a language of envgraph" in call("format picture.png")
