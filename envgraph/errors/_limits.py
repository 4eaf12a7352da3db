"""How much a file may ask for, and how a person allows more."""

from __future__ import annotations

import os
from typing import Final

from envgraph.errors._exceptions import InvalidArgument
from envgraph.errors._numbers import LARGEST_INT, parse_float, parse_int

_VARIABLE = "ENVGRAPH_LIMITS"

MOST_ERRORS: Final = 100
"""Mistakes after which the rest of a file is not read or checked: nobody reads so many before mending some."""
MOST_NESTED: Final = 100
"""How deep anything may nest: brackets, expressions, blocks of rules, steps of units, packages, closures.

Checks descend by recursion, and generated source nests alike: Python allows 1,000 calls, 200 parentheses and 100 levels
of indentation.
"""
MOST_STEPS: Final = 1_000_000_000
"""Steps, generations and attempts that a person may ask for; all of them end sooner with Ctrl-C."""


def limit(usual: int) -> int:
    """A limit on what a file may ask for: `usual`, times the number in the environment variable `ENVGRAPH_LIMITS`.

    One number for all limits: who raises one trusts the file, and worker processes see it too. A message about a
    limit ends with `RAISE_LIMIT`.

    Raises:
        InvalidArgument: the variable is no number above 0, or more than a million.

    >>> limit(1000)
    1000
    """
    text = os.environ.get(_VARIABLE, "1")
    factor = parse_float(text)
    if factor is None or not 0 < factor <= 1_000_000:
        message = f"the environment variable {_VARIABLE} is `{text[:20]}`, but must be a number"
        raise InvalidArgument(message, "write one above 0, and 1,000,000 at most, such as 10")
    return max(int(usual * factor), 1)


def parse_within(text: str, low: int, most: int) -> int:
    """Parse a whole number of at least `low`, and at most the limit `most`.

    Raises:
        InvalidArgument: the text is not such a number.
    """
    highest, number = min(limit(most), LARGEST_INT), parse_int(text)
    if number is None or not low <= number <= highest:
        shown = text[:20] + "..." * (len(text) > 20)
        hint = RAISE_LIMIT if text.isdecimal() and number != 0 and highest < LARGEST_INT else None
        raise InvalidArgument(f"`{shown}` is not a whole number from {low:,} to {highest:,}", hint)
    return number


RAISE_LIMIT = f"set the environment variable {_VARIABLE}=10 to make every limit ten times as large"
"""The hint of every message about a limit."""
