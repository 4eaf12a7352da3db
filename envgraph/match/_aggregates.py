"""Aggregates of data values."""

from __future__ import annotations

from collections.abc import Collection
from math import fsum, isfinite

from envgraph.metamodel import Value

LARGEST_INT = 2**63 - 1


def total(values: Collection[int | float]) -> int | float | None:
    """Sum; 0 of nothing; None when it is no finite number or an int beyond 64 bits.

    Floats are added exactly and rounded once, so that the order of the tuples does not matter.

    >>> total([0.1] * 10), total([2, 3]), total([])
    (1.0, 5, 0)
    """
    if any(isinstance(value, float) for value in values):
        return _finite(values)
    result = sum(values)
    return result if -LARGEST_INT - 1 <= result <= LARGEST_INT else None


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
    except (OverflowError, ValueError):
        return None
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
