"""Explore all 3^n states of n dining philosophers, beside CLIPS, and the ends of long corridors.

    python -m benchmarks philosophers

`engine.explore` in its variants, by the engine and by a program that numba compiles, beside CLIPS in the same run,
where a state is a fact of symbols and a move asserts another one: no graph, no way back, but the same states and moves.
Then a token that walks into one of twenty corridors: breadth-first search changes the corridor with every move, and may
be slower. Seconds of processor time, once each.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from time import process_time
from typing import Any, NamedTuple

from benchmarks._clips import clips
from benchmarks._philosophers import RULES, clips_table, table
from envgraph import Engine, Rule
from envgraph.env.compiled import has_numba
from envgraph.graph import Model
from envgraph.metamodel import Class, Metamodel, Reference

PEERS = ("clips",)
TARGET = 5_000
"""States a second of the engine."""

COMPILED_TARGET = 400_000
"""States a second of a compiled program that is known, at 10 philosophers."""

PUBLISHED = 740
"""States a second of Henshin 0.9.2 on 4 threads at 10 philosophers: 59,049 states, 459,270 transitions, 80.5 s."""

VARIANTS: dict[str, dict[str, Any]] = {
    "breadth first": {"goal": lambda _: False},  # a function, so that no program is compiled
    "depth first": {"strategy": "depth"},
    "versions kept": {"keep": True},
    "up to isomorphism": {"up_to": "isomorphism"},
}


CORRIDORS = 20
MAZE = Metamodel(
    "maze",
    (
        Class("Cell", features=(Reference("to", "Cell", 0, None),)),
        Class("Token", features=(Reference("at", "Cell"),)),
    ),
)


class Sizes(NamedTuple):
    """The number of philosophers in each table, and the number of cells in a corridor."""

    philosophers: tuple[int, ...]
    cells: int


FULL = Sizes((8, 10), 500)
QUICK = Sizes((3,), 5)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"Henshin, published: {PUBLISHED} states/s; to be {TARGET}")
    for number in sizes.philosophers:
        title(f"{number} philosophers")
        ours = 0.0
        for name, options in VARIANTS.items():
            states, moves, seconds = explore(table(number), RULES, options)
            assert states == 3**number or "up_to" in options
            show(name, states, moves, seconds)
            ours = ours or states / seconds
        compiled, engine = 0.0, table(number)
        for name in ("compiling", "compiled") if has_numba() else ():
            states, moves, seconds = explore(engine, RULES, {})
            show(name, states, moves, seconds)
            compiled = states / seconds
        if clips is not None:
            states, moves, seconds = in_clips(number)
            show("CLIPS", states, moves, seconds)
            print(f"breadth first / CLIPS: {ours / (states / seconds):.2f} states/s")
        print(
            f"{'met' if compiled >= COMPILED_TARGET else 'missed'}, compiled; times the engine: {compiled / ours:.0f}"
        )
        print(f"{'met' if ours >= TARGET else 'missed'}; times Henshin, published: {ours / PUBLISHED:.0f}")
    title(f"{CORRIDORS} corridors")
    for strategy in ("breadth", "depth"):
        found = explore(corridors(sizes.cells), ["walk"], {"strategy": strategy})
        assert found[0] == CORRIDORS * sizes.cells + 1
        show(f"{strategy} first", *found)


def title(what: str) -> None:
    """Print what is explored, above the columns of `show`."""
    print(f"{what:20}{'states':>12}{'transitions':>13}{'seconds':>9}{'states/s':>10}")


def corridors(cells: int) -> Engine:
    """Return an engine on a token between the corridors, each of which has `cells` cells."""
    model = Model(MAZE)
    middle = model.create("Cell")
    for _ in range(CORRIDORS):
        end = middle
        for _ in range(cells):
            cell = model.create("Cell")
            end.to.append(cell)
            end = cell
    model.create("Token", at=middle)
    engine = Engine(model)
    engine.add(Rule("walk", lhs="t : Token -at-> a : Cell -to-> b : Cell", modify="set t.at = b"))
    return engine


def show(name: str, states: int, moves: int, seconds: float) -> None:
    """One line."""
    print(f"{name:20}{states:12}{moves:13}{seconds:9.2f}{states / seconds:10.0f}", flush=True)


def explore(engine: Engine, rules: Sequence[str], options: dict[str, Any]) -> tuple[int, int, float]:
    """Return states, transitions and seconds."""
    result, seconds = timed(lambda: engine.explore(rules, limit=1_000_000, **options))
    assert result.complete and result.deadlocks
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
