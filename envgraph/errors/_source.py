"""Texts and half-open stretches of them."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A text and the name it is shown under.

    Two sources are equal only if they are the same object: spans into different readings of one file must not be
    mixed.
    """

    name: str
    text: str
    _line_starts: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = [0]
        starts.extend(index + 1 for index, char in enumerate(self.text) if char == "\n")
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
        number = f" {line} | "
        width = max(1, min(self.end - self.start, len(text) - column + 1))
        pad = "".join(char if char == "\t" else " " for char in text[: column - 1])
        return f"{number}{text}\n{' ' * (len(number) - 2)}| {pad}{'^' * width}"

    def __str__(self) -> str:
        return f"{self.source.name}:{self.line}:{self.column}"
