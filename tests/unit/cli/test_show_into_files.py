"""`envgraph show --output`: the file has the format that its name says, the terminal that of `--format`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from envgraph.cli import main

METAMODEL = "metamodel s class Part { }"
MODEL = 'import "s.metamodel" model small : s { p : Part }'


@pytest.fixture(autouse=True)
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.metamodel").write_text(METAMODEL, encoding="utf-8")
    Path("s.model").write_text(MODEL, encoding="utf-8")


def show(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["envgraph", "show", *arguments])
    return main()


@pytest.mark.parametrize("format", ["text", "json"])
def test_json_is_written_to_the_file_and_its_name_to_the_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], format: str
) -> None:
    assert show(monkeypatch, "s.model", "--format", format, "-o", "x.json") == 0
    assert capsys.readouterr().out == "wrote x.json\n"
    assert [one["class"] for one in json.loads(Path("x.json").read_text(encoding="utf-8"))["objects"]] == ["Part"]


def test_errors_are_printed_in_the_format_of_the_option_not_of_the_file_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show(monkeypatch, "s.metamodel", "-o", "x.json") == 1
    printed = capsys.readouterr()
    assert (printed.out, Path("x.json").exists()) == ("", False)
    assert printed.err.startswith("error: a metamodel cannot be printed as JSON")
    assert show(monkeypatch, "s.metamodel", "--format", "json", "-o", "x.json") == 1
    assert json.loads(capsys.readouterr().out)["ok"] is False


def test_only_objects_of_the_named_classes_are_drawn(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("s.metamodel").write_text("metamodel s class Part { } class Bolt { } class Nut { }", encoding="utf-8")
    Path("s.model").write_text('import "s.metamodel" model small : s { p : Part  b : Bolt  n : Nut }', encoding="utf-8")
    for format in ("svg", "dot"):
        assert show(monkeypatch, "s.model", "--classes", "Part, Nut", "--format", format) == 0
        drawn = capsys.readouterr().out
        assert [name in drawn for name in ("Part", "Bolt", "Nut")] == [True, False, True]
    assert show(monkeypatch, "s.model", "--classes", "Part,But", "-o", "x.svg") == 1
    assert "But" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["s.model"], ["s.metamodel", "--format", "svg"], ["nothing"]])
def test_classes_are_refused_without_a_picture_of_a_model(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert show(monkeypatch, *arguments, "--classes", "Part") == 1
    assert "`--classes` is allowed only for a picture of a model" in capsys.readouterr().err
