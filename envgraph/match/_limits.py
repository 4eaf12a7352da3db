"""The limit of the number of matches of a pattern."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from envgraph.errors import RAISE_LIMIT, EvaluationError, limit
from envgraph.pattern import Pattern

MOST_MATCHES: Final = 1_000_000
"""Of a pattern that nothing holds together, or combinations without a match: a second, 200 MB for a dozen variables."""


def at_most(pattern: Pattern, searched: bool) -> Callable[..., None]:
    """A function that is called where objects are combined with others that nothing connects with them.

    It is given the number of matches found so far; without it, when a search begins.

    Args:
        pattern: whose matches they are.
        searched: whether combinations without a match count, too.

    Raises:
        EvaluationError: these are too many.
    """
    most = limit(MOST_MATCHES)
    known = tried = 0

    def check(number: int | None = None) -> None:
        nonlocal known, tried
        if number is None:
            known = tried = 0
        elif number > most:
            raise _too_many(pattern, f"has more than {most:,} matches")
        elif number != known:
            known, tried = number, 0
        elif searched:
            tried += 1
            if tried > most:
                raise _too_many(pattern, f"has been looked for in more than {most:,} combinations of objects")

    return check


def _too_many(pattern: Pattern, what: str) -> EvaluationError:
    name = pattern.qualified_name.partition("#")[0]
    message = f"`{name}` {what}: nothing connects some of them, so all are combined with all"
    return EvaluationError(message, pattern.span, f"connect them by a link or a value; {RAISE_LIMIT}")
