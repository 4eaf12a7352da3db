"""Numbers in texts: of the command line, of environment variables, and in files that leave numbers as texts."""

from __future__ import annotations

import re
from math import inf, isfinite
from typing import Final

LARGEST_INT: Final = 2**63 - 1
"""Ints that are stored or leave an expression have 64 bits; the least one is `-LARGEST_INT - 1`."""
_INT: Final = re.compile("([+-]?)0*([0-9]{1,19})")
_FLOAT: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def parse_int(text: str) -> int | None:
    """Parse a whole number of 64 bits: ASCII digits, perhaps with a sign before them. Return None for other texts.

    The digits are counted first. Python's `int` fails on thousands of them, and accepts `1_000` and blanks.
    """
    found = _INT.fullmatch(text)
    number = int(found[1] + found[2]) if found else LARGEST_INT + 1
    return number if -LARGEST_INT - 1 <= number <= LARGEST_INT else None


def parse_float(text: str) -> float | None:
    """Parse a finite float written in ASCII, such as `-1.5e3`. Return None for other texts."""
    number = float(text) if _FLOAT.fullmatch(text) else inf
    return number if isfinite(number) else None
