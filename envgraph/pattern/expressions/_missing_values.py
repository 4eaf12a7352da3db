"""Find the subexpression because of which an expression has no value, after its evaluation has failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from envgraph.errors import SHOWN, EvaluationError, Span
from envgraph.metamodel import Value
from envgraph.pattern._expression_data import (
    Binary,
    Conditional,
    Constant,
    Expression,
    FunctionCall,
    Navigation,
)
from envgraph.pattern._occurrences import children
from envgraph.pattern.expressions._evaluate import STRICT_OPERATORS, FeatureReader, evaluate, raw_value


def explain_error(
    error: EvaluationError,
    expression: Expression,
    values: Mapping[str, Value | int | None],
    read: FeatureReader | None,
    span: Span | None,
    advice: str,
) -> EvaluationError:
    """Return a copy of an error with the span of the subexpression that has no value, and with a hint.

    Args:
        error: the error that the evaluation raised.
        expression: the evaluated expression.
        values: the values of its variables.
        read: the function that reads features, or None.
        span: the span to report if the expression has none.
        advice: the hint that proposes a condition at this place, with `{}` for the condition.
    """
    found = find_cause(expression, values, read) or expression
    hint = _condition_hint(found, values, read, advice) or error.hint
    return EvaluationError(error.message, found.span or expression.span or span, hint)


def _condition_hint(
    found: Expression, values: Mapping[str, Value | int | None], read: FeatureReader | None, advice: str
) -> str | None:
    asked: Expression | None = None
    operator = "!= 0"
    match found:
        case Navigation():
            asked, operator = found, "!= none"
        case Binary("/" | "%", _, divisor) | FunctionCall("mod", (_, divisor)):
            asked = divisor if raw_value(divisor, values, read) == 0 else None
    if asked is not None and asked.span is not None and not isinstance(asked, Constant):
        text = asked.span.text
        if len(text) <= SHOWN.source and "\n" not in text:
            if isinstance(asked, Binary | Conditional) and text[0] != "(":
                text = f"({text})"
            return advice.format(f"{text} {operator}")
    return None


def find_cause(
    expression: Expression, values: Mapping[str, Value | int | None], read: FeatureReader | None = None
) -> Expression | None:
    """Return the smallest subexpression without a value whose operands have values, or None if all is evaluated.

    The expression is evaluated again, which is only for messages.

    >>> from envgraph.pattern import Binary, Constant
    >>> find_cause(Binary("+", Constant(1), Binary("/", Constant(2), Constant(0))), {}).operator
    '/'
    """
    try:
        evaluate(expression, values, read)
    except EvaluationError:
        return _failing_part(expression, values, read)
    return None


def _failing_part(node: Expression, values: Mapping[str, Any], read: FeatureReader | None) -> Expression:
    match node:
        case Binary() if node.operator in STRICT_OPERATORS:
            return _failing_part_of_chain(node, values, read)
        case Conditional():
            asked: tuple[Expression, ...] = (node.test,)
            if not _raises_error(node.test, values, read):
                asked = (node.then if raw_value(node.test, values, read) else node.otherwise,)
        case _:
            asked = tuple(children(node))
    strict = not isinstance(node, Conditional) and not (isinstance(node, Binary) and node.operator in ("==", "!="))
    for part in asked:
        # Earlier operands did not fail, nor decide `&&` or `||`. Otherwise this operand would not have been evaluated.
        if _raises_error(part, values, read):
            return _failing_part(part, values, read)
        if strict and raw_value(part, values, read) is None:
            return part
    return node


def _failing_part_of_chain(node: Binary, values: Mapping[str, Any], read: FeatureReader | None) -> Expression:
    """Return the part because of which a chain (`a + b - c`) has no value, without recursion along its left sides."""
    first, links = node.chain()
    if _raises_error(first, values, read):
        return _failing_part(first, values, read)
    result = raw_value(first, values, read)
    if result is None:
        return first
    for link in links:
        if _raises_error(link.right, values, read):
            return _failing_part(link.right, values, read)
        right = raw_value(link.right, values, read)
        if right is None:
            return link.right
        try:
            result = STRICT_OPERATORS[link.operator](result, right)
        except EvaluationError:
            return link
    return node


def _raises_error(node: Expression, values: Mapping[str, Any], read: FeatureReader | None) -> bool:
    """Return True if evaluating the expression raises an EvaluationError."""
    try:
        raw_value(node, values, read)
    except EvaluationError:
        return True
    return False
