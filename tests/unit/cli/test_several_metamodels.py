"""`--metamodel` more than once, with the commands that take it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main

SHARED = Path(__file__).parents[2] / "golden" / "shared"
CLUB, ROOMS = SHARED / "club" / "club.ecore", SHARED / "rooms" / "rooms.ecore"
Run = Callable[..., tuple[int, str, str]]

ALONE = """<ecore:EPackage xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore" name="alone" nsURI="http://example.org/alone" nsPrefix="alone">
  <eClassifiers xsi:type="ecore:EClass" name="Seat"/>
</ecore:EPackage>
"""
MODEL = """<xmi:XMI xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:club="http://example.org/club" xmlns:rooms="http://example.org/rooms" xmlns:alone="http://example.org/alone">
  <club:Club meets="/1"><members name="Ada"/></club:Club>
  <rooms:Room state="taken"><seats/></rooms:Room>
  <alone:Seat/>
</xmi:XMI>
"""
QUERIES = """import "http://example.org/club"
import "http://example.org/rooms" as r
import "http://example.org/alone"

pattern pairs(one : Seat, other : r::Seat) {
    Seat(one);
    r::Seat(other);
}
"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command where there are a metamodel, a model and queries: exit code, output, messages."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for name, text in {"alone.ecore": ALONE, "m.xmi": MODEL, "q.vql": QUERIES}.items():
        Path(name).write_text(text)

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


BOTH = ("-m", CLUB, "-m", "alone.ecore")


def test_check_takes_metamodels(run: Run) -> None:
    code, out, err = run("check", "q.vql", "m.xmi", *BOTH)
    assert code == 0 and "error" not in out + err and "unconnected parts" in err
    code, _, err = run("check", "q.vql", "-m", CLUB)
    assert code == 1
    assert "no metamodel has the uri `http://example.org/alone`" in err and "`--metamodel`" in err


def test_check_accepts_ecore_files_that_refer_to_each_other_in_any_order(run: Run) -> None:
    for files in ((CLUB, ROOMS), (ROOMS, CLUB), (ROOMS,)):
        code, out, err = run("check", *files)
        assert (code, err) == (0, "") and out.startswith("no problems in ")


def test_match_takes_metamodels(run: Run) -> None:
    code, out, _ = run("match", "m.xmi", "q.vql", "pairs", *BOTH)
    assert code == 0 and "alone::Seat" in out and "rooms::Seat" in out


def test_show_takes_metamodels(run: Run) -> None:
    code, out, _ = run("show", "m.xmi", *BOTH)
    assert code == 0 and "alone::Seat" in out
    code, out, _ = run("show", CLUB)
    assert code == 0 and "Member" in out and "rooms::State" not in out
    code, out, _ = run("show", CLUB, "--format", "svg")
    assert code == 0 and out.startswith("<svg")


def test_convert_writes_the_namespaces_of_a_model_and_one_metamodel(run: Run) -> None:
    assert run("convert", "m.xmi", "m.json", *BOTH)[0] == 0
    assert run("convert", "m.json", "again.xmi", *BOTH)[0] == 0
    again = Path("again.xmi").read_text()
    assert "<rooms:Room " in again and "<alone:Seat/>" in again and "<club:Club " in again
    assert run("convert", CLUB, "all.ecore", "-m", "alone.ecore")[0] == 0
    text = Path("all.ecore").read_text()
    assert text.count("<eSubpackages ") == 2 and 'nsURI="http://example.org/alone"' in text
    code, out, _ = run("match", "again.xmi", "q.vql", "pairs", "-m", "all.ecore")
    assert code == 0 and "alone::Seat" in out


def test_a_metamodel_option_with_a_model_file_is_refused(run: Run) -> None:
    code, _, err = run("check", "q.vql", "-m", CLUB, "-m", "m.xmi")
    assert code == 1 and "`m.xmi` is a model, not a metamodel" in err
