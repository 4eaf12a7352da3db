"""Random behaviours and units, compiled and live: rewards, ends, observations, states and errors are always equal."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from envgraph.errors import LIMITS
from tests.oracle.random_behaviours import random_behaviour_case
from tests.oracle.random_units import random_unit_case
from tests.profile import examples
from tests.unit.env.side_by_side import step_side_by_side


@settings(max_examples=examples(5))
@given(st.integers(0, 2**48))
def test_compiled_random_environment_steps_like_the_live_environment(seed: int) -> None:
    world = random_behaviour_case(seed)
    step_side_by_side(world.engines, world.behaviour, 40, native=False, seed=seed % 1000)


@settings(max_examples=examples(5))
@given(st.integers(0, 2**32 - 1))
def test_compiled_random_unit_runs_like_the_live_unit(seed: int) -> None:
    """So few combinations of choices are allowed that some have more."""
    engine, behaviour = random_unit_case(seed)
    with pytest.MonkeyPatch.context() as few:
        few.setitem(LIMITS, "outcomes", 20)
        step_side_by_side([engine], behaviour, 12, native=False, seed=seed % 1000)
