"""Split Sierpinski triangles, all levels up to 8 and up to 10, beside CLIPS.

    python -m benchmarks sierpinski

All triangles of a level are found, then split: by the prepared rule, and by the unit `all split;`, which is one
transaction that looks at each match again. Beside CLIPS in the same run. Seconds of processor time, medians; making the
engine is left out, the environment of CLIPS (a millisecond) is not.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from math import inf
from statistics import median
from time import process_time
from typing import NamedTuple

from benchmarks._clips import clips
from benchmarks._sierpinski import clips_levels, objects, split_all, triangle

PEERS = ("clips",)

TARGETS = {8: 0.15, 10: 1.5}
"""Seconds."""

PUBLISHED = {8: 0.022, 10: 0.329}
"""GrGen.NET 8.1, measured before."""


class Sizes(NamedTuple):
    """The last levels, and how many measurements a median is of."""

    levels: tuple[int, ...]
    repeats: int


FULL = Sizes((8, 10), repeats=5)
QUICK = Sizes((2, 3), repeats=1)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"{'levels':>6}{'prepared':>10}{'unit':>10}{'watched':>10}{'CLIPS':>10}{'prepared/CLIPS':>16}", end="")
    print(f"{'GrGen.NET':>12}{'target':>9}  seconds")
    for levels in sizes.levels:
        fast = time_of(lambda: prepared(levels), sizes.repeats)  # noqa: B023
        unit = time_of(lambda: as_unit(levels), sizes.repeats)  # noqa: B023
        live = time_of(lambda: prepared(levels, watched=True), sizes.repeats)  # noqa: B023
        other = None if clips is None else time_of(lambda: in_clips(levels), sizes.repeats)  # noqa: B023
        shown = "-" if other is None else f"{other:.3f}"
        ratio = "-" if other is None else f"{fast / other:.2f}"
        print(f"{levels:6}{fast:10.3f}{unit:10.3f}{live:10.3f}{shown:>10}{ratio:>16}", end="")
        published, target = PUBLISHED.get(levels, inf), TARGETS.get(levels, inf)
        print(f"{published:12.3f}{target:9.2f}{'' if fast <= target else '  missed'}", flush=True)


def time_of(measure: Callable[[], float], repeats: int) -> float:
    """Median."""
    return median(measure() for _ in range(repeats))


def prepared(levels: int, watched: bool = False) -> float:
    """Seconds with the prepared rules, with or without views of the triangles."""
    engine = triangle(watched)
    gc.collect()
    started = process_time()
    for level in range(1, levels + 1):
        split_all(engine, level)
    seconds = process_time() - started
    assert len(engine.model) == objects(levels)
    return seconds


def as_unit(levels: int) -> float:
    """Seconds with a unit a level."""
    engine = triangle()
    engine.step_limit = 3**levels
    gc.collect()
    started = process_time()
    for level in range(levels):
        engine.run(f"level{level % 2}")
    seconds = process_time() - started
    assert len(engine.model) == objects(levels)
    return seconds


def in_clips(levels: int) -> float:
    """Seconds in CLIPS."""
    started = process_time()
    done, _ = clips_levels(levels)
    seconds = process_time() - started
    assert done == (3**levels - 1) // 2
    return seconds
