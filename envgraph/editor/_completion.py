"""Complete the word at the cursor."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from envgraph.code import dataclass
from envgraph.editor._completed_names import offered_names
from envgraph.editor._cursors import Cursor, cursor_at
from envgraph.editor._documents import Document, JsonObject
from envgraph.editor._family_completion import complete_family
from envgraph.editor._scopes import Definitions, Scope
from envgraph.editor._wanted_values import WantedValue
from envgraph.errors import WARNING_CODES
from envgraph.lang import Files
from envgraph.metamodel import SUPPRESS

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_KINDS: Final = {
    "function": 3, "variable": 6, "class": 7, "property": 10, "value": 12, "enum": 13, "keyword": 14, "snippet": 15,
    "file": 17, "reference": 18, "folder": 19, "literal": 20, "type": 25,
}  # fmt: skip
"""The numbers of the kinds of offers in the protocol."""
_RANKS: Final = {"variable": 1, "property": 1, "reference": 1, "literal": 1, "keyword": 3}
_LATE_KEYWORDS: Final = frozenset({"avg", "count", "eval", "false", "max", "min", "none", "package", "sum", "true"})
"""Keywords that are offered after the others: few statements begin with a value, and few files have a package."""
_SNIPPET: Final = 2
_REFUSED_KEYWORDS: Final = frozenset({"and", "TRUE", "FALSE", "java", "instanceof", "unwind"})
"""Keywords that the grammars accept only to report them, or that have no effect."""
_IMPORTED: Final = {
    "query": ("metamodel", "ecore", "query", "vql"),
    "rules": ("metamodel", "ecore", "query", "vql", "rules"),
    "environment": ("metamodel", "ecore", "query", "vql", "rules"),
    "model": ("metamodel", "ecore"),
}
"""By language: the suffixes of the files that a file can import."""


@dataclass(frozen=True, slots=True)
class Offer:
    """A word that can be written at the cursor.

    Attributes:
        label: the word.
        kind: a key of `_KINDS`.
        detail: a short text beside the word, such as a type.
        doc: a longer text, or None.
        inserted: the text to insert in place of the label; with `is_snippet`, `${1:x}` in it are places to fill in.
    """

    label: str
    kind: str
    detail: str = ""
    doc: str | None = None
    inserted: str = ""
    is_snippet: bool = False


def complete(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the words that can be written at a position of a document."""
    document = service.document(params)
    offset = document.offset(params["position"])
    definitions = Definitions(service.checked(document.source.name), document.source.name)
    if document.source.name.endswith(".toml"):
        found = complete_family(document, offset, definitions, service.edited_files())
        return [_item(document, start, end, Offer(*one)) for start, end, one in found]
    cursor = cursor_at(document, offset)
    if cursor is None:
        return []
    if cursor.string is not None:
        return [*_complete_string(document, cursor, definitions, service.edited_files())]
    states = cursor.reading.states_before(cursor.lexemes[cursor.index].start)
    if states is None:
        return []
    offers = [Offer(*one) for one in offered_names(cursor, states, definitions)]
    wanted = WantedValue(cursor, definitions, Scope(definitions, cursor))
    offers += [one for one in offered_keywords(cursor, states) if not wanted.excludes(one.label)]
    unique = {(one.label, one.kind): one for one in reversed(offers)}
    return [_item(document, cursor.start, cursor.end, one) for one in reversed(unique.values())]


def _item(document: Document, start: int, end: int, offer: Offer) -> JsonObject:
    made: JsonObject = {
        "label": offer.label,
        "kind": _KINDS[offer.kind],
        "sortText": f"{4 if offer.label in _LATE_KEYWORDS else _RANKS.get(offer.kind, 2)}{offer.label}",
        "filterText": offer.label,
        "textEdit": {
            "range": document.range(document.source.span_between(start, end)),
            "newText": offer.inserted or offer.label,
        },
    }
    if offer.detail:
        made["detail"] = offer.detail
    if offer.doc:
        made["documentation"] = {"kind": "markdown", "value": offer.doc}
    if offer.is_snippet:
        made["insertTextFormat"] = _SNIPPET
    return made


def offered_keywords(cursor: Cursor, states: list[int]) -> Iterator[Offer]:
    """Yield the keywords that the parser accepts at the cursor, but none that it accepts only to report it."""
    grammar = cursor.reading.grammar
    for word, terminal in grammar.lexer.keywords.items():
        if word in _REFUSED_KEYWORDS or not grammar.accepts(states, terminal):
            continue
        after = [*states]
        grammar.advance(after, terminal)
        # `or` between bodies and `as` in imports are keywords; the others are operators of other languages.
        if (word == "or" and grammar.accepts(after, "INT")) or (word == "as" and _is_cast(cursor, after)):
            continue
        if word == "metamodel" and (cursor.part_start or cursor.index):
            continue  # It is accepted behind the header only to report it.
        yield Offer(word, "keyword")


def _is_cast(cursor: Cursor, after: list[int]) -> bool:
    return cursor.reading.grammar.accepts(after, "NAME") and cursor.before(2).value != "import"


def _complete_string(
    document: Document, cursor: Cursor, definitions: Definitions, files: Files
) -> Iterator[JsonObject]:
    """Yield what can be written in a string: the path or URI of an import, or the code of a warning to suppress."""
    if cursor.before().value == "import":
        yield from _complete_path(document, cursor, files)
        for package in definitions.metamodel.packages if definitions.metamodel else ():
            if "://" in package.uri:
                yield _item(document, cursor.start, cursor.end, Offer(package.uri, "value", package.path))
    call = cursor.call()
    if call is not None and [one.value for one in cursor.lexemes[call.opening - 2 : call.opening]] == ["@", SUPPRESS]:
        for code in sorted(WARNING_CODES):
            yield _item(document, cursor.start, cursor.end, Offer(code, "value"))


def _complete_path(document: Document, cursor: Cursor, files: Files) -> Iterator[JsonObject]:
    """Yield the files and folders that an import can name, in the folder that is written already."""
    assert cursor.string is not None
    folder = cursor.string.rpartition("/")[0]
    start = cursor.start + (len(folder) + 1 if folder else 0)
    inside = files.name(f"{folder}/." if folder else ".", beside=document.source.name)
    for entry in files.entries(inside):
        last = posixpath.basename(entry)
        suffix = last.rpartition(".")[2]
        if suffix in _IMPORTED.get(cursor.language, ()) and entry != document.source.name:
            yield _item(document, start, cursor.end, Offer(last, "file"))
        elif files.is_directory(entry) and last[:1] != ".":
            yield _item(document, start, cursor.end, Offer(f"{last}/", "folder"))
