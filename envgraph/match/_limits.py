"""How many matches a pattern may have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from envgraph.errors import RAISE_LIMIT, EvaluationError, limit
from envgraph.pattern import Pattern

MOST_MATCHES: Final = 1_000_000
"""Of a pattern that nothing holds together, and of a recursive one: a second, and 200 MB for a dozen variables."""


def too_many(pattern: Pattern, why: str) -> EvaluationError:
    """A pattern has more matches than it may have."""
    what = f"`{pattern.qualified_name.partition('#')[0]}` has more than {limit(MOST_MATCHES):,} matches"
    return EvaluationError(
        f"{what}: {why}", pattern.span, f"connect them by a link or a value; {RAISE_LIMIT}"
    )


def at_most(pattern: Pattern) -> Callable[[int], None]:
    """A function that is given the number of matches found so far.

    Raises:
        EvaluationError: these are too many.
    """
    most = limit(MOST_MATCHES)

    def check(number: int) -> None:
        if number > most:
            raise too_many(pattern, "nothing connects some of its objects, so all are combined with all")

    return check
