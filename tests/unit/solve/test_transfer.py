"""Hit probabilities and chain transfer."""

from dataclasses import replace
from functools import cache
from math import inf, log10

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve import chain_transfer, hit_probability, softened_policy, value_iteration
from tests.unit.learn.forest_tables import forest, published_family
from tests.unit.learn.small_tables import random_table, table

END = [(1.0, 1, 0.0, 0)]


def recursive_hit(tabular: Tabular, policy: np.ndarray, horizon: int) -> float:
    """The same probability, backwards and state by state."""

    @cache
    def hit(state: int, left: int) -> float:
        if left == 0:
            return 0.0
        total = 0.0
        for action in range(tabular.n_actions):
            for outcome in range(tabular.next_state.shape[2]):
                index = (state, action, outcome)
                chance = policy[tabular.observation[state], action] * tabular.probability[index]
                ended = tabular.terminated[index]
                after = float(ended == 1) if ended else hit(int(tabular.next_state[index]), left - 1)
                total += chance * after
        return total

    starts = zip(tabular.start_states.tolist(), tabular.start_probability.tolist(), strict=True)
    return sum(weight * hit(state, horizon) for state, weight in starts)


def test_the_hit_probability_of_a_random_walk_grows_with_the_horizon() -> None:
    coin = table([[[(1.0, 1, 0.0, 1)], [(1.0, 0, 0.0, 0)]], [END, END]])
    assert hit_probability(coin, horizon=1) == 0.5
    assert hit_probability(coin, horizon=3) == 0.875


def test_an_episode_that_ends_in_failure_is_not_a_hit() -> None:
    assert hit_probability(table([[[(1.0, 1, 0.0, 2)]], [END]])) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_hit_probability_agrees_with_a_recursion(seed: int) -> None:
    tabular = random_table(seed)
    policy = np.random.default_rng(seed).dirichlet(np.ones(3), size=7)
    assert hit_probability(tabular, policy, 12) == pytest.approx(recursive_hit(tabular, policy, 12), rel=1e-12)


def test_a_softened_policy_divides_probability_equally_among_best_actions() -> None:
    fork = table([[[(1.0, 1, 1.0, 1)], [(1.0, 1, 1.0, 1)], [(1.0, 1, 0.0, 1)], [(1.0, 1, 0.0, 1)]], [END] * 4])
    assert softened_policy(fork, 0.5)[0].tolist() == [0.375, 0.375, 0.125, 0.125]
    assert softened_policy(fork, 1.0)[0].tolist() == [0.25] * 4


def test_unreachable_observations_get_the_uniform_policy() -> None:
    """State 2 prefers action 1, but no episode comes there."""
    island = table([[[(1.0, 1, 0.0, 1)]] * 2, [END] * 2, [[(1.0, 1, 0.0, 2)], [(1.0, 1, 1.0, 1)]]])
    assert value_iteration(island).policy[2] == 1
    assert softened_policy(island, 0.0)[2].tolist() == [0.5, 0.5]


def test_states_with_the_same_observation_get_the_mean_of_their_best_actions() -> None:
    right_then_left = table(
        [
            [[(1.0, 0, 0.0, 2)], [(1.0, 1, 0.0, 0)]],
            [[(1.0, 2, 1.0, 1)], [(1.0, 2, 0.0, 2)]],
            [[(1.0, 2, 0.0, 0)]] * 2,
        ],
        observation=[0, 0, 1],
    )
    assert softened_policy(right_then_left, 0.0)[0].tolist() == [0.5, 0.5]


def test_chain_transfer_sums_the_logarithms_along_the_chain() -> None:
    first, second = forest(["SRG", "VVR"]), forest(["SBG", "RRR"])
    expected = log10(hit_probability(first)) + log10(hit_probability(second, softened_policy(first)))
    assert chain_transfer([first, second]) == pytest.approx(expected, rel=1e-12)
    assert chain_transfer([first]) == log10(hit_probability(first))


def test_a_chain_with_the_path_of_the_target_has_higher_transfer() -> None:
    target = forest(["SRR", "BBR", "BBG"])
    along, aside = forest(["SRR", "VVR", "VVG"]), forest(["SVV", "RVV", "RRG"])
    assert chain_transfer([along, target]) > chain_transfer([aside, target])


def test_chain_transfer_to_an_unreachable_target_is_minus_infinity() -> None:
    assert chain_transfer([forest(["SB", "BG"])]) == -inf


def test_a_random_walk_hardly_ever_solves_the_published_target() -> None:
    """Each environment of the published family is harder for a random walk than the one before it."""
    hits = [hit_probability(tabular) for tabular in published_family()]
    assert hits == sorted(hits, reverse=True)
    assert 1e-6 < hits[-1] < 1e-5


def test_chain_transfer_does_not_depend_on_unreachable_states() -> None:
    family = published_family()[-2:]
    assert chain_transfer([_reachable_part(one) for one in family]) == pytest.approx(chain_transfer(family), rel=1e-12)


def _reachable_part(tabular: Tabular) -> Tabular:
    kept, queue = {int(tabular.start_states[0]): 0}, [int(tabular.start_states[0])]
    for state in queue:
        for following in tabular.next_state[state].ravel().tolist():
            if following not in kept:
                kept[following] = len(kept)
                queue.append(following)
    renamed = np.vectorize(lambda state: kept[state])
    return replace(
        tabular,
        next_state=renamed(tabular.next_state[queue]).astype(np.int32),
        probability=tabular.probability[queue],
        reward=tabular.reward[queue],
        terminated=tabular.terminated[queue],
        observation=tabular.observation[queue],
        start_states=np.array([0], np.int32),
    )


def test_invalid_arguments_are_refused() -> None:
    loop = table([[[(1.0, 0, 0.0, 0)]]])
    with pytest.raises(InvalidArgument, match="`policy` has the shape"):
        hit_probability(loop, np.ones((2, 1)))
    with pytest.raises(InvalidArgument, match="`epsilon`"):
        softened_policy(loop, 1.5)
