"""The operators and functions of the expression language, as Python functions of values.

`evaluate` uses these functions, and generated code calls them by the names in `EXPRESSION_NAMESPACE`.
Each function returns a value or raises `EvaluationError`, and no other exception.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final, Literal

from envgraph.code import dataclass
from envgraph.errors import LIMITS, EvaluationError
from envgraph.metamodel import Scalar, Value

_INT_LOW, _INT_HIGH = -(2**63), 2**63 - 1

Number = int | float


def value_text(value: Value) -> str:
    """Return the text of a value for concatenation: `true` and `false` for bools, and the name for an enum literal."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


_OVERFLOW_HINT: Final = "use smaller numbers, or calculate with a `float`: an `int` has at most 64 bits"


def check_bounds(value: Any) -> Any:
    """Return the value of a whole expression if it is an int of 64 bits or a string of at most a million characters.

    Values of other types are returned unchanged. Inside an expression ints are exact, however large. Only the result is
    limited, because a rule stores it and reads it again: a loop of `x = x * x` ends with an error instead of
    exhausting the memory.

    Raises:
        EvaluationError: the value is too large.
    """
    if type(value) is int and not _INT_LOW <= value <= _INT_HIGH:
        raise EvaluationError("overflow: the result does not fit 64 bits", hint=_OVERFLOW_HINT)
    if type(value) is str and len(value) > LIMITS["characters"]:
        raise EvaluationError(f"overflow: the result has more than {LIMITS['characters']} characters")
    return value


def check_finite(value: float) -> float:
    """Return the number unchanged if it is finite.

    Raises:
        EvaluationError: the number is infinite or NaN.
    """
    if value - value != 0:
        raise EvaluationError("overflow: the result is not a finite number")
    return value


def add(left: Value, right: Value) -> Value:
    """Return a concatenation if one side is a string, else the sum. Raise `EvaluationError` if it is not finite."""
    if isinstance(left, str) or isinstance(right, str):
        return value_text(left) + value_text(right)
    try:
        result = left + right
    except OverflowError as error:
        raise _overflow(error) from None
    return result if result - result == 0 else check_finite(result)


def _finite_operation(operation: Callable[[Any, Any], Number]) -> Callable[[Number, Number], Number]:
    """Return the operation with a check: it raises `EvaluationError` if its result is not finite."""

    def checked_operation(left: Number, right: Number) -> Number:
        try:
            result = operation(left, right)
        except OverflowError as error:
            raise _overflow(error) from None
        return result if result - result == 0 else check_finite(result)

    return checked_operation


subtract: Final = _finite_operation(operator.sub)
multiply: Final = _finite_operation(operator.mul)
_python_modulo: Final = _finite_operation(operator.mod)


def apply_chain(first: Any, *rest: Any) -> Any:
    """Apply operations to `first` from left to right. `rest` alternates operations and right operands.

    >>> apply_chain(7, subtract, 2, add, " left")
    '5 left'
    """
    for operation, operand in zip(rest[::2], rest[1::2], strict=True):
        first = operation(first, operand)
    return first


def _overflow(error: OverflowError) -> EvaluationError:
    return EvaluationError(f"overflow: {error}")


def divide(left: Number, right: Number) -> Number:
    """Return `left / right`. The quotient of two ints is truncated toward zero, as in Java.

    >>> divide(-7, 2), divide(-7, 2.0)
    (-3, -3.5)
    """
    if right == 0:
        raise EvaluationError("division by zero")
    if isinstance(left, int) and isinstance(right, int):
        quotient = left // right
        return quotient + 1 if quotient < 0 and quotient * right != left else quotient
    try:
        result = left / right
    except OverflowError as error:
        raise _overflow(error) from None
    return result if result - result == 0 else check_finite(result)


def remainder(left: Number, right: Number) -> Number:
    """Return the remainder of `left / right`, with the sign of `left` as in Java.

    >>> remainder(-7, 2), remainder(7, -2)
    (-1, 1)
    """
    if right == 0:
        raise EvaluationError("division by zero")
    if isinstance(left, int) and isinstance(right, int):
        return left - divide(left, right) * right
    return _call_guarded(math.fmod, left, right)  # type: ignore[no-any-return]


