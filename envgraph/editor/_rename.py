"""Rename a definition and everything that refers to it, in all files of the open folders."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Final

from envgraph.editor._documents import JsonObject
from envgraph.editor._name_index import NameIndex, Place, Symbol
from envgraph.errors import InvalidArgument
from envgraph.lang import LANGUAGES, data_path, language_of, reserved_words, text_parts

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService

_NAME: Final = re.compile(r"[^\W\d]\w*")
_CALLABLE: Final = ("pattern", "rule", "function")
_TYPES: Final = frozenset({"int", "float", "bool", "string"})
_NOUNS: Final = {"class": "class or enum", "rule": "rule or unit"}


def prepare_rename(service: LanguageService, params: JsonObject) -> JsonObject | None:
    """Return the range and the text of the name at a position; None if there is no name that can be changed."""
    document = service.document(params)
    index = service.index(document.source.name)
    place = index.place_at(document.source, document.offset(params["position"]))
    if place is None or place.mention.kind in ("file", "package") or index.resolve(place) is None:
        return None
    return {"range": document.range(place.span), "placeholder": place.mention.text}


def rename(service: LanguageService, params: JsonObject) -> JsonObject:
    """Return the edits of all files that give a definition another name.

    Raises:
        InvalidArgument: the name is not valid, is a keyword or is used already, or a place that may need the change
            cannot be understood or changed.
    """
    document, new = service.document(params), str(params["newName"])
    offset = document.offset(params["position"])
    place = service.index(document.source.name).place_at(document.source, offset)
    symbol = None
    if place is not None and place.mention.kind not in ("file", "package"):
        index = service.index(document.source.name, place.mention.text)
        symbol = index.resolve(place)
    if place is None or symbol is None:
        raise InvalidArgument("there is no name here that can be changed", "put the cursor on a name")
    if new == symbol.name:
        return {"changes": {}}
    found = [*index.occurrences(symbol)]
    _check_new_name(new, found)
    _check_unused(index, symbol, new, found)
    _check_certain(index, symbol, found)
    changes: dict[str, list[JsonObject]] = {}
    for one in found:
        changed = service.document_of(one.span)
        changes.setdefault(changed.uri, []).append({"range": changed.range(one.span), "newText": new})
    return {"changes": changes}


def _check_new_name(new: str, found: Iterable[Place]) -> None:
    """Raise InvalidArgument if the new name cannot be written in one of the places."""
    if not _NAME.fullmatch(new):
        raise InvalidArgument(
            f"`{new}` is not a name", "a name has letters, digits and `_`, and begins with a letter or `_`"
        )
    for name in dict.fromkeys(one.source.name for one in found):
        language = language_of(name)
        if new in _TYPES or (language in LANGUAGES and new in reserved_words(str(language))):
            raise InvalidArgument(f"`{new}` has a meaning in {name}", "choose another name")


def _check_unused(index: NameIndex, symbol: Symbol, new: str, found: Iterable[Place]) -> None:
    """Raise InvalidArgument if another definition has the new name, so that names would change their meaning."""
    for place in _clashes(index, symbol, new, found):
        noun = _NOUNS.get(place.mention.kind, place.mention.kind)
        raise InvalidArgument(f"the {noun} at {place.span} is already called `{new}`", "choose another name")


def _clashes(index: NameIndex, symbol: Symbol, new: str, found: Iterable[Place]) -> Iterator[Place]:
    kinds: tuple[str, ...] = _CALLABLE if symbol.kind in _CALLABLE else (symbol.kind,)
    if symbol.kind in ("variable", "alias", "object", "action"):
        homes = {(one.source.name, one.start if symbol.kind == "variable" else 0) for one in found}
        kinds = (symbol.kind, "literal") if symbol.kind == "object" else kinds
        for source in index.sources.values():
            for start, names in index.parts(source):
                if (source.name, start if symbol.kind == "variable" else 0) in homes:
                    for one in names.by_text.get(new, ()):
                        if one.kind in kinds:
                            yield Place(source, start, one)
        return
    for kind in kinds:
        for place in index.definitions.get((kind, new), ()):
            if kind not in ("feature", "literal") or _share_names(index, symbol, place):
                yield place


def _share_names(index: NameIndex, symbol: Symbol, place: Place) -> bool:
    """Return True if the features or literals of two classes or enums may be confused."""
    other = str(place.mention.holder[1]) if place.mention.holder else ""
    if symbol.kind == "literal" or index.metamodel is None:
        return True  # `::name` may mean a literal of any enum.
    pairs = [(one, each) for one in index.full_names(str(symbol.within)) for each in index.full_names(other)]
    return not pairs or any(index.metamodel.may_overlap(one, each) for one, each in pairs)


def _check_certain(index: NameIndex, symbol: Symbol, found: list[Place]) -> None:
    """Raise InvalidArgument if the name occurs where it cannot be changed, or where its meaning is not certain."""
    known = {(one.source.name, one.span.start) for one in found}
    if not any(one.mention.is_definition for one in found) and symbol.kind != "variable":
        message = f"`{symbol.name}` is not defined in a file of envgraph's languages"
        raise InvalidArgument(message, "rename it by hand, in the file that defines it")
    bundled = [one.source.name for one in found if _is_bundled(one.source.name)]
    if bundled:
        hint = "copy the domain first, with `envgraph new NAME --domain DOMAIN`"
        raise InvalidArgument(f"{bundled[0]} belongs to a bundled domain, which is not changed", hint)
    if symbol.kind == "variable":
        return
    pattern = re.compile(rf"(?<!\w){re.escape(symbol.name)}(?!\w)")
    for source in index.sources.values():
        if not pattern.search(source.text):
            continue
        if language_of(source.name) is None and not source.name.endswith(".toml"):
            hint = "change it by hand there, or move that file"
            raise InvalidArgument(f"{source.name} contains `{symbol.name}`, too, but cannot be changed", hint)
        for part in text_parts(source):
            seen = pattern.search(part.text)
            if seen and part.reading.has_mistakes:
                span = source.span_between(part.start + seen.start(), part.start + seen.end())
                raise InvalidArgument(f"there are mistakes near `{symbol.name}` at {span}", "correct them first")
        for start, names in index.parts(source):
            for one in names.by_text.get(symbol.name, ()):
                place = Place(source, start, one)
                if (
                    one.kind in (symbol.kind, "unknown")
                    and (source.name, place.span.start) not in known
                    and not index.resolve(place)
                ):
                    message = f"the meaning of `{symbol.name}` at {place.span} is unknown"
                    raise InvalidArgument(message, "give the variable before it a class")


def _is_bundled(name: str) -> bool:
    """Return True if a file belongs to the bundled domains of an installed package."""
    folder = data_path("rules").resolve()
    return "_data" in folder.parts and str(folder) in name
