"""Convert the syntax trees of `.query` files to patterns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from lark import Token, Tree

from envgraph.errors import Span
from envgraph.lang.read._query_conditions import conditions_of, java_type_of
from envgraph.lang.read._query_header import DefinitionsFile, name_of, read_definitions
from envgraph.lang.read._reading import Reading, TypeNames, type_of, type_span_of
from envgraph.lang.syntax._parsing import Parsed, annotation_of, tokens, trees
from envgraph.metamodel import SUPPRESS, Annotation
from envgraph.pattern import Body, FunctionDeclaration, Parameter, Pattern, Strategy


def read_query(
    parsed: Parsed, types: TypeNames | None = None
) -> DefinitionsFile[Pattern | FunctionDeclaration]:
    """Return the functions and patterns of a `.query` file that could be read, functions first, and its diagnostics."""
    file = read_definitions(parsed, types, _definition)
    ordered = sorted(file.definitions, key=lambda one: isinstance(one, Pattern))
    return replace(file, definitions=tuple(ordered))


def _definition(reading: Reading, package: str, tree: Tree[Token]) -> Pattern | FunctionDeclaration:
    return _declaration(reading, tree) if tree.data == "declaration" else _pattern(reading, package, tree)


def parameters_of(reading: Reading, tree: Tree[Token]) -> tuple[Parameter, ...]:
    """Parse the parameters of a definition; return an empty tuple if it has none."""
    return tuple(
        _parameter(reading, item)
        for part in trees(tree.children, "parameters")
        for item in trees(part.children, "parameter")
    )


def suppressions_in(reading: Reading, tree: Tree[Token]) -> tuple[Annotation, ...]:
    """Return all annotations of a definition; warn of each one but `@suppress`, because it has no effect there."""
    parts = trees(tree.children, "annotation")
    found = tuple(annotation_of(reading.parsed.source, part) for part in parts)
    for part, one in zip(parts, found, strict=True):
        if one.name != SUPPRESS:
            reading.warn("unknown-annotation", f"`@{one.name}` has no effect here", part, "leave it out")
    return found


def _pattern(reading: Reading, package: str, tree: Tree[Token]) -> Pattern:
    name = name_of(tree)
    words = [tokens(part.children)[0] for part in trees(tree.children, "modifier")]
    for word in ("private", "search", "incremental"):
        reading.only(f"`{word}`", (token for token in words if token == word))
    return Pattern(
        name=str(name),
        parameters=parameters_of(reading, tree),
        bodies=tuple(_body(reading, part) for part in trees(tree.children, "body")),
        package=package,
        private="private" in words,
        strategy=_strategy(reading, words),
        annotations=tuple(
            annotation_of(reading.parsed.source, part) for part in trees(tree.children, "annotation")
        ),
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
        mended=reading.parsed.mended(tree),
    )


def _declaration(reading: Reading, tree: Tree[Token]) -> FunctionDeclaration:
    name = name_of(tree)
    suppressions_in(reading, tree)
    result, result_span = _typed(reading, tree)
    return FunctionDeclaration(
        str(name),
        parameters_of(reading, tree),
        result or "",
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
        result_span=result_span,
    )


def _typed(reading: Reading, tree: Tree[Token]) -> tuple[str | None, Span | None]:
    """Parse the type of a parameter or function result.

    Returns:
        The type's name and span; both None if no type is written. The name is None for an unknown Java class, which is
        then reported.
    """
    for part in trees(tree.children, "type"):
        return type_of(reading, part), type_span_of(reading, part)
    for part in trees(tree.children, "java_type"):
        type_ = java_type_of(reading, part)
        if type_ is None:
            reading.gap(part)
        return type_, reading.span(part)
    return None, None


def _strategy(reading: Reading, words: Iterable[Token]) -> Strategy | None:
    strategies = {str(word): word for word in words if word != "private"}
    if len(strategies) == 2:
        hint = "leave one of them out"
        reading.error(
            "contradiction", "a pattern cannot be both `search` and `incremental`", strategies["search"], hint
        )
    if "search" in strategies:
        return "search"
    return "incremental" if strategies else None


def _parameter(reading: Reading, tree: Tree[Token]) -> Parameter:
    name = name_of(tree)
    direction = {str(tokens(part.children)[0]) for part in trees(tree.children, "direction")}
    type_, span = _typed(reading, tree)
    return Parameter(
        str(name),
        type_,
        "in" if "in" in direction else "out" if direction else None,
        reading.span(name),
        type_span=span,
    )


def _body(reading: Reading, tree: Tree[Token]) -> Body:
    name = tokens(tree.children, "NAME")
    return Body(
        conditions_of(reading, trees(tree.children)),
        str(name[0]) if name else None,
        reading.span(tree),
    )
