"""Show how costs grow with the size of the input: n, 2n and 4n, and the exponent.

    python -m benchmarks growth

Each line is a kind of input in three sizes, each twice the previous one. Times are processor times, the best of three
runs, each on a new input. The exponent is the power of n by which time grows from the first size to the last: 1 is
linear, and no case should exceed 1.3.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from math import log2
from time import process_time
from typing import NamedTuple

from benchmarks import (
    _growth_differences,
    _growth_documents,
    _growth_features,
    _growth_loops,
    _growth_recursion,
    _growth_values,
)
from benchmarks._growth import Case, Prepare


class Sizes(NamedTuple):
    """The factor of all sizes, and the number of runs, of which the fastest counts."""

    scale: float
    runs: int


FULL = Sizes(1.0, 3)
QUICK = Sizes(0.01, 1)

PARTS: dict[str, Callable[[], Iterator[Case]]] = {
    "loops on demand": _growth_loops.cases,
    "watched differences": _growth_differences.cases,
    "watched circles and recursion": _growth_recursion.cases,
    "compared values": _growth_values.cases,
    "ordered features of an object with 8,000": _growth_features.cases,
    "EMF documents": _growth_documents.cases,
}


def main(sizes: Sizes) -> None:
    """Print a line for each case."""
    worst = 0.0
    for title, cases in PARTS.items():
        print(f"\n{title:48}{'n':>8}{'n [ms]':>10}{'2n [ms]':>10}{'4n [ms]':>10}{'exponent':>10}")
        for name, size, prepare in cases():
            least = max(int(size * sizes.scale), 8)
            prepare(8)()  # imports and caches are not timed
            times = [best(prepare, least * factor, sizes.runs) for factor in (1, 2, 4)]
            exponent = log2(times[2] / times[0]) / 2
            worst = max(worst, exponent)
            shown = "".join(f"{1e3 * one:10.1f}" for one in times)
            print(f"{name:48}{least:8,}{shown}{exponent:10.2f}", flush=True)
    print(f"\nlargest exponent: {worst:.2f}")


def best(prepare: Prepare, size: int, runs: int) -> float:
    """Return the least time of some runs in seconds."""
    found = []
    for _ in range(runs):
        work = prepare(size)
        gc.collect()
        started = process_time()
        work()
        found.append(max(process_time() - started, 1e-9))
    return min(found)
