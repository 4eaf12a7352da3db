"""Compute the edits that format a text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import SequenceMatcher
from functools import lru_cache
from typing import TYPE_CHECKING

from envgraph.editor._documents import Document, JsonObject
from envgraph.errors import LoadError
from envgraph.lang import TextPart, format_text, text_parts

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService


def format_document(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the edits that format a document; [] if it has syntax errors."""
    document = service.document(params)
    return [*_edits(document, _blocks(document))]


def format_range(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the edits that format all definitions that overlap a range of a document."""
    document = service.document(params)
    start, end = (document.offset(params["range"][one]) for one in ("start", "end"))
    return [
        *_edits(document, [one for one in _blocks(document) if one.start < max(end, start + 1) and start < one.end])
    ]


def _blocks(document: Document) -> list[TextPart]:
    """Return the parts of a document, joined where no empty line is between them.

    The definitions in a block may be aligned with each other, so they are formatted together.
    """
    blocks: list[TextPart] = []
    for part in text_parts(document.source):
        if blocks and not blocks[-1].text.replace("\r", "").endswith("\n\n"):
            blocks[-1] = TextPart(part.language, blocks[-1].start, blocks[-1].text + part.text)
        else:
            blocks.append(part)
    return blocks


def _edits(document: Document, blocks: Iterable[TextPart]) -> Iterator[JsonObject]:
    """Yield an edit for each group of changed lines; yield none if a block has syntax errors."""
    try:
        formatted = [(one, _formatted(one.language, one.text)) for one in blocks]
    except LoadError:
        return
    for block, text in formatted:
        is_last = block.end == len(document.source.text)
        yield from _line_edits(document, block, text if is_last or not text else text + _line_break(text))


@lru_cache(maxsize=2048)
def _formatted(language: str, text: str) -> str:
    return format_text(language, text)


def _line_break(text: str) -> str:
    return "\r\n" if text.endswith("\r\n") else "\n"


def _line_edits(document: Document, block: TextPart, text: str) -> Iterator[JsonObject]:
    old, new = block.text.splitlines(keepends=True), text.splitlines(keepends=True)
    if old == new:
        return
    starts = [block.start]
    for line in old:
        starts.append(starts[-1] + len(line))
    for tag, first, last, other_first, other_last in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        if tag != "equal":
            span = document.source.span_between(starts[first], starts[last])
            yield {"range": document.range(span), "newText": "".join(new[other_first:other_last])}
