"""Measure how well a family leads from one environment to the next, without training."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, log10

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve._evaluation import evaluate_policy
from envgraph.solve._value_iteration import value_iteration


def hit_probability(tabular: Tabular, policy: NDArray[np.float64] | None = None, horizon: int = 200) -> float:
    """Return the exact probability that an episode ends in success within `horizon` steps.

    Args:
        tabular: the environment.
        policy: float64 [observations, actions], the probability of an action; by default a random walk.
        horizon: number of steps.

    Raises:
        InvalidArgument: the policy does not fit the environment.
    """
    shape = (tabular.n_observations, tabular.n_actions)
    if policy is not None and policy.shape != shape:
        raise InvalidArgument(f"`policy` has the shape {policy.shape}, but must have {shape}")
    of_states = None if policy is None else policy[tabular.observation]
    return evaluate_policy(tabular, of_states, horizon).success_rate


def softened_policy(tabular: Tabular, epsilon: float = 0.5, discount: float = 0.99) -> NDArray[np.float64]:
    """Return the optimal policy mixed with a random one, over observations [observations, actions].

    It is (1 - epsilon) x uniform over the best actions + epsilon x uniform over all. Observations that no reachable
    state has get the uniform policy. An observation of several states gets the mean of their policies.
    """
    if not 0.0 <= epsilon <= 1.0:
        raise InvalidArgument(f"`epsilon` is {epsilon!r}, it must be from 0 to 1")
    best = value_iteration(tabular, discount).best_actions.astype(np.float64)
    best /= best.sum(axis=1, keepdims=True)
    reached = reachable_states(tabular)
    seen = tabular.observation[reached]
    count = np.bincount(seen, minlength=tabular.n_observations)
    policy = np.full((tabular.n_observations, tabular.n_actions), 1.0 / tabular.n_actions)
    for action in range(tabular.n_actions):
        share = np.bincount(seen, best[reached, action], minlength=tabular.n_observations)
        policy[count > 0, action] = (share / np.maximum(count, 1))[count > 0]
    return (1.0 - epsilon) * policy + epsilon / tabular.n_actions


def chain_transfer(
    tabulars: Sequence[Tabular], epsilon: float = 0.5, horizon: int = 200, discount: float = 0.99
) -> float:
    """Return how easily each environment's best policy finds success in the next: the sum of log10 hit probabilities.

    The policy in the first environment is a random walk; in each later one it is the softened policy of the one before.
    The result is at most 0, and minus infinity if success cannot be reached.
    """
    policy: NDArray[np.float64] | None = None
    total = 0.0
    for tabular in tabulars:
        hit = hit_probability(tabular, policy, horizon)
        total += log10(hit) if hit > 0.0 else -inf
        policy = softened_policy(tabular, epsilon, discount)
    return total


def reachable_states(tabular: Tabular) -> NDArray[np.bool_]:
    """Return bool [states]: True for each state that an episode can reach."""
    reached = np.zeros(tabular.n_states, bool)
    frontier = tabular.start_states[tabular.start_probability > 0.0]
    while len(frontier):
        reached[frontier] = True
        following = tabular.next_state[frontier][tabular.probability[frontier] > 0.0]
        frontier = np.unique(following[~reached[following]])
    return reached
