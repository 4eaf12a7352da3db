"""Lay out documents: texts with optional line breaks are printed as lines of limited width.

The method is P. Wadler's "A prettier printer" (2003) in the form used by Prettier. A group is printed on one line if it
fits, else all of its own optional breaks become line breaks. In addition, neighbouring lines can be aligned in columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from typing import Final

from envgraph.code import dataclass

WIDTH: Final = 120
"""Maximal width of a line, in columns. A longer token is not split."""

STEP: Final = 4
"""Width of one indentation, in columns."""


@dataclass(frozen=True, slots=True)
class Text:
    """A text that is printed unchanged."""

    text: str

    @property
    def forced(self) -> bool:
        """Return True if the text contains a line break, so that every group around it is printed on several lines."""
        return "\n" in self.text


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment of several lines, whose lines are shifted by as many columns as its first line.

    Attributes:
        column: the column at which the comment began in the input.
    """

    text: str
    column: int

    @property
    def forced(self) -> bool:
        """Return True: a comment always breaks the groups around it."""
        return True


@dataclass(frozen=True, slots=True)
class Line:
    """A possible line break.

    Attributes:
        flat: the text printed instead if the line does not end here.
        forced: True if the line always ends here.
        blank: True if an empty line follows when the line ends here.
    """

    flat: str = " "
    forced: bool = False
    blank: bool = False


@dataclass(frozen=True, slots=True)
class Mark:
    """A position that can be aligned with the same position in neighbouring lines.

    Attributes:
        kind: neighbouring lines are aligned together if their first marks have the same kind.
        spaces: the number of blanks that the author wrote here. Lines are aligned only if an author wrote more than
            usual.
        usual: the number of blanks here without alignment.
        always: True if the mark also counts in groups that are broken into lines.
    """

    kind: str
    spaces: int
    usual: int = 1
    always: bool = False

    @property
    def forced(self) -> bool:
        """Return False: a mark never breaks a line."""
        return False


@dataclass(frozen=True, slots=True)
class Joined:
    """A sequence of documents, printed one after the other; `forced` breaks every group around it."""

    parts: tuple[Document, ...]
    forced: bool


@dataclass(frozen=True, slots=True)
class Indent:
    """A document whose line breaks are indented by `columns` more columns."""

    inner: Document
    columns: int
    forced: bool


@dataclass(frozen=True, slots=True)
class Group:
    """A document that is printed on one line if it fits; if `forced` is True, always on several lines."""

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
    """Return a sequence of documents; `broken=True` forces the group around it onto several lines."""
    found = tuple(parts)
    return Joined(found, broken or any(part.forced for part in found))


def indented(*parts: Document, columns: int = STEP) -> Document:
    """Return a sequence of documents whose line breaks are indented further."""
    inner = joined(parts)
    return Indent(inner, columns, inner.forced)


def grouped(*parts: Document) -> Document:
    """Return a sequence of documents that is printed on one line if possible."""
    inner = joined(parts)
    return Group(inner, inner.forced)


# --- printing


Piece = str | Mark
Command = tuple[int, bool, Document]
"""The indentation, True if the document is printed on one line, and the document."""


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
    """Return True if `first`, and the commands `rest` behind it up to a line break, fit into `room` columns."""
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
    """Return a comment of several lines moved from one column to another, but not beyond the left margin.

    If every further line begins with `*`, these stars are placed below each other. Lines indented with tabs are not
    moved.
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
    """Return the printed pieces of a document that starts on a new line; line breaks are separate pieces."""
    printer = _Printer()
    printer.run(document)
    return printer.pieces


def lines_of(pieces: Iterable[Piece]) -> list[str]:
    """Return printed pieces as lines, aligned in columns as their marks require."""
    rows = _columns(list(_rows(pieces)), comments=False)
    return ["".join(row.cells) for row in _columns(rows, comments=True)]


# --- columns


@dataclass(slots=True)
class _Row:
    """A line, split at its marks; `marks[i]` is before `cells[i + 1]`."""

    cells: list[str] = field(default_factory=lambda: [""])
    marks: list[Mark] = field(default_factory=list)

    def kind(self, comments: bool) -> tuple[str, int] | None:
        """Return the kind and indentation that neighbouring lines must share to be aligned with this line, or None.

        If `comments` is True, only marks of trailing comments count, and indentation does not; else all other marks.
        """
        found = [mark.kind for mark in self.marks if (mark.kind == COMMENT) is comments]
        if not found:
            return None
        text = "".join(self.cells)
        return found[0], 0 if comments else len(text) - len(text.lstrip(" "))


COMMENT: Final = "comment"
"""Kind of the marks before comments at the ends of lines, which are aligned after all other marks."""


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
    """Align lines at their marks of a kind, if the author wrote more blanks than usual and no line becomes too long."""
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
"""Kinds of marks with two blanks between the columns, if the author wrote two or more blanks at all of them."""
