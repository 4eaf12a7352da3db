"""Parse numbers written as text: in command lines, environment variables and files."""

from __future__ import annotations

import re
from math import inf, isfinite
from typing import Final

LARGEST_INT: Final = 2**63 - 1
"""Largest int of 64 bits. All stored ints and results of expressions are from `-LARGEST_INT - 1` to `LARGEST_INT`."""
TOLERANCE: Final = 1e-9
"""Largest difference of probabilities, scores and rewards that are the same but for the rounding of their terms."""
_INT: Final = re.compile("([+-]?)0*([0-9]{1,19})")
_FLOAT: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def parse_int(text: str) -> int | None:
    """Parse a 64-bit whole number: ASCII digits with an optional sign. Return None for any other text.

    Python's `int` is not used alone, because it fails for thousands of digits and accepts `1_000` and blanks.
    """
    found = _INT.fullmatch(text)
    number = int(found[1] + found[2]) if found else LARGEST_INT + 1
    return number if -LARGEST_INT - 1 <= number <= LARGEST_INT else None


def parse_float(text: str) -> float | None:
    """Parse a finite float written in ASCII, such as `-1.5e3`. Return None for any other text."""
    number = float(text) if _FLOAT.fullmatch(text) else inf
    return number if isfinite(number) else None
