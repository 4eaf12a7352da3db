"""What SARSA learns, and where it differs from Q-learning."""

from dataclasses import replace

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.learn import Epsilon, TrainingSettings, train_curriculum
from envgraph.solve import evaluate
from tests.unit.learn.small_tables import random_table

WIDTH, HEIGHT = 6, 3


def cliff() -> Tabular:
    """Sutton and Barto 2018, example 6.6, smaller: between start and goal in the last row is a cliff."""
    states, last = WIDTH * HEIGHT, WIDTH * (HEIGHT - 1)
    following = np.zeros((states, 4, 1), np.int32)
    reward, terminated = np.full((states, 4, 1), -1.0), np.zeros((states, 4, 1), np.int8)
    for state in range(states):
        y, x = divmod(state, WIDTH)
        for action, (right, down) in enumerate(((-1, 0), (0, 1), (1, 0), (0, -1))):
            to = min(max(y + down, 0), HEIGHT - 1) * WIDTH + min(max(x + right, 0), WIDTH - 1)
            if to == states - 1:
                terminated[state, action] = 1
            elif to > last:
                reward[state, action], to = -100.0, last
            following[state, action] = to
    return Tabular(
        next_state=following,
        probability=np.ones((states, 4, 1)),
        reward=reward,
        terminated=terminated,
        observation=np.arange(states, dtype=np.int32),
        start_states=np.array([last], np.int32),
        start_probability=np.ones(1),
        action_names=("left", "down", "right", "up"),
        n_observations=states,
        observation_shape=(states,),
    )


def learned(agent: str, seed: int) -> tuple[float, list[int]]:
    """Reward in the second half of the training, and the rows on the greedy way."""
    epsilon = Epsilon(start=0.1, minimum=0.1)
    settings = TrainingSettings(
        agent=agent, epsilon=epsilon, learning_rate=0.5, discount=1.0, steps_per_environment=20_000, limit=500
    )
    table = cliff()
    training = train_curriculum([table], settings, np.random.default_rng(seed))
    reward = training.curve.reward
    state, rows = int(table.start_states[0]), []
    for _ in range(WIDTH * HEIGHT):
        action = int(training.q[state].argmax())
        if table.terminated[state, action, 0]:
            break
        state = int(table.next_state[state, action, 0])
        rows.append(state // WIDTH)
    return reward[-1] - reward[len(reward) // 2], rows


def test_sarsa_avoids_the_cliff_and_has_a_higher_return_than_q_learning() -> None:
    gained = {agent: [learned(agent, seed) for seed in range(3)] for agent in ("q_learning", "sarsa", "expected_sarsa")}
    along = [min(rows) for _, rows in gained["q_learning"]]
    assert along == [HEIGHT - 2] * 3
    rewards = {agent: np.mean([reward for reward, _ in found]) for agent, found in gained.items()}
    assert min(rewards["sarsa"], rewards["expected_sarsa"]) > rewards["q_learning"]
    assert all(min(rows) == 0 for _, rows in gained["expected_sarsa"])


def test_expected_sarsa_without_exploration_equals_q_learning() -> None:
    greedy = TrainingSettings(
        epsilon=Epsilon(start=0.0, minimum=0.0), steps_per_environment=2_000, limit=30, initial_value=0.5
    )
    for seed in range(4):
        found = [
            train_curriculum([random_table(seed)], replace(greedy, agent=agent), np.random.default_rng(1)).q
            for agent in ("q_learning", "expected_sarsa")
        ]
        assert np.array_equal(*found)


@pytest.mark.parametrize("agent", ["sarsa", "expected_sarsa"])
def test_sarsa_agents_learn_to_succeed(agent: str) -> None:
    table = cliff()
    settings = TrainingSettings(agent=agent, steps_per_environment=20_000, limit=60)
    training = train_curriculum([table], settings, np.random.default_rng(0))
    assert evaluate(training.q, table, 1, 60, np.random.default_rng(0)).success_rate == 1.0
