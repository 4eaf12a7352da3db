"""Find the subexpression because of which an expression has no value, after its evaluation has failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from envgraph.errors import SHOWN, EvaluationError, Span
from envgraph.metamodel import Value
from envgraph.pattern._bodies import children
from envgraph.pattern._terms import Binary, Conditional, Constant, Expression, FunctionCall, Navigation
from envgraph.pattern.expressions._evaluate import STRICT, Reader, evaluate, raw_value


def explained(
    error: EvaluationError,
    expression: Expression,
    values: Mapping[str, Value | int | None],
    read: Reader | None,
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
    found = cause(expression, values, read) or expression
    hint = _hint(found, values, read, advice) or error.hint
    return EvaluationError(error.message, found.span or expression.span or span, hint)


def _hint(
    found: Expression, values: Mapping[str, Value | int | None], read: Reader | None, advice: str
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


def cause(
    expression: Expression, values: Mapping[str, Value | int | None], read: Reader | None = None
) -> Expression | None:
    """Return the smallest subexpression without a value whose operands have values, or None if all is evaluated.

    The expression is evaluated again, which is only for messages.

    >>> from envgraph.pattern import Binary, Constant
    >>> cause(Binary("+", Constant(1), Binary("/", Constant(2), Constant(0))), {}).operator
    '/'
    """
    try:
        evaluate(expression, values, read)
    except EvaluationError:
        return _cause(expression, values, read)
    return None


def _cause(node: Expression, values: Mapping[str, Any], read: Reader | None) -> Expression:
    match node:
        case Binary() if node.operator in STRICT:
            return _cause_in_chain(node, values, read)
        case Conditional():
            asked: tuple[Expression, ...] = (node.test,)
            if not _fails(node.test, values, read):
                asked = (node.then if raw_value(node.test, values, read) else node.otherwise,)
        case _:
            asked = tuple(children(node))
    strict = not isinstance(node, Conditional) and not (
        isinstance(node, Binary) and node.operator in ("==", "!=")
    )
    for part in asked:
        # Earlier operands did not fail, nor decide `&&` or `||`. Otherwise this operand would not have been evaluated.
        if _fails(part, values, read):
            return _cause(part, values, read)
        if strict and raw_value(part, values, read) is None:
            return part
    return node


def _cause_in_chain(node: Binary, values: Mapping[str, Any], read: Reader | None) -> Expression:
    """Return the part because of which a chain (`a + b - c`) has no value, without recursion along its left sides."""
    first, links = node.chain()
    if _fails(first, values, read):
        return _cause(first, values, read)
    result = raw_value(first, values, read)
    if result is None:
        return first
    for link in links:
        if _fails(link.right, values, read):
            return _cause(link.right, values, read)
        right = raw_value(link.right, values, read)
        if right is None:
            return link.right
        try:
            result = STRICT[link.operator](result, right)
        except EvaluationError:
            return link
    return node


def _fails(node: Expression, values: Mapping[str, Any], read: Reader | None) -> bool:
    """Return True if evaluating the expression raises an EvaluationError."""
    try:
        raw_value(node, values, read)
    except EvaluationError:
        return True
    return False
