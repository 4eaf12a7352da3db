"""Limits on what messages and printed objects show, so that the most important part is not lost in the rest."""

from __future__ import annotations

from typing import Final

from envgraph.code import dataclass


@dataclass(frozen=True, slots=True)
class Shown:
    """Largest numbers of characters, names and rows that are shown; of more, a text says how many there are."""

    message: int = 2_000  # characters; a longer message is cut in the middle, since names may be long
    line: int = 300  # characters of a line of a file; a longer line is cut to the surroundings of the span
    exception: int = 140  # characters of the message in a repr
    source: int = 40  # characters that a hint repeats from the source
    names: int = 5  # of a long list, and losses that a warning lists
    notes: int = 5  # of a diagnostic
    objects: int = 4  # objects that a parameter may mean, as notes
    places: int = 10  # other places of a name
    cycle: int = 20  # steps of a cycle
    expected: int = 9  # tokens that may follow
    literals: int = 4  # of an enum; of one with more, hints show one
    items: int = 10  # of a list in a repr
    matches: int = 3  # in a repr
    rows: int = 100  # matches in a notebook, members on a terminal, objects in a picture
    pictures: int = 24  # of members of a family in a notebook
    markup: int = 500_000  # characters of a picture in a notebook
    lines: int = 400  # of a text in a notebook
    firings: int = 20  # last firings before the step limit, whose rules are named
    marks: int = 6  # tokens that the description of a picture names
    similar: int = 1_000  # names that are compared with a wrong one
    variables: int = 200  # of a body in which a similar one is looked for
    longest: int = 200  # characters of a name that gets a suggestion


SHOWN: Final = Shown()
