"""Random behaviours and units, compiled and live: rewards, ends, observations, states and errors are always equal."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import example, given, settings, strategies as st

from envgraph.behaviour import Action, Behaviour, Branch, Domain, ObserveFind, RuleCall
from envgraph.errors import LIMITS
from envgraph.pattern import PatternCall, Variable
from envgraph.rewrite import Engine
from tests.oracle.random_behaviours import random_behaviour_case
from tests.oracle.random_units import QUERIES, RULES, Writer
from tests.profile import examples
from tests.unit.env.side_by_side import step_side_by_side
from tests.unit.rewrite.graphs import chain, definitions, patterns

BASE = (*patterns(QUERIES), *definitions(RULES))


@settings(max_examples=examples(5))
@given(st.integers(0, 2**48))
@example(72)  # a reward reads a feature that a parameter has lost with its class, in the same step
def test_compiled_random_environment_steps_like_the_live_environment(seed: int) -> None:
    world = random_behaviour_case(seed)
    step_side_by_side(world.engines, world.behaviour, 40, native=False, seed=seed % 1000)


@settings(max_examples=examples(5))
@given(st.integers(0, 2**32 - 1))
def test_compiled_random_unit_runs_like_the_live_unit(seed: int) -> None:
    """Units are run by an action; so few steps and combinations of choices are allowed that some have more."""
    model = chain(1 + seed % 4)
    model.node(seed % 4).links.append(model.node(0))
    engine = Engine(model)
    engine.add(*BASE, *definitions(Writer(Random(seed)).unit()))
    engine.step_limit = 15 if seed % 3 == 0 else 150
    actions = [
        Action(name, (Branch(1.0, RuleCall(name, tuple(map(Variable, names)))),), tuple((n, ITEM) for n in names))
        for name, names in (("u", "a"), ("up", "a"), ("link", "ab"))
    ]
    seen = ObserveFind(PatternCall("big", (Variable("_"),)), 3)
    behaviour = Behaviour("random", actions=tuple(actions), observations=(seen,), limit=6)
    with pytest.MonkeyPatch.context() as few:
        few.setitem(LIMITS, "outcomes", 20)
        step_side_by_side([engine], behaviour, 12, native=False, seed=seed % 1000)


ITEM = Domain(cls="Item")
