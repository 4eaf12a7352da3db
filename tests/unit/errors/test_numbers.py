"""Numbers in texts, and limits on them."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from envgraph.errors import LIMITS, InvalidArgument, parse_float, parse_int, parse_int_within, scaled_limit

LONG = "9" * 5000
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("text", "whole", "real"),
    [
        ("0", 0, 0.0),
        ("-7", -7, -7.0),
        ("+7", 7, 7.0),
        ("007", 7, 7.0),
        ("0" * 5000 + "7", 7, 7.0),
        (str(2**63 - 1), 2**63 - 1, float(2**63)),
        (str(2**63), None, float(2**63)),
        (str(-(2**63)), -(2**63), -float(2**63)),
        (str(-(2**63) - 1), None, -float(2**63)),
        (LONG, None, None),
        ("-" + LONG, None, None),
        ("1.5", None, 1.5),
        (".5", None, 0.5),
        ("5.", None, 5.0),
        ("1e3", None, 1000.0),
        ("1E-400", None, 0.0),
        ("1e400", None, None),
        ("1e" + LONG, None, None),
        ("nan", None, None),
        ("inf", None, None),
        ("1_000", None, None),
        ("1,000", None, None),
        ("0x10", None, None),
        (" 1", None, None),
        ("1\n", None, None),
        ("١٢", None, None),
        ("１", None, None),
        ("²", None, None),
        ("--1", None, None),
        ("-", None, None),
        (".", None, None),
        ("", None, None),
    ],
)
def test_only_ascii_numbers_within_64_bits_are_parsed(text: str, whole: int | None, real: float | None) -> None:
    assert (parse_int(text), parse_float(text)) == (whole, real)


@pytest.mark.parametrize(
    ("text", "message", "raisable"),
    [
        ("0", "`0` is not a whole number from 1 to 100", False),
        ("101", "`101` is not a whole number from 1 to 100", True),
        (LONG, f"`{LONG[:20]}...` is not a whole number from 1 to 100", True),
        ("many", "`many` is not a whole number from 1 to 100", False),
    ],
)
def test_a_number_out_of_its_range_is_named_with_the_range(
    text: str, message: str, raisable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "width", 100)
    with pytest.raises(InvalidArgument) as caught:
        parse_int_within(text, 1, "width")
    assert caught.value.message == message
    assert ("ENVGRAPH_LIMITS=10" in str(caught.value.hint)) == raisable


def test_limits_can_be_raised_at_most_by_a_factor_of_a_million(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "1e6")
    assert scaled_limit("rounds") == 1_000_000_000 and parse_int_within("1000000000", 1, "rounds") == 1_000_000_000
    for wrong in ("1000001", "1e18", "1e400", LONG, "1_0", "inf", ""):
        monkeypatch.setenv("ENVGRAPH_LIMITS", wrong)
        with pytest.raises(InvalidArgument, match="ENVGRAPH_LIMITS is `") as caught:
            scaled_limit("rounds")
        assert caught.value.hint == "set it to a number such as 10, or unset it"


ROWS = {
    "file bytes": "any other file",
    "model bytes": "a model that programs write",
    "query bytes": "a file with queries",
    "files": "files that are read together",
    "tags": "tags of an `.ecore` file",
    "open tags": "tags of an `.xmi` file",
    "nesting of TOML": "parts of a key",
    "levels": "levels of a file",
    "cells": "cells of all levels",
    "members": "members of a family",
    "width": "`width`",
    "rounds": "`rounds` of `tournament`",
    "applications": "`initial_applications`",
    "attempts": "`rounds` of `simulated_annealing`",
    "episodes": "`evaluation_episodes`",
    "steps": "any other number of steps",
    "hidden units": "`hidden`",
    "workers": "`--workers`",
    "seed": "a seed",
    "matches": "matches of a pattern",
    "instances": "matches of the blocks",
    "steps of a run": "steps of a run",
    "derived rules": "rules that one `derive`",
}
"""The limits that `ENVGRAPH_LIMITS` raises, each with the begin of its row in the documentation."""


def test_the_documented_limits_are_those_that_are_raised() -> None:
    text = (ROOT / "docs" / "reference" / "limits.md").read_text()
    table = dict(re.findall(r"^\| (.*?) \| ([\d,]+(?: MB)?) \|$", text, re.MULTILINE))
    for name, begin in ROWS.items():
        (most,) = (most for what, most in table.items() if what.startswith(begin))
        number = int(most.removesuffix(" MB").replace(",", "")) * (2**20 if most.endswith("MB") else 1)
        assert number == LIMITS[name], name


def test_only_documented_limits_are_raised() -> None:
    kept, raised = set[str](), set[str]()
    for path in (ROOT / "envgraph").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "LIMITS":
                kept |= {ast.literal_eval(node.slice)} if isinstance(node.slice, ast.Constant) else set()
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "limit" and node.args:
                raised |= {ast.literal_eval(node.args[0])} if isinstance(node.args[0], ast.Constant) else set()
    assert raised <= ROWS.keys() and kept - ROWS.keys() == LIMITS.keys() - ROWS.keys()
