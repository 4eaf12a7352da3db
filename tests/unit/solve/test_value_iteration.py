"""Value iteration."""

import numpy as np
import pytest

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.solve import optimal_return, value_iteration
from tests.unit.learn.forest_tables import published_family
from tests.unit.learn.small_tables import random_table, table

END = [(1.0, 1, 0.0, 0)]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("discount", [0.0, 0.5, 0.95])
def test_no_change_of_an_action_improves_the_policy(seed: int, discount: float) -> None:
    """The policy's own values, from a system of linear equations, are those found and satisfy Bellman's equation."""
    tabular = random_table(seed)
    found = value_iteration(tabular, discount)
    chosen = (np.arange(12), found.policy)
    chance = np.where(tabular.terminated == 0, tabular.probability, 0.0)
    moves = np.zeros((12, 3, 12))
    np.add.at(moves, (np.arange(12)[:, None, None], np.arange(3)[:, None], tabular.next_state), chance)
    reward = (tabular.probability * tabular.reward).sum(axis=2)
    values = np.linalg.solve(np.eye(12) - discount * moves[chosen], reward[chosen])
    assert found.values == pytest.approx(values, abs=1e-9)
    assert (reward + discount * moves @ values).max(axis=1) == pytest.approx(values, abs=1e-9)


def test_the_best_returns_of_the_published_family() -> None:
    """On a shortest way of 13 steps, less 0.1 a vegetation tile, more 1 for the water where it pays."""
    returns = [optimal_return(tabular) for tabular in published_family()]
    assert returns == pytest.approx([10.7, 10.7, 10.9, 10.9, 10.9, 10.2], abs=1e-12)


def test_equal_actions_are_all_best_actions_and_the_policy_has_the_lowest() -> None:
    fork = table([[[(1.0, 1, 0.1 + 0.2, 1)], [(1.0, 1, 0.3, 1)], [(1.0, 1, 0.2, 1)]], [END, END, END]])
    found = value_iteration(fork)
    assert found.best_actions[0].tolist() == [True, True, False]
    assert found.policy[0] == 0


def test_values_ignore_states_after_a_terminated_outcome() -> None:
    tempting = table([[[(1.0, 1, 1.0, 2)]], [[(1.0, 1, 100.0, 0)]]])
    assert value_iteration(tempting, 0.9).values[0] == 1.0


def test_undiscounted_values_are_found_where_episodes_end() -> None:
    assert optimal_return(published_family()[-1], discount=0.9999)
    slippery = table([[[(0.5, 1, 2.0, 1), (0.5, 0, -1.0, 0)]], [END]])
    assert value_iteration(slippery, 1.0).values[0] == pytest.approx(1.0)


def test_values_that_grow_without_bound_are_an_error() -> None:
    with pytest.raises(EvaluationError, match="do not converge"):
        value_iteration(table([[[(1.0, 0, 1.0, 0)]]]), 1.0)


@pytest.mark.parametrize(("discount", "tolerance"), [(1.1, 1e-9), (-0.1, 1e-9), (0.9, 0.0), (float("nan"), 1e-9)])
def test_arguments_outside_their_range_are_refused(discount: float, tolerance: float) -> None:
    with pytest.raises(InvalidArgument):
        value_iteration(table([[[(1.0, 0, 1.0, 0)]]]), discount, tolerance)
