"""What a policy achieves."""

import numpy as np
import pytest

from envgraph.errors import InvalidArgument
from envgraph.solve import evaluate, evaluate_policy
from tests.unit.learn.small_tables import random_table, table

END = [(1.0, 1, 0.0, 0)]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_one_episode_is_exact_in_deterministic_tables() -> None:
    generator = rng()
    found = evaluate(np.zeros((2, 1)), table([[[(1.0, 1, 3.0, 1)]], [END]]), 3_000, 200, generator)
    assert (found.success_rate, found.mean_return, found.mean_length) == (1.0, 3.0, 1.0)
    assert (found.episodes, found.exact) == (1, True)
    assert generator.random() == rng().random()


def test_a_truncated_episode_is_not_a_success() -> None:
    found = evaluate(np.zeros((1, 1)), table([[[(1.0, 0, -1.0, 0)]]]), 1, 7, rng())
    assert (found.success_rate, found.mean_return, found.mean_length) == (0.0, -7.0, 7.0)


def test_an_episode_that_ends_in_failure_is_not_a_success() -> None:
    assert evaluate(np.zeros((2, 1)), table([[[(1.0, 1, 1.0, 2)]], [END]]), 1, 9, rng()).success_rate == 0.0


def test_the_lowest_of_equal_actions_is_chosen() -> None:
    fork = table([[[(1.0, 1, 1.0, 1)], [(1.0, 1, 2.0, 2)]], [END, END]])
    assert evaluate(np.zeros((2, 2)), fork, 1, 9, rng()).mean_return == 1.0
    assert evaluate(np.array([[0.0, 1.0], [0.0, 0.0]]), fork, 1, 9, rng()).mean_return == 2.0


def test_start_states_count_with_their_probability() -> None:
    two = table([[[(1.0, 1, 0.0, 1)]], [END], [[(1.0, 1, 4.0, 2)]]], starts={0: 0.75, 2: 0.25})
    found = evaluate(np.zeros((3, 1)), two, 3_000, 9, rng())
    assert (found.success_rate, found.mean_return, found.exact) == (0.75, 1.0, True)


@pytest.mark.parametrize("seed", range(4))
def test_sampled_episodes_agree_with_expected_values(seed: int) -> None:
    """Within five standard deviations of the mean of so many episodes."""
    tabular = random_table(seed)
    q = np.random.default_rng(seed).random((7, 3))
    policy = np.eye(3)[q.argmax(axis=1)[tabular.observation]]
    sampled = evaluate(q, tabular, 100_000, 25, rng())
    exact = evaluate_policy(tabular, policy, 25)
    assert (sampled.exact, exact.exact) == (False, True)
    assert sampled.success_rate == pytest.approx(exact.success_rate, abs=0.008)
    assert sampled.mean_return == pytest.approx(exact.mean_return, abs=0.15)
    assert sampled.mean_length == pytest.approx(exact.mean_length, abs=0.12)


@pytest.mark.parametrize("seed", range(4))
def test_deterministic_episodes_agree_with_expected_values(seed: int) -> None:
    tabular = random_table(seed, outcomes=1, starts=3)
    q = np.random.default_rng(seed).random((7, 3))
    followed = evaluate(q, tabular, 1, 25, rng())
    exact = evaluate_policy(tabular, np.eye(3)[q.argmax(axis=1)[tabular.observation]], 25)
    assert followed.success_rate == pytest.approx(exact.success_rate)
    assert followed.mean_return == pytest.approx(exact.mean_return)
    assert followed.mean_length == pytest.approx(exact.mean_length)


def test_evaluations_with_the_same_seed_are_equal() -> None:
    q = np.zeros((7, 3))
    assert evaluate(q, random_table(3), 50, 25, rng()) == evaluate(q, random_table(3), 50, 25, rng())


def test_invalid_arguments_are_refused() -> None:
    loop = table([[[(1.0, 0, 0.0, 0)]]])
    with pytest.raises(InvalidArgument, match="`q` has the shape"):
        evaluate(np.zeros((2, 1)), loop, 1, 1, rng())
    with pytest.raises(InvalidArgument, match="must be at least 1"):
        evaluate(np.zeros((1, 1)), loop, 0, 1, rng())
    with pytest.raises(InvalidArgument, match="must be at least 1"):
        evaluate(np.zeros((1, 1)), loop, 1, 0, rng())
    with pytest.raises(InvalidArgument, match="`policy` has the shape"):
        evaluate_policy(loop, np.ones((1, 2)), 1)
