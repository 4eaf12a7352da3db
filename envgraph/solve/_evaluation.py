"""Evaluate policies: by following or sampling episodes for Q-values, by exact computation for policies over states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve._running import flat_arrays, run_loop


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The mean results of episodes.

    Attributes:
        success_rate: share of episodes that end in success, from 0 to 1; not in failure or by truncation.
        mean_return: mean sum of rewards; discounted only if a discount was given.
        mean_length: mean number of steps.
        episodes: number of episodes evaluated.
        exact: True for expected values, False for estimates.
    """

    success_rate: float
    mean_return: float
    mean_length: float
    episodes: int
    exact: bool


def evaluate(
    q: NDArray[np.float64], tabular: Tabular, episodes: int, limit: int, rng: np.random.Generator
) -> Evaluation:
    """Evaluate the greedy policy of Q-values, which takes the lowest of equally good actions.

    In a deterministic environment all episodes from one start are the same. So one episode from each start state is
    followed and weighted with its probability. The result is exact, and neither `episodes` nor `rng` is used.

    Args:
        q: Q-values [observations, actions].
        tabular: the environment.
        episodes: number of episodes to sample if outcomes are stochastic.
        limit: steps after which an episode is truncated.
        rng: advanced only if outcomes are stochastic.

    Raises:
        InvalidArgument: the Q-values do not fit the environment, or a number is not positive.
    """
    if q.shape != (tabular.n_observations, tabular.n_actions):
        raise InvalidArgument(f"`q` has the shape {q.shape}, not {(tabular.n_observations, tabular.n_actions)}")
    if episodes < 1 or limit < 1:
        raise InvalidArgument(f"`episodes` is {episodes} and `limit` is {limit}, but both must be at least 1")
    policy = np.argmax(q[tabular.observation], axis=1)
    if tabular.deterministic:
        return _follow_episodes(tabular, policy, limit)
    return _sample_episodes(tabular, policy, episodes, limit, rng)


def _follow_episodes(tabular: Tabular, policy: NDArray[np.intp], limit: int) -> Evaluation:
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


def _sample_episodes(
    tabular: Tabular, policy: NDArray[np.intp], episodes: int, limit: int, rng: np.random.Generator
) -> Evaluation:
    """Return the mean results of sampled episodes, which advance in parallel, one step at a time."""
    states = np.arange(tabular.n_states)
    chances = cumulative_probabilities(tabular.probability[states, policy])
    starts = np.searchsorted(cumulative_probabilities(tabular.start_probability), rng.random(episodes), "right")
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
    return Evaluation(successes / episodes, float(totals.mean()), float(lengths.mean()), episodes, exact=False)


def evaluate_policy(tabular: Tabular, policy: NDArray[Any] | None, limit: int, *, discount: float = 1.0) -> Evaluation:
    """Return the exact expected values of a policy over states, from the distribution over states after each step.

    Args:
        tabular: the environment.
        policy: int [states], an action for each state; or float64 [states, actions], the probability of an action in a
            state; None for a random walk with equally likely actions. For Q-values over observations pass
            `q.argmax(axis=1)[tabular.observation]`.
        limit: steps after which an episode is truncated.
        discount: in [0, 1]; a reward after t steps counts `discount ** t` times.

    Raises:
        InvalidArgument: the policy does not fit the environment, or a number is outside its range.
    """
    if limit < 1 or not 0.0 <= discount <= 1.0:
        raise InvalidArgument(f"`limit`, {limit}, must be positive, and `discount`, {discount}, from 0 to 1")
    states, outcomes = tabular.n_states, tabular.next_state.size
    arrays = flat_arrays(tabular), _action_probabilities(tabular, policy).reshape(-1)
    first, target = np.zeros(states + 1, np.int64), np.zeros(outcomes, np.int64)
    moved, success, gain = np.zeros(outcomes), np.zeros(states), np.zeros(states)
    written = first, target, moved, success, gain
    used = run_loop("chain", (*arrays[0], arrays[1], *tabular.next_state.shape[1:]), written)
    present = np.bincount(tabular.start_states, tabular.start_probability, minlength=states)
    steps = first, target[:used], moved[:used], success, gain, discount, limit
    success_rate, mean_return, mean_length = run_loop("follow", steps, (present, np.zeros(states)))
    return Evaluation(success_rate, mean_return, mean_length, len(tabular.start_states), exact=True)


def _action_probabilities(tabular: Tabular, policy: NDArray[Any] | None) -> NDArray[np.float64]:
    """Return float64 [states, actions], the action probabilities of a policy; a wrong policy raises InvalidArgument."""
    shape = tabular.n_states, tabular.n_actions
    if policy is None:
        return np.full(shape, 1.0 / tabular.n_actions)
    if policy.shape == shape:
        if not (policy >= 0.0).all() or not np.allclose(policy.sum(axis=1), 1.0, rtol=0.0, atol=1e-9):
            raise InvalidArgument("each row of `policy` must be probabilities of actions with the sum 1")
        return np.ascontiguousarray(policy, np.float64)
    if policy.shape != shape[:1] or not np.issubdtype(policy.dtype, np.integer):
        raise InvalidArgument(f"`policy` has the shape {policy.shape}, but must be int {shape[:1]} or float {shape}")
    if not ((policy >= 0) & (policy < tabular.n_actions)).all():
        raise InvalidArgument(f"`policy` has actions that are not from 0 to {tabular.n_actions - 1}")
    shares = np.zeros(shape)
    shares[np.arange(tabular.n_states), policy] = 1.0
    return shares


def cumulative_probabilities(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return cumulative probabilities over the last axis, infinite from the last outcome that can happen.

    >>> cumulative_probabilities(np.array([0.5, 0.25, 0.25, 0.0])).tolist()
    [0.5, 0.75, inf, inf]
    """
    possible = probability > 0.0
    last = possible.shape[-1] - 1 - np.argmax(np.flip(possible, -1), -1, keepdims=True)
    return np.where(np.arange(possible.shape[-1]) < last, np.cumsum(probability, -1), np.inf)
