"""Find the lines of a text that can be folded, the texts that enclose a position, and the links of imports."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING

from envgraph.editor._documents import Document, JsonObject
from envgraph.lang import PUNCTUATION, PartReading, TextPart, part_at, text_parts

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_COMMENTS = re.compile(r"/\*[\s\S]*?\*/|//[^\n]*(?:\n[ \t]*//[^\n]*)*")
_HEADER = re.compile(r"^[ \t]*(?:import|package)\b[^\n]*(?:\n+[ \t]*(?:import|package)\b[^\n]*)*", re.MULTILINE)
_TABLE = re.compile(r"^\[[^\n]*\n(?:(?!\[)[^\n]*(?:\n|\Z))*", re.MULTILINE)
"""Matches a table of a TOML file with its header."""


def folding_ranges(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the blocks, comments and groups of imports of a document that have more than one line."""
    document = service.document(params)
    return [*_folds(document)]


def _folds(document: Document) -> Iterator[JsonObject]:
    source = document.source
    if source.name.endswith(".toml"):
        for table in _TABLE.finditer(source.text):
            yield from _fold(document, table.start(), table.start() + len(table.group().rstrip()))
    for part in text_parts(source):
        first = source.line_and_column(part.start)[0] - 1
        for fold in _folds_of_part(part.language, part.text):
            yield fold | {one: first + fold[one] for one in ("startLine", "endLine")}


@lru_cache(maxsize=2048)
def _folds_of_part(language: str, text: str) -> tuple[JsonObject, ...]:
    """Return the folds of a part; lines count from its first line."""
    reading = TextPart(language, 0, text).reading
    document = Document("", reading.source)
    return tuple(fold for one in _foldable_texts(reading) for fold in _fold(document, *one))


def _foldable_texts(reading: PartReading) -> Iterator[tuple[int, int, str | None]]:
    """Yield start, end and kind of all foldable texts of a part, as offsets in the part."""
    open_braces: list[int] = []
    end, text = 0, reading.source.text
    for lexeme in reading.lexemes:
        for comment in _COMMENTS.finditer(text, end, lexeme.start):
            yield comment.start(), comment.end(), "comment"
        if lexeme.kind == "TEXT":
            yield lexeme.start, lexeme.end, None
        elif lexeme.kind == PUNCTUATION and lexeme.value == "{":
            open_braces.append(lexeme.start)
        elif lexeme.kind == PUNCTUATION and lexeme.value == "}" and open_braces:
            # The line of the `}` stays visible.
            yield open_braces.pop(), text.rfind("\n", 0, lexeme.start), None
        end = max(end, lexeme.end)
    for header in _HEADER.finditer(text):
        yield header.start(), header.end(), "imports"


def _fold(document: Document, start: int, end: int, kind: str | None = None) -> Iterator[JsonObject]:
    first, last = (document.source.line_and_column(max(0, one))[0] - 1 for one in (start, end))
    if first < last:
        yield {"startLine": first, "endLine": last} | ({"kind": kind} if kind else {})


def selection_ranges(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return for each position the texts around it, from the word outwards to the whole document."""
    document = service.document(params)
    return [_selection(document, document.offset(one)) for one in params["positions"]]


def _selection(document: Document, offset: int) -> JsonObject:
    source = document.source
    spans = [(0, len(source.text))]
    part = part_at(source, offset)
    if part is not None:
        around = part.reading.spans_around(offset - part.start)
        spans += [(part.start + start, part.start + end) for start, end in around]
    found: JsonObject = {}
    for start, end in dict.fromkeys(one for one in spans if one[0] <= offset <= one[1]):
        found = {"range": document.range(source.span_between(start, end))} | ({"parent": found} if found else {})
    return found


def document_links(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return a link for each imported file that exists."""
    from envgraph.editor._open_files import uri_of_name

    document = service.document(params)
    files, links = service.edited_files(), []
    for part in (one for one in text_parts(document.source) if "import" in one.text):
        for word, path in zip(part.reading.lexemes, part.reading.lexemes[1:], strict=False):
            if word.value != "import" or path.kind != "STRING" or path.brace_depth:
                continue
            name = files.name(path.value, beside=document.source.name)
            if files.exists(name):
                span = document.source.span_between(part.start + path.start + 1, part.start + path.end - 1)
                links.append({"range": document.range(span), "target": uri_of_name(files, name)})
    return links
