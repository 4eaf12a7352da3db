"""Names in messages and hints."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from unicodedata import normalize

_MANY = 1000
"""Among more names than this, only those that begin in the same way are compared letter by letter."""
_LONG = 200
"""A name that is longer than this is compared with none."""


_LOOKALIKES = str.maketrans(
    "АВЕКМНОРСТУХаеорсухіјѕԁԛԝΑΒΕΖΗΙΚΜΝΟΡΤΥΧο",
    "ABEKMHOPCTYXaeopcyxijsdqwABEZHIKMNOPTYXo",
)
"""Letters of Cyrillic and Greek that look like Latin ones."""


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
    if len(name) > _LONG:
        return None
    if not name.isascii():
        latin = normalize("NFKC", name).translate(_LOOKALIKES)
        if latin in candidates:
            other = next(char for char in name if not char.isascii())
            return f"did you mean `{latin}`? `{other}` only looks like a letter of it (U+{ord(other):04X})"
    if len(candidates) > _MANY:
        candidates = [one for one in candidates if one[:2] == name[:2] and abs(len(one) - len(name)) < 3][
            :_MANY
        ]
    close = get_close_matches(name, candidates, n=1, cutoff=0.6)
    return f"did you mean `{close[0]}`?" if close else None
