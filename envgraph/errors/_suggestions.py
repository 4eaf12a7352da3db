"""Format names in messages, and suggest known names for misspelt ones."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from unicodedata import normalize

from envgraph.errors._shown import SHOWN

_LOOKALIKES = str.maketrans(
    "АВЕКМНОРСТУХаеорсухіјѕԁԛԝΑΒΕΖΗΙΚΜΝΟΡΤΥΧο",
    "ABEKMHOPCTYXaeopcyxijsdqwABEZHIKMNOPTYXo",
)
"""Maps Cyrillic and Greek letters to the Latin letters that they look like."""


class ReplacementHint(str):
    """A hint that says what to write in place of a part of the marked text.

    Attributes:
        wrong: the part of the marked text.
        right: the text to write.
    """

    __slots__ = ("right", "wrong")

    wrong: str
    right: str

    def __new__(cls, text: str, wrong: str, right: str) -> ReplacementHint:
        """Return a hint with this text."""
        made = super().__new__(cls, text)
        made.wrong, made.right = wrong, right
        return made

    def __getnewargs__(self) -> tuple[str, str, str]:  # type: ignore[override]  # those of `str` are its text alone
        """Return the arguments of the constructor, from which pickle makes the hint again."""
        return str(self), self.wrong, self.right


def quote_with_article(name: str) -> str:
    """Return a name in backquotes with its article, for messages.

    >>> quote_with_article("int"), quote_with_article("Tile")
    ('an `int`', 'a `Tile`')
    """
    return f"{'an' if name[:1] in tuple('aeiouAEIO') else 'a'} `{name}`"


def count_with_noun(count: int, word: str) -> str:
    """Return a count with its noun, in the plural unless the count is 1.

    >>> count_with_noun(1, "value"), count_with_noun(0, "value")
    ('1 value', '0 values')
    """
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """Return a hint with the known name most similar to `name`, or None if no known name is similar.

    >>> did_you_mean("metods", ["methods", "fields"])
    'did you mean `methods`?'
    """
    near = most_similar(name, known)
    if near is None:
        return None
    if not name.isascii() and near == _latin_lookalike(name):
        other = next(char for char in name if not char.isascii())
        lookalike = f"did you mean `{near}`? `{other}` (U+{ord(other):04X}) only looks like a Latin letter"
        return ReplacementHint(lookalike, name, near)
    return ReplacementHint(f"did you mean `{near}`?", name, near)


def most_similar(name: str, known: Iterable[str]) -> str | None:
    """Return the known name most similar to `name`, or None if no known name is similar.

    A single known name that continues `name` with an underscore counts as similar.

    >>> most_similar("metods", ["methods", "fields"]), most_similar("steps", ["seeds", "steps_per_environment"])
    ('methods', 'steps_per_environment')
    """
    candidates = sorted(set(known))
    folded = {candidate.casefold(): candidate for candidate in reversed(candidates)}
    if name.casefold() in folded:
        return folded[name.casefold()]
    if len(name) > SHOWN.longest:
        return None
    if not name.isascii() and _latin_lookalike(name) in candidates:
        return _latin_lookalike(name)
    longer = [one for one in candidates if one.startswith(f"{name}_")]
    if len(longer) == 1:
        return longer[0]
    if len(candidates) > SHOWN.similar:
        candidates = [one for one in candidates if one[:2] == name[:2] and abs(len(one) - len(name)) < 3][
            : SHOWN.similar
        ]
    close = get_close_matches(name, candidates, n=1, cutoff=0.6)
    return close[0] if close else None


def _latin_lookalike(name: str) -> str:
    return normalize("NFKC", name).translate(_LOOKALIKES)


def list_names(names: Iterable[str]) -> str:
    """Return sorted names in backquotes, each once, separated by commas; of more than six only five and a count.

    >>> list_names("b") + "; " + list_names("gfedcba")
    '`b`; `a`, `b`, `c`, `d`, `e` and 2 more'
    """
    known = sorted(set(names))
    if len(known) <= SHOWN.names + 1:
        return quote_names(known)
    return f"{quote_names(known[: SHOWN.names])} and {len(known) - SHOWN.names} more"


def quote_names(names: Iterable[object]) -> str:
    """Return all names in backquotes, separated by commas, in the given order.

    >>> quote_names("ba")
    '`b`, `a`'
    """
    return ", ".join(f"`{name}`" for name in names)


def name_hint(name: str, known: Iterable[str]) -> str | None:
    """Return a hint for an unknown name: a similar known name, else a list of the known names; None if there are none.

    The list omits names that begin with `_` or contain `#`.

    >>> name_hint("methds", ["methods", "fields"]), name_hint("Zed", ["methods", "fields"])
    ('did you mean `methods`?', 'there are `fields`, `methods`')
    """
    candidates = set(known)
    near = did_you_mean(name, candidates)
    if near is not None:
        return near
    public_names = [one for one in candidates if one[:1] != "_" and "#" not in one]
    return f"there {'is' if len(public_names) == 1 else 'are'} {list_names(public_names)}" if public_names else None
