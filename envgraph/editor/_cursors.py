"""The text before the cursor: the word that is being written, the parser's state, and the call around it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.code import dataclass
from envgraph.editor._documents import Document
from envgraph.lang import END, PUNCTUATION, Lexeme, PartReading, TextPart, part_at

_OPENING, _CLOSING = ("(", "[", "{"), (")", "]", "}")


@dataclass(frozen=True, slots=True)
class EnclosingCall:
    """A call whose brackets contain a place.

    Attributes:
        opening: the index of the lexeme `(`.
        position: the number of commas between the bracket and the place.
    """

    opening: int
    position: int


@dataclass(frozen=True, slots=True)
class Cursor:
    """A place in a text where a word is written, or could be.

    Attributes:
        language: the language of the text.
        reading: the part of the text with the place; all offsets and indices are those in the part.
        index: the index of the word's lexeme or, if no word is there, of the next lexeme.
        start, end: the range of the word in the whole text; empty if no word is there.
        part_start: the offset of the part in the whole text.
        string: the text of the string before the place; None if the place is not in a string.
    """

    language: str
    reading: PartReading
    index: int
    start: int
    end: int
    part_start: int
    string: str | None = None

    @property
    def lexemes(self) -> Sequence[Lexeme]:
        """Return the lexemes of the part."""
        return self.reading.lexemes

    def before(self, distance: int = 1) -> Lexeme:
        """Return the lexeme at a distance before the word; an empty lexeme if there is none."""
        place = self.index - distance
        return self.lexemes[place] if place >= 0 else Lexeme(END, "", 0, 0)

    @property
    def following(self) -> str:
        """Return the text of the lexeme after the word."""
        place = self.index + (self.start < self.end)
        return self.lexemes[min(place, len(self.lexemes) - 1)].value

    def enclosing(self, sign: str, through: str = "") -> int | None:
        """Return the index of the innermost bracket that is open at the word; None if this bracket is not `sign`.

        Open brackets `through` are ignored.
        """
        depth = 0
        for place in range(self.index - 1, -1, -1):
            lexeme = self.lexemes[place]
            if lexeme.kind != PUNCTUATION:
                continue
            if lexeme.value in _CLOSING:
                depth += 1
            elif lexeme.value in _OPENING:
                if depth == 0 and lexeme.value != through:
                    return place if lexeme.value == sign else None
                depth = max(0, depth - 1)
        return None

    def completed(self) -> PartReading:
        """Return the part with a name at the cursor, so that its statement can be parsed where the word is missing."""
        if self.start < self.end:
            return self.reading
        text, place = self.reading.source.text, self.start - self.part_start
        return TextPart(self.language, 0, f"{text[:place]} _ {text[place:]}").reading

    def call(self) -> EnclosingCall | None:
        """Return the call around the word; None if the innermost open bracket before it is no `(`."""
        opening = self.enclosing("(")
        if opening is None:
            return None
        arguments = [*split_arguments(self.lexemes[opening + 1 : self.index])]
        return EnclosingCall(opening, max(0, len(arguments) - 1))


def split_arguments(lexemes: Sequence[Lexeme]) -> Iterator[Sequence[Lexeme]]:
    """Yield the lexemes of each argument of a call, up to the closing bracket or the end of the lexemes."""
    depth = begin = 0
    for place, lexeme in enumerate(lexemes):
        if lexeme.kind != PUNCTUATION:
            continue
        if lexeme.value in _OPENING:
            depth += 1
        elif lexeme.value in _CLOSING:
            depth -= 1
            if depth < 0:
                yield lexemes[begin:place]
                return
        elif lexeme.value == "," and depth == 0:
            yield lexemes[begin:place]
            begin = place + 1
    yield lexemes[begin:]


def cursor_at(document: Document, offset: int) -> Cursor | None:
    """Return the cursor at an offset of a document; None in comments, numbers, and texts without a known language."""
    part = part_at(document.source, offset)
    if part is None:
        return None
    reading, place = part.reading, offset - part.start
    index = next(i for i, one in enumerate(reading.lexemes) if one.end >= place or one.kind == END)
    lexeme = reading.lexemes[index]
    if lexeme.start >= place or (lexeme.kind == PUNCTUATION and lexeme.end == place):
        index += lexeme.start < place
        end = reading.lexemes[index - 1].end if index else 0
        if _is_in_comment(reading.source.text[end:place]):
            return None
        lexeme = reading.lexemes[index]
        if lexeme.kind != "NAME" or lexeme.start > place:
            return Cursor(part.language, reading, index, offset, offset, part.start)
    if lexeme.kind == "NAME":
        return Cursor(part.language, reading, index, part.start + lexeme.start, part.start + lexeme.end, part.start)
    if lexeme.kind == "STRING" and lexeme.start < place:
        closed = len(lexeme.value) + 2 <= lexeme.end - lexeme.start
        end = part.start + lexeme.end - closed
        string = reading.source.text[lexeme.start + 1 : place]
        start = part.start + lexeme.start + 1
        return Cursor(part.language, reading, index, start, end, part.start, string) if offset <= end else None
    return None


def _is_in_comment(text: str) -> bool:
    """Return True if a text between two lexemes ends inside a comment."""
    line = text.rpartition("\n")[2]
    return "//" in line or text.rfind("/*") > text.rfind("*/")
