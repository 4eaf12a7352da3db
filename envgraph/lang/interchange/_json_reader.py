"""Parse JSON with the position of every value, for diagnostics about files that people may have edited."""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterator, Mapping, Set as AbstractSet
from dataclasses import replace
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING, Any

from envgraph.errors import Diagnostic, LoadError, Source, Span, name_hint, sort_diagnostics
from envgraph.graph import JsonPath, Model, json_place, model_from_json
from envgraph.lang.read._model_reader import ModelFile, ModelText
from envgraph.metamodel import LARGEST_INT, Metamodel

if TYPE_CHECKING:
    from jsonschema import ValidationError

_TOO_LONG_NUMBER = re.compile(r"-?[0-9]{4300,}")
"""Matches numbers with so many digits that Python refuses them."""
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F][0-9a-fA-F]{2}")
_ESCAPE = re.compile(r"\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}|\\u[0-9a-fA-F]{4}|\\.", re.DOTALL)
"""Matches single escapes; the two halves of a surrogate pair are one match."""
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]:,]|[^\s{}\[\]:,"]+')


_KIND_TEXTS = {
    dict: "an object",
    list: "a list",
    str: "a string",
    int: "a number",
    float: "a number",
    bool: "a truth value",
    type(None): "null",
}
_WANTED_TEXTS = {
    "object": "an object",
    "array": "a list",
    "string": "a string",
    "number": "a number",
    "boolean": "a truth value",
}


def parse_json(source: Source) -> tuple[object, dict[JsonPath, Span]]:
    """Return the value of a JSON text, and the span of each of its parts by its path.

    Raises:
        LoadError: the text is not JSON.

    >>> value, spans = parse_json(Source("a.json", '{"x": [1, 20]}'))
    >>> value, spans["x", 1].text
    ({'x': [1, 20]}, '20')
    """
    return _parse_value(source), dict(value_spans(source))


def read_json_model(source: Source, metamodel: Metamodel | None) -> ModelFile:
    """Return the model in a JSON text with all diagnostics; after errors the model is None.

    Without a metamodel only the JSON syntax is checked, and the model is None, too.
    """
    start = source.span_between(0, 0)
    name = posixpath.basename(source.name).rpartition(".")[0] or source.name
    try:
        if metamodel is None:
            _parse_value(source)
            return ModelFile((ModelText(name, start, "", None, {}),), ())
        model = parse_model(source, metamodel)
    except LoadError as error:
        return ModelFile((ModelText(name, start, "", None, {}),), error.diagnostics)
    return ModelFile((ModelText(model.name, start, metamodel.name, model, _JsonObjectSpans(source)),), ())


class _JsonObjectSpans(Mapping[int, Span]):
    """A mapping from object ids to spans in a JSON model, computed at the first access."""

    def __init__(self, source: Source) -> None:
        self._source = source

    @cached_property
    def _spans(self) -> Mapping[int, Span]:
        ids = [one["id"] for one in json.loads(self._source.text)["objects"]]
        spans = {path[1]: span for path, span in value_spans(self._source) if len(path) == 2 and path[0] == "objects"}
        return {node: spans[index] for index, node in enumerate(ids)}

    def __getitem__(self, node: int) -> Span:
        return self._spans[node]

    def __iter__(self) -> Iterator[int]:
        return iter(self._spans)

    def __len__(self) -> int:
        return len(self._spans)


def check_json(value: object, spans: Mapping[JsonPath, Span], schema: Mapping[str, Any]) -> list[Diagnostic]:
    r"""Return a diagnostic for each violation of a JSON Schema, in the order of the text.

    >>> value, spans = parse_json(Source("a.json", '{"x": [1, "2"]}'))
    >>> schema = {"properties": {"x": {"items": {"type": "number"}}}}
    >>> [str(one).split("\n")[0] for one in check_json(value, spans, schema)]
    ['a.json:1:11: `x[1]` is a string, not a number']
    """
    from jsonschema import Draft202012Validator  # slow to import, and few commands need it

    found = Draft202012Validator(schema).iter_errors(value)
    return sort_diagnostics([problem for error in found for problem in _schema_problems(error, spans)])


def _schema_problems(error: ValidationError, spans: Mapping[JsonPath, Span]) -> Iterator[Diagnostic]:
    path: JsonPath = tuple(error.absolute_path)
    if error.validator == "additionalProperties" and (known := error.schema.get("properties")):
        for key in (one for one in error.instance if one not in known):
            yield Diagnostic("unknown-key", f"unknown key `{key}`", spans[(*path, key)], name_hint(key, known))
        return
    what, wanted = f"`{json_place(path)}`" if path else "the document", error.validator_value
    match error.validator:
        case "type":
            message = f"{what} is {_KIND_TEXTS[type(error.instance)]}, not {_WANTED_TEXTS[wanted]}"
        case "required":
            message = f"{what} has no `{next(key for key in wanted if key not in error.instance)}`"
        case "const":
            found = f", not `{error.instance}`" if isinstance(error.instance, str) else ""
            message = f"{what} must be `{wanted}`{found[:100]}"
        case "minItems":
            message = f"{what} is empty"
        case _:
            message = f"{what}: {error.message[:200]}"
    yield Diagnostic("bad-format", message, spans[path])


def model_at(value: object, metamodel: Metamodel, spans: Mapping[JsonPath, Span], path: JsonPath, file: str) -> Model:
    """Return the model of a JSON value that is at `path` in a larger document, whose parts have the given spans.

    Raises:
        LoadError: the value is not a model of the metamodel; each diagnostic has the position of the wrong part.
    """
    try:
        return model_from_json(value, metamodel, file=file)  # type: ignore[arg-type]  # `model_from_json` checks it
    except LoadError as error:
        placed = [
            replace(problem, span=problem.span or spans[path + _existing_path(problem, value)])
            for problem in error.diagnostics
        ]
        raise LoadError(placed) from error


def parse_model(source: Source, metamodel: Metamodel) -> Model:
    """Return the model of a JSON text in the format of `envgraph.graph.model_to_json`.

    Raises:
        LoadError: the text is not JSON, or not a model of the metamodel; each diagnostic has the position of the wrong
            part.
    """
    value = _parse_value(source)
    if not isinstance(value, dict):
        raise LoadError.from_problem(
            "bad-format", "a model must be a JSON object", source.span_between(0, 1), "write `{ .. }`"
        )
    try:
        return model_from_json(value, metamodel, file=source.name)
    except LoadError as error:
        paths = [_existing_path(problem, value) for problem in error.diagnostics]
        spans = _spans_of(source, set(paths))
        placed = zip(error.diagnostics, paths, strict=True)
        raise LoadError([replace(problem, span=problem.span or spans[path]) for problem, path in placed]) from error


def _parse_value(source: Source) -> object:
    if not source.text.strip():
        raise LoadError.from_problem(
            "empty-file",
            "the file is empty",
            source.span_between(0, 0),
            "write models as JSON with `envgraph convert`",
        )
    try:
        value: object = json.loads(source.text, parse_constant=_parse_finite, parse_float=_parse_finite)
    except _NotFiniteNumber as error:
        span = next(span for _, span in value_spans(source) if span.text == error.text)
        hint = 'write a finite number; in a model write `"inf"` for an infinite float'
        raise LoadError.from_problem("bad-number", f"`{error.text}` is not a JSON number", span, hint) from None
    except json.JSONDecodeError as error:
        span = source.span_between(error.pos, error.pos + 1)
        raise LoadError.from_problem(
            "syntax", f"not JSON: {error.msg.lower().removesuffix(' at')}", span, _json_hint(error)
        ) from error
    except RecursionError:
        hint = "write a model as a flat list of objects; no value in it is nested deeper than a list"
        raise LoadError.from_problem(
            "syntax", "the JSON is nested too deeply", source.span_between(0, 1), hint
        ) from None
    except ValueError as error:
        found = _TOO_LONG_NUMBER.search(source.text)
        if found is None:  # no other cause is known
            raise
        span, hint = source.span_between(*found.span()), f"an int has 64 bits: write {LARGEST_INT} at most"
        raise LoadError.from_problem("number-too-large", "the number is too large", span, hint) from error
    found = next(_lone_surrogates(source.text), None)
    if found is not None:
        message = f"`{found.group()}` is half of a character"
        hint = "write the character itself, or both halves"
        raise LoadError.from_problem("bad-escape", message, source.span_between(*found.span()), hint)
    return value


class _NotFiniteNumber(Exception):
    """An exception raised for a number that is not finite: `NaN`, `Infinity` or a float that is too large."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.text = text


def _parse_finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise _NotFiniteNumber(text)
    return value


def _json_hint(error: json.JSONDecodeError) -> str | None:
    """Return a hint for the mistake that Python's JSON parser reports, or None."""
    before, here = error.doc[: error.pos].rstrip()[-1:], error.doc[error.pos : error.pos + 1]
    if before == "," and here in ("}", "]", "", '"', ","):
        return "remove the comma before it: no value follows" if here in ("}", "]") else None
    if here == "'":
        return 'write names and texts between `"`'
    if "delimiter" in error.msg:
        return "write a comma between entries, and a colon between a name and its value"
    if "property name" in error.msg:
        return 'write names of entries between `"`'
    if "Unterminated" in error.msg:
        return 'close it with `"`'
    return (
        "write a text, a number, `true`, `false`, `null`, a list or an object"
        if here
        else "add the missing rest of the file"
    )


def _lone_surrogates(text: str) -> Iterator[re.Match[str]]:
    """Yield the escapes that are only half of a character, because such a text cannot be written again."""
    if _SURROGATE.search(text) is None:
        return
    for found in _ESCAPE.finditer(text):
        if _SURROGATE.fullmatch(found.group()):
            yield found


def _existing_path(problem: Diagnostic, value: Any) -> JsonPath:
    """Return the path to the value that a problem is about, or to the innermost existing value around it."""
    for number, step in enumerate(problem.subject):
        inside = range(len(value)) if isinstance(value, list) else value if isinstance(value, dict) else ()
        if step not in inside:
            return problem.subject[:number]
        value = value[step]
    return problem.subject


def _spans_of(source: Source, wanted: AbstractSet[JsonPath]) -> Mapping[JsonPath, Span]:
    """Return the spans of the wanted paths; reading stops when all of them are found."""
    spans: dict[JsonPath, Span] = {}
    for path, span in value_spans(source):
        if path in wanted:
            spans[path] = span
            if len(spans) == len(wanted):
                break
    return spans


def value_spans(source: Source) -> Iterator[tuple[JsonPath, Span]]:
    """Yield path and span of every value in a text that must be valid JSON; inner values come before outer ones."""
    path: list[str | int] = []  # of the next value
    opened: list[int] = []  # offsets where the enclosing objects and lists begin
    expects_key = False
    for token in _TOKEN.finditer(source.text):
        text = token.group()
        if text in "{[":
            opened.append(token.start())
            path.append(0 if text == "[" else "")
            expects_key = text == "{"
        elif text in "}]":
            path.pop()
            yield tuple(path), source.span_between(opened.pop(), token.end())
            expects_key = False
        elif text == ",":
            last = path[-1]
            expects_key = isinstance(last, str)
            if isinstance(last, int):
                path[-1] = last + 1
        elif text == ":":
            expects_key = False
        elif expects_key:
            path[-1] = json.loads(text)
        else:
            yield tuple(path), source.span_between(token.start(), token.end())
