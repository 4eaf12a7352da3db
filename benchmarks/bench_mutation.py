"""Mutate the Burning Forest, 8x8: choose, apply, validate, measure and roll back, beside CLIPS.

    python -m benchmarks mutation

The step that a search repeats, with the paper's four constraints (start, goal and water in their places, and a way
from start to goal), and with all that the bundled family demands. Beside CLIPS in the same run: there a mutation is a
fact retracted and one asserted, the way is found by firing a rule, and everything is undone by hand; the measure, and
the three places, which no mutation can touch, are left out.
Microseconds of processor time a mutation, medians.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace
from random import Random
from statistics import median
from time import process_time
from typing import Any, NamedTuple

from numpy.random import default_rng

from benchmarks._clips import Clips, clips
from envgraph.graph import Model
from envgraph.search import Domain, Problem, Require

TARGET = 50
"""Microseconds."""

PEERS = ("clips",)
PAPER = ("startTileFixedLocation", "goalTileFixedLocation", "waterTileFixedLocation", "solvable")
KINDS = ("RoadTile", "VegetationTile", "BurningTile")


class Sizes(NamedTuple):
    """Mutations of a measurement, and how many measurements a median is of."""

    mutations: int
    repeats: int


FULL = Sizes(mutations=2_000, repeats=5)
QUICK = Sizes(mutations=20, repeats=1)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    domain = Domain.load("burning_forest/paper.toml")
    whole = domain.problem(domain.engine())
    four = [one for one in whole.constraints if isinstance(one, Require) and one.pattern.split(".")[-1] in PAPER]
    assert len(four) == len(PAPER)
    paper = replace(whole, constraints=four)
    print(f"microseconds a mutation, to be {TARGET}")
    fast = show("four constraints", lambda count: mutate(paper, count), sizes)
    show(f"all {len(whole.constraints)} constraints", lambda count: mutate(whole, count), sizes)
    whole.engine.watch("solvable", *PAPER[:3])
    show("four, watched", lambda count: mutate(paper, count), sizes)
    if clips is not None:
        forest = ClipsForest(domain.initial())
        other = show("CLIPS", lambda count: mutate_in_clips(forest, count), sizes)
        print(f"four constraints / CLIPS: {fast / other:.2f}")
    print("met" if fast <= TARGET else "missed")


def show(name: str, measure: Callable[[int], tuple[float, int]], sizes: Sizes) -> float:
    """Print and return the median; and how many of the mutations were valid."""
    found = [measure(sizes.mutations) for _ in range(sizes.repeats)]
    micros = 1e6 * median(seconds for seconds, _ in found) / sizes.mutations
    valid = sum(valid for _, valid in found) / sizes.mutations / sizes.repeats
    print(f"{name:22}{micros:8.1f}    {valid:.1%} valid", flush=True)
    return micros


def mutate(problem: Problem, count: int) -> tuple[float, int]:
    """Seconds, and how many mutations were valid."""
    engine, rng, valid = problem.engine, default_rng(1), 0
    assert problem.is_valid()  # as a search begins; what is kept current is from here on
    gc.collect()
    started = process_time()
    for _ in range(count):
        savepoint = engine.model.graph.history.savepoint()
        chosen = engine.choose(problem.mutations, rng)
        assert chosen is not None
        engine.fire(*chosen)
        if problem.is_valid():
            valid += 1
            problem.compute_measures()
        engine.model.graph.history.rollback(savepoint)
    return process_time() - started, valid


# --- CLIPS

CONSTRUCTS = """
(deftemplate tile (slot of) (slot is)) (deftemplate passage (slot from) (slot to)) (deftemplate reached (slot of))
(defrule walk (reached (of ?here)) (passage (from ?here) (to ?there)) (tile (of ?there) (is ~BurningTile)) =>
    (assert (reached (of ?there))))
(defrule arrive (declare (salience 1)) (reached (of ?goal)) (tile (of ?goal) (is GoalTile)) => (halt))
"""


class ClipsForest:
    """The forest as facts, and the three places as Python values."""

    def __init__(self, model: Model) -> None:
        self.environment = Clips(CONSTRUCTS)
        self.facts = {}
        for tile in model.nodes("Tile"):
            self.facts[tile.id] = self.assert_tile(tile.id, tile.cls)
            for other in (tile.left, tile.right, tile.up, tile.down):
                if other is not None:
                    self.environment.add("passage", **{"from": tile.id, "to": other.id})
        self.kinds = {tile.id: tile.cls for tile in model.nodes("Tile")}
        self.mutable = [tile for tile, kind in self.kinds.items() if kind in KINDS]
        self.start = model.nodes("StartTile")[0].id
        self.goal = model.nodes("GoalTile")[0].id

    def assert_tile(self, tile: int, kind: str) -> Any:
        """Assert what a tile is."""
        return self.environment.add("tile", of=tile, **{"is": self.environment.symbol(kind)})

    def solvable(self) -> bool:
        """Whether the walk from the start arrives."""
        self.environment.add("reached", of=self.start)
        self.environment.run()
        found = self.environment.environment.eval(f"(any-factp ((?r reached)) (= ?r:of {self.goal}))")
        self.environment.environment.eval("(do-for-all-facts ((?r reached)) TRUE (retract ?r))")
        return str(found).upper() == "TRUE"


def mutate_in_clips(forest: ClipsForest, count: int) -> tuple[float, int]:
    """Seconds, and how many mutations were valid."""
    random, valid = Random(1), 0
    started = process_time()
    for _ in range(count):
        tile = random.choice(forest.mutable)
        old = forest.kinds[tile]
        forest.facts[tile].retract()
        forest.facts[tile] = forest.assert_tile(tile, random.choice([kind for kind in KINDS if kind != old]))
        valid += forest.solvable()
        forest.facts[tile].retract()
        forest.facts[tile] = forest.assert_tile(tile, old)
    return process_time() - started, valid
