"""Find the kind of each token of a text, so that editors can colour it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

from envgraph.editor._documents import Document, JsonObject
from envgraph.editor._mention_data import Mention
from envgraph.editor._mentions import mentions_of
from envgraph.lang import END, PUNCTUATION, Lexeme, PartReading, TextPart, text_parts

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

TOKEN_TYPES: Final = (
    "namespace", "type", "parameter", "variable", "property", "enumMember", "function", "decorator", "keyword",
    "comment", "string", "number",
)  # fmt: skip
"""The kinds of tokens, as the Language Server Protocol calls them."""
_NAME_KINDS: Final = {
    "class": "type", "environment": "type", "feature": "property", "literal": "enumMember", "variable": "variable",
    "object": "variable", "pattern": "function", "rule": "function", "function": "function", "action": "function",
    "metamodel": "namespace", "model": "namespace", "package": "namespace", "alias": "namespace",
}  # fmt: skip
"""By kind of `Mention`: the kind of its token."""
_LEXEME_KINDS = {"STRING": "string", "TEXT": "string", "INT": "number", "FLOAT": "number", "LONG": "number"}
_COMMENT = re.compile(r"//[^\r\n]*|/\*[\s\S]*?(?:\*/|\Z)")
_FIRST_CHARACTERS = 20_000
"""Characters of a document whose tokens are sent before its first check, which parses the rest in another thread."""
_LINE_BREAK = re.compile(r"\r?\n")


class ColouredPiece(NamedTuple):
    """A piece of one line: offsets in its part, the kind of token, and 1 for a definition, else 0."""

    start: int
    end: int
    kind: str
    modifiers: int


def semantic_tokens(service: LanguageService, params: JsonObject) -> JsonObject:
    """Return the tokens of a document: five numbers for each, relative to the token before.

    Before the first check of a large document, these are the tokens of its beginning. The editor asks again after it.
    """
    document = service.document(params)
    parts = text_parts(document.source)
    if service.refreshes_tokens and not service.is_parsed(document.source.name):
        first = [one for one in parts if one.start < _FIRST_CHARACTERS]
        if len(first) < len(parts):
            service.partial_tokens.add(document.source.name)
            parts = tuple(first)
    return {"data": encode_tokens(document, parts)}


def semantic_tokens_in_range(service: LanguageService, params: JsonObject) -> JsonObject:
    """Return the tokens of all definitions that overlap a range of a document."""
    document = service.document(params)
    start, end = (document.offset(params["range"][one]) for one in ("start", "end"))
    parts = [one for one in text_parts(document.source) if one.start <= end and start < one.end]
    return {"data": encode_tokens(document, parts)}


def encode_tokens(document: Document, parts: Iterable[TextPart]) -> list[int]:
    """Return the tokens of parts of a document as the protocol writes them.

    Each token is five numbers: lines after the token before, characters after its start or the start of the line,
    length, kind and modifiers; lengths are in UTF-16 code units.
    """
    data: list[int] = []
    line = 0
    for part in parts:
        first = document.source.line_and_column(part.start)[0] - 1
        own, last = _encoded_part(part.language, part.text)
        if own:
            data.append(first + own[0] - line)
            data += own[1:]
            line = first + last
    return data


@lru_cache(maxsize=2048)
def _encoded_part(language: str, text: str) -> tuple[tuple[int, ...], int]:
    """Return the encoded tokens of a part, and the line of the last one, counted from the first line of the part."""
    document = Document("", TextPart(language, 0, text).reading.source)
    data: list[int] = []
    line = character = 0
    for piece in coloured_pieces(TextPart(language, 0, text)):
        position = document.position(piece.start)
        if position["line"] != line:
            character = 0
        length = len(text[piece.start : piece.end].encode("utf-16-le")) // 2
        data += (position["line"] - line, position["character"] - character, length)
        data += (TOKEN_TYPES.index(piece.kind), piece.modifiers)
        line, character = position["line"], position["character"]
    return tuple(data), line


def coloured_pieces(part: TextPart) -> Iterator[ColouredPiece]:
    """Yield the coloured pieces of a part in the order of the text; none goes over the end of its line."""
    reading, text, end = part.reading, part.text, 0
    names = {one.start: one for one in mentions_of(part).all if one.kind in _NAME_KINDS}
    for before, lexeme in zip((None, *reading.lexemes), reading.lexemes, strict=False):
        for comment in _COMMENT.finditer(text, end, lexeme.start):
            yield from _pieces_on_lines(text, comment.start(), comment.end(), "comment", 0)
        known = names.get(lexeme.start) if lexeme.kind == "NAME" else None
        if known is not None and lexeme.terminal in ("", "NAME"):
            yield ColouredPiece(lexeme.start, lexeme.end, _name_kind(known), int(known.is_definition))
        elif kind := _kind_of(lexeme, before, reading):
            yield from _pieces_on_lines(text, lexeme.start, lexeme.end, kind, 0)
        end = max(end, lexeme.end)


def _name_kind(mention: Mention) -> str:
    scope = mention.scope
    is_parameter = mention.kind == "variable" and scope is not None and mention.text in scope.parameters
    return "parameter" if is_parameter else _NAME_KINDS[mention.kind]


def _kind_of(lexeme: Lexeme, before: Lexeme | None, reading: PartReading) -> str | None:
    """Return the kind of a lexeme that is no name of the syntax tree; None for signs."""
    if lexeme.kind == PUNCTUATION:
        return "decorator" if lexeme.value == "@" else None
    if lexeme.kind != "NAME":
        return None if lexeme.kind == END else _LEXEME_KINDS[lexeme.kind]
    if lexeme.terminal not in ("", "NAME"):
        return "keyword"
    if before is not None and before.value == "@":
        return "decorator"
    is_word = not lexeme.is_escaped and not lexeme.terminal and lexeme.value in reading.grammar.lexer.keywords
    return "keyword" if is_word else "variable"


def _pieces_on_lines(text: str, start: int, end: int, kind: str, modifiers: int) -> Iterator[ColouredPiece]:
    """Yield a piece for each line from `start` to `end` that is not empty."""
    while start < end:
        line_break = _LINE_BREAK.search(text, start, end)
        stop = line_break.start() if line_break else end
        if stop > start:
            yield ColouredPiece(start, stop, kind, modifiers)
        start = line_break.end() if line_break else end