def _call_guarded(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of the standard library. Raise `EvaluationError` if it fails or its result is not finite."""
    try:
        result = function(*arguments)
    except (ValueError, OverflowError, ZeroDivisionError) as error:
        raise EvaluationError(f"no value: {error}") from None
    return check_finite(result) if isinstance(result, float) else result


def _smallest(*numbers: Number) -> Number:
    return _promoted(min(numbers), numbers)


def _largest(*numbers: Number) -> Number:
    return _promoted(max(numbers), numbers)


def _promoted(chosen: Number, numbers: tuple[Number, ...]) -> Number:
    """Return `chosen`, as a float if any number is a float, so that the type does not depend on the choice."""
    return _call_guarded(float, chosen) if any(isinstance(n, float) for n in numbers) else chosen


def _round(number: Number) -> int:
    # floor(number + 0.5) would be wrong, because the sum rounds: 0.49999999999999994 would become 1.
    low: int = _call_guarded(math.floor, number)
    return low + 1 if number - low >= 0.5 else low


def _modulo(left: Number, right: Number) -> Number:
    if right == 0:
        raise EvaluationError("division by zero")
    return _python_modulo(left, right)


def _substring(string: str, start: int, end: int | None = None) -> str:
    stop = len(string) if end is None else end
    if not 0 <= start <= stop <= len(string):
        raise EvaluationError(f"a string of {len(string)} characters has no part from {start} to {stop}")
    return string[start:stop]


def _replace(string: str, old: str, new: str) -> str:
    # The length is checked before the string is built, because one replacement can square the length.
    if len(string) + string.count(old) * max(0, len(new) - len(old)) > LIMITS["characters"]:
        raise EvaluationError(f"overflow: the result has more than {LIMITS['characters']} characters")
    return string.replace(old, new)


ArgumentKind = Literal["number", "int", "string", "data"]


@dataclass(frozen=True, slots=True)
class BuiltinFunction:
    """A built-in function of the expression language.

    Attributes:
        parameters: the kind of each argument.
        result: the type of the result. None means float if an argument is a float, else int.
        optional: the number of arguments at the end that may be omitted.
        variadic: True if the last argument may be repeated.
        total: True if the function has a value for all arguments.
        doc: one line for the reference.
    """

    name: str
    parameters: tuple[ArgumentKind, ...]
    result: Scalar | None
    implementation: Callable[..., Any]
    doc: str
    optional: int = 0
    variadic: bool = False
    total: bool = False

    def accepts_count(self, count: int) -> bool:
        """Return True if the function can be called with `count` arguments."""
        least = len(self.parameters) - self.optional
        return count >= least and (self.variadic or count <= len(self.parameters))

    def parameter_kind(self, position: int) -> ArgumentKind:
        """Return the kind of the argument at a position. The last parameter also covers all later positions."""
        return self.parameters[min(position, len(self.parameters) - 1)]

    @property
    def signature(self) -> str:
        """Return the form of a call, for hints and the reference."""
        names = list(self.parameters)
        required = names[: len(names) - self.optional]
        extra = "".join(f"[, {name}]" for name in names[len(required) :])
        return f"{self.name}({', '.join(required)}{extra}{', ...' if self.variadic else ''})"


_INT, _FLOAT, _BOOL, _STRING = Scalar.INT, Scalar.FLOAT, Scalar.BOOL, Scalar.STRING

_BUILTIN_FUNCTIONS = (
    BuiltinFunction("abs", ("number",), None, abs, "absolute value", total=True),
    BuiltinFunction("min", ("number", "number"), None, _smallest, "smallest of two or more numbers", variadic=True),
    BuiltinFunction("max", ("number", "number"), None, _largest, "largest of two or more numbers", variadic=True),
    BuiltinFunction(
        "sqrt",
        ("number",),
        _FLOAT,
        partial(_call_guarded, math.sqrt),
        "square root; no value for a negative number",
    ),
    BuiltinFunction("pow", ("number", "number"), _FLOAT, partial(_call_guarded, math.pow), "power, always a float"),
    BuiltinFunction("exp", ("number",), _FLOAT, partial(_call_guarded, math.exp), "e to the power of a number"),
    BuiltinFunction(
        "log", ("number",), _FLOAT, partial(_call_guarded, math.log), "natural logarithm of a positive number"
    ),
    BuiltinFunction("floor", ("number",), _INT, partial(_call_guarded, math.floor), "largest int that is not greater"),
    BuiltinFunction("ceil", ("number",), _INT, partial(_call_guarded, math.ceil), "smallest int that is not less"),
    BuiltinFunction("round", ("number",), _INT, _round, "nearest int, halves upward"),
    BuiltinFunction("mod", ("number", "number"), None, _modulo, "remainder with the sign of the divisor"),
    BuiltinFunction("toInt", ("number",), _INT, partial(_call_guarded, math.trunc), "the int without the fraction"),
    BuiltinFunction("toFloat", ("number",), _FLOAT, partial(_call_guarded, float), "the same number as a float"),
    BuiltinFunction("intValue", ("number",), _INT, partial(_call_guarded, math.trunc), "as `toInt`"),
    BuiltinFunction("longValue", ("number",), _INT, partial(_call_guarded, math.trunc), "as `toInt`"),
    BuiltinFunction("doubleValue", ("number",), _FLOAT, partial(_call_guarded, float), "as `toFloat`"),
    BuiltinFunction("floatValue", ("number",), _FLOAT, partial(_call_guarded, float), "as `toFloat`"),
    BuiltinFunction(
        "toString", ("data",), _STRING, value_text, "the text of a value, as in a concatenation", total=True
    ),
    BuiltinFunction("length", ("string",), _INT, len, "number of characters", total=True),
    BuiltinFunction("isEmpty", ("string",), _BOOL, operator.not_, "true if the string is empty", total=True),
    BuiltinFunction(
        "startsWith",
        ("string", "string"),
        _BOOL,
        str.startswith,
        "true if the first string starts with the second",
        total=True,
    ),
    BuiltinFunction(
        "endsWith",
        ("string", "string"),
        _BOOL,
        str.endswith,
        "true if the first string ends with the second",
        total=True,
    ),
    BuiltinFunction(
        "contains",
        ("string", "string"),
        _BOOL,
        operator.contains,
        "true if the first string contains the second",
        total=True,
    ),
    BuiltinFunction(
        "indexOf",
        ("string", "string"),
        _INT,
        str.find,
        "index of the second string in the first, from 0, or -1",
        total=True,
    ),
    BuiltinFunction(
        "substring",
        ("string", "int", "int"),
        _STRING,
        _substring,
        "characters from one index (from 0) up to another, excluded, or the end",
        optional=1,
    ),
    BuiltinFunction(
        "replace",
        ("string", "string", "string"),
        _STRING,
        _replace,
        "the first string with the second replaced by the third",
    ),
    BuiltinFunction("trim", ("string",), _STRING, str.strip, "without white space at both ends", total=True),
    BuiltinFunction("toUpper", ("string",), _STRING, str.upper, "in upper case", total=True),
    BuiltinFunction("toLower", ("string",), _STRING, str.lower, "in lower case", total=True),
    BuiltinFunction("toUpperCase", ("string",), _STRING, str.upper, "in upper case", total=True),
    BuiltinFunction("toLowerCase", ("string",), _STRING, str.lower, "in lower case", total=True),
)

FUNCTIONS: Final[Mapping[str, BuiltinFunction]] = {function.name: function for function in _BUILTIN_FUNCTIONS}
"""The standard library of expressions, by name."""

EXPRESSION_NAMESPACE: Final[Mapping[str, object]] = {
    "EvaluationError": EvaluationError,
    "_add": add,
    "_chain": apply_chain,
    "_subtract": subtract,
    "_multiply": multiply,
    "_divide": divide,
    "_remainder": remainder,
    "_text": value_text,
    "_bounded": check_bounds,
    **{f"_fn_{function.name}": function.implementation for function in _BUILTIN_FUNCTIONS},
}
"""The values of all global names in the code that `compile_expression` returns."""
