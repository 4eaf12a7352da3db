"""Explore all 3^n states of n dining philosophers, beside CLIPS.

    python -m benchmarks philosophers

`engine.explore` in its variants, beside CLIPS in the same run, where a state is a fact of symbols and a move asserts
another one: no graph, no way back, but the same states and moves. Seconds of processor time, once each.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import process_time
from typing import Any, NamedTuple

from benchmarks._clips import clips
from benchmarks._philosophers import RULES, clips_table, table

PEERS = ("clips",)
TARGET = 5_000
"""States a second."""

PUBLISHED = 740
"""States a second of Henshin 0.9.2 on 4 threads at 10 philosophers: 59,049 states, 459,270 transitions, 80.5 s."""

VARIANTS: dict[str, dict[str, Any]] = {
    "breadth first": {},
    "depth first": {"strategy": "depth"},
    "versions kept": {"keep": True},
    "up to isomorphism": {"up_to": "isomorphism"},
}


class Sizes(NamedTuple):
    """How many philosophers there are."""

    philosophers: int


FULL = Sizes(10)
QUICK = Sizes(3)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"Henshin, published: {PUBLISHED} states/s; to be {TARGET}")
    print(f"{sizes.philosophers} philosophers{'states':>17}{'transitions':>13}{'seconds':>9}{'states/s':>10}")
    ours = 0.0
    for name, options in VARIANTS.items():
        states, moves, seconds = explore(sizes.philosophers, options)
        show(name, states, moves, seconds)
        ours = ours or states / seconds
    if clips is not None:
        states, moves, seconds = in_clips(sizes.philosophers)
        show("CLIPS", states, moves, seconds)
        print(f"breadth first / CLIPS: {ours / (states / seconds):.2f} states/s")
    print(f"{'met' if ours >= TARGET else 'missed'}; times Henshin, published: {ours / PUBLISHED:.0f}")


def show(name: str, states: int, moves: int, seconds: float) -> None:
    """One line."""
    print(f"{name:20}{states:12}{moves:13}{seconds:9.2f}{states / seconds:10.0f}", flush=True)


def explore(size: int, options: dict[str, Any]) -> tuple[int, int, float]:
    """States, transitions and seconds."""
    engine = table(size)
    found = timed(lambda: engine.explore(RULES, limit=3**size, **options))
    result, seconds = found
    assert result.complete and len(result.deadlocks) == 2
    assert len(result) == 3**size or "up_to" in options
    return len(result), result.statistics.transitions, seconds


def in_clips(size: int) -> tuple[int, int, float]:
    """States, moves and seconds in CLIPS."""
    environment = clips_table(size)
    moves, seconds = timed(environment.run)
    return environment.count("state"), moves, seconds


def timed(job: Callable[[], Any]) -> tuple[Any, float]:
    """What it returns, and seconds."""
    gc.collect()
    started = process_time()
    result = job()
    return result, process_time() - started
