"""Python versions of array access and bit operations, for programs that run without numba; `_arrays` has numba's.

`uniform` and `hash_row` of `kernels` use 64-bit words, and are replaced here by versions that use Python's ints.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, Final
from zlib import crc32

import numpy as np

__all__ = [
    "add_checked",
    "arrays_at",
    "bit",
    "bit_at",
    "count_bits",
    "exp",
    "fixed",
    "hash_row",
    "log",
    "lowest_bit",
    "matrix",
    "multiply_checked",
    "pow",
    "sqrt",
    "subtract_checked",
    "uniform",
    "vector",
    "width",
]

MASK_64_BITS: Final = 2**64 - 1
"""Python's ints are cut to it, so that results equal those of 64-bit words in compiled programs."""


def as_numpy_array(array: Any) -> Any:
    """Return the argument: without numba, the array arguments of programs are NumPy arrays already."""
    return array


vector = matrix = fixed = arrays_at = as_numpy_array


def width(array: Any) -> int:
    """Return the number of columns of a two-dimensional array."""
    return int(array.shape[1])


def bit(word: int, place: int) -> int:
    """Return the bit (0 or 1) of an element of a bit set, from the 32-bit word that contains the element."""
    return (word >> (place & 31)) & 1


def bit_at(place: int) -> int:
    """Return a 32-bit word in which only the bit of an element of a bit set is set."""
    return 1 << (int(place) & 31)


def count_bits(word: int) -> int:
    """Return the number of bits that are set in a word."""
    return int(word).bit_count()


def lowest_bit(word: int) -> int:
    """Return the position of the lowest bit that is set in a word."""
    return int(word & -word).bit_length() - 1


def _checked(operation: Callable[[int, int], int]) -> Callable[[int, int], tuple[int, bool]]:
    """Return a function that returns the last 64 bits of the result of an operation, and True if it has more."""

    def checked(left: int, right: int) -> tuple[int, bool]:
        value = operation(int(left), int(right))
        cut = (value + 2**63 & MASK_64_BITS) - 2**63
        return cut, cut != value

    return checked


def _without_errors(function: Callable[..., float]) -> Callable[..., float]:
    """Return a function of floats that returns NaN where `function` raises an error."""

    def guarded(*numbers: float) -> float:
        try:
            return function(*numbers)
        except (ValueError, OverflowError):
            return math.nan

    return guarded


add_checked, subtract_checked, multiply_checked = map(_checked, (operator.add, operator.sub, operator.mul))
exp, log, sqrt = map(_without_errors, (math.exp, math.log, math.sqrt))
pow = _without_errors(math.pow)


def uniform(states: Any, row: int) -> float:
    """Return the next double of NumPy's PCG64 in [0, 1), and update the generator state in a row of `states`."""
    lo, hi, inc_lo, inc_hi = (int(part) for part in states[row])
    state = (hi << 64 | lo) * 0x2360ED051FC65DA44385DF649FCCF645 + (inc_hi << 64 | inc_lo)
    lo, hi = state & MASK_64_BITS, state >> 64 & MASK_64_BITS
    states[row, 0], states[row, 1] = lo, hi
    mixed, turns = hi ^ lo, hi >> 58
    mixed = (mixed >> turns | mixed << (-turns & 63)) & MASK_64_BITS
    return float((mixed >> 11) * 2.0**-53)


def hash_row(states: Any, floats: Any, row: int) -> Any:
    """Return a hash of a state, which is one row of ints and one row of floats."""
    return np.uint64(crc32(states[row].tobytes() + floats[row].tobytes()))
