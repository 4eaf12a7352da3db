"""Runs what the documentation of Python says of the packages of others; other tests here use it."""

from __future__ import annotations

import contextlib
import io
import runpy
import sys

import pytest

from tests.unit.test_docs import ROOT, Block, blocks, run_python, run_shell, save_file


def run_section(name: str, names: dict[str, object], first: str = "", last: str = "") -> list[str]:
    """Run the blocks of a page, or those between two of its lines, in the present directory, and also skipped blocks.

    Returns:
        What each prints that has its text below it; that is what is there.
    """
    page = ROOT / "docs" / name
    text = page.read_text("utf-8")
    start, end = text.count("\n", 0, text.index(first)), text.count("\n", 0, text.index(last) if last else len(text))
    found = [block for block in blocks(page) if start < block.line < end]
    after: list[Block | None] = [*found[1:], None]
    said = []
    for block, below in zip(found, after, strict=True):
        save_file(block)
        if block.language in ("python", "sh"):
            printed = run_python(block, names) if block.language == "python" else run_shell(block)
            if below is not None and block.precedes(below) and below.language == "text":
                assert printed == below.text
                said.append(printed)
    return said


def run_example(name: str, *arguments: str) -> str:
    """Run a file of `docs/examples` in this process, and return what it prints."""
    path, printed = ROOT / "docs" / "examples" / name, io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [str(path), *arguments])
        with contextlib.redirect_stdout(printed):
            runpy.run_path(str(path), run_name="__main__")
    return printed.getvalue()
