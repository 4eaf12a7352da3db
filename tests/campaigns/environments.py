"""Random behaviours over random metamodels, patterns, rules and units: the compiled environment beside the live one."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from gymnasium.vector import AutoresetMode

from envgraph.behaviour import ObserveAround, ObserveAttribute, ObserveFind, OnRefused, action_keys
from envgraph.env import FloatRange
from envgraph.env._observation_spaces import OBSERVATION_KINDS
from envgraph.errors import LIMITS
from tests.oracle.random_behaviours import random_behaviour_case
from tests.oracle.random_units import random_unit_case
from tests.unit.env.side_by_side import Family, compare_random_steps
from tests.unit.env.vectors_side_by_side import compare_vectors

STEPS = 8_000
"""Of each member. Most are taken from and to states that have been seen already, which takes less time."""
ROUNDS = 30
"""Of each vector: the live one makes every step."""
HISTORIES = (None, None, 1, 3)


def prepare() -> None:
    """Nothing to do."""


def campaign(random: Random) -> tuple[str, Counter[str]]:
    """One behaviour, with a family of one to three members, or one unit; each observed in two ways, too."""
    if random.random() < 0.2:
        kind, (engine, behaviour) = "unit", random_unit_case(random.randrange(2**32))
        family = Family([engine], behaviour)
    else:
        world = random_behaviour_case(random.randrange(2**48))
        kind = "compiled, some clauses left out" if world.refused else "compiled"
        family = Family(world.engines, world.behaviour)
    with pytest.MonkeyPatch.context() as few:
        few.setitem(LIMITS, "outcomes", 20 if kind == "unit" else 200)  # masks try so many
        steps = STEPS // 4 if kind == "unit" else STEPS  # the live engine does most of them anew
        compare_random_steps(family, steps, native=False, seed=random.randrange(1000))
        counts = constructs(family)
        for observation in random.sample(OBSERVATION_KINDS, 2):
            history = None if observation in ("graph", "text") else random.choice(HISTORIES)
            before, mode = family.compared, random.choice([*AutoresetMode])
            compare_vectors(family, observation, history, mode, ROUNDS, random.randrange(1000))
            if family.compared > before:
                counts.update([f'"{observation}"', *(["history"] if history else [])])
    return kind, counts + Counter(steps=family.compared)


def constructs(family: Family) -> Counter[str]:
    """Which of the constructs that are met more seldom a behaviour has: each counts once."""
    behaviour, metamodel = family.behaviour, family.engines[0].model.metamodel
    owners = (behaviour, *behaviour.agents)
    written = action_keys(behaviour, family.keys, metamodel)
    assert len({key for keys in written.values() for key in keys}) == sum(map(len, written.values()))
    assert behaviour.together or written.keys() <= {*family.program.action_names}
    ranged = {one.name for one in metamodel.attributes if one.range is not None}
    found = {"@key"} if written else set[str]()
    found |= {"floats" for one in family.program.observation_shape if isinstance(one, FloatRange)}
    for one in (one for owner in owners for one in owner.observations):
        kind = "@range" if isinstance(one, ObserveAttribute) and getattr(one.path, "feature", "") in ranged else ""
        if isinstance(one, ObserveFind) and one.each is not None:
            kind = "find for" if one.up_to is None else "count for"
        if isinstance(one, ObserveAround):
            kind = "window"
        found |= {f"{kind} if" if one.visible is not None else kind} if kind else set()
    for effect in (one for owner in owners for one in owner.effects if isinstance(one, OnRefused)):
        found |= {f"refused {effect.end or ('nothing' if effect.reward is None else 'reward')}"}
    return Counter(found)
