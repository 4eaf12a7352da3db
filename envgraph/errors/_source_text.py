"""Define source texts, and half-open spans of characters in them."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import field
from unicodedata import category, east_asian_width

from envgraph.code import dataclass, escape_unprintable
from envgraph.errors._shown import SHOWN


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A source text with the name that messages show for it.

    Two sources are equal only if they are the same object, so that spans of two readings of one file are never mixed.
    """

    name: str
    text: str = field(repr=False)
    _line_starts: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = [0, *(found.end() for found in re.finditer("\n", self.text))]
        object.__setattr__(self, "_line_starts", tuple(starts))

    def line_and_column(self, offset: int) -> tuple[int, int]:
        r"""Return line and column of a character offset, both from 1; the offset may be the end of the text.

        >>> Source("a", "one\ntwo").line_and_column(5)
        (2, 2)
        """
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def line_start(self, number: int) -> int:
        """Return the offset of the first character of a line (from 1); the length of the text for a line after it."""
        return self._line_starts[number - 1] if number <= len(self._line_starts) else len(self.text)

    def line_text(self, number: int) -> str:
        """Return a line (from 1) without its line break; "" if the text has fewer lines."""
        if number > len(self._line_starts):
            return ""
        start = self._line_starts[number - 1]
        end = self._line_starts[number] - 1 if number < len(self._line_starts) else len(self.text)
        return self.text[start:end].removesuffix("\r")

    def span_between(self, start: int, end: int) -> Span:
        """Return the half-open span between two character offsets, clipped to the text."""
        size = len(self.text)
        start = min(max(start, 0), size)
        return Span(self, start, min(max(end, start), size))


@dataclass(frozen=True, slots=True)
class Span:
    """A half-open range of characters of a source: offsets from 0, `start` included, `end` excluded."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Return the line of the first character, from 1."""
        return self.source.line_and_column(self.start)[0]

    @property
    def column(self) -> int:
        """Return the column of the first character, from 1."""
        return self.source.line_and_column(self.start)[1]

    @property
    def text(self) -> str:
        """Return the characters of the span."""
        return self.source.text[self.start : self.end]

    def joined_with(self, other: Span) -> Span:
        """Return the span from the start of this span to the end of `other`, a span of the same source."""
        return Span(self.source, self.start, max(self.end, other.end))

    def excerpt(self) -> str:
        r"""Return the first line of the span with its line number, and a line with carets below the characters.

        >>> print(Source("m", "class C {\n  int metods\n}").span_between(16, 22).excerpt())
         2 |   int metods
           |       ^^^^^^
        """
        line, column = self.source.line_and_column(self.start)
        text = self.source.line_text(line)
        width = max(1, min(self.end - self.start, len(text) - column + 1))
        text, column, width = _clip_line(text, column, width)
        # Replace each character by exactly one, so that the carets stay below the right characters.
        text = "".join(c if c.isprintable() or c == "\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
        number = f" {line} | "
        pad = "".join(char if char == "\t" else " " * _column_width(char) for char in text[: column - 1])
        marks = "^" * max(1, sum(map(_column_width, text[column - 1 : column - 1 + width])))
        return f"{number}{text}\n{' ' * (len(number) - 2)}| {pad}{marks}"

    def __str__(self) -> str:
        return f"{escape_unprintable(self.source.name)}:{self.line}:{self.column}"


def _column_width(char: str) -> int:
    """Return the number of terminal columns that a character takes: 0, 1 or 2."""
    if char.isascii():
        return 1
    if category(char) in ("Mn", "Me", "Cf"):
        return 0
    return 2 if east_asian_width(char) in ("W", "F") else 1


def _clip_line(text: str, column: int, width: int) -> tuple[str, int, int]:
    """Return a line, cut to the surroundings of a span if it is long, and the span's column and width in the result."""
    if len(text) <= SHOWN.line:
        return text, column, width
    start = max(0, column - 1 - SHOWN.line // 3)
    end = min(len(text), start + SHOWN.line)
    before, after = "..." * (start > 0), "..." * (end < len(text))
    column -= start - len(before)
    return f"{before}{text[start:end]}{after}", column, min(width, end - start - column + 1 + len(before))
