"""List the definitions of a document or of the whole folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from envgraph.editor._documents import Document, JsonObject
from envgraph.editor._mention_data import Mention
from envgraph.editor._name_index import NameIndex, Place

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_SYMBOL_KINDS: Final = {
    "metamodel": 4, "class": 5, "feature": 7, "enum": 10, "literal": 22, "pattern": 12, "function": 12, "rule": 6,
    "environment": 2, "action": 24, "model": 19, "object": 19, "measure": 14,
}  # fmt: skip
"""By kind of definition: the `SymbolKind` of the protocol."""
_MAX_SYMBOLS: Final = 200
"""Definitions that a search of the folder returns."""


def document_symbols(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the definitions of a document, as a tree: features in classes, actions in environments."""
    document = service.document(params)
    index = NameIndex({document.source.name: document.source}, None)
    roots: list[JsonObject] = []
    open_: list[tuple[int, JsonObject]] = []
    for place in _definitions(index, document):
        made = _symbol(document, place)
        start, end = place.start + place.mention.tree_start, place.start + place.mention.tree_end
        while open_ and open_[-1][0] <= start:
            open_.pop()
        (open_[-1][1]["children"] if open_ else roots).append(made)
        open_.append((end, made))
    return roots


def _definitions(index: NameIndex, document: Document) -> list[Place]:
    found = [
        Place(document.source, start, one)
        for start, names in index.parts(document.source)
        for one in names.definitions
        if one.kind in _SYMBOL_KINDS
    ]
    return sorted(found, key=lambda one: (one.definition_span.start, -one.definition_span.end))


def _symbol(document: Document, place: Place) -> JsonObject:
    return {
        "name": place.mention.text,
        "kind": _SYMBOL_KINDS[_shown_kind(place.mention)],
        "range": document.range(place.definition_span),
        "selectionRange": document.range(place.span),
        "children": [],
    }


def _shown_kind(mention: Mention) -> str:
    is_enum = mention.kind == "class" and mention.scope is not None and mention.scope.name.startswith("enum ")
    return "enum" if is_enum else mention.kind


def workspace_symbols(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the definitions in all files of the open folders whose names contain the letters of a query, in order."""
    query = str(params.get("query", "")).casefold()
    found: dict[str, JsonObject] = {}
    for index in service.all_indexes():
        for (kind, name), places in index.definitions.items():
            if kind in _SYMBOL_KINDS and _contains_letters(name.casefold(), query):
                for place in places:
                    location = service.location(place.span)
                    kind_number = _SYMBOL_KINDS[_shown_kind(place.mention)]
                    found.setdefault(str(location), {"name": name, "kind": kind_number, "location": location})
        if len(found) >= _MAX_SYMBOLS:
            break
    return [*found.values()][:_MAX_SYMBOLS]


def _contains_letters(name: str, letters: str) -> bool:
    rest = iter(name)
    return all(letter in rest for letter in letters)
