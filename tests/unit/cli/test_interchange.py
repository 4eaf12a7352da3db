"""`.ecore`, `.xmi` and `.vql` files on the command line."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from envgraph.cli import main
from envgraph.graph import model_to_xmi
from envgraph.lang import bundled_domain, load_workspace

DATA = Path(__file__).parents[2] / "data" / "emf"
RAILWAY = (DATA / "railway.xmi", DATA / "railway.vql")
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command in an empty directory: exit code, output, messages."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def run_it(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["envgraph", *map(str, arguments)])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return run_it


def test_json_matches_contain_class_id_and_attributes_of_objects(run: Run) -> None:
    code, out, _ = run("match", *RAILWAY, "posLength", "--metamodel", DATA / "railway.ecore", "--format", "json")
    matches: list[dict[str, Any]] = json.loads(out)
    assert code == 0
    first = matches[0]["segment"]
    assert (first["class"], first["attributes"]) == ("Segment", {"id": 52, "length": -5})
    assert isinstance(first["id"], int) and matches[0]["length"] == -5


def test_warnings_of_queries_are_counted_on_standard_error(run: Run, tmp_path: Path) -> None:
    queries = tmp_path / "long.query"
    queries.write_text("pattern long(segment : Segment, length) { Segment.length(segment, length); }\n")
    plain = "match", DATA / "railway.xmi", queries, "long", "-m", DATA / "railway.ecore"
    for arguments in (plain, (*plain, "--format", "json")):
        code, out, err = run(*arguments)
        assert code == 0
        command = f"check {DATA / 'railway.ecore'} {queries}"
        assert err == f"1 warning: `envgraph {command}` shows it\n"
        assert "warning: no type declared for `length`, inferred `int`" in run(*command.split())[2]
        assert "warning" not in out
    assert isinstance(json.loads(out), list)
    model = tmp_path / "railway.json"
    run("convert", DATA / "railway.xmi", model, "-m", DATA / "railway.ecore")
    assert "1 warning: " in run("match", model, *plain[2:])[2]


def test_the_table_names_objects_by_their_key(run: Run) -> None:
    code, out, _ = run("match", *RAILWAY, "switchMonitored", "-m", DATA / "railway.ecore")
    assert code == 0
    assert "1 match of switchMonitored" in out and "Switch {id = 42}" in out


def test_a_missing_metamodel_gets_a_hint_to_the_option(run: Run) -> None:
    code, _, err = run("match", *RAILWAY, "posLength")
    assert code == 1
    assert "no metamodel has the uri `http://www.semanticweb.org/ontologies/2015/trainbenchmark`" in err
    assert "--metamodel" in err and err.count("hint:") == 1


def test_a_missing_model_is_the_only_error_where_it_may_have_named_the_metamodel(run: Run) -> None:
    code, _, err = run("match", DATA / "none.xmi", DATA / "railway.vql", "posLength")
    assert code == 1
    assert "none.xmi:1:1: there is no such file" in err and "no metamodel has the uri" not in err


def test_a_model_that_names_its_metamodel_needs_no_option(run: Run) -> None:
    code, out, _ = run("match", DATA / "library.xmi", DATA / "library.vql", "freeBook")
    assert code == 0 and "Emma" in out


def test_a_written_model_names_the_metamodel_that_its_file_named(run: Run, tmp_path: Path) -> None:
    model, query = tmp_path / "written here.xmi", DATA / "library.vql"
    assert run("convert", DATA / "library.xmi", model)[0] == 0
    code, out, _ = run("match", model, query, "freeBook")
    assert code == 0 and "Emma" in out
    assert run("convert", model, tmp_path / "again.xmi")[0] == 0
    assert (tmp_path / "again.xmi").read_text() == model.read_text()
    assert "schemaLocation" not in model_to_xmi(load_workspace([str(model)]).model())


def test_a_metamodel_that_does_not_fit_the_files_is_reported(run: Run) -> None:
    code, _, err = run("match", *RAILWAY, "posLength", "-m", DATA / "library.ecore")
    assert code == 1
    assert "no namespace `http://www.semanticweb.org" in err and "no metamodel has the uri" in err


def test_metamodels_and_models_are_converted(run: Run, tmp_path: Path) -> None:
    assert run("convert", DATA / "railway.ecore", "a/r.ecore") == (0, "wrote a/r.ecore\n", "")
    assert run("convert", DATA / "railway.xmi", "r.json", "-m", "a/r.ecore")[0] == 0
    assert run("convert", "r.json", "r.xmi", "-m", "a/r.ecore")[0] == 0
    arguments = ("switchSet", "-m", "a/r.ecore", "--format", "json")
    matches = [run("match", model, DATA / "railway.vql", *arguments)[1] for model in (RAILWAY[0], "r.json", "r.xmi")]
    assert matches[0] == matches[1] == matches[2] and json.loads(matches[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("railway.xmi", "out.xml"), "cannot be written; did you mean `.xmi`?"),
        (("railway.ecore", "out.metamodel"), "a metamodel is converted to `.ecore`"),
        (("railway.xmi", "out.ecore"), "load its `.ecore` or `.metamodel` file too"),
        (("railway.vql", "out.xmi"), "is a file of patterns, not a model (.model, .xmi, .json)"),
        (("railway.ecore", "out.json"), "is a metamodel, not a model (.model, .xmi, .json)"),
        (("nothing.json", "out.xmi"), "there is no such file"),
        (("nothing.xmi", "out.json"), "there is no such file"),
    ],
)
def test_files_that_cannot_be_converted_are_refused(run: Run, arguments: tuple[str, str], message: str) -> None:
    code, out, err = run("convert", DATA / arguments[0], arguments[1])
    assert (code, out) == (1, "")
    assert message in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("railway.ecore", "railway.vql", "posLength"), "railway.ecore` is a metamodel, not a model"),
        (
            ("railway.xmi", "railway.vql", "posLength", "-m", str(DATA / "railway.vql")),
            "railway.vql` is a file of patterns, not a metamodel",
        ),
        (
            ("railway.xmi", "railway.vql", "posLength", "-m", "rail.ecore"),
            "rail.ecore:1:1: there is no such file",
        ),
    ],
)
def test_files_in_the_wrong_argument_are_refused(run: Run, arguments: tuple[str, ...], message: str) -> None:
    code, out, err = run("match", *(DATA / one if n < 2 else one for n, one in enumerate(arguments)))
    assert (code, out) == (1, "") and message in err


def test_applying_a_rule_writes_xmi(run: Run, tmp_path: Path) -> None:
    rule = 'package r\nimport "railway"\nrule longer { lhs { s : Segment; check s.length < 0; } '
    (tmp_path / "r.rules").write_text(rule + "modify { set s.length = 7; } }")
    metamodel = ("-m", DATA / "railway.ecore")
    assert run("apply", DATA / "railway.xmi", "r.rules", "longer", *metamodel, "-o", "new.xmi")[0] == 0
    assert 'length="7"' in (tmp_path / "new.xmi").read_text("utf-8")
    assert "1 match of posLength" in run("match", "new.xmi", DATA / "railway.vql", "posLength", *metamodel)[1]


def test_errors_in_json_models_are_reported_with_positions(run: Run, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text('{"format": "envgraph-model-1", "objects": [{"id": 0, "class": "Rout"}]}')
    for name, message in (
        ("bad.json", "bad.json:1:63: "),
        ("none.json", "none.json:1:1: there is no such file"),
    ):
        code, _, err = run("match", name, DATA / "railway.vql", "posLength", "-m", DATA / "railway.ecore")
        assert code == 1 and message in err
    (tmp_path / "dir.json").mkdir()
    (tmp_path / "empty.json").touch()
    for name, message in (
        ("dir.json", "the directory contains no file"),
        ("empty.json", "the file is empty"),
    ):
        code, _, err = run("match", name, DATA / "railway.vql", "posLength", "-m", DATA / "railway.ecore")
        assert code == 1 and message in err


def test_a_family_generated_from_xmi_and_ecore_files_is_the_same(run: Run, tmp_path: Path) -> None:
    directory = tmp_path / "other"
    shutil.copytree(bundled_domain("burning_forest"), directory)
    for name, converted in (("target_8x8.model", "target.xmi"), ("burning_forest.metamodel", "forest.ecore")):
        assert run("convert", directory / name, directory / converted)[0] == 0
    for path in directory.glob("*.*"):
        if path.suffix in (".model", ".metamodel"):
            path.unlink()
        else:
            text = path.read_text("utf-8").replace("target_8x8.model", "target.xmi")
            path.write_text(text.replace("burning_forest.metamodel", "forest.ecore"), "utf-8")
    family = directory / "paper.toml"
    assert run("check", family) == (0, f"no problems in {family}\n", "")
    shown = [
        run("generate", what, "--generations", 30, "--name", f"{n}")
        for n, what in enumerate((family, "burning_forest/paper.toml"))
    ]
    assert shown[0][0] == 0
    assert run("show", 0)[1] == run("show", 1)[1]


ITEMS = """<ecore:EPackage xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="m" nsURI="m" nsPrefix="m">
  <eClassifiers xsi:type="ecore:EClass" name="Item">
    <eOperations name="run"/>
    <eOperations name="stop"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="tags" upperBound="-1"
        eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EString"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="size" transient="true"
        eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EInt"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="items" upperBound="-1" containment="true" eType="#//Item"/>
  </eClassifiers>
