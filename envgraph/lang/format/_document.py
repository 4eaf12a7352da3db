"""Documents: text with places where a line may end, and how they become lines of at most so many columns.

After P. Wadler, "A prettier printer" (2003), in the form that Prettier gave it: a group is printed on one line if it
fits there, else each of its own places ends the line. Besides, neighbouring lines can be set in columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from typing import Final

from envgraph.code import dataclass

WIDTH: Final = 120
"""Columns of a line; a word that is longer by itself stays whole."""

STEP: Final = 4
"""Columns of an indentation."""


@dataclass(frozen=True, slots=True)
class Text:
    """Characters as they are."""

    text: str

    @property
    def forced(self) -> bool:
        """Whether it ends a line, wherever it stands."""
        return "\n" in self.text


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment of several lines; its text is shifted as far as its first line was.

    Attributes:
        column: where it began.
    """

    text: str
    column: int

    @property
    def forced(self) -> bool:
        """It ends a line."""
        return True


@dataclass(frozen=True, slots=True)
class Line:
    """A place where a line may end.

    Attributes:
        flat: what stands there if it does not.
        forced: it always ends.
        blank: an empty line follows, if it ends.
    """

    flat: str = " "
    forced: bool = False
    blank: bool = False


@dataclass(frozen=True, slots=True)
class Mark:
    """A place that can be set below the same place of the line above.

    Attributes:
        kind: lines whose first marks are of one kind are set in columns together.
        spaces: how many blanks the author has put there. Where nobody put more than usual, nothing is moved.
        usual: how many blanks stand there otherwise.
        always: it counts in broken groups too.
    """

    kind: str
    spaces: int
    usual: int = 1
    always: bool = False

    @property
    def forced(self) -> bool:
        """It ends no line."""
        return False


@dataclass(frozen=True, slots=True)
class Joined:
    """One document after the other."""

    parts: tuple[Document, ...]
    forced: bool


@dataclass(frozen=True, slots=True)
class Indent:
    """A document whose lines are indented by so many columns more."""

    inner: Document
    columns: int
    forced: bool


@dataclass(frozen=True, slots=True)
class Group:
    """A document that is on one line or on several; `forced` says that it is on several."""

    inner: Document
    forced: bool


Document = Text | Comment | Line | Mark | Joined | Indent | Group

NOTHING: Final = Text("")
SPACE: Final = Text(" ")
LINE: Final = Line()
SOFT: Final = Line("")
HARD: Final = Line(forced=True)
BLANK: Final = Line(forced=True, blank=True)


def joined(parts: Iterable[Document], *, broken: bool = False) -> Document:
    """One after the other; `broken` breaks the group around it."""
    found = tuple(parts)
    return Joined(found, broken or any(part.forced for part in found))


def indented(*parts: Document, columns: int = STEP) -> Document:
    """One after the other, further in."""
    inner = joined(parts)
    return Indent(inner, columns, inner.forced)


def grouped(*parts: Document) -> Document:
    """One after the other, on one line if possible."""
    inner = joined(parts)
    return Group(inner, inner.forced)


# --- printing


Piece = str | Mark
Command = tuple[int, bool, Document]
"""Indentation, whether on one line, what."""


@dataclass(slots=True)
class _Printer:
    pieces: list[Piece] = field(default_factory=list)
    column: int = 0

    def run(self, document: Document) -> None:
        waiting: list[Command] = [(0, False, document)]
        while waiting:
            indent, flat, one = waiting.pop()
            match one:
                case Text(text):
                    self._text(text)
                case Joined(parts):
                    waiting.extend((indent, flat, part) for part in reversed(parts))
                case Indent(inner, columns):
                    waiting.append((indent + columns, flat, inner))
                case Group(inner, forced):
                    on_one = flat or (
                        not forced and fits(waiting, (indent, True, inner), WIDTH - self.column)
                    )
                    waiting.append((indent, on_one, inner))
                case Line(text, forced, blank):
                    if flat and not forced:
                        self._text(text)
                    else:
                        self._end(indent, blank)
                case Mark(always=always):
                    if flat or always:
                        self.pieces.append(one)
                case Comment(text, column):
                    self._text(_shifted(text, column, self.column))

    def _text(self, text: str) -> None:
        if not text:
            return
        self.pieces.append(text)
        _, newline, last = text.rpartition("\n")
        self.column = len(last) if newline else self.column + len(text)

    def _end(self, indent: int, blank: bool) -> None:
        while self.pieces and isinstance(self.pieces[-1], str) and not self.pieces[-1].strip(" "):
            self.pieces.pop()
        self.pieces.append("\n\n" if blank else "\n")
        self.column = indent
        if indent:
            self.pieces.append(" " * indent)


