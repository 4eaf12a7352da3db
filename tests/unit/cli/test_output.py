"""Tables on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main

Table = Callable[..., list[str]]
LARGEST_STYLED = 2000
"""Rows above which a table is printed as plain text on a terminal, too."""


@pytest.fixture
def printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Table:
    """Run a command on a model of items with these texts; return the lines without blanks at their ends."""
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    classes = "class Item { string text  int number }\nclass 日本 { }\n"
    Path("a.metamodel").write_text(f"metamodel a\n{classes}", "utf-8")
    body = "{ Item.number(i, number); Item.text(i, text); }"
    query = f"pattern item(number : int, text : string) {body}"
    Path("a.query").write_text(f'package a\nimport "a.metamodel"\n{query}\n', "utf-8")

    def run(command: str, texts: list[str], *, terminal: bool) -> list[str]:
        items = " ".join(f'i{n} : Item {{ number = {-n} text = "{text}" }}' for n, text in enumerate(texts))
        model = f'import "a.metamodel"\nmodel m : a {{ o : 日本 {{ }} {items} }}\n'
        Path("a.model").write_text(model, "utf-8")
        monkeypatch.setattr(sys, "argv", ["envgraph", *command.split()])
        with monkeypatch.context() as patched:
            patched.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
            assert main() == 0
        return [line.rstrip() for line in capsys.readouterr().out.splitlines()]

    return run


MATCH, SHOW = "match a.model a.query item", "show a.model"


@pytest.mark.parametrize("terminal", [True, False])
def test_a_table_is_printed_alike_to_a_pipe_and_to_a_terminal(printed: Table, terminal: bool) -> None:
    texts = ["it", "日本", *[""] * 8, "last"]
    found = printed(MATCH, texts, terminal=terminal)
    assert [*found[:4], found[-1]] == [
        "11 matches of item",
        "number  text",
        "0       it",
        "-1      日本",
        "-10     last",
    ]
    assert printed(SHOW, texts, terminal=terminal) == [
        "m: 12 objects of a",
        "class  objects",
        "Item        11",
        "日本         1",
    ]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_large_table_has_one_unwrapped_line_for_each_row(printed: Table, terminal: bool) -> None:
    long, two = "x" * 200, r"two\nlines"
    lines = printed(MATCH, [long, *[two] * LARGEST_STYLED], terminal=terminal)
    assert lines[2:4] == [f"0       {long}", f"-1      {two}"]
    assert len(lines) - 2 == 1 + LARGEST_STYLED


def test_a_small_table_on_a_terminal_folds_long_cells(printed: Table) -> None:
    lines = printed(MATCH, ["x" * 200], terminal=True)
    assert len(lines) > 4 and max(map(len, lines)) <= 80
    assert sum(line.count("x") for line in lines[2:]) == 200
