"""Arrays of families and environments, in the order in which `advance` of `kernels` takes them."""

# The text of this module is part of exported packages.

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

NO_RANDOM_NUMBERS = np.zeros(0)


class FamilyArrays(NamedTuple):
    """The data of a family, with a row for each member. The letters are the names of the arrays in programs.

    Attributes:
        tables: int32 [members, ..], `T`.
        reals: float64 [members, ..], `G`.
        offsets: int64 [..], `L`, the same for all members.
        ints, floats: int64 and float64 [members, ..]: the initial states, `S` and `F`.
    """

    tables: NDArray[np.int32]
    reals: NDArray[np.float64]
    offsets: NDArray[np.int64]
    ints: NDArray[np.int64]
    floats: NDArray[np.float64]

    def tables_for(self, native: bool) -> NDArray[Any]:
        """Return the tables in the dtype that programs need: int32 with numba (`native`), int64 in Python."""
        return self.tables if native else self.tables.astype(np.int64)


class EnvironmentRows(NamedTuple):
    """The arrays of a batch of environments; each array has one row for each environment.

    Attributes:
        drawn: the random number of the last step; `advance` takes its numbers from there, or stores them there.
        actions: the next action of each environment, or `BEGIN` or `SKIP` of `step_kernels`.
        flat: the components as one-hot vectors, one after the other; without columns if they are not needed.
    """

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
    actions: NDArray[np.int64]
    flat: NDArray[np.float32]


def zero_rows(count: int, arrays: FamilyArrays, components: int, flat: int = 0) -> EnvironmentRows:
    """Return zeroed arrays for `count` environments, with a number of components, and of columns of `flat`."""
    ints, floats = arrays.ints.shape[1], arrays.floats.shape[1]
    widths = {"ints": (ints,), "floats": (floats,), "streams": (4,), "components": (components,), "flat": (flat,)}
    reals, truths = dict.fromkeys(("floats", "reward", "drawn"), np.float64), dict.fromkeys(("over", "cut"), np.bool_)
    kinds = {"streams": np.uint64, "flat": np.float32} | reals | truths
    return EnvironmentRows._make(
        np.zeros((count, *widths.get(name, ())), kinds.get(name, np.int64)) for name in EnvironmentRows._fields
    )


def zero_row_buffers(shape: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return zeroed row buffers (ints, floats) of a shape."""
    return np.zeros(shape, dtype=np.int64), np.zeros(shape)


class BatchArrays:
    """The arrays of a batch of environments, and the buffers that one thread needs to step them.

    Args:
        arrays: the data of the members.
        members: the number of the member of each environment.
        rows: the arrays of the environments.
        space: the numbers of rows and columns of the row buffers.
        sizes: the numbers of values of the components of an observation.
        function: `advance` of the program.
        native: True if `function` takes addresses of arrays.

    Attributes:
        failed_state: two arrays (ints, floats); their second row is the state before the last step that failed.
        settings: int64 [3]: the number of environments; 1 if the next random numbers are in `drawn`, or 0 if they are
            sampled from the streams; the limit of steps, or 0.
        advance: steps the environments with their `actions`; returns the last environment with an error, or -1.
    """

    def __init__(
        self,
        arrays: FamilyArrays,
        members: NDArray[np.int64],
        rows: EnvironmentRows,
        space: tuple[int, int],
        sizes: Sequence[int],
        function: Callable[..., int],
        *,
        native: bool,
    ) -> None:
        ints, floats, *others = rows
        first, second = np.zeros((2, ints.shape[1]), dtype=np.int64), np.zeros((2, floats.shape[1]))
        self.failed_state = first, second
        fixed = arrays.tables_for(native), arrays.reals, arrays.offsets
        work = *zero_row_buffers(space), np.zeros(2)
        columns = np.cumsum([0, *sizes])
        self.settings = np.array([len(members), 0, 0])
        batch = ints, floats, *work, members, *arrays[3:], *others, *self.failed_state
        self._arrays = (*fixed, *batch, columns, self.settings)
        self._addresses = _addresses(self._arrays)
        self._given: Any = self._addresses.ctypes.data if native else self._arrays
        self.advance: Callable[[], int] = partial(function, self._given)

    def call_function(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call another function of the program with the arrays of the environments."""
        return function(self._given, *arguments)


def _addresses(arrays: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """Return the address and shape of each array; the arrays must exist as long as the result is used."""
    rows = np.zeros((len(arrays), 3), dtype=np.int64)
    for row, array in zip(rows, arrays, strict=True):
        assert array.flags.c_contiguous
        row[: 1 + array.ndim] = array.ctypes.data, *array.shape
    return rows


def generator_states(generators: Sequence[np.random.Generator]) -> NDArray[np.uint64]:
    """Return the states of PCG64 generators, one row for each generator."""
    rows = []
    for generator in generators:
        state: Any = generator.bit_generator.state["state"]
        rows.append([part >> shift & 2**64 - 1 for part in (state["state"], state["inc"]) for shift in (0, 64)])
    return np.array(rows, dtype=np.uint64).reshape(len(rows), 4)