</ecore:EPackage>
"""


def test_convert_counts_losses_and_writes_only_with_lossy(run: Run, tmp_path: Path) -> None:
    Path("m.ecore").write_text(ITEMS)
    Path("m.xmi").write_text('<m:Item xmlns:m="m" size="2"><tags>a</tags><items size="1"/><items/></m:Item>')
    code, _, err = run("convert", "m.xmi", "m.json", "-m", "m.ecore")
    assert (code, Path("m.json").exists()) == (1, False)
    assert "left out: 2 values of `Item.size`" in err
    assert "the warning says what `m.xmi` would lose; add `--lossy` to write the rest" in err
    assert run("convert", "m.xmi", "m.json", "-m", "m.ecore", "--lossy")[0] == 0
    assert '"tags": [\n     "a"\n    ]' in Path("m.json").read_text()
    Path("n.xmi").write_text('<m:Item xmlns:m="m"><tags>a</tags></m:Item>')  # nothing of this one is lost
    assert run("convert", "n.xmi", "n.json", "-m", "m.ecore")[0] == 0

    code, _, err = run("convert", "m.ecore", "n.ecore")
    assert (code, Path("n.ecore").exists()) == (1, False)
    assert "left out: 2 operations of classes" in err
    assert "2 warnings say what `m.ecore` would lose" in err
    assert run("convert", "m.ecore", "n.ecore", "--lossy")[0] == 0
    assert 'name="tags" upperBound="-1"' in Path("n.ecore").read_text()
    assert "tags [0..*], items [0..*]" in run("show", "n.ecore")[1]


def test_objects_of_a_grid_are_given_and_shown_by_column_and_row(run: Run) -> None:
    classes = 'class Board { contains Cell[] cells }\n@glyph(".") class Cell { int x int y }\n'
    Path("b.metamodel").write_text(f"metamodel board\n{classes}")
    grid = 'grid cell { column x row y rows "..." }'
    Path("b.model").write_text(f'import "b.metamodel"\nmodel m : board {{ board : Board {{ cells = {grid} }} }}')
    Path("b.query").write_text('import "b.metamodel"\npattern at(c : Cell, x : int) { Cell.x(c, x); }')
    code, out, _ = run("match", "b.model", "b.query", "at", "--where", "c=cell[2, 0]")
    assert (code, out.splitlines()[-1].split()) == (0, ["Cell", "cell[2,", "0]", "2"])
    code, _, err = run("match", "b.model", "b.query", "at", "--where", "c=cell[3, 0]")
    assert code == 1 and "the model has no object `cell[3, 0]`; did you mean `cell[" in err


def test_objects_can_be_given_by_their_keys(run: Run) -> None:
    Path("b.metamodel").write_text(
        "metamodel b\nclass Ward { contains Bed[] beds contains Lamp[] lamps }\n"
        "@key(number) class Bed { int number }\nclass Lamp { int n }\n"
    )
    Path("b.model").write_text(
        'import "b.metamodel"\nmodel m : b {\n'
        "Ward { beds = [Bed { number = 7 }, Bed { number = 0 }] lamps = [Lamp { }] } }"
    )
    Path("b.query").write_text(
        'import "b.metamodel"\npattern bed(b : Bed) { Bed(b); }\npattern lamp(l : Lamp) { Lamp(l); }\n'
    )
    assert "Bed {number = 7}" in run("match", "b.model", "b.query", "bed")[1]
    for given in ("7", "Bed {number = 7}"):
        code, out, _ = run("match", "b.model", "b.query", "bed", "-w", f"b={given}")
        assert code == 0 and "Bed {number = 7}" in out and "Bed {number = 0}" not in out
    assert "Bed {number = 0}" in run("match", "b.model", "b.query", "bed", "-w", "b=0")[1]  # though 0 is the ward's id
    code, _, err = run("match", "b.model", "b.query", "bed", "-w", "b=70")
    assert code == 1 and "the model has no object `70`; did you mean `7`" in err
    for given in ("3", "Lamp#3"):
        assert run("match", "b.model", "b.query", "lamp", "-w", f"l={given}")[0] == 0
