"""Random behaviours over random metamodels, patterns and rules: the compiled environment beside the live one."""

from __future__ import annotations

from random import Random

from tests.oracle.random_behaviours import random_behaviour_case
from tests.unit.env.side_by_side import step_side_by_side


def prepare() -> None:
    """Nothing to do."""


def campaign(random: Random) -> str:
    """One behaviour, with a family of one to three members."""
    world = random_behaviour_case(random.randrange(2**48))
    step_side_by_side(world.engines, world.behaviour, 400, native=False, seed=random.randrange(1000))
    return "compiled, some clauses left out" if world.refused else "compiled"
