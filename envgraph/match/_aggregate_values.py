"""Aggregates of numbers: count, sum, mean, minimum and maximum."""

from __future__ import annotations

from collections.abc import Collection
from math import fsum, isfinite

from envgraph.metamodel import LARGEST_INT, Value

EXACT_INTS = 2**53
"""The int up to which a float represents every int exactly."""

_SMALLEST = 1074
"""The exponent of the smallest float: every float is a multiple of 2 ** -1074."""


def fits_int64(value: int) -> bool:
    """Return True if an int fits into a signed 64-bit integer."""
    return -LARGEST_INT - 1 <= value <= LARGEST_INT


def float_to_multiple(value: float) -> int:
    """Return the integer `m` for which a finite float equals `m * 2 ** -1074`. Sums of such integers are exact.

    >>> multiple_to_float(10 * float_to_multiple(0.1)), 0.1 * 3, multiple_to_float(3 * float_to_multiple(0.1))
    (1.0, 0.30000000000000004, 0.30000000000000004)
    """
    numerator, denominator = value.as_integer_ratio()
    return numerator << (_SMALLEST + 1 - denominator.bit_length())


def multiple_to_float(multiple: int) -> float | None:
    """Return the float nearest to `multiple * 2 ** -1074`; None if that number is beyond the largest float."""
    try:
        return multiple / (1 << _SMALLEST)
    except OverflowError:
        return None


def total(values: Collection[int | float]) -> int | float | None:
    """Return the sum of numbers; 0 for no numbers; None if the sum is not a finite float, or is an int beyond 64 bits.

    Floats are added exactly and rounded once, so the result does not depend on the order of the numbers.

    >>> total([0.1] * 10), total([2, 3]), total([])
    (1.0, 5, 0)
    """
    for value in values:
        if isinstance(value, float):
            return _finite(values)
    result = sum(map(int, values))
    return result if fits_int64(result) else None


def mean(values: Collection[int | float]) -> float | None:
    """Return the arithmetic mean of numbers as a float; None for no numbers, or if their sum is not a finite float.

    >>> mean([1, 2]), mean([])
    (1.5, None)
    """
    result = _finite(values) if values else None
    return None if result is None else result / len(values)


def _finite(values: Collection[int | float]) -> float | None:
    """Return the exactly rounded sum of numbers as a float; None if the sum is not finite."""
    try:
        result = fsum(values)
    except ValueError:  # infinities of both signs
        return None
    except OverflowError:  # only an intermediate sum may overflow: then exact integer sums give the result
        return (
            multiple_to_float(sum(map(float_to_multiple, map(float, values)))) if all(map(isfinite, values)) else None
        )
    return result if isfinite(result) else None


def aggregate(function: str, values: Collection[int | float]) -> Value | None:
    """Return an aggregate of numbers; None for avg, min or max of no numbers, or if a sum is out of range.

    Args:
        function: count, sum, avg, min or max.
        values: the numbers; for count the items to count, which may be anything.
    """
    match function:
        case "count":
            return len(values)
        case "sum":
            return total(values)
        case "avg":
            return mean(values)
        case "min":
            return min(values, default=None)
        case "max":
            return max(values, default=None)
    raise AssertionError(function)


def least(values: Collection[int | float]) -> int | float | None:
    """Return the minimum of numbers; None for no numbers."""
    return min(values, default=None)


def most(values: Collection[int | float]) -> int | float | None:
    """Return the maximum of numbers; None for no numbers."""
    return max(values, default=None)
