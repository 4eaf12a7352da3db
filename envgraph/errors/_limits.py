"""Limit the sizes that a file may ask for. The environment variable `ENVGRAPH_LIMITS` multiplies all limits."""

from __future__ import annotations

import os
from typing import Final

from envgraph.errors._exceptions import InvalidArgument
from envgraph.errors._numbers import LARGEST_INT, parse_float, parse_int

_VARIABLE = "ENVGRAPH_LIMITS"

MOST_ERRORS: Final = 100
"""Number of errors after which the rest of a file is not read or checked: nobody reads more at once."""
MOST_NESTED: Final = 100
"""Maximal nesting of brackets, expressions, blocks of rules, steps of units, packages and closures.

Checks are recursive, and generated source is nested in the same way. Python allows 1,000 nested calls, 200 nested
parentheses and 100 levels of indentation.
"""
MOST_STEPS: Final = 1_000_000_000
"""Maximal number of steps, generations or attempts that a person may ask for. Ctrl-C stops them earlier."""


def limit(usual: int) -> int:
    """Return a limit: the default `usual` times the factor in the environment variable `ENVGRAPH_LIMITS`, at least 1.

    One factor changes all limits, also in worker processes. A message about a limit ends with `RAISE_LIMIT`.

    Raises:
        InvalidArgument: the variable is not a number above 0 and at most a million.

    >>> limit(1000)
    1000
    """
    text = os.environ.get(_VARIABLE, "1")
    factor = parse_float(text)
    if factor is None or not 0 < factor <= 1_000_000:
        message = (
            f"the variable {_VARIABLE} is `{text[:20]}`, but must be a number above 0 and at most 1,000,000"
        )
        raise InvalidArgument(message, "set it to a number such as 10, or unset it")
    return max(int(usual * factor), 1)


def parse_within(text: str, low: int, most: int) -> int:
    """Parse a whole number from `low` to the limit `most` (times the factor in `ENVGRAPH_LIMITS`).

    Raises:
        InvalidArgument: the text is not a whole number in this range.
    """
    highest, number = min(limit(most), LARGEST_INT), parse_int(text)
    if number is None or not low <= number <= highest:
        shown = text[:20] + "..." * (len(text) > 20)
        hint = RAISE_LIMIT if text.isdecimal() and number != 0 and highest < LARGEST_INT else None
        raise InvalidArgument(f"`{shown}` is not a whole number from {low:,} to {highest:,}", hint)
    return number


RAISE_LIMIT = f"set the environment variable {_VARIABLE}=10 to make every limit ten times as large"
"""Hint of every message about a limit."""
