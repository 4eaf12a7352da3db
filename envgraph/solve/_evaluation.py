"""What a policy achieves: followed or sampled for Q-values, computed for a policy over states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.errors import InvalidArgument


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How episodes end, on average.

    Attributes:
        success_rate: how many end in success, from 0 to 1; not in failure, nor at the limit.
        mean_return: sum of rewards, undiscounted.
        mean_length: steps.
        episodes: how many were looked at.
        exact: these are expected values, not estimates.
    """

    success_rate: float
    mean_return: float
    mean_length: float
    episodes: int
    exact: bool


def evaluate(
    q: NDArray[np.float64], tabular: Tabular, episodes: int, limit: int, rng: np.random.Generator
) -> Evaluation:
    """What the greedy policy achieves; of equal actions the lowest is taken.

    In a deterministic environment all episodes from one start are the same. One from each start state is followed
    and weighted with its probability, which is exact and draws nothing, whatever `episodes` says.

    Args:
        q: Q-values [observations, actions].
        tabular: the environment.
        episodes: how many to sample where outcomes are drawn.
        limit: steps after which an episode is over.
        rng: advanced only where outcomes are drawn.

    Raises:
        InvalidArgument: the Q-values do not fit the environment, or a number is not positive.
    """
    if q.shape != (tabular.n_observations, tabular.n_actions):
        raise InvalidArgument(f"`q` is {q.shape}, not {(tabular.n_observations, tabular.n_actions)}")
    if episodes < 1 or limit < 1:
        raise InvalidArgument("`episodes` and `limit` must be positive")
    policy = np.argmax(q, axis=1)[tabular.observation]
    if tabular.deterministic:
        return _follow(tabular, policy, limit)
    return _sample(tabular, policy, episodes, limit, rng)


def _follow(tabular: Tabular, policy: NDArray[np.intp], limit: int) -> Evaluation:
    states = np.arange(tabular.n_states)
    following = tabular.next_state[states, policy, 0].tolist()
    rewards = tabular.reward[states, policy, 0].tolist()
    terminated = tabular.terminated[states, policy, 0].tolist()
    expected = np.zeros(3)
    for start, weight in zip(tabular.start_states.tolist(), tabular.start_probability.tolist(), strict=True):
        state, total, length, ended = start, 0.0, 0, 0
        while not ended and length < limit:
            total, ended, state = total + rewards[state], terminated[state], following[state]
            length += 1
        expected += weight * np.array([ended == 1, total, length])
    success, mean_return, mean_length = expected.tolist()
    return Evaluation(success, mean_return, mean_length, len(tabular.start_states), exact=True)


def _sample(
    tabular: Tabular, policy: NDArray[np.intp], episodes: int, limit: int, rng: np.random.Generator
) -> Evaluation:
    """All episodes side by side, one step at a time."""
    states = np.arange(tabular.n_states)
    chances = accumulate(tabular.probability)[states, policy]
    starts = np.searchsorted(accumulate(tabular.start_probability), rng.random(episodes), "right")
    state = tabular.start_states[starts]
    running = np.arange(episodes)
    totals, lengths, successes = np.zeros(episodes), np.zeros(episodes), 0
    for _ in range(limit):
        outcome = (chances[state] <= rng.random((len(running), 1))).sum(axis=1)
        index = (state, policy[state], outcome)
        totals[running] += tabular.reward[index]
        lengths[running] += 1
        ended = tabular.terminated[index]
        successes += int((ended == 1).sum())
        state, running = tabular.next_state[index][ended == 0], running[ended == 0]
        if not len(running):
            break
    return Evaluation(
        successes / episodes, float(totals.mean()), float(lengths.mean()), episodes, exact=False
    )


def evaluate_policy(tabular: Tabular, policy: NDArray[np.float64], limit: int) -> Evaluation:
    """Expected values of a policy over states, from the distribution over states after each step.

    Args:
        tabular: the environment.
        policy: float64 [states, actions], the probability of an action in a state.
        limit: steps after which an episode is over.

    Raises:
        InvalidArgument: the policy does not fit the environment.
    """
    if policy.shape != (tabular.n_states, tabular.n_actions):
        raise InvalidArgument(f"`policy` is {policy.shape}, not {(tabular.n_states, tabular.n_actions)}")
    chance = policy[:, :, None] * tabular.probability
    reward = (chance * tabular.reward).sum(axis=(1, 2))
    success = np.where(tabular.terminated == 1, chance, 0.0).sum(axis=(1, 2))
    origin, action, outcome = np.nonzero((chance > 0.0) & (tabular.terminated == 0))
    moved, target = chance[origin, action, outcome], tabular.next_state[origin, action, outcome]
    present = np.bincount(tabular.start_states, tabular.start_probability, minlength=tabular.n_states)
    expected = np.zeros(3)
    for _ in range(limit):
        expected += present @ success, present @ reward, present.sum()
        present = np.bincount(target, present[origin] * moved, minlength=tabular.n_states)
    success_rate, mean_return, mean_length = expected.tolist()
    return Evaluation(success_rate, mean_return, mean_length, len(tabular.start_states), exact=True)


def accumulate(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cumulative probabilities over the last axis, infinite from the last outcome that can happen.

    >>> accumulate(np.array([0.5, 0.25, 0.25, 0.0])).tolist()
    [0.5, 0.75, inf, inf]
    """
    possible = probability > 0.0
    last = possible.shape[-1] - 1 - np.argmax(np.flip(possible, -1), -1, keepdims=True)
    return np.where(np.arange(possible.shape[-1]) < last, np.cumsum(probability, -1), np.inf)
