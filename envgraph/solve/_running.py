"""Run the loops over tables: compiled if numba is installed, else by Python."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.env.compiled import functions, has_numba
from envgraph.solve import _loops

CALLED: Final = ("search", "settle", "chain", "follow")


def run(
    name: str, read: tuple[Any, ...], written: tuple[NDArray[Any], ...], *, native: bool | None = None
) -> Any:
    """Run a function of `_loops`, and return its result, which is the same with and without numba.

    Args:
        name: the name of the function.
        read: its first arguments, numbers and flat arrays.
        written: its last arguments, arrays that it changes in place.
        native: True to compile with numba; None for True if numba is installed.
    """
    if has_numba() if native is None else native:
        return functions("", (_loops,), CALLED, native=True)[name](*read, *written)
    lists = [array.tolist() for array in written]
    known = [one.tolist() if isinstance(one, np.ndarray) else one for one in read]
    result = functions("", (_loops,), CALLED, native=False)[name](*known, *lists)
    for array, values in zip(written, lists, strict=True):
        array[:] = values
    return result


def flat(tabular: Tabular) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the next states, probabilities, rewards and `terminated` of a table as arrays with one axis."""
    return (
        np.ascontiguousarray(tabular.next_state, np.int32).reshape(-1),
        np.ascontiguousarray(tabular.probability, np.float64).reshape(-1),
        np.ascontiguousarray(tabular.reward, np.float64).reshape(-1),
        np.ascontiguousarray(tabular.terminated, np.int8).reshape(-1),
    )
