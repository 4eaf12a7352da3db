"""Find definitions and references of the name at a position."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph.editor._documents import JsonObject
from envgraph.editor._name_index import NameIndex, Place, Symbol
from envgraph.errors import Span
from envgraph.metamodel import simple_name

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_READ, _WRITE = 2, 3


def find_definition(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return where the name at a position is defined; for an import, the file."""
    document = service.document(params)
    index = service.index(document.source.name)
    place = index.place_at(document.source, document.offset(params["position"]))
    if place is None:
        return []
    if place.mention.kind == "file":
        return _imported_file(service, index, place)
    symbol = index.resolve(place)
    if symbol is None:
        return []
    return [service.location(span) for span in definition_spans(index, symbol)]


def definition_spans(index: NameIndex, symbol: Symbol) -> list[Span]:
    """Return the span of the name in its definition; [] if it is unknown."""
    found = index.definition_of(symbol)
    if found is not None:
        return [found.span]
    if symbol.kind == "class":
        return [span for span in [index.span_of_class(symbol.name)] if span is not None]
    if symbol.kind == "literal":
        enums = index.metamodel.enum_types if index.metamodel else ()
        for enum in (one for one in enums if simple_name(one.name) == symbol.within):
            span = dict(enum.places).get(f"literal {enum.literals.index(symbol.name)}")
            return [span] if span else []
    if symbol.kind == "feature" and index.metamodel is not None:
        for owner in index.full_names(str(symbol.within)):
            feature = index.metamodel.feature(owner, symbol.name) if owner in index.metamodel.classes else None
            if feature is not None and feature.span is not None:
                return [feature.span]
    return []


def find_references(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return all places that refer to what the name at a position refers to, in all files of the open folders."""
    document = service.document(params)
    offset = document.offset(params["position"])
    place = service.index(document.source.name).place_at(document.source, offset)
    if place is None:
        return []
    index = service.index(document.source.name, place.mention.text)
    symbol = index.resolve(place)
    if symbol is None:
        return []
    declared = params.get("context", {}).get("includeDeclaration", True)
    found = [one for one in index.occurrences(symbol) if declared or not one.mention.is_definition]
    return [service.location(one.span) for one in found]


def highlight(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return all places in the document that refer to what the name at a position refers to."""
    document = service.document(params)
    index = service.index(document.source.name)
    place = index.place_at(document.source, document.offset(params["position"]))
    symbol = index.resolve(place) if place else None
    if symbol is None:
        return []
    return [
        {"range": document.range(one.span), "kind": _WRITE if one.mention.is_definition else _READ}
        for one in index.occurrences(symbol, [document.source])
    ]


def _imported_file(service: LanguageService, index: NameIndex, place: Place) -> list[JsonObject]:
    files = service.edited_files()
    name = files.name(place.mention.text, beside=place.source.name)
    if files.exists(name):
        start = {"line": 0, "character": 0}
        return [{"uri": service.document_named(name).uri, "range": {"start": start, "end": start}}]
    found = index.definitions.get(("metamodel", place.mention.text), [])
    return [service.location(one.span) for one in found]
