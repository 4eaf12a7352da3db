"""Observations as vectors of float32: ints as one-hot vectors, floats as their values."""

# The text of this module is part of exported packages.

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


class FloatRange(int):
    """The size of a component that observes a float: the number of float32 values from `low` to `high`.

    The component is the rank of the float, cut to the range, among these values; 0 is `low`. Engines thus observe only
    ints.

    Attributes:
        low, high: the range.
        may_hide: True if the component has one more value, the last, which means "out of sight".
    """

    low: float
    high: float
    may_hide: bool

    def __new__(cls, low: float, high: float, may_hide: bool = False) -> FloatRange:
        """Return the size of a component."""
        found = super().__new__(cls, float_rank(high) - float_rank(low) + 1 + may_hide)
        found.low, found.high, found.may_hide = low, high, may_hide
        return found

    def __getnewargs__(self) -> tuple[float, float, bool]:  # type: ignore[override]
        """Return the arguments of the constructor, for copies, pickle and files."""
        return self.low, self.high, self.may_hide

    def rank(self, value: float) -> int:
        """Return the component for a float."""
        return float_rank(min(max(value, self.low), self.high)) - float_rank(self.low)

    def decode(self, ranks: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the floats of components on a new last axis; with `may_hide`, then 1 if out of sight, otherwise 0.

        A float that is out of sight is `low`.
        """
        hidden = (ranks == self - 1) & self.may_hide
        bits = np.where(hidden, 0, ranks) + float_rank(self.low)
        found = np.where(bits < 0, -(2**31) - bits, bits).astype(np.int32).view(np.float32)
        return np.stack([found, hidden.astype(np.float32)][: 1 + self.may_hide], axis=-1)


def float_rank(value: float) -> int:
    """Return the rank of a number, rounded to float32, among all float32 numbers; that of 0.0 is 0."""
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
        widths = [1 + one.may_hide if isinstance(one, FloatRange) else one for one in shape]
        firsts = np.cumsum([0, *widths])
        self.floats = [
            (place, slice(*firsts[place : place + 2].tolist()), one)
            for place, one in enumerate(shape)
            if isinstance(one, FloatRange)
        ]
        self._ints = [place for place, one in enumerate(shape) if not isinstance(one, FloatRange)]
        self._firsts, self.width = firsts[self._ints], int(firsts[-1])

    def bounds(self) -> NDArray[np.float32]:
        """Return the lowest and the highest value of each entry, float32 [2, entries]."""
        found = np.stack([np.zeros(self.width, np.float32), np.ones(self.width, np.float32)])
        for _, entries, one in self.floats:
            found[:, entries.start] = one.low, one.high
        return found

    def encode(self, parts: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the vectors [.., entries] of components [.., components]."""
        found = np.zeros((*parts.shape[:-1], self.width), dtype=np.float32)
        ints = parts[..., self._ints] if self.floats else parts
        np.put_along_axis(found, ints + self._firsts, 1.0, axis=-1)
        for place, entries, one in self.floats:
            found[..., entries] = one.decode(parts[..., place])
        return found


def component_sizes_of(shape: Any) -> list[int]:
    """Return the sizes of components from JSON, in which the arguments of a `FloatRange` stand for it."""
    return [FloatRange(*one) if isinstance(one, list) else one for one in shape]
