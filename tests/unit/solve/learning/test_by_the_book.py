"""n-step learning, double Q-learning and random ties beside the boxes of Sutton and Barto 2018."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.env.compiled import program_of
from envgraph.errors import InvalidArgument
from envgraph.learn import Epsilon, TrainingSettings, train_curriculum, train_program
from tests.unit.env.corners.yard import Yard
from tests.unit.learn.small_tables import random_table, table

EPSILON = Epsilon(start=0.3, minimum=0.3)
SETTINGS = TrainingSettings(
    steps_per_environment=400, epsilon=EPSILON, learning_rate=0.2, discount=0.9, limit=12, initial_value=0.1
)


def epsilon_greedy_action(values: NDArray[np.float64], u: float) -> int:
    return int(u / 0.3 * len(values)) if u < 0.3 else int(values.argmax())


def expected_value(values: NDArray[np.float64]) -> float:
    return float(0.7 * values.max() + 0.3 * values.mean())


def n_step(world: Tabular, settings: TrainingSettings, seed: int) -> NDArray[np.float64]:
    """The box of section 7.2, one episode after the other; the returns are sums of powers of the discount."""
    q = np.full((world.n_observations, 3), settings.initial_value)
    draws = iter(np.random.default_rng(seed).random(settings.steps_per_environment).tolist())
    left, n, gamma = settings.steps_per_environment, settings.n_step, settings.discount
    while left:
        state = int(world.start_states[0])
        states, actions, rewards, ended = (
            [state],
            [epsilon_greedy_action(q[world.observation[state]], next(draws))],
            [0.0],
            0,
        )
        end, t = 10**9, 0
        while True:
            if t < end:
                at = states[t], actions[t], 0
                rewards.append(float(world.reward[at]))
                states.append(int(world.next_state[at]))
                ended, left = int(world.terminated[at]), left - 1
                if ended or t + 1 == settings.limit or not left:
                    end = t + 1
                    tail = 0.0 if ended else expected_value(q[world.observation[states[end]]])
                elif settings.agent == "sarsa":
                    actions.append(epsilon_greedy_action(q[world.observation[states[t + 1]]], next(draws)))
            tau = t - n + 1
            if tau >= 0:
                last = min(tau + n, end)
                g = sum(gamma ** (i - tau - 1) * rewards[i] for i in range(tau + 1, last + 1))
                if last == end:
                    g += gamma ** (last - tau) * tail
                else:
                    row = q[world.observation[states[last]]]
                    g += gamma**n * (row[actions[last]] if settings.agent == "sarsa" else expected_value(row))
                seen = world.observation[states[tau]]
                q[seen, actions[tau]] += settings.learning_rate * (g - q[seen, actions[tau]])
            if settings.agent == "expected_sarsa" and t + 1 < end:
                actions.append(epsilon_greedy_action(q[world.observation[states[t + 1]]], next(draws)))
            t += 1
            if tau == end - 1:
                break
    return q


@pytest.mark.parametrize("agent", ["sarsa", "expected_sarsa"])
@pytest.mark.parametrize("n", [1, 3, 20])
def test_n_step_learning_agrees_with_the_algorithm_of_the_book(agent: str, n: int) -> None:
    settings = TrainingSettings.from_spec({"agent": agent, "n_step": n}, **_spec())
    for seed in range(3):
        world = random_table(seed, 1, 1)
        found = train_curriculum([world], settings, np.random.default_rng(seed), backend="python").q
        assert found == pytest.approx(n_step(world, settings, seed), abs=1e-12)


def _spec() -> dict[str, object]:
    return {name: getattr(SETTINGS, name) for name in SETTINGS.__dataclass_fields__ if name not in ("agent", "n_step")}


def test_double_q_learning_overestimates_noisy_actions_less_than_q_learning() -> None:
    """Example 6.7: the left leads to many actions, whose rewards are -0.1 on average; the right ends with 0."""
    noisy = [[(0.5, 1, 0.9, 2), (0.5, 1, -1.1, 2)]] * 10
    world = table([[[(1.0, 1, 0.0, 0)], *[[(1.0, 0, 0.0, 2)]] * 9], noisy])
    settings = TrainingSettings(
        steps_per_environment=600, discount=1.0, epsilon=Epsilon(start=0.9, minimum=0.9), ties="random"
    )
    lefts = {}
    for agent in ("q_learning", "double_q_learning"):
        found = [
            train_curriculum([world], replace(settings, agent=agent), np.random.default_rng(seed)).q
            for seed in range(40)
        ]
        assert {q.shape for q in found} == {(2, 10)}
        lefts[agent] = np.mean([q[0, 0] for q in found])
    assert lefts["double_q_learning"] < lefts["q_learning"] - 0.02


def test_double_q_learning_updates_one_of_its_two_values_in_each_step() -> None:
    """One step of one action: each visit moves one of both by the rate, and the mean by half of that."""
    world = table([[[(1.0, 0, 1.0, 1)]]])
    settings = TrainingSettings(agent="double_q_learning", steps_per_environment=1, learning_rate=0.5)
    assert train_curriculum([world], settings, np.random.default_rng(0)).q.tolist() == [[0.25]]
    values = train_curriculum(
        [world], replace(settings, initial_value=2.0), np.random.default_rng(0), q=np.array([[3.0]])
    ).q
    assert values.tolist() == [[2.5]]


@pytest.mark.parametrize("agent", ["q_learning", "sarsa", "double_q_learning"])
def test_random_ties_choose_equal_actions_equally_often(agent: str) -> None:
    """All that can happen is worth nothing, so that nothing is learned but where the agent went."""
    row = [[(1.0, action, 0.0, 0)] for action in range(4)]
    world = replace(table([row] * 4), reward=np.zeros((4, 4, 1)))
    paid = replace(world, reward=np.where(np.arange(4)[:, None] == world.next_state[0], 1.0, 0.0)[None].repeat(4, 0))
    settings = TrainingSettings.from_spec(
        {"agent": agent, "ties": "random", "epsilon": {"start": 0.0, "minimum": 0.0}},
        steps_per_environment=1,
        learning_rate=1.0,
    )
    went = Counter(
        int(train_curriculum([paid], settings, np.random.default_rng(seed)).q[0].argmax()) for seed in range(400)
    )
    assert sorted(went) == [0, 1, 2, 3] and min(went.values()) > 70
    lowest = replace(settings, ties="lowest")
    assert train_curriculum([paid], lowest, np.random.default_rng(1)).q[0].argmax() == 0


@pytest.mark.parametrize("agent", ["q_learning", "double_q_learning"])
def test_n_step_learning_is_refused_for_q_learning_agents(agent: str) -> None:
    with pytest.raises(InvalidArgument, match="`n_step` above 1 is for `sarsa` and `expected_sarsa`"):
        TrainingSettings.from_spec({"agent": agent, "n_step": 2})


@pytest.mark.parametrize(
    ("spec", "what"),
    [
        ({"agent": "double_q_learning"}, "double Q-learning"),
        ({"agent": "sarsa", "n_step": 2}, "n-step learning"),
    ],
)
def test_agents_that_need_tables_are_refused_in_programs(spec: dict[str, object], what: str) -> None:
    engine, behaviour = Yard("", "action wait = nothing()\nobserve adam.kind").opened()
    program = program_of(engine, behaviour, native=False)
    with pytest.raises(InvalidArgument, match=f"{what} needs tables"):
        train_program(program, TrainingSettings.from_spec(spec), np.random.default_rng(0))
