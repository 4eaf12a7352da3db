"""How much a file may ask for, and how a person allows more."""

from __future__ import annotations

import os
from math import isfinite
from typing import Final

from envgraph.errors._exceptions import InvalidArgument

_VARIABLE = "ENVGRAPH_LIMITS"

MOST_ERRORS: Final = 100
"""Mistakes after which the rest of a file is not read or checked: nobody reads so many before mending some."""
MOST_NESTED: Final = 100
"""How deep anything may nest: brackets, expressions, blocks of rules, steps of units, packages, closures.

Checks descend by recursion, and generated source nests alike: Python allows 1,000 calls, 200 parentheses and 100 levels
of indentation.
"""


def limit(usual: int) -> int:
    """A limit on what a file may ask for: `usual`, times the number in the environment variable `ENVGRAPH_LIMITS`.

    One number for all limits: who raises one trusts the file, and worker processes see it too. A message about a
    limit ends with `RAISE_LIMIT`.

    Raises:
        InvalidArgument: the variable is no number above 0.

    >>> limit(1000)
    1000
    """
    text = os.environ.get(_VARIABLE, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not (isfinite(factor) and factor > 0):
        raise InvalidArgument(
            f"the environment variable {_VARIABLE} is `{text}`, and not a number such as 10"
        )
    return max(int(usual * factor), 1)


RAISE_LIMIT = f"{_VARIABLE}=10 in the environment raises this limit, and all others, ten times"
"""The hint of every message about a limit."""
