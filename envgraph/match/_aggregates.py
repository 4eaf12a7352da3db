"""Aggregates of data values."""

from __future__ import annotations

from collections.abc import Collection
from math import fsum, isfinite

from envgraph.metamodel import LARGEST_INT, Value

EXACT_INTS = 2**53
"""Up to here every int is a float."""

_SMALLEST = 1074
"""Every float is a multiple of 2 to the power of minus this."""


def fits(value: int) -> bool:
    """Return whether it is an int of 64 bits."""
    return -LARGEST_INT - 1 <= value <= LARGEST_INT


def scaled(value: float) -> int:
    """A finite float as a multiple of the smallest one: such ints add up exactly.

    >>> unscaled(10 * scaled(0.1)), 0.1 * 3, unscaled(3 * scaled(0.1))
    (1.0, 0.30000000000000004, 0.30000000000000004)
    """
    numerator, denominator = value.as_integer_ratio()
    return numerator << (_SMALLEST + 1 - denominator.bit_length())


def unscaled(multiple: int) -> float | None:
    """The nearest float; None beyond the largest."""
    try:
        return multiple / (1 << _SMALLEST)
    except OverflowError:
        return None


def total(values: Collection[int | float]) -> int | float | None:
    """Sum; 0 of nothing; None when it is no finite number or an int beyond 64 bits.

    Floats are added exactly and rounded once, so that the order of the tuples does not matter.

    >>> total([0.1] * 10), total([2, 3]), total([])
    (1.0, 5, 0)
    """
    for value in values:
        if isinstance(value, float):
            return _finite(values)
    result = sum(map(int, values))
    return result if fits(result) else None


def mean(values: Collection[int | float]) -> float | None:
    """Arithmetic mean, always a float; None of nothing, or when the sum is no finite number.

    >>> mean([1, 2]), mean([])
    (1.5, None)
    """
    result = _finite(values) if values else None
    return None if result is None else result / len(values)


def _finite(values: Collection[int | float]) -> float | None:
    try:
        result = fsum(values)
    except ValueError:  # infinities of both signs
        return None
    except OverflowError:  # perhaps only on the way: then the sum of other orders would be a number
        return unscaled(sum(map(scaled, map(float, values)))) if all(map(isfinite, values)) else None
    return result if isfinite(result) else None


def aggregate(function: str, values: Collection[int | float]) -> Value | None:
    """The aggregate over the column of a group, which is the group itself for count; None if there is none."""
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
    """Minimum; None of nothing."""
    return min(values, default=None)


def most(values: Collection[int | float]) -> int | float | None:
    """Maximum; None of nothing."""
    return max(values, default=None)
