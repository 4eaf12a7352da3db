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

INDENT_COLUMNS: Final = 4
"""Width of one indentation, in columns."""


@dataclass(frozen=True, slots=True)
class TextDocument:
    """A text that is printed unchanged."""

    text: str

    @property
    def breaks_groups(self) -> bool:
        """Return True if the text contains a line break, so that every group around it is printed on several lines."""
        return "\n" in self.text


@dataclass(frozen=True, slots=True)
class CommentDocument:
    """A comment of several lines, whose lines are shifted by as many columns as its first line.

    Attributes:
        column: the column at which the comment began in the input.
    """

    text: str
    column: int

    @property
    def breaks_groups(self) -> bool:
        """Return True: a comment always breaks the groups around it."""
        return True


@dataclass(frozen=True, slots=True)
class LineBreak:
    """A possible line break.

    Attributes:
        flat_text: the text printed instead if the line does not end here.
        breaks_groups: True if the line always ends here.
        has_blank_line: True if an empty line follows when the line ends here.
    """

    flat_text: str = " "
    breaks_groups: bool = False
    has_blank_line: bool = False


@dataclass(frozen=True, slots=True)
class AlignmentMark:
    """A position that can be aligned with the same position in neighbouring lines.

    Attributes:
        kind: neighbouring lines are aligned together if their first marks have the same kind.
        spaces: the number of blanks that the author wrote here. Lines are aligned only if an author wrote more than
            usual.
        usual_spaces: the number of blanks here without alignment.
        counts_in_broken_groups: True if the mark also counts in groups that are broken into lines.
    """

    kind: str
    spaces: int
    usual_spaces: int = 1
    counts_in_broken_groups: bool = False

    @property
    def breaks_groups(self) -> bool:
        """Return False: a mark never breaks a line."""
        return False


@dataclass(frozen=True, slots=True)
class JoinedDocument:
    """A sequence of documents, printed one after the other; `breaks_groups` breaks every group around it."""

    parts: tuple[Document, ...]
    breaks_groups: bool


@dataclass(frozen=True, slots=True)
class IndentedDocument:
    """A document whose line breaks are indented by `columns` more columns."""

    inner: Document
    columns: int
    breaks_groups: bool


@dataclass(frozen=True, slots=True)
class DocumentGroup:
    """A document that is printed on one line if it fits; if `breaks_groups` is True, always on several lines."""

    inner: Document
    breaks_groups: bool


Document = (
    TextDocument | CommentDocument | LineBreak | AlignmentMark | JoinedDocument | IndentedDocument | DocumentGroup
)

EMPTY_TEXT: Final = TextDocument("")
SPACE: Final = TextDocument(" ")
LINE_OR_BLANK: Final = LineBreak()
LINE_OR_NOTHING: Final = LineBreak("")
FORCED_LINE: Final = LineBreak(breaks_groups=True)
FORCED_EMPTY_LINE: Final = LineBreak(breaks_groups=True, has_blank_line=True)


def join_documents(parts: Iterable[Document], *, force_break: bool = False) -> Document:
    """Return a sequence of documents; `broken=True` forces the group around it onto several lines."""
    found = tuple(parts)
    return JoinedDocument(found, force_break or any(part.breaks_groups for part in found))


def indent_documents(*parts: Document, columns: int = INDENT_COLUMNS) -> Document:
    """Return a sequence of documents whose line breaks are indented further."""
    inner = join_documents(parts)
    return IndentedDocument(inner, columns, inner.breaks_groups)


def group_documents(*parts: Document) -> Document:
    """Return a sequence of documents that is printed on one line if possible."""
    inner = join_documents(parts)
    return DocumentGroup(inner, inner.breaks_groups)


# --- printing


Piece = str | AlignmentMark
PrintCommand = tuple[int, bool, Document]
"""The indentation, True if the document is printed on one line, and the document."""


@dataclass(slots=True)
class _DocumentPrinter:
    pieces: list[Piece] = field(default_factory=list)
    column: int = 0

    def print_document(self, document: Document) -> None:
        waiting: list[PrintCommand] = [(0, False, document)]
        while waiting:
            indent, flat, one = waiting.pop()
            match one:
                case TextDocument(text):
                    self._add_text(text)
                case JoinedDocument(parts):
                    waiting.extend((indent, flat, part) for part in reversed(parts))
                case IndentedDocument(inner, columns):
                    waiting.append((indent + columns, flat, inner))
                case DocumentGroup(inner, forced):
                    on_one = flat or (not forced and fits_on_line(waiting, (indent, True, inner), WIDTH - self.column))
                    waiting.append((indent, on_one, inner))
                case LineBreak(text, forced, blank):
                    if flat and not forced:
                        self._add_text(text)
                    else:
                        self._end_line(indent, blank)
                case AlignmentMark(counts_in_broken_groups=always):
                    if flat or always:
                        self.pieces.append(one)
                case CommentDocument(text, column):
                    self._add_text(_shift_comment(text, column, self.column))

    def _add_text(self, text: str) -> None:
        if not text:
            return
        self.pieces.append(text)
        _, newline, last = text.rpartition("\n")
        self.column = len(last) if newline else self.column + len(text)

    def _end_line(self, indent: int, blank: bool) -> None:
        while self.pieces and isinstance(self.pieces[-1], str) and not self.pieces[-1].strip(" "):
            self.pieces.pop()
        self.pieces.append("\n\n" if blank else "\n")
        self.column = indent
        if indent:
            self.pieces.append(" " * indent)


