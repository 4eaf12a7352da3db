"""Shorthand functions that build nodes of generated code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from envgraph.code._syntax_tree import (
    AttributeAccess,
    Call,
    Constant,
    Expression,
    ExpressionStatement,
    Name,
    Operation,
    Tuple,
)

NONE: Final = Constant(None)
TRUE: Final = Constant(True)
FALSE: Final = Constant(False)


def emit_call(function: Expression | str, *arguments: Expression) -> Call:
    """Return a call node; a string as `function` refers to a name of the namespace."""
    return Call(Name(function) if isinstance(function, str) else function, arguments)


def emit_call_statement(
    function: Expression | str, *arguments: Expression, origin: object = None
) -> ExpressionStatement:
    """Return a statement that calls a function, given as in `emit_call`, and discards the result."""
    return ExpressionStatement(emit_call(function, *arguments), origin)


def emit_method_call(object_: Expression, name: str, *arguments: Expression) -> Call:
    """Return a node that calls the method `name` of an object."""
    return Call(AttributeAccess(object_, name), arguments)


def emit_tuple(*items: Expression) -> Tuple:
    """Return a tuple node with the given items."""
    return Tuple(items)


def emit_equal(left: Expression, right: Expression) -> Operation:
    """Return the expression `left == right`."""
    return Operation("==", (left, right))


def emit_is_not_none(value: Expression) -> Operation:
    """Return the expression `value is not None`."""
    return Operation("is not", (value, NONE))


def emit_not(test: Expression) -> Expression:
    """Return an expression that is true if and only if `test` is false."""
    match test:
        case Constant(value=held):
            return Constant(not held)
        case Operation("in", operands):
            return Operation("not in", operands)
        case _:
            return Operation("not", (test,))


def emit_joined(operator: str, operands: Sequence[Expression], empty: int) -> Expression:
    """Return the operands joined by an operator; a single operand itself, and the constant `empty` without operands."""
    if len(operands) < 2:
        return operands[0] if operands else Constant(empty)
    return Operation(operator, tuple(operands))


def emit_is_none(value: Expression) -> Operation:
    """Return the expression `value is None`."""
    return Operation("is", (value, NONE))
