"""The value of an expression, by walking its tree."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.metamodel import Scalar, Value
from envgraph.pattern._bodies import children, navigations
from envgraph.pattern._terms import (
    Binary,
    Conditional,
    Constant,
    EnumLiteral,
    Expression,
    FunctionCall,
    Navigation,
    Unary,
    Variable,
)
from envgraph.pattern.expressions._operations import (
    FUNCTIONS,
    add,
    bounded,
    divide,
    multiply,
    remainder,
    subtract,
)

Reader = Callable[[int, str], Value | int | None]
"""Reads a single-valued feature of an object: the value, the id of the target, or None if there is none."""

STRICT: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": add,
    "-": subtract,
    "*": multiply,
    "/": divide,
    "%": remainder,
    "<": lambda left, right: left < right,
    "<=": lambda left, right: left <= right,
    ">": lambda left, right: left > right,
    ">=": lambda left, right: left >= right,
}


def evaluate(
    expression: Expression, values: Mapping[str, Value | int | None], read: Reader | None = None
) -> Value | int | None:
    """The value of a checked expression; enum literals are their names, objects their ids.

    `&&`, `||` and `?:` evaluate only what they need. A path that leads nowhere gives None, which equals `none` alone
    and which no operator or function takes.

    Args:
        expression: free of errors, as `check_expression` says.
        values: of every variable in it.
        read: reads the features of objects; may be missing when the expression has no path.

    Raises:
        EvaluationError: division by zero, overflow, a function outside its domain, an operand without a value.
        InvalidArgument: a variable without an entry in `values`, or a path without `read`.
    """
    value: Value | int | None = raw_value(expression, values, read)
    return bounded(value) if computes(expression) else value


def computes(expression: Expression) -> bool:
    """Return whether the value may be a new one, which has to stay in bounds, and no truth value or float."""
    match expression:
        case Binary():
            return expression.operator in ("+", "-", "*", "/", "%")
        case Unary():
            return expression.operator == "-"
        case Conditional():
            return computes(expression.then) or computes(expression.otherwise)
        case FunctionCall():
            known = FUNCTIONS.get(expression.function)
            return known is not None and known.result not in (Scalar.BOOL, Scalar.FLOAT)
        case _:
            return False


def holds(
    expression: Expression, values: Mapping[str, Value | int | None], read: Reader | None = None
) -> bool:
    """Return whether a `check` holds.

    Every path in it (outside `== none`) must have a value, even where `||` would not look: that is what makes
    `x.attr` a path constraint. An expression without a value does not hold, as in VIATRA.
    """
    return value_of(expression, values, read) is True


def value_of(
    expression: Expression, values: Mapping[str, Value | int | None], read: Reader | None = None
) -> Value | int | None:
    """The value of an `eval`, or None when it has none: then the body does not match. Paths as in `holds`."""
    try:
        if any(raw_value(path, values, read) is None for path in navigations(expression)):
            return None
        return evaluate(expression, values, read)
    except EvaluationError:
        return None


def raw_value(node: Expression, values: Mapping[str, Any], read: Reader | None) -> Any:
    match node:
        case Variable():
            if node.name not in values:
                raise InvalidArgument(f"no value for variable `{node.name}`")
            return values[node.name]
        case Constant():
            return node.value
        case EnumLiteral():
            return node.literal
        case Navigation():
            owner = raw_value(node.object, values, read)
            if isinstance(owner, str):  # `text.length`: objects are ints
                return FUNCTIONS[node.feature].implementation(owner)
            if read is None:
                raise InvalidArgument(f"no model to read `{node.feature}` from")
            return None if owner is None else read(owner, node.feature)
        case Unary():
            operand = _present(node.operand, values, read)
            return not operand if node.operator == "!" else -operand
        case Binary():
            return _binary(node, values, read)
        case Conditional():
            return raw_value(node.then if _present(node.test, values, read) else node.otherwise, values, read)
        case FunctionCall():
            arguments = [_present(argument, values, read) for argument in node.arguments]
            if node.declaration is not None:
                return node.declaration.at(node.span)(*arguments)
            return FUNCTIONS[node.function].implementation(*arguments)


def _binary(node: Binary, values: Mapping[str, Any], read: Reader | None) -> Any:
    match node.operator:
        case "&&":
            return all(_present(part, values, read) for part in children(node))
        case "||":
            return any(_present(part, values, read) for part in children(node))
        case "==":
            return raw_value(node.left, values, read) == raw_value(node.right, values, read)
        case "!=":
            return raw_value(node.left, values, read) != raw_value(node.right, values, read)
    first, links = node.chain()
    result = _present(first, values, read)
    for link in links:
        result = STRICT[link.operator](result, _present(link.right, values, read))
    return result


def _present(node: Expression, values: Mapping[str, Any], read: Reader | None) -> Any:
    value = raw_value(node, values, read)
    if value is None:
        name = f"`{node.feature}`" if isinstance(node, Navigation) else "an operand"
        raise EvaluationError(f"{name} has no value")
    return value
