"""State-space exploration: the dining philosophers, all 3^n states.

    python -m benchmarks philosophers

`engine.explore` in its variants, beside CLIPS in the same run, where a state is a fact of symbols and a move asserts
another one: no graph, no way back, but the same states and moves. Seconds of processor time, once each.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import process_time
from typing import Any

from benchmarks._clips import MISSING, clips
from benchmarks._philosophers import RULES, clips_table, table

SIZE = 10
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


def main() -> None:
    """Print the figures."""
    if clips is None:
        print(MISSING)
    print(f"Henshin, published: {PUBLISHED} states/s; to be {TARGET}")
    print(f"{SIZE} philosophers{'states':>17}{'transitions':>13}{'seconds':>9}{'states/s':>10}")
    ours = 0.0
    for name, options in VARIANTS.items():
        states, moves, seconds = explore(options)
        show(name, states, moves, seconds)
        ours = ours or states / seconds
    if clips is not None:
        states, moves, seconds = in_clips()
        show("CLIPS", states, moves, seconds)
        print(f"breadth first / CLIPS: {ours / (states / seconds):.2f} states/s")
    print(f"{'met' if ours >= TARGET else 'missed'}; times Henshin, published: {ours / PUBLISHED:.0f}")


def show(name: str, states: int, moves: int, seconds: float) -> None:
    """One line."""
    print(f"{name:20}{states:12}{moves:13}{seconds:9.2f}{states / seconds:10.0f}", flush=True)


def explore(options: dict[str, Any]) -> tuple[int, int, float]:
    """States, transitions and seconds."""
    engine = table(SIZE)
    found = timed(lambda: engine.explore(RULES, limit=3**SIZE, **options))
    result, seconds = found
    assert result.complete and len(result.deadlocks) == 2
    assert len(result) == 3**SIZE or "up_to" in options
    return len(result), result.statistics.transitions, seconds


def in_clips() -> tuple[int, int, float]:
    """States, moves and seconds in CLIPS."""
    environment = clips_table(SIZE)
    moves, seconds = timed(environment.run)
    return environment.count("state"), moves, seconds


def timed(job: Callable[[], Any]) -> tuple[Any, float]:
    """What it returns, and seconds."""
    gc.collect()
    started = process_time()
    result = job()
    return result, process_time() - started


if __name__ == "__main__":
    main()
