"""Observations as vectors of float32: ints as one-hot vectors, floats as their values."""

# The text of this module is part of exported packages.

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from envgraph.env._float_ranges import FloatRange, float_rank


class FlatLayout:
    """The entries of components in an observation "flat".

    Args:
        shape: the sizes of the components.

    Attributes:
        floats: the numbers of the components that observe floats. The entry of one that may be hidden is followed by
            another entry: 1 if it is not visible, otherwise 0.
        width: the number of entries.
    """

    def __init__(self, shape: Sequence[int]) -> None:
        limits = {number: one.limits for number, one in enumerate(shape) if isinstance(one, FloatRange)}
        widths = [1 + limits[number][2] if number in limits else size for number, size in enumerate(shape)]
        ends = np.cumsum([0, *widths])
        self.floats, self.width = [*limits], int(ends[-1])
        self._ints = [number for number in range(len(shape)) if number not in limits]
        self._firsts, self._starts, self._lasts = ends[self._ints], ends[self.floats], ends[1:][self.floats] - 1
        self._limits = np.array([*limits.values()], dtype=np.float64).reshape(-1, 3)
        self._lowest = np.array([float_rank(low) for low, _, _ in limits.values()], dtype=np.int64)
        self._hidden = np.array([shape[n] - 1 if one[2] else -1 for n, one in limits.items()], dtype=np.int64)

    def bounds(self) -> NDArray[np.float32]:
        """Return the lowest and the highest value of each entry, float32 [2, entries]."""
        found = np.stack([np.zeros(self.width, np.float32), np.ones(self.width, np.float32)])
        found[:, self._starts] = self._limits[:, :2].T
        return found

    def encode(self, parts: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the vectors [.., entries] of components [.., components]."""
        found = np.zeros((*parts.shape[:-1], self.width), dtype=np.float32)
        np.put_along_axis(found, (parts[..., self._ints] if self.floats else parts) + self._firsts, 1.0, axis=-1)
        if self.floats:
            ranks = parts[..., self.floats]
            hidden = ranks == self._hidden
            bits = np.where(hidden, 0, ranks) + self._lowest
            found[..., self._lasts] = hidden  # replaced by the float if this is its only entry
            found[..., self._starts] = np.where(bits < 0, -(2**31) - bits, bits).astype(np.int32).view(np.float32)
        return found
