"""Evaluate expressions by walking their syntax trees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.metamodel import Scalar, Value
from envgraph.pattern._expression_data import (
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
from envgraph.pattern._occurrences import children, required_paths
from envgraph.pattern.expressions._builtin_functions import (
    FUNCTIONS,
    add,
    check_bounds,
    divide,
    multiply,
    remainder,
    subtract,
)

FeatureReader = Callable[[int, str], Value | int | None]
"""Returns a single-valued feature of an object: the value, the id of the target, or None if unset."""

STRICT_OPERATORS: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
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
    expression: Expression, values: Mapping[str, Value | int | None], read: FeatureReader | None = None
) -> Value | int | None:
    """Return the value of a checked expression. Enum literals are represented by their names, objects by their ids.

    `&&`, `||` and `?:` evaluate only the operands that they need. A path without a target gives None. None is equal
    only to `none`, and operators and functions refuse it.

    Args:
        expression: an expression that `check_expression` has found free of errors.
        values: the value of every variable in it.
        read: reads the features of objects; may be None if the expression has no path.

    Raises:
        EvaluationError: division by zero, overflow, a function outside its domain, an operand without a value.
        InvalidArgument: a variable without an entry in `values`, or a path without `read`.
    """
    value: Value | int | None = raw_value(expression, values, read)
    return check_bounds(value) if needs_bounds(expression) else value


def needs_bounds(expression: Expression) -> bool:
    """Return True if the value may be a newly computed int or string, whose size `check_bounds` has to limit."""
    match expression:
        case Binary():
            return expression.operator in ("+", "-", "*", "/", "%")
        case Unary():
            return expression.operator == "-"
        case Conditional():
            return needs_bounds(expression.then) or needs_bounds(expression.otherwise)
        case FunctionCall():
            known = FUNCTIONS.get(expression.function)
            return known is not None and known.result not in (Scalar.BOOL, Scalar.FLOAT)
        case _:
            return False


def check_holds(
    expression: Expression, values: Mapping[str, Value | int | None], read: FeatureReader | None = None
) -> bool:
    """Return True if the expression of a `check` is true.

    Every path in it (outside `== none`) must have a value, even in an operand that `||` would not evaluate. So
    `x.attr` is also a path constraint. An expression without a value counts as false, as in VIATRA.
    """
    return value_of(expression, values, read) is True


def value_of(
    expression: Expression, values: Mapping[str, Value | int | None], read: FeatureReader | None = None
) -> Value | int | None:
    """Return the value of an `eval`, or None if it has no value, so that its body does not match.

    Paths must have a value as in `check_holds`.
    """
    try:
        if any(raw_value(path, values, read) is None for path in required_paths(expression)):
            return None
        return evaluate(expression, values, read)
    except EvaluationError:
        return None


def raw_value(node: Expression, values: Mapping[str, Any], read: FeatureReader | None) -> Any:
    match node:
        case Variable():
            if node.name not in values:
                raise InvalidArgument(f"`values` has no value for variable `{node.name}`")
            return values[node.name]
        case Constant():
            return node.value
        case EnumLiteral():
            return node.literal
        case Navigation():
            owner = raw_value(node.object, values, read)
            if isinstance(owner, str):  # `text.length`: a string is not an object, because objects are ints
                return FUNCTIONS[node.feature].implementation(owner)
            if read is None:
                raise InvalidArgument(f"pass `read`: the expression reads `{node.feature}`")
            return None if owner is None else read(owner, node.feature)
        case Unary():
            operand = _required_value(node.operand, values, read)
            return not operand if node.operator == "!" else -operand
        case Binary():
            return _binary_value(node, values, read)
        case Conditional():
            return raw_value(node.then if _required_value(node.test, values, read) else node.otherwise, values, read)
        case FunctionCall():
            arguments = [_required_value(argument, values, read) for argument in node.arguments]
            if node.declaration is not None:
                return node.declaration.bound_to_call(node.span)(*arguments)
            return FUNCTIONS[node.function].implementation(*arguments)


def _binary_value(node: Binary, values: Mapping[str, Any], read: FeatureReader | None) -> Any:
    match node.operator:
        case "&&":
            return all(_required_value(part, values, read) for part in children(node))
        case "||":
            return any(_required_value(part, values, read) for part in children(node))
        case "==":
            return raw_value(node.left, values, read) == raw_value(node.right, values, read)
        case "!=":
            return raw_value(node.left, values, read) != raw_value(node.right, values, read)
    first, links = node.chain()
    result = _required_value(first, values, read)
    for link in links:
        result = STRICT_OPERATORS[link.operator](result, _required_value(link.right, values, read))
    return result


def _required_value(node: Expression, values: Mapping[str, Any], read: FeatureReader | None) -> Any:
    value = raw_value(node, values, read)
    if value is None:
        name = f"`{node.feature}`" if isinstance(node, Navigation) else "an operand"
        raise EvaluationError(f"{name} has no value")
    return value
