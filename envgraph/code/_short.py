"""Short ways to make nodes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Final

from envgraph.code._tree import Call, Constant, Expression, Member, Name, Operation, Tuple

NONE: Final = Constant(None)
TRUE: Final = Constant(True)
FALSE: Final = Constant(False)


def call(function: Expression | str, *arguments: Expression) -> Call:
    """A call; of a name from outside, if it is a string."""
    return Call(Name(function) if isinstance(function, str) else function, arguments)


def method(object_: Expression, name: str, *arguments: Expression) -> Call:
    """A call of a method."""
    return Call(Member(object_, name), arguments)


def tuple_of(*items: Expression) -> Tuple:
    """Several values as one."""
    return Tuple(items)


def equal(left: Expression, right: Expression) -> Operation:
    """Return whether two values are equal."""
    return Operation("==", (left, right))


def some(value: Expression) -> Operation:
    """Return whether there is a value."""
    return Operation("is not", (value, NONE))


def inverse(test: Expression) -> Expression:
    """The opposite of a test."""
    match test:
        case Constant(value=held):
            return Constant(not held)
        case Operation("in", operands):
            return Operation("not in", operands)
        case _:
            return Operation("not", (test,))


def joined(operator: str, operands: Sequence[Expression], empty: int) -> Expression:
    """An operation, if there is anything to operate on."""
    if len(operands) < 2:
        return operands[0] if operands else Constant(empty)
    return Operation(operator, tuple(operands))


def is_none(value: Expression) -> Operation:
    """Return whether there is no value."""
    return Operation("is", (value, NONE))


def chained(operator: str, operands: Sequence[Expression]) -> Expression:
    """An operator between each operand and all before it."""
    return reduce(lambda left, right: Operation(operator, (left, right)), operands)
