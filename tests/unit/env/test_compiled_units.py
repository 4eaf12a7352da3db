"""Units, as the one action of Sokoban and in tables; others are among the corners."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from envgraph.env import explore
from envgraph.env.compiled import enumerate_states, program_of
from envgraph.env.compiled.kernels.step_kernels import CAPACITY
from tests.unit.env.corners.units import QUERY, RULES
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import EXTRA, mutants, opened, step_side_by_side

SOKOBAN = EXTRA / "sokoban2"
GO = "unit go(worker : Worker, way : Way) { walk(worker, way) | push(worker, way); }\n"
WALK, PUSH = (f"    action {name}(way : Way) = {name}(worker, way)\n" for name in ("walk", "push"))


def sokoban(folder: Path) -> tuple[Path, Path]:
    """Sokoban whose one action is a unit: its model, and the environment."""
    for file in SOKOBAN.iterdir():
        (folder / file.name).write_text(file.read_text())
    rules, environment = folder / "sokoban.rules", folder / "sokoban.environment"
    rules.write_text(f"{rules.read_text()}\n{GO}")
    text = environment.read_text()
    assert WALK + PUSH in text
    environment.write_text(text.replace(WALK + PUSH, "    action go(way : Way) = go(worker, way)\n"))
    return folder / "small.model", environment


def test_compiled_sokoban_with_a_unit_steps_like_the_live_engine(tmp_path: Path) -> None:
    engine, behaviour = opened(*sokoban(tmp_path))
    program = step_side_by_side(mutants(engine, behaviour, 3), behaviour, 100, native=False)
    assert program.action_names == ("go(west)", "go(south)", "go(east)", "go(north)")


def test_compiled_table_with_units_equals_that_of_the_live_engine() -> None:
    behaviour = """
    action any = any() reward 1 else reward -1
    action go(s : Spot) = 0.5: attempt(i1, s)
    each step apply 0.25: any()
    observe i1.at among Spot or none
    """
    units = "unit any { light | dark; } unit attempt(i : Item, s : Spot) { try { go(i, s); } else { any; } }"
    engine, found = Yard(RULES + units, behaviour, QUERY, head="i1 : Item").opened()
    mine, other = enumerate_states(program_of(engine, found, native=False)), explore(engine, found).tabular
    for name in ("probability", "next_state", "reward", "allowed"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(other, name))
    assert mine.n_states > 50


def test_unit_restores_a_state_that_is_larger_than_a_region_of_the_row_buffers() -> None:
    yard = Yard(
        RULES + "rule see { lhs { m : Man; s : Spot; } modify { create m -visited-> s; set s.n += 1; } }\n"
        "unit seen(s : Spot) { try { see; up(s); dark; } else { down(s); see; } }",
        "action seen(s : Spot) = seen(s) reward 1\nobserve adam.at among Spot or none",
        QUERY,
        head="adam : Man",
    )
    engine, behaviour = yard.opened()
    owner = engine.model.node(next(iter(engine.model.graph.extent("Yard"))))
    for number in range(90):
        owner.men.append(engine.model.create("Man", name=f"m{number}"))
        owner.spots.append(engine.model.create("Spot", x=10 + number))
    program = step_side_by_side([engine], behaviour, 12, native=False)
    assert program.arrays.ints.shape[1] > CAPACITY
