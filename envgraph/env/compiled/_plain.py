"""What Python makes of names that all programs use, where there is no numba: `_arrays` has the same.

What of `kernels` calculates with words of 64 bits is here again, with Python's ints.
"""

from __future__ import annotations

from typing import Any, Final
from zlib import crc32

import numpy as np

__all__ = [
    "arrays_at",
    "bit",
    "bit_at",
    "count_bits",
    "fixed",
    "hash_row",
    "lowest_bit",
    "matrix",
    "uniform",
    "vector",
    "width",
]

WORD: Final = 2**64 - 1


def same(array: Any) -> Any:
    """Arrays are those of NumPy."""
    return array


vector = matrix = fixed = arrays_at = same


def width(array: Any) -> int:
    """The length of a row."""
    return int(array.shape[1])


def bit(word: int, place: int) -> int:
    """A bit of a word of a set."""
    return (word >> (place & 31)) & 1


def bit_at(place: int) -> int:
    """The word with one bit."""
    return 1 << (int(place) & 31)


def count_bits(word: int) -> int:
    """How many bits of a word are set."""
    return int(word).bit_count()


def lowest_bit(word: int) -> int:
    """The number of the lowest bit that is set."""
    return int(word & -word).bit_length() - 1


def uniform(states: Any, row: int) -> float:
    """NumPy's PCG64: the next double of a stream; its state is a row."""
    lo, hi, inc_lo, inc_hi = (int(part) for part in states[row])
    state = (hi << 64 | lo) * 0x2360ED051FC65DA44385DF649FCCF645 + (inc_hi << 64 | inc_lo)
    lo, hi = state & WORD, state >> 64 & WORD
    states[row, 0], states[row, 1] = lo, hi
    mixed, turns = hi ^ lo, hi >> 58
    mixed = (mixed >> turns | mixed << (-turns & 63)) & WORD
    return float((mixed >> 11) * 2.0**-53)


def hash_row(states: Any, floats: Any, row: int) -> Any:
    """A hash of a state."""
    return np.uint64(crc32(states[row].tobytes() + floats[row].tobytes()))
