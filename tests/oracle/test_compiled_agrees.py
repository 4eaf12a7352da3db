"""Random behaviours, compiled and live: rewards, ends, observations, states and errors are equal, step by step."""

from __future__ import annotations

from hypothesis import example, given, settings, strategies as st

from tests.oracle.random_behaviours import random_behaviour_case
from tests.profile import examples
from tests.unit.env.side_by_side import step_side_by_side


@settings(max_examples=examples(5))
@given(st.integers(0, 2**48))
@example(72)  # a reward reads a feature that a parameter has lost with its class, in the same step
def test_compiled_random_environment_steps_like_the_live_environment(seed: int) -> None:
    world = random_behaviour_case(seed)
    step_side_by_side(world.engines, world.behaviour, 40, native=False, seed=seed % 1000)
