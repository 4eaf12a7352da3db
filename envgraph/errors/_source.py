"""Texts and half-open stretches of them."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import field
from unicodedata import category, east_asian_width

from envgraph.code import dataclass, visible

_LONGEST = 300
"""Of a longer line, only what surrounds the place is shown."""


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A text and the name it is shown under.

    Two sources are equal only if they are the same object: spans into different readings of one file must not be
    mixed.
    """

    name: str
    text: str = field(repr=False)
    _line_starts: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = [0, *(found.end() for found in re.finditer("\n", self.text))]
        object.__setattr__(self, "_line_starts", tuple(starts))

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column of a character offset, both counted from 1; the end of the text is a position too.

        >>> Source("a", "one\\ntwo").position(5)
        (2, 2)
        """
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def line(self, number: int) -> str:
        """Text of a line (from 1), without its end; "" past the last line."""
        if number > len(self._line_starts):
            return ""
        start = self._line_starts[number - 1]
        end = self._line_starts[number] - 1 if number < len(self._line_starts) else len(self.text)
        return self.text[start:end].removesuffix("\r")

    def span(self, start: int, end: int) -> Span:
        """The half-open span from one character offset to another, clipped to the text."""
        size = len(self.text)
        start = min(max(start, 0), size)
        return Span(self, start, min(max(end, start), size))


@dataclass(frozen=True, slots=True)
class Span:
    """Characters `start` (included) to `end` (excluded) of a source; both are offsets from 0."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line of the first character, from 1."""
        return self.source.position(self.start)[0]

    @property
    def column(self) -> int:
        """Column of the first character, from 1."""
        return self.source.position(self.start)[1]

    @property
    def text(self) -> str:
        """The characters themselves."""
        return self.source.text[self.start : self.end]

    def to(self, other: Span) -> Span:
        """The span from the start of this one to the end of another of the same source."""
        return Span(self.source, self.start, max(self.end, other.end))

    def excerpt(self) -> str:
        """The first line of the span with its number, and carets below the characters.

        >>> print(Source("m", "class C {\\n  int metods\\n}").span(16, 22).excerpt())
         2 |   int metods
           |       ^^^^^^
        """
        line, column = self.source.position(self.start)
        text = self.source.line(line)
        width = max(1, min(self.end - self.start, len(text) - column + 1))
        text, column, width = _clipped(text, column, width)
        # One character for each: the carets stand below what they mean.
        text = "".join(c if c.isprintable() or c == "\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
        number = f" {line} | "
        pad = "".join(char if char == "\t" else " " * _columns(char) for char in text[: column - 1])
        marks = "^" * max(1, sum(map(_columns, text[column - 1 : column - 1 + width])))
        return f"{number}{text}\n{' ' * (len(number) - 2)}| {pad}{marks}"

    def __str__(self) -> str:
        return f"{visible(self.source.name)}:{self.line}:{self.column}"


def _columns(char: str) -> int:
    """Return how much room a character takes on a terminal."""
    if char.isascii():
        return 1
    if category(char) in ("Mn", "Me", "Cf"):
        return 0
    return 2 if east_asian_width(char) in ("W", "F") else 1


def _clipped(text: str, column: int, width: int) -> tuple[str, int, int]:
    """A line cut to what surrounds a place, with the column and width of the place there."""
    if len(text) <= _LONGEST:
        return text, column, width
    start = max(0, column - 1 - _LONGEST // 3)
    end = min(len(text), start + _LONGEST)
    before, after = "..." * (start > 0), "..." * (end < len(text))
    column -= start - len(before)
    return f"{before}{text[start:end]}{after}", column, min(width, end - start - column + 1 + len(before))
