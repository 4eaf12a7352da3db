"""Names in messages and hints."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def with_article(name: str) -> str:
    """A name in backquotes with its article, for messages.

    >>> with_article("int"), with_article("Tile")
    ('an `int`', 'a `Tile`')
    """
    return f"{'an' if name[:1] in tuple('aeiouAEIO') else 'a'} `{name}`"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A hint naming the known name that is nearest to `name`, or None when none is near.

    >>> did_you_mean("metods", ["methods", "fields"])
    'did you mean `methods`?'
    """
    candidates = sorted(set(known))
    folded = {candidate.casefold(): candidate for candidate in reversed(candidates)}
    if name.casefold() in folded:
        return f"did you mean `{folded[name.casefold()]}`?"
    close = get_close_matches(name, candidates, n=1, cutoff=0.6)
    return f"did you mean `{close[0]}`?" if close else None
