"""Charts as PNG by resvg: `make test-integrations` installs and runs it."""

from __future__ import annotations

from pathlib import Path
from struct import unpack

import pytest

from envgraph.cli import main
from envgraph.report import Series, chart_png, line_chart, standalone_chart

pytest.importorskip("resvg_py")


def picture(colour: int) -> bytes:
    one = Series("a", (0.0, 1.0), (2.0, 3.0), number=colour)
    found = chart_png(standalone_chart(line_chart([one], x_label="x", y_label="y", title="t")))
    assert found is not None
    return found


def test_a_chart_has_two_pixels_for_each_unit_and_its_colours() -> None:
    pixels = picture(0)
    assert pixels.startswith(b"\x89PNG\r\n\x1a\n")
    assert unpack(">II", pixels[16:24]) == (1440, 640)
    assert pixels != picture(1)


def test_the_paper_has_its_charts_as_png_beside_svg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short = "--seeds 2 --steps 10000 --no-times --force --output"
    monkeypatch.setattr("sys.argv", ["envgraph", "reproduce", "paper", *short.split(), str(tmp_path)])
    assert main() == 0
    assert {one.stem for one in tmp_path.glob("*.png")} == {one.stem for one in tmp_path.glob("*.svg")} != set()