def fits(rest: Sequence[Command], first: Command, room: int) -> bool:
    """Return whether a document fits on the line, with what follows it up to the next place where the line may end."""
    waiting = [first]
    after = len(rest)
    while room >= 0:
        if not waiting:
            if not after:
                return True
            after -= 1
            waiting.append(rest[after])
        indent, flat, one = waiting.pop()
        match one:
            case Text(text):
                if "\n" in text:
                    return len(text.partition("\n")[0]) <= room
                room -= len(text)
            case Comment(text):
                return len(text.partition("\n")[0]) <= room
            case Joined(parts):
                waiting.extend((indent, flat, part) for part in reversed(parts))
            case Indent(inner) | Group(inner):
                waiting.append((indent, flat and not (isinstance(one, Group) and one.forced), inner))
            case Line(text, forced):
                if forced or not flat:
                    return True
                room -= len(text)
            case Mark():
                pass
    return False


def _shifted(text: str, column: int, to: int) -> str:
    """A comment of several lines, moved from one column to another; as far left as all of its lines can go.

    Where each line has a `*`, they stand below each other.
    """
    first, *rest = text.split("\n")
    full = [line for line in rest if line.strip()]
    if all(line.lstrip().startswith("*") for line in rest):
        return "\n".join((first, *(" " * (to + 1) + line.strip() for line in rest)))
    if any("\t" in line[: len(line) - len(line.lstrip())] for line in full):
        return text
    margin = min((len(line) - len(line.lstrip(" ")) for line in full), default=0)
    move = max(to - column, -margin)
    moved = (" " * move + line if move > 0 else line[-move:] for line in rest)
    return "\n".join((first, *(line.rstrip() for line in moved)))


def printed(document: Document) -> list[Piece]:
    """A document as it is printed from the start of a line; line ends are pieces of their own."""
    printer = _Printer()
    printer.run(document)
    return printer.pieces


def lines_of(pieces: Iterable[Piece]) -> list[str]:
    """The lines of what was printed, set in columns where the marks in them say so."""
    rows = _columns(list(_rows(pieces)), comments=False)
    return ["".join(row.cells) for row in _columns(rows, comments=True)]


# --- columns


@dataclass(slots=True)
class _Row:
    """A line, cut at its marks; `marks[i]` stands before `cells[i + 1]`."""

    cells: list[str] = field(default_factory=lambda: [""])
    marks: list[Mark] = field(default_factory=list)

    def kind(self, comments: bool) -> tuple[str, int] | None:
        """Return what it can be set in columns with: the kind of its marks, and its indentation."""
        found = [mark.kind for mark in self.marks if (mark.kind == COMMENT) is comments]
        if not found:
            return None
        text = "".join(self.cells)
        return found[0], 0 if comments else len(text) - len(text.lstrip(" "))


COMMENT: Final = "comment"
"""Kind of the marks before comments at the ends of lines; they are set in columns after everything else."""


def _rows(pieces: Iterable[Piece]) -> Iterator[_Row]:
    row = _Row()
    for piece in pieces:
        if isinstance(piece, Mark):
            row.marks.append(piece)
            row.cells.append("")
            continue
        first, *rest = piece.split("\n")
        row.cells[-1] += first
        for line in rest:
            yield row
            row = _Row([line])
    yield row


def _columns(rows: list[_Row], *, comments: bool) -> list[_Row]:
    start = 0
    while start < len(rows):
        kind = rows[start].kind(comments)
        end = start + 1
        while kind and end < len(rows) and rows[end].kind(comments) == kind:
            end += 1
        if kind:
            _align(rows[start:end], kind[0])
        start = end
    return rows


def _align(rows: list[_Row], kind: str) -> None:
    """Set lines in columns, unless the author did not, or one gets too long."""
    places = [[i for i, mark in enumerate(row.marks) if mark.kind == kind] for row in rows]
    marks = [[row.marks[place] for place in found] for row, found in zip(rows, places, strict=True)]
    if len(rows) < 2 or not any(mark.spaces > mark.usual for found in marks for mark in found):
        return
    padded = [list(row.cells) for row in rows]
    for turn in range(max(map(len, places))):
        having = [number for number, found in enumerate(places) if turn < len(found)]
        ends = {number: sum(map(len, padded[number][: places[number][turn] + 1])) for number in having}
        here = [marks[number][turn] for number in having]
        more = int(kind in _WIDE and all(mark.spaces > mark.usual for mark in here))
        for number in having:
            padded[number][places[number][turn]] += " " * (max(ends.values()) - ends[number] + more)
    if all(sum(map(len, cells)) <= WIDTH for cells in padded):
        for row, cells in zip(rows, padded, strict=True):
            row.cells = cells


_WIDE: Final = frozenset({"annotation", "on", "table"})
"""Kinds of marks with two blanks between the columns, if the author has two or more everywhere."""
