"""Observations as vectors of float32: ints as one-hot vectors, floats as their values."""

# The text of this module is part of exported packages.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

LARGEST_FLOAT32 = float(np.finfo(np.float32).max)


class FloatRange(int):
    """The size of a component that observes a float: the number of float32 values in a range.

    The component is the rank of the float, cut to the range, among these values. Engines thus observe only ints.

    Attributes:
        limits: the range, and True if the component has one more value, the last, which means "not visible".
    """

    limits: tuple[float, float, bool]

    def __new__(cls, *limits: Any) -> Self:
        """Return the size of a component for `limits`."""
        low, high, may_hide = limits
        found = super().__new__(cls, float_rank(high) - float_rank(low) + 1 + may_hide)
        found.limits = low, high, may_hide
        return found

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Return the arguments of the constructor, for copies."""
        return self.limits

    def decode(self, ranks: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the floats on a new last axis; with a second entry, 1 beside the lowest float if it is not visible."""
        low, _, may_hide = self.limits
        hidden = (ranks == self - 1) & may_hide
        bits = np.where(hidden, 0, ranks) + float_rank(low)
        found = np.where(bits < 0, -(2**31) - bits, bits).astype(np.int32).view(np.float32)
        return np.stack([found, hidden.astype(np.float32)][: 1 + may_hide], axis=-1)


def float_rank(value: float) -> int:
    """Return the rank of a number, rounded to float32, among all float32 values; that of 0.0 is 0."""
    bits = int(np.float32(value).view(np.int32))
    return bits if bits >= 0 else -(2**31) - bits


class FlatLayout:
    """The entries of components in an observation "flat".

    Args:
        shape: the sizes of the components.

    Attributes:
        floats: for each component that observes a float its number, its entries, and its size.
        width: the number of entries.
    """

    def __init__(self, shape: Sequence[int]) -> None:
        sizes = [*enumerate(shape)]
        firsts = np.cumsum([0, *(1 + one.limits[2] if isinstance(one, FloatRange) else one for one in shape)])
        ends = firsts.tolist()
        self.floats = [(n, slice(*ends[n : n + 2]), one) for n, one in sizes if isinstance(one, FloatRange)]
        self._ints = [n for n, one in sizes if not isinstance(one, FloatRange)]
        self._firsts, self.width = firsts[self._ints], ends[-1]

    def bounds(self) -> NDArray[np.float32]:
        """Return the lowest and the highest value of each entry, float32 [2, entries]."""
        found = np.stack([np.zeros(self.width, np.float32), np.ones(self.width, np.float32)])
        for _, entries, one in self.floats:
            found[:, entries.start] = one.limits[:2]
        return found

    def encode(self, parts: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the vectors [.., entries] of components [.., components]."""
        found = np.zeros((*parts.shape[:-1], self.width), dtype=np.float32)
        np.put_along_axis(found, (parts[..., self._ints] if self.floats else parts) + self._firsts, 1.0, axis=-1)
        for place, entries, one in self.floats:
            found[..., entries] = one.decode(parts[..., place])
        return found
