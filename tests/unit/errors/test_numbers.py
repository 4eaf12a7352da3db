"""Numbers in texts, and limits on them."""

from __future__ import annotations

import pytest

from envgraph.errors import InvalidArgument, limit, parse_float, parse_int, parse_within

LONG = "9" * 5000


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
def test_numbers_are_ascii_digits_that_fit_64_bits(text: str, whole: int | None, real: float | None) -> None:
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
def test_a_number_out_of_its_range_is_named_with_the_range(text: str, message: str, raisable: bool) -> None:
    with pytest.raises(InvalidArgument) as caught:
        parse_within(text, 1, 100)
    assert caught.value.message == message
    assert ("ENVGRAPH_LIMITS=10" in str(caught.value.hint)) == raisable


def test_limits_are_raised_a_million_times_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "1e6")
    assert limit(50) == 50_000_000 and parse_within("50000000", 1, 50) == 50_000_000
    for wrong in ("1000001", "1e18", "1e400", LONG, "1_0", "inf", ""):
        monkeypatch.setenv("ENVGRAPH_LIMITS", wrong)
        with pytest.raises(InvalidArgument, match="ENVGRAPH_LIMITS is `") as caught:
            limit(50)
        assert caught.value.hint == "set it to a number such as 10, or unset it"
