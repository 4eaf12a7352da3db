"""The arrays that a program works on, in the order in which `advance` of `kernels` names them."""

# The text of this module is part of exported packages.

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

NO_NUMBERS, NO_ACTIONS = np.zeros(0), np.zeros(0, dtype=np.int64)


class Arrays(NamedTuple):
    """A family as data.

    Attributes:
        tables: int32 [members, ..], `T`.
        reals: float64 [members, ..], `G`.
        offsets: int64 [..], `L`.
        ints, floats: int64 and float64 [members, ..]: the initial states, `S` and `F`.
    """

    tables: NDArray[np.int32]
    reals: NDArray[np.float64]
    offsets: NDArray[np.int64]
    ints: NDArray[np.int64]
    floats: NDArray[np.float64]

    def tables_for(self, native: bool) -> NDArray[Any]:
        """The tables; Python calculates with their entries, so there they have 64 bits."""
        return self.tables if native else self.tables.astype(np.int64)


class Rows(NamedTuple):
    """What environments are: of each array a row is one."""

    ints: NDArray[np.int64]
    floats: NDArray[np.float64]
    streams: NDArray[np.uint64]
    components: NDArray[np.int64]
    steps: NDArray[np.int64]
    over: NDArray[np.bool_]
    observation: NDArray[np.int64]
    reward: NDArray[np.float64]
    ended: NDArray[np.int64]
    cut: NDArray[np.bool_]
    drawn: NDArray[np.float64]


def rows_of(count: int, arrays: Arrays, components: int) -> Rows:
    """Rows of so many environments whose observations have so many components; in no state yet."""
    ints, floats = arrays.ints.shape[1], arrays.floats.shape[1]
    widths = {"ints": (ints,), "floats": (floats,), "streams": (4,), "components": (components,)}
    reals, truths = ("floats", "reward", "drawn"), ("over", "cut")
    kinds = {"streams": np.uint64} | dict.fromkeys(reals, np.float64) | dict.fromkeys(truths, np.bool_)
    return Rows._make(
        np.zeros((count, *widths.get(name, ())), kinds.get(name, np.int64)) for name in Rows._fields
    )


def space_of(shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Space for the rows of questions."""
    return np.zeros(shape, dtype=np.int64), np.zeros(shape)


class World:
    """Environments, and the space that a thread needs for their steps.

    Args:
        arrays: of their members.
        members: number of the member of each.
        rows: what they are.
        space: how many rows of questions there are, and how many columns.
        function: `advance` of the program.
        native: whether that takes addresses.

    Attributes:
        before: in the second row of each the state before the step in which something went wrong last.
        advance: begins episodes, or does steps; the last environment in which something went wrong, or -1.
    """

    def __init__(
        self,
        arrays: Arrays,
        members: NDArray[np.int64],
        rows: Rows,
        space: tuple[int, int],
        function: Callable[..., int],
        *,
        native: bool,
    ) -> None:
        ints, floats, *others = rows
        first, second = np.zeros((2, ints.shape[1]), dtype=np.int64), np.zeros((2, floats.shape[1]))
        self.before = first, second
        fixed = arrays.tables_for(native), arrays.reals, arrays.offsets
        work = *space_of(space), np.zeros(1)
        self._arrays = (*fixed, ints, floats, *work, members, *arrays[3:], *others, *self.before)
        self._given: Any = _addresses(self._arrays) if native else self._arrays
        self.advance: Callable[..., int] = partial(function, self._given)

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Another function of the program that takes the environments."""
        return function(self._given, *arguments)


def _addresses(arrays: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """Where arrays are, and their shapes; they have to outlive that."""
    rows = np.zeros((len(arrays), 3), dtype=np.int64)
    for row, array in zip(rows, arrays, strict=True):
        assert array.flags.c_contiguous
        row[: 1 + array.ndim] = array.ctypes.data, *array.shape
    return rows


def streams(generators: Sequence[np.random.Generator]) -> NDArray[np.uint64]:
    """The states of NumPy's generators, a row each."""
    rows = []
    for generator in generators:
        state: Any = generator.bit_generator.state["state"]
        rows.append(
            [part >> shift & 2**64 - 1 for part in (state["state"], state["inc"]) for shift in (0, 64)]
        )
    return np.array(rows, dtype=np.uint64).reshape(len(rows), 4)
