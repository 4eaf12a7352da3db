"""Tables on the terminal."""

from __future__ import annotations

import pytest

from envgraph.cli import _output as output


def test_a_large_table_looks_like_a_small_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [("Tile 1", "3", "it"), ("日本", "-17", "")]
    texts = []
    for most in (len(rows), len(rows) - 1):
        monkeypatch.setattr(output, "_MOST_STYLED", most)
        output.print_table("2 matches", ("tile", "x", "name"), rows, right=(1,))
        texts.append([line.rstrip() for line in capsys.readouterr().out.splitlines()])
    assert texts[0] == texts[1] == ["2 matches", "tile      x  name", "Tile 1    3  it", "日本    -17"]


def test_a_large_table_has_one_line_for_a_row(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "_MOST_STYLED", 0)
    output.print_table("1 match", ("text",), [("two\nlines",)])
    assert capsys.readouterr().out == "1 match\ntext\ntwo\\nlines\n"
