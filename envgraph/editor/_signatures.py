"""Describe the parameters of the call around the cursor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from envgraph.code import dataclass
from envgraph.editor._cursors import Cursor, EnclosingCall, cursor_at
from envgraph.editor._documents import JsonObject
from envgraph.editor._scopes import Definitions
from envgraph.pattern import FUNCTIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from envgraph.editor._language_service import LanguageService

_ANNOTATIONS: Final = {
    "key": (
        ("attribute", "attribute ..."),
        "The attributes whose values identify an object. Or the keys of an action.",
    ),
    "glyph": (("letter", "colour"), "The letter and the colour of the objects of a class."),
    "range": (("lowest", "highest", "step = .."), "The range of a number."),
    "suppress": (("code", "code ..."), "The codes of warnings that are not reported here."),
    "weight": (("number",), "The weight with which a rule is sampled; 1 without it."),
    "priority": (("number",), "Rules with a higher priority are tried first; 0 without it."),
    "semantics": (
        ("dpo | spo",),
        "An object with other links cannot be deleted (dpo), or is deleted with them (spo).",
    ),
    "match": (
        ("homomorphic | injective",),
        "Different names may stand for the same object (homomorphic) or not (injective).",
    ),
    "hom": (("name", "name ..."), "Names that may stand for the same object."),
    "cap": (("number", "kind = number ..."), "The largest number of derived rules of a kind."),
    "Constraint": (("key = {..}", "severity = ..", "message = .."), "Each match of the pattern is a violation."),
    "FunctionalDependency": (("forEach = {..}", "unique = {..}"), "The variables that identify a match."),
    "QueryBasedFeature": (("feature = ..",), "The matches are the values of a derived feature."),
}
"""By annotation: its arguments, the last one for all further arguments, and its meaning."""


@dataclass(frozen=True, slots=True)
class _Help:
    name: str
    parameters: Sequence[str]
    doc: str | None


def signature_help(service: LanguageService, params: JsonObject) -> JsonObject | None:
    """Return the parameters of the call around a position, and which one is written there; None outside of calls."""
    document = service.document(params)
    cursor = cursor_at(document, document.offset(params["position"]))
    call = cursor.call() if cursor is not None else None
    if cursor is None or call is None or call.opening == 0:
        return None
    found = _help_for(cursor, call, Definitions(service.checked(document.source.name), document.source.name))
    if found is None:
        return None
    label = f"{found.name}({', '.join(found.parameters)})"
    parameters, place = [], len(found.name) + 1
    for one in found.parameters:
        parameters.append({"label": [place, place + len(one.encode("utf-16-le")) // 2]})
        place += len(one.encode("utf-16-le")) // 2 + 2
    signature: JsonObject = {"label": label, "parameters": parameters}
    if found.doc:
        signature["documentation"] = {"kind": "markdown", "value": found.doc}
    active = min(call.position, max(0, len(parameters) - 1))
    return {"signatures": [signature], "activeSignature": 0, "activeParameter": active}


def _help_for(cursor: Cursor, call: EnclosingCall, definitions: Definitions) -> _Help | None:
    """Return the help for the definition that a call names; None if it is unknown, or defined here."""
    place = call.opening - 1
    if cursor.lexemes[place].value in ("+", "*"):
        place -= 1
    path = [cursor.lexemes[place].value]
    while place > 1 and cursor.lexemes[place - 1].value == ".":
        place -= 2
        path.insert(0, cursor.lexemes[place].value)
    before, name = cursor.lexemes[place - 1].value if place else "", ".".join(path)
    if before == "@":
        arguments, doc = _ANNOTATIONS.get(name, ((), ""))
        return _Help(f"@{name}", arguments, doc) if doc else None
    if before in ("pattern", "rule", "unit", "environment", "function", "action"):
        return None
    signature = definitions.patterns.get(name) if before == "find" else None
    if signature is None and before != "find" and cursor.language in ("rules", "environment"):
        signature = definitions.rules.get(name)
    if signature is not None:
        return _Help(signature.name, signature.parameter_labels, signature.doc)
    cls = definitions.find_class(path[0])
    if cls is not None:
        return _relation_help(definitions, cls, path)
    function = FUNCTIONS.get(path[-1])
    if function is None:
        return None
    # `text.length()` is the same as `length(text)`.
    names = [*map(str, function.parameters[len(path) > 1 :]), *(["..."] if function.variadic else [])]
    return _Help(name, names, function.doc)


def _relation_help(definitions: Definitions, cls: str, path: Sequence[str]) -> _Help:
    """Return the help for `Class(object)` or `Class.feature(object, value)`."""
    if len(path) == 1:
        return _Help(path[0], [f"object : {cls}"], None)
    feature = definitions.features(definitions.type_of_path(cls, path[1:-1])).get(path[-1])
    type_ = definitions.type_of_path(cls, path[1:])
    return _Help(
        ".".join(path), [f"object : {cls}", f"value : {type_}" if type_ else "value"], feature.doc if feature else None
    )