def fits_on_line(following: Sequence[PrintCommand], first: PrintCommand, columns_left: int) -> bool:
    """Return True if `first`, and the commands `following` behind it up to a line break, fit into `columns_left`
    columns.
    """
    waiting = [first]
    after = len(following)
    while columns_left >= 0:
        if not waiting:
            if not after:
                return True
            after -= 1
            waiting.append(following[after])
        indent, flat, one = waiting.pop()
        match one:
            case TextDocument(text):
                if "\n" in text:
                    return len(text.partition("\n")[0]) <= columns_left
                columns_left -= len(text)
            case CommentDocument(text):
                return len(text.partition("\n")[0]) <= columns_left
            case JoinedDocument(parts):
                waiting.extend((indent, flat, part) for part in reversed(parts))
            case IndentedDocument(inner) | DocumentGroup(inner):
                waiting.append((indent, flat and not (isinstance(one, DocumentGroup) and one.breaks_groups), inner))
            case LineBreak(text, forced):
                if forced or not flat:
                    return True
                columns_left -= len(text)
            case AlignmentMark():
                pass
    return False


def _shift_comment(text: str, column: int, to: int) -> str:
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


def print_pieces(document: Document) -> list[Piece]:
    """Return the printed pieces of a document that starts on a new line; line breaks are separate pieces."""
    printer = _DocumentPrinter()
    printer.print_document(document)
    return printer.pieces


def aligned_lines(pieces: Iterable[Piece]) -> list[str]:
    """Return printed pieces as lines, aligned in columns as their marks require."""
    rows = _align_neighbours(list(_marked_lines(pieces)), trailing_comments=False)
    return ["".join(row.cells) for row in _align_neighbours(rows, trailing_comments=True)]


# --- columns


@dataclass(slots=True)
class _MarkedLine:
    """A line, split at its marks; `marks[i]` is before `cells[i + 1]`."""

    cells: list[str] = field(default_factory=lambda: [""])
    marks: list[AlignmentMark] = field(default_factory=list)

    def alignment_key(self, trailing_comments: bool) -> tuple[str, int] | None:
        """Return the kind and indentation that neighbouring lines must share to be aligned with this line, or None.

        If `trailing_comments` is True, only marks of trailing comments count, and indentation does not; else all other
        marks.
        """
        found = [mark.kind for mark in self.marks if (mark.kind == COMMENT_MARK_KIND) is trailing_comments]
        if not found:
            return None
        text = "".join(self.cells)
        return found[0], 0 if trailing_comments else len(text) - len(text.lstrip(" "))


COMMENT_MARK_KIND: Final = "comment"
"""Kind of the marks before comments at the ends of lines, which are aligned after all other marks."""


def _marked_lines(pieces: Iterable[Piece]) -> Iterator[_MarkedLine]:
    row = _MarkedLine()
    for piece in pieces:
        if isinstance(piece, AlignmentMark):
            row.marks.append(piece)
            row.cells.append("")
            continue
        first, *rest = piece.split("\n")
        row.cells[-1] += first
        for line in rest:
            yield row
            row = _MarkedLine([line])
    yield row


def _align_neighbours(rows: list[_MarkedLine], *, trailing_comments: bool) -> list[_MarkedLine]:
    start = 0
    while start < len(rows):
        kind = rows[start].alignment_key(trailing_comments)
        end = start + 1
        while kind and end < len(rows) and rows[end].alignment_key(trailing_comments) == kind:
            end += 1
        if kind:
            _align(rows[start:end], kind[0])
        start = end
    return rows


def _align(rows: list[_MarkedLine], kind: str) -> None:
    """Align lines at their marks of a kind, if the author wrote more blanks than usual and no line becomes too long."""
    places = [[i for i, mark in enumerate(row.marks) if mark.kind == kind] for row in rows]
    marks = [[row.marks[place] for place in found] for row, found in zip(rows, places, strict=True)]
    if len(rows) < 2 or not any(mark.spaces > mark.usual_spaces for found in marks for mark in found):
        return
    padded = [list(row.cells) for row in rows]
    for turn in range(max(map(len, places))):
        having = [number for number, found in enumerate(places) if turn < len(found)]
        ends = {number: sum(map(len, padded[number][: places[number][turn] + 1])) for number in having}
        here = [marks[number][turn] for number in having]
        more = int(kind in _WIDE_MARK_KINDS and all(mark.spaces > mark.usual_spaces for mark in here))
        for number in having:
            padded[number][places[number][turn]] += " " * (max(ends.values()) - ends[number] + more)
    if all(sum(map(len, cells)) <= WIDTH for cells in padded):
        for row, cells in zip(rows, padded, strict=True):
            row.cells = cells


_WIDE_MARK_KINDS: Final = frozenset({"annotation", "on", "table"})
"""Kinds of marks with two blanks between the columns, if the author wrote two or more blanks at all of them."""
