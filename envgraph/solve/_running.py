"""Run the loops over tables: compiled if numba is installed, else by Python."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.env.compiled import has_numba, load_functions
from envgraph.solve import _table_kernels

LOOP_NAMES: Final = ("search", "settle", "chain", "follow")


def run_loop(
    name: str, inputs: tuple[Any, ...], outputs: tuple[NDArray[Any], ...], *, native: bool | None = None
) -> Any:
    """Run a function of `_loops`, and return its result, which is the same with and without numba.

    Args:
        name: the name of the function.
        inputs: its first arguments, numbers and flat arrays.
        outputs: its last arguments, arrays that it changes in place.
        native: True to compile with numba; None for True if numba is installed.
    """
    if has_numba() if native is None else native:
        return load_functions("", (_table_kernels,), LOOP_NAMES, native=True)[name](*inputs, *outputs)
    lists = [array.tolist() for array in outputs]
    known = [one.tolist() if isinstance(one, np.ndarray) else one for one in inputs]
    result = load_functions("", (_table_kernels,), LOOP_NAMES, native=False)[name](*known, *lists)
    for array, values in zip(outputs, lists, strict=True):
        array[:] = values
    return result


def flat_arrays(tabular: Tabular) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the next states, probabilities, rewards and `terminated` of a table as arrays with one axis."""
    return (
        np.ascontiguousarray(tabular.next_state, np.int32).reshape(-1),
        np.ascontiguousarray(tabular.probability, np.float64).reshape(-1),
        np.ascontiguousarray(tabular.reward, np.float64).reshape(-1),
        np.ascontiguousarray(tabular.terminated, np.int8).reshape(-1),
    )
