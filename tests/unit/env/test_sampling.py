"""One uniform number decides all choices of a step, in the live engine and in a table alike."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, explore
from envgraph.env._random_choices import UniformDraw
from envgraph.env._tabular import cumulative_sums
from tests.unit.env import forest
from tests.unit.env.coins import loaded

TURNING = """
action turn = 0.6: turn() | 0.3: drop(hand) reward 1 else reward -1
action grab(coin : Coin) = 0.9: grab(hand, coin, value) reward value else reward -2
on reset apply turn()
each step reward -0.01 apply 0.3: turn() | 0.2: drop(hand)
on find pair(x, _) reward x.value
on find down(coin) reward 0.5 apply 0.7: turnBack(coin) | 0.1: drop(hand)
on find held(hand, coin) apply turn()
on neg find up(_) terminate failure
observe hand.holds among Coin or none
observe coin.side for coin : Coin
"""


def test_draw_divides_the_unit_interval_by_probabilities() -> None:
    assert [UniformDraw(u).choose([0.2, 0.3]) for u in (0.0, 0.19, 0.2, 0.49, 0.5, 0.999)] == [
        0,
        0,
        1,
        1,
        None,
        None,
    ]
    assert [UniformDraw(u).pick(4) for u in (0.0, 0.24, 0.25, 0.75, 0.9999999)] == [0, 0, 1, 3, 3]


def test_rounding_never_makes_a_certain_choice_uncertain() -> None:
    tenths = [0.1] * 10  # they add up to a little less than 1
    assert reduce(add, tenths) < 1.0  # not sum(), which compensates from Python 3.12 on
    assert UniformDraw(1.0 - 2**-53).choose(tenths) == 9


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6), st.floats(0.0, 1.0, exclude_max=True))
def test_the_rest_of_a_draw_stays_in_the_unit_interval(weights: Sequence[float], uniform: float) -> None:
    total = sum(weights)
    probabilities = [weight / total for weight in weights] if total > 1.0 else list(weights)
    draw = UniformDraw(uniform)
    position = draw.choose(probabilities)
    assert 0.0 <= draw.remainder < 1.0
    assert position is None or probabilities[position] > 0.0
    assert 0 <= draw.pick(3) < 3
    assert 0.0 <= draw.remainder < 1.0


def test_outcomes_of_probability_zero_are_never_sampled() -> None:
    rows = np.array([[0.0, 0.5, 0.5, 0.0], [0.1, 0.0, 0.9, 0.0], [1.0, 0.0, 0.0, 0.0]])
    sums = cumulative_sums(rows)
    for row, line in zip(rows, sums, strict=True):
        for uniform in np.linspace(0.0, 1.0 - 2**-53, 1001):
            place = int(np.searchsorted(line, uniform, side="right"))
            assert row[place] > 0.0


@pytest.mark.parametrize("name", ["forest", "coins"])
def test_live_and_tabular_environments_do_the_same_for_the_same_seed(name: str) -> None:
    if name == "forest":
        engine, behaviour = forest.engine(forest.published_maps()[2]), forest.behaviour()
    else:
        engine, behaviour = loaded(TURNING)
    table = EnvgraphEnv(explore(engine, behaviour).tabular)
    live = EnvgraphLiveEnv(Simulator(engine, behaviour))
    actions = np.random.default_rng(5).integers(table.action_space.n, size=1000)
    assert live.observation_space == table.observation_space
    seed: int | None = 11
    running, episodes = False, 0
    for action in actions:
        if not running:
            assert live.reset(seed=seed)[0] == table.reset(seed=seed)[0]
            seed, episodes = None, episodes + 1
        one, other = live.step(action), table.step(action)
        assert one[0] == other[0]
        assert one[1] == pytest.approx(other[1], abs=1e-12)
        assert one[2:4] == other[2:4]
        assert one[4]["success"] == other[4]["success"]
        running = not one[2]
    assert episodes > 10


def test_probabilities_of_a_table_equal_frequencies_of_live_steps() -> None:
    engine, behaviour = loaded(TURNING)
    table = explore(engine, behaviour).tabular
    table.check()
    live = Simulator(engine, behaviour)
    rng = np.random.default_rng(3)
    counts: dict[int, int] = {}
    for _ in range(2000):
        live.reset(rng)
        seen = live.step(0, rng).observation
        counts[seen] = counts.get(seen, 0) + 1
    expected: dict[int, float] = {}
    for start, chance in zip(table.start_states, table.start_probability, strict=True):
        for to, p in zip(table.next_state[start, 0], table.probability[start, 0], strict=True):
            seen = int(table.observation[to])
            expected[seen] = expected.get(seen, 0.0) + float(chance * p)
    assert set(counts) == {seen for seen, p in expected.items() if p > 0.0}
    for seen, p in expected.items():
        assert counts.get(seen, 0) == pytest.approx(2000 * p, abs=5 * (2000 * p * (1 - p) + 1) ** 0.5)
