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

_PREFIX, _SUFFIX, _RESULT = "result == eval(", ")", "result"
"""Text around an expression: expressions are parsed as the body of a pattern."""

OTHER_MEASURES_HINT: Final = "write an expression over the measures above it, such as"


@dataclass(frozen=True, slots=True)
class ExpressionMeasure:
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


def parse_measure_expression(
    text: str, names: Sequence[str], metamodel: Metamodel, text_span: Span | None
) -> tuple[Expression | None, list[Diagnostic]]:
    """Parse and check an expression over measures.

    Args:
        text: the expression, in the syntax of queries.
        names: the measures that it may name.
        metamodel: the metamodel of the models.
        text_span: span of the text with its quotation marks, or None.

    Returns:
        The expression, or None if it has errors; and the diagnostics.
    """
    expression, problems = parse_expression(
        text, text_span, f"{OTHER_MEASURES_HINT} `2 * {names[0] if names else 'length'}`"
    )
    if expression is None:
        return None, problems
    unknown = [
        Diagnostic(
            "unknown-measure",
            f"unknown measure `{one.name}`",
            span_in_file(one.span, text, text_span),
            name_hint(one.name, names) or "name only measures that are defined above this one",
        )
        for one in variables_in(expression)
        if one.name not in names
    ]
    scope = dict.fromkeys(named_measures(expression), Scalar.FLOAT)
    problems = [*unknown, *check_number_expression(expression, scope, metamodel, text, text_span)]
    return (None if problems else expression), problems


def parse_expression(text: str, text_span: Span | None, hint: str) -> tuple[Expression | None, list[Diagnostic]]:
    """Parse an expression without resolving the names in it.

    Args:
        text: the expression, in the syntax of queries.
        text_span: span of the text with its quotation marks, or None.
        hint: the hint of the diagnostic if the text is not a single expression.

    Returns:
        The expression, or None if it has errors or is nested too deeply; and the diagnostics.
    """
    try:
        body = Pattern("x", parameters=f"{_RESULT} : float", body=f"{_PREFIX}{text}{_SUFFIX}").bodies[0]
    except LoadError as error:
        return None, [replace(one, span=span_in_file(one.span, text, text_span)) for one in error.diagnostics]
    match body.constraints:
        case (Comparison(left=Variable(), right=Evaluation(expression=expression)),):
            return expression, []
        case _:
            return None, [Diagnostic("syntax", "this is not a single expression", text_span, hint)]


def check_number_expression(
    expression: Expression,
    scope: Mapping[str, Scalar],
    metamodel: Metamodel,
    text: str,
    text_span: Span | None,
) -> list[Diagnostic]:
    """Check that an expression has a number as its value, and return the diagnostics.

    Args:
        scope: the types of the variables in the expression.
        text, text_span: as for `parse_expression`.
    """
    _, wrong = check_expression(expression, scope, metamodel, expected=Scalar.FLOAT)
    return [replace(one, span=span_in_file(one.span, text, text_span)) for one in wrong]


def named_measures(expression: Expression) -> tuple[str, ...]:
    """Return the names of the measures in an expression, without duplicates, in order of first occurrence."""
    return tuple(dict.fromkeys(one.name for one in variables_in(expression)))


def span_in_file(span: Span | None, text: str, text_span: Span | None) -> Span | None:
    """Convert a span inside the parsed pattern to a span in the file.

    If the file spells the text otherwise, such as with escapes, return `text_span`: the span of the whole text, or
    None.
    """
    if span is None or text_span is None or text_span.text[1:-1] != text:
        return text_span
    start, end = (min(max(0, at - len(_PREFIX)), len(text)) for at in (span.start, span.end))
    return text_span.source.span_between(text_span.start + 1 + start, text_span.start + 1 + max(start, end))
