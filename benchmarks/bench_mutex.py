"""Rewrite a ring of processes (mutual exclusion), at three sizes, beside CLIPS.

    python -m benchmarks mutex

The short transformation sequence: the same rules through the prepared functions of rules, through the checked facade,
and (the last phase) as a unit in one transaction, beside CLIPS in the same run. All rules that fire more than once are
watched: their matches are kept current all the time, and one is drawn at random. Seconds of processor time, medians;
compiling rules and views is left out on both sides.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from statistics import median
from time import process_time
from typing import NamedTuple

from benchmarks._clips import clips
from benchmarks._mutex import PHASES, Rewrite, clips_sequence, facade, prepared, ring, rules
from envgraph.rewrite import Engine

PEERS = ("clips",)
TARGET = 250_000
"""Rewrites a second."""

PUBLISHED = {"GrGen.NET 8.1, measured before": "0.7 million, at 1,000,000 processes 0.4"}


class Sizes(NamedTuple):
    """Numbers of processes, each with the number of measurements that a median is of; that for the single phases."""

    repeats: dict[int, int]
    phases: int


FULL = Sizes({1_000: 7, 10_000: 5, 100_000: 3}, phases=10_000)
QUICK = Sizes({10: 1, 20: 1, 30: 1}, phases=10)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    for tool, figure in PUBLISHED.items():
        print(f"{tool}: {figure} rewrites/s")
    print(f"thousand rewrites a second, to be {TARGET // 1000} at each size and the same at all")
    print(f"{'processes':>10}{'prepared':>10}{'facade':>10}{'unit':>10}{'CLIPS':>10}{'prepared/CLIPS':>16}")
    rates: list[float] = []
    units: list[float] = []
    for size, repeats in sizes.repeats.items():
        fast = rate(lambda: sequence(size, prepared), repeats)  # noqa: B023
        checked = rate(lambda: sequence(size, facade), repeats)  # noqa: B023
        unit = rate(lambda: as_unit(size), repeats)  # noqa: B023
        other = None if clips is None else rate(lambda: in_clips(size), repeats)  # noqa: B023
        shown = "-" if other is None else f"{other / 1e3:.0f}"
        ratio = "-" if other is None else f"{fast / other:.2f}"
        print(
            f"{size:10}{fast / 1e3:10.0f}{checked / 1e3:10.0f}{unit / 1e3:10.0f}{shown:>10}{ratio:>16}",
            flush=True,
        )
        rates.append(fast)
        units.append(unit)
    missed = [size for size, found in zip(sizes.repeats, rates, strict=True) if found < TARGET]
    print(f"prepared, slowest over fastest: {min(rates) / max(rates):.2f}; missed at {missed or 'no size'}")
    print(f"unit, slowest over fastest: {min(units) / max(units):.2f}; its journal and trace grow until it ends")
    print_phases(sizes.phases)


def rate(measure: Callable[[], tuple[int, float]], repeats: int) -> float:
    """Rewrites a second, median."""
    found = []
    for _ in range(repeats):
        done, seconds = measure()
        found.append(done / seconds)
    return median(found)


def sequence(size: int, way: Callable[[Engine], Rewrite]) -> tuple[int, float]:
    """Rewrites and seconds of the whole sequence."""
    engine = ring()
    rewrite = way(engine)
    order = [rule for phase in PHASES for rule in rules(phase, size)]
    gc.collect()
    started = process_time()
    for rule in order:
        rewrite(rule)
    seconds = process_time() - started
    assert engine.count("request") == size
    return len(order), seconds


def as_unit(size: int) -> tuple[int, float]:
    """Rewrites and seconds of the last phase as `unit passOn`."""
    engine = ring()
    engine.run("passOn")  # there is nothing to pass on yet, but it is compiled now
    rewrite = prepared(engine)
    for rule in [rule for phase in PHASES[:3] for rule in rules(phase, size)]:
        rewrite(rule)
    engine.step_limit = 10 * size
    gc.collect()
    started = process_time()
    engine.run("passOn")
    seconds = process_time() - started
    assert engine.count("request") == size
    return 3 * size, seconds


def in_clips(size: int) -> tuple[int, float]:
    """Rewrites and seconds of the whole sequence in CLIPS."""
    run, environment = clips_sequence(size)
    started = process_time()
    done = run()
    seconds = process_time() - started
    assert done == 5 * size - 1
    assert (environment.count("token"), environment.count("request")) == (1, 0)
    return done, seconds


def print_phases(size: int) -> None:
    """Microseconds a rewrite in each phase."""
    engine = ring()
    rewrite = prepared(engine)
    print(f"microseconds a rewrite, prepared, {size} processes:", end="")
    for phase in PHASES:
        order = rules(phase, size)
        started = process_time()
        for rule in order:
            rewrite(rule)
        print(f"  {phase} {1e6 * (process_time() - started) / len(order):.2f}", end="")
    print()
