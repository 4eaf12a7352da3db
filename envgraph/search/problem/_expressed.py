"""Measures that a family file defines as expressions over other measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, LoadError, Span, name_hint
from envgraph.lang import Pattern
from envgraph.metamodel import Metamodel, Scalar
from envgraph.pattern import (
    Comparison,
    Evaluation,
    Expression,
    Variable,
    check_expression,
    value_of,
    variables_in,
)
from envgraph.rewrite import Engine
from envgraph.search.problem._problem import IndividualMeasure

_BEFORE, _AFTER, _RESULT = "result == eval(", ")", "result"
"""Text around an expression: expressions are parsed as the body of a pattern."""

OTHERS: Final = "write an expression over the measures above it, such as"


@dataclass(frozen=True, slots=True)
class Expressed:
    """A measure that is the value of an expression over other measures.

    Attributes:
        expression: the expression, free of errors.
        measures: the measures named in the expression, by name, each with the number used if a model has no value of
            it. An infinite number means that the expression has no value either.
    """

    expression: Expression
    measures: Mapping[str, tuple[IndividualMeasure, float]]

    def evaluate(self, engine: Engine) -> float:
        """Return the value for the engine's current model; `inf` if the expression or a measure in it has no value."""
        values: dict[str, float | int | str | bool | None] = {}
        for name, (measure, otherwise) in self.measures.items():
            value = float(measure.evaluate(engine))
            if not isfinite(value):
                value = otherwise
            if not isfinite(value):
                return inf
            values[name] = value
        found = value_of(self.expression, values)
        return inf if found is None else float(found)


def read_expression(
    text: str, names: Sequence[str], metamodel: Metamodel, place: Span | None
) -> tuple[Expression | None, list[Diagnostic]]:
    """Parse and check an expression over measures.

    Args:
        text: the expression, in the syntax of queries.
        names: the measures that it may name.
        metamodel: the metamodel of the models.
        place: span of the text with its quotation marks, or None.

    Returns:
        The expression, or None if it has errors; and the diagnostics.
    """
    expression, problems = parsed_expression(text, place, f"{OTHERS} `2 * {names[0] if names else 'length'}`")
    if expression is None:
        return None, problems
    unknown = [
        Diagnostic(
            "unknown-measure",
            f"unknown measure `{one.name}`",
            within(one.span, text, place),
            name_hint(one.name, names) or "name only measures that are defined above this one",
        )
        for one in variables_in(expression)
        if one.name not in names
    ]
    scope = dict.fromkeys(named(expression), Scalar.FLOAT)
    problems = [*unknown, *checked_expression(expression, scope, metamodel, text, place)]
    return (None if problems else expression), problems


def parsed_expression(text: str, place: Span | None, hint: str) -> tuple[Expression | None, list[Diagnostic]]:
    """Parse an expression without resolving the names in it.

    Args:
        text: the expression, in the syntax of queries.
        place: span of the text with its quotation marks, or None.
        hint: the hint of the diagnostic if the text is not a single expression.

    Returns:
        The expression, or None if it has errors or is nested too deeply; and the diagnostics.
    """
    try:
        body = Pattern("x", parameters=f"{_RESULT} : float", body=f"{_BEFORE}{text}{_AFTER}").bodies[0]
    except LoadError as error:
        return None, [replace(one, span=within(one.span, text, place)) for one in error.diagnostics]
    match body.constraints:
        case (Comparison(left=Variable(), right=Evaluation(expression=expression)),):
            return expression, []
        case _:
            return None, [Diagnostic("syntax-error", "this is not a single expression", place, hint)]


def checked_expression(
    expression: Expression,
    scope: Mapping[str, Scalar],
    metamodel: Metamodel,
    text: str,
    place: Span | None,
) -> list[Diagnostic]:
    """Check that an expression has a number as its value, and return the diagnostics.

    Args:
        scope: the types of the variables in the expression.
        text, place: as for `parsed_expression`.
    """
    _, wrong = check_expression(expression, scope, metamodel, expected=Scalar.FLOAT)
    return [replace(one, span=within(one.span, text, place)) for one in wrong]


def named(expression: Expression) -> tuple[str, ...]:
    """Return the names of the measures in an expression, without duplicates, in order of first occurrence."""
    return tuple(dict.fromkeys(one.name for one in variables_in(expression)))


def within(span: Span | None, text: str, place: Span | None) -> Span | None:
    """Convert a span inside the parsed pattern to a span in the file.

    If the file spells the text otherwise, such as with escapes, return `place`: the span of the whole text, or None.
    """
    if span is None or place is None or place.text[1:-1] != text:
        return place
    start, end = (min(max(0, at - len(_BEFORE)), len(text)) for at in (span.start, span.end))
    return place.source.span(place.start + 1 + start, place.start + 1 + max(start, end))
