"""Measures that are expressions over other measures, as a family file has them."""

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
"""What stands around an expression in the body of a pattern, which is how it is read."""

OTHERS: Final = "write an expression over the measures above it, such as"


@dataclass(frozen=True, slots=True)
class Expressed:
    """The value of an expression over other measures.

    Attributes:
        expression: free of errors.
        measures: those that it names, each with what counts where it has no value; infinite for nothing.
    """

    expression: Expression
    measures: Mapping[str, tuple[IndividualMeasure, float]]

    def evaluate(self, engine: Engine) -> float:
        """The value of the model at which the engine stands; infinite where it, or one that it names, has none."""
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
    """Read an expression over measures.

    Args:
        text: as in a query.
        names: of the measures that it may name.
        metamodel: of the models.
        place: where the text stands, between quotation marks.

    Returns:
        The expression, None where it has mistakes; and those, each at its place.
    """
    expression, problems = parsed_expression(text, place, f"{OTHERS} `2 * {names[0] if names else 'length'}`")
    if expression is None:
        return None, problems
    unknown = [
        Diagnostic(
            "unknown-measure",
            f"unknown measure `{one.name}`",
            within(one.span, text, place),
            name_hint(one.name, names) or "measures above this one can be named",
        )
        for one in variables_in(expression)
        if one.name not in names
    ]
    scope = dict.fromkeys(named(expression), Scalar.FLOAT)
    problems = [*unknown, *checked_expression(expression, scope, metamodel, text, place)]
    return (None if problems else expression), problems


def parsed_expression(text: str, place: Span | None, hint: str) -> tuple[Expression | None, list[Diagnostic]]:
    """Read an expression, whatever its names mean.

    Args:
        text: as in a query.
        place: where the text stands, between quotation marks.
        hint: what to write where it is no expression.

    Returns:
        The expression, None where it has mistakes, or is nested too deeply; and those, each at its place.
    """
    try:
        body = Pattern("x", parameters=f"{_RESULT} : float", body=f"{_BEFORE}{text}{_AFTER}").bodies[0]
    except LoadError as error:
        return None, [replace(one, span=within(one.span, text, place)) for one in error.diagnostics]
    match body.constraints:
        case (Comparison(left=Variable(), right=Evaluation(expression=expression)),):
            return expression, []
        case _:
            return None, [Diagnostic("syntax-error", "this is not one expression", place, hint)]


def checked_expression(
    expression: Expression,
    scope: Mapping[str, Scalar],
    metamodel: Metamodel,
    text: str,
    place: Span | None,
) -> list[Diagnostic]:
    """What is wrong with an expression that is to be a number, each at its place in the file.

    Args:
        scope: types of its variables.
        text, place: as for `parsed_expression`.
    """
    _, wrong = check_expression(expression, scope, metamodel, expected=Scalar.FLOAT)
    return [replace(one, span=within(one.span, text, place)) for one in wrong]


def named(expression: Expression) -> tuple[str, ...]:
    """The measures that an expression names."""
    return tuple(dict.fromkeys(one.name for one in variables_in(expression)))


def within(span: Span | None, text: str, place: Span | None) -> Span | None:
    """The place of a part of the text in the file; that of the whole where the file spells the text otherwise."""
    if span is None or place is None or place.text[1:-1] != text:
        return place
    start, end = (min(max(0, at - len(_BEFORE)), len(text)) for at in (span.start, span.end))
    return place.source.span(place.start + 1 + start, place.start + 1 + max(start, end))
