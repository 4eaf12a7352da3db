"""Describe the name at a position: its kind, its signature with types, its doc comment, its matches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from envgraph.editor._documents import JsonObject
from envgraph.editor._lenses import count_text
from envgraph.editor._name_index import NameIndex, Place, Symbol
from envgraph.metamodel import Attribute, Class, EnumType, Feature, simple_name, type_name
from envgraph.pattern import StaticType, type_text

if TYPE_CHECKING:
    from envgraph.editor._checked_files import CheckResult
    from envgraph.editor._language_service import LanguageService


def hover(service: LanguageService, params: JsonObject) -> JsonObject | None:
    """Return the description of the name at a position, as Markdown; None if there is no name."""
    document = service.document(params)
    index = service.index(document.source.name)
    place = index.place_at(document.source, document.offset(params["position"]))
    symbol = index.resolve(place) if place else None
    if place is None or symbol is None:
        return None
    lines = [*describe(index, service.checked(document.source.name), place, symbol)]
    if not lines:
        return None
    head, *rest = lines
    value = "\n\n".join([f"```envgraph\n{head}\n```", *rest])
    return {"contents": {"kind": "markdown", "value": value}, "range": document.range(place.span)}


def describe(index: NameIndex, result: CheckResult, place: Place, symbol: Symbol) -> Iterator[str]:
    """Yield the signature of a definition, its doc comment if it has one, and further remarks."""
    match symbol.kind:
        case "class":
            yield from _describe_class(index, symbol)
        case "feature":
            yield from _describe_feature(index, symbol)
        case "literal":
            yield f"{symbol.within}::{symbol.name}"
        case "pattern":
            yield from _describe_pattern(result, symbol)
        case "rule" | "function":
            yield from _describe_callable(result, symbol)
        case "variable":
            types = index.classes_of(("variable", place.mention.scope, symbol.name))
            yield f"{symbol.name} : {' | '.join(_most_specific(index, types))}" if types else symbol.name
        case "object":
            found = index.definition_of(symbol)
            yield found.definition_span.text.partition("{")[0].strip() if found else symbol.name
        case _:
            yield f"{symbol.kind} {symbol.name}"


def _most_specific(index: NameIndex, classes: Iterable[str]) -> list[str]:
    """Return classes without those that have a subclass among them."""
    given = [*classes]
    known = index.metamodel.classes if index.metamodel else {}
    return [
        simple_name(one)
        for one in given
        if not any(
            other != one and other in known and one in known and index.metamodel and index.metamodel.is_a(other, one)
            for other in given
        )
    ]


def _describe_class(index: NameIndex, symbol: Symbol) -> Iterator[str]:
    for full in index.full_names(symbol.name):
        assert index.metamodel is not None
        found: Class | EnumType | None = index.metamodel.classes.get(full) or index.metamodel.enums.get(full)
        if isinstance(found, Class):
            above = f" extends {', '.join(map(simple_name, found.supertypes))}" if found.supertypes else ""
            yield f"{'abstract ' if found.abstract else ''}class {symbol.name}{above}"
            features = index.metamodel.features(full).values()
            if found.doc:
                yield found.doc
            if features:
                yield ", ".join(f"`{feature_text(one)}`" for one in features)
            return
        if found is not None:
            yield f"enum {symbol.name} {{ {', '.join(found.literals)} }}"
            if found.doc:
                yield found.doc
            return
    yield f"class {symbol.name}"


def feature_text(feature: Feature) -> str:
    """Return a feature with its type and multiplicity, as in `at : Floor[1]`."""
    type_ = type_name(feature.type) if isinstance(feature, Attribute) else simple_name(feature.target)
    has_one_value = isinstance(feature, Attribute) and not feature.many and feature.lower == 1
    return f"{feature.name} : {type_}" + ("" if has_one_value else f"[{feature.multiplicity}]")


def _describe_feature(index: NameIndex, symbol: Symbol) -> Iterator[str]:
    for owner in index.full_names(str(symbol.within)):
        assert index.metamodel is not None
        feature = index.metamodel.feature(owner, symbol.name) if owner in index.metamodel.classes else None
        if feature is not None:
            kind = "" if isinstance(feature, Attribute) else "contains " if feature.containment else "refers "
            yield f"{kind}{symbol.within}.{feature_text(feature)}"
            if feature.doc:
                yield feature.doc
            if not isinstance(feature, Attribute) and feature.opposite:
                yield f"opposite of `{simple_name(feature.target)}.{feature.opposite}`"
            return
    yield f"{symbol.within}.{symbol.name}"


def qualified_name(symbol: Symbol) -> str:
    """Return the name of a pattern, rule or unit with its package."""
    return f"{symbol.within}.{symbol.name}" if symbol.within else symbol.name


def _parameter_text(name: str, type_: StaticType | None) -> str:
    return f"{name} : {simple_name(type_text(type_))}" if type_ is not None else name


def _describe_pattern(result: CheckResult, symbol: Symbol) -> Iterator[str]:
    workspace, name = result.workspace, qualified_name(symbol)
    pattern = next((one for one in workspace.patterns if one.qualified_name == name), None)
    library = workspace.registration.library if workspace.registration else None
    if pattern is None:
        yield f"pattern {symbol.name}"
        return
    if library is not None and name in library.names():
        types: Iterable[StaticType | None] = library.parameter_types(name)
        shown = [_parameter_text(one.name, type_) for one, type_ in zip(pattern.parameters, types, strict=True)]
    else:
        shown = [f"{one.name} : {one.type}" if one.type else one.name for one in pattern.parameters]
    yield f"{'private ' if pattern.private else ''}pattern {symbol.name}({', '.join(shown)})"
    if pattern.doc:
        yield pattern.doc
    yield from _match_count_line(result, name, "pattern")


def _describe_callable(result: CheckResult, symbol: Symbol) -> Iterator[str]:
    workspace, name = result.workspace, qualified_name(symbol)
    found = next((one for one in workspace.definitions if one.qualified_name == name), None)
    table = workspace.registration.directory.signatures if workspace.registration else {}
    if symbol.kind == "function" or name not in table:
        yield f"{symbol.kind} {symbol.name}"
    else:
        parameters = ", ".join(_parameter_text(one.name, one.type) for one in table[name].parameters)
        yield f"{table[name].kind} {symbol.name}" + (f"({parameters})" if table[name].kind != "group" else "")
    if found is not None and found.doc:
        yield found.doc
    yield from _match_count_line(result, name, "rule")


def _match_count_line(result: CheckResult, name: str, kind: str) -> Iterator[str]:
    if result.counts is not None and name in result.counts.numbers:
        yield f"{count_text(result.counts.numbers[name], kind)} in `{result.counts.model}`"
