"""Names in messages and hints."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from unicodedata import normalize

_MANY = 1000
"""Among more names than this, only those that begin in the same way are compared letter by letter."""
_LONG = 200
"""A name that is longer than this is compared with none."""
_SHOWN = 5
"""So many names are listed."""


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


def plural(count: int, word: str) -> str:
    """A number of things, for messages.

    >>> plural(1, "value"), plural(0, "value")
    ('1 value', '0 values')
    """
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """A hint naming the known name that is nearest to `name`, or None when none is near.

    >>> did_you_mean("metods", ["methods", "fields"])
    'did you mean `methods`?'
    """
    near = nearest(name, known)
    if near is None:
        return None
    if not name.isascii() and near == _latin(name):
        other = next(char for char in name if not char.isascii())
        return f"did you mean `{near}`? `{other}` only looks like a letter of it (U+{ord(other):04X})"
    return f"did you mean `{near}`?"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is nearest to `name`, or None when none is near; the only one that it is the first word of.

    >>> nearest("metods", ["methods", "fields"]), nearest("steps", ["seeds", "steps_per_environment"])
    ('methods', 'steps_per_environment')
    """
    candidates = sorted(set(known))
    folded = {candidate.casefold(): candidate for candidate in reversed(candidates)}
    if name.casefold() in folded:
        return folded[name.casefold()]
    if len(name) > _LONG:
        return None
    if not name.isascii() and _latin(name) in candidates:
        return _latin(name)
    longer = [one for one in candidates if one.startswith(f"{name}_")]
    if len(longer) == 1:
        return longer[0]
    if len(candidates) > _MANY:
        candidates = [one for one in candidates if one[:2] == name[:2] and abs(len(one) - len(name)) < 3][
            :_MANY
        ]
    close = get_close_matches(name, candidates, n=1, cutoff=0.6)
    return close[0] if close else None


def _latin(name: str) -> str:
    return normalize("NFKC", name).translate(_LOOKALIKES)


def listed(names: Iterable[str]) -> str:
    """Names in backquotes, in order; of more than six only the first five.

    >>> listed("b") + "; " + listed("gfedcba")
    '`b`; `a`, `b`, `c`, `d`, `e` and 2 more'
    """
    known = sorted(set(names))
    if len(known) <= _SHOWN + 1:
        return quoted(known)
    return f"{quoted(known[:_SHOWN])} and {len(known) - _SHOWN} more"


def quoted(names: Iterable[object]) -> str:
    """Names in backquotes, all of them as they come.

    >>> quoted("ba")
    '`b`, `a`'
    """
    return ", ".join(f"`{name}`" for name in names)


def name_hint(name: str, known: Iterable[str]) -> str | None:
    """A hint for an unknown name: the known name that is nearest, or else what there is; None if there is nothing.

    >>> name_hint("methds", ["methods", "fields"]), name_hint("Zed", ["methods", "fields"])
    ('did you mean `methods`?', 'there are `fields`, `methods`')
    """
    candidates = set(known)
    near = did_you_mean(name, candidates)
    if near is not None:
        return near
    plain = [one for one in candidates if one[:1] != "_" and "#" not in one]
    return f"there {'is' if len(plain) == 1 else 'are'} {listed(plain)}" if plain else None
