"""Convert the syntax trees of `.query` files to patterns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from lark import Token, Tree

from envgraph.errors import Span
from envgraph.lang.read._file_reading import FileReading, TypeNames, resolve_type, type_name_span
from envgraph.lang.read._query_conditions import parse_conditions, parse_java_type
from envgraph.lang.read._query_header import DefinitionsFile, name_token, read_definitions
from envgraph.lang.syntax._parser import ParseResult, annotation_of, select_tokens, select_trees
from envgraph.metamodel import SUPPRESS, Annotation
from envgraph.pattern import Body, FunctionDeclaration, Parameter, Pattern, Strategy


def read_query(parsed: ParseResult, types: TypeNames | None = None) -> DefinitionsFile[Pattern | FunctionDeclaration]:
    """Return the functions and patterns of a `.query` file that could be read, functions first, and its diagnostics."""
    file = read_definitions(parsed, types, _parse_definition)
    ordered = sorted(file.definitions, key=lambda one: isinstance(one, Pattern))
    return replace(file, definitions=tuple(ordered))


def _parse_definition(reading: FileReading, package: str, tree: Tree[Token]) -> Pattern | FunctionDeclaration:
    return _parse_declaration(reading, tree) if tree.data == "declaration" else _parse_pattern(reading, package, tree)


def parse_parameters(reading: FileReading, tree: Tree[Token]) -> tuple[Parameter, ...]:
    """Parse the parameters of a definition; return an empty tuple if it has none."""
    return tuple(
        _parse_parameter(reading, item)
        for part in select_trees(tree.children, "parameters")
        for item in select_trees(part.children, "parameter")
    )


def parse_suppressions(reading: FileReading, tree: Tree[Token], *known: str) -> tuple[Annotation, ...]:
    """Return all annotations of a definition; warn of all but `@suppress` and `known` ones, which have no effect."""
    parts = select_trees(tree.children, "annotation")
    found = tuple(annotation_of(reading.parsed.source, part) for part in parts)
    for part, one in zip(parts, found, strict=True):
        if one.name not in (SUPPRESS, *known):
            reading.warn("unknown-annotation", f"`@{one.name}` has no effect here", part, "leave it out")
    return found


def _parse_pattern(reading: FileReading, package: str, tree: Tree[Token]) -> Pattern:
    name = name_token(tree)
    words = [select_tokens(part.children)[0] for part in select_trees(tree.children, "modifier")]
    for word in ("private", "search", "incremental"):
        reading.first_or_report(f"`{word}`", (token for token in words if token == word))
    return Pattern(
        name=str(name),
        parameters=parse_parameters(reading, tree),
        bodies=tuple(_parse_body(reading, part) for part in select_trees(tree.children, "body")),
        package=package,
        private="private" in words,
        strategy=_parse_strategy(reading, words),
        annotations=tuple(
            annotation_of(reading.parsed.source, part) for part in select_trees(tree.children, "annotation")
        ),
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
        mended=reading.parsed.has_mistake(tree),
    )


def _parse_declaration(reading: FileReading, tree: Tree[Token]) -> FunctionDeclaration:
    name = name_token(tree)
    parse_suppressions(reading, tree)
    result, result_span = _parse_type(reading, tree)
    return FunctionDeclaration(
        str(name),
        parse_parameters(reading, tree),
        result or "",
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
        result_span=result_span,
    )


def _parse_type(reading: FileReading, tree: Tree[Token]) -> tuple[str | None, Span | None]:
    """Parse the type of a parameter or function result.

    Returns:
        The type's name and span; both None if no type is written. The name is None for an unknown Java class, which is
        then reported.
    """
    for part in select_trees(tree.children, "type"):
        return resolve_type(reading, part), type_name_span(reading, part)
    for part in select_trees(tree.children, "java_type"):
        type_ = parse_java_type(reading, part)
        if type_ is None:
            reading.record_gap(part)
        return type_, reading.span(part)
    return None, None


def _parse_strategy(reading: FileReading, words: Iterable[Token]) -> Strategy | None:
    strategies = {str(word): word for word in words if word != "private"}
    if len(strategies) == 2:
        hint = "leave one of them out"
        reading.error(
            "contradiction", "a pattern cannot be both `search` and `incremental`", strategies["search"], hint
        )
    if "search" in strategies:
        return "search"
    return "incremental" if strategies else None


def _parse_parameter(reading: FileReading, tree: Tree[Token]) -> Parameter:
    name = name_token(tree)
    direction = {str(select_tokens(part.children)[0]) for part in select_trees(tree.children, "direction")}
    type_, span = _parse_type(reading, tree)
    return Parameter(
        str(name),
        type_,
        "in" if "in" in direction else "out" if direction else None,
        reading.span(name),
        type_span=span,
    )


def _parse_body(reading: FileReading, tree: Tree[Token]) -> Body:
    name = select_tokens(tree.children, "NAME")
    return Body(
        parse_conditions(reading, select_trees(tree.children)),
        str(name[0]) if name else None,
        reading.span(tree),
    )
