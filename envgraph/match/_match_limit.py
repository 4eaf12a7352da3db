"""The limit on the number of matches of a pattern."""

from __future__ import annotations

from collections.abc import Callable

from envgraph.errors import RAISE_LIMIT_HINT, EvaluationError, scaled_limit
from envgraph.pattern import Pattern


def make_match_limit_check(pattern: Pattern, counts_failures: bool) -> Callable[..., None]:
    """Return a function that counts combinations of unconnected objects. Above a limit it raises `EvaluationError`.

    Each search first calls the function without arguments, which sets the counts to 0. Before each loop over objects
    that no constraint connects with those of outer loops, the search calls it with the number of matches so far and the
    loop's variable.

    Args:
        pattern: the pattern of the search, named in the error.
        counts_failures: if True, combinations tested since the last match are counted, too.
    """
    most = scaled_limit("matches")
    known = tried = 0

    def check(number: int | None = None, variable: str = "") -> None:
        nonlocal known, tried
        if number is None:
            known = tried = 0
        elif number != known:
            known, tried = number, 0
        elif counts_failures:
            tried += 1
        if known > most or tried > most:
            raise _too_many(pattern, most, variable)

    return check


def _too_many(pattern: Pattern, max_combinations: int, variable: str) -> EvaluationError:
    """Return the error for more than `max_combinations` combinations. `variable` names the unconnected variable, or is
    "".
    """
    name, _, block = pattern.qualified_name.partition("#")
    whose = f"`{name}`" if block in ("", "lhs") else f"the `{block.rstrip('0123456789')}` block of `{name}`"
    which = f"`{variable}`" if variable.isidentifier() else "one of its variables"
    message = (
        f"{whose} has more than {max_combinations:,} combinations of objects: "
        f"nothing connects {which} with the other variables"
    )
    hint = f"connect {which} with another variable by a link or by an equal value, or {RAISE_LIMIT_HINT}"
    return EvaluationError(message, pattern.span, hint)
