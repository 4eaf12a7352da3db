"""Compute the best policy of an environment whose table is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.errors import LIMITS, EvaluationError, InvalidArgument
from envgraph.solve._evaluation import cumulative_probabilities
from envgraph.solve._running import flat_arrays, run_loop

# Actions are equally good below this difference, relative to the largest value: well above the tolerance of the
# values, well below what a step costs at any sensible discount.
MARGIN = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class OptimalPolicy:
    """The values and policy of the best agent that observes the state.

    Attributes:
        values: float64 [states], expected discounted return.
        action_values: float64 [states, actions], expected discounted return if the next action is given.
        policy: intp [states], a best action; the lowest of equally good ones, up to rounding.
    """

    values: NDArray[np.float64]
    action_values: NDArray[np.float64]
    policy: NDArray[np.intp]

    @property
    def best_actions(self) -> NDArray[np.bool_]:
        """Return bool [states, actions]: True for all best actions, up to rounding."""
        return _best_mask(self.action_values)


def value_iteration(tabular: Tabular, discount: float = 0.99, tolerance: float = 1e-10) -> OptimalPolicy:
    """Compute the best policy of an environment without a time limit. Sutton and Barto 2018, section 4.4.

    Args:
        tabular: the environment.
        discount: in [0, 1]; 1 needs an environment in which no reward can be collected for ever.
        tolerance: distance of the values from the true ones, relative to the largest reward (at least 1). With
            discount 1 it bounds the change in the last sweep instead.

    Raises:
        InvalidArgument: the discount or the tolerance is outside its range.
        EvaluationError: the values do not converge, which happens with a discount at or close to 1.
    """
    if not 0.0 <= discount <= 1.0 or not tolerance > 0.0:
        raise InvalidArgument(f"`discount`, {discount}, must be from 0 to 1; `tolerance`, {tolerance}, positive")
    scale = max(1.0, float(np.abs(tabular.reward).max()))
    enough = scale * tolerance * ((1.0 - discount) / discount if 0.0 < discount < 1.0 else 1.0)
    values, change = _iterate_values(tabular, discount, enough, LIMITS["sweeps"])
    if change > enough:
        raise EvaluationError(f"values do not converge in {LIMITS['sweeps']} sweeps: use a `discount` below {discount}")
    onward = np.where(tabular.terminated == 0, discount * values[tabular.next_state], 0.0)
    action_values = (tabular.probability * (tabular.reward + onward)).sum(axis=2)
    return OptimalPolicy(values, action_values, np.argmax(_best_mask(action_values), axis=1))


def optimal_return(tabular: Tabular, limit: int = 200, *, discount: float = 1.0) -> float:
    """Return the greatest expected return within `limit` steps of any agent, including agents that count the steps.

    The result takes `limit` sweeps of value iteration from 0, or fewer once no value changes (backward induction;
    Puterman 1994, section 4.5). It is exact up to rounding.

    Args:
        tabular: the environment.
        limit: steps after which an episode is truncated.
        discount: in [0, 1]; a reward after t steps counts `discount ** t` times.

    Raises:
        InvalidArgument: a number is outside its range.
    """
    if limit < 1 or not 0.0 <= discount <= 1.0:
        raise InvalidArgument(f"`limit`, {limit}, must be positive, and `discount`, {discount}, from 0 to 1")
    values, _ = _iterate_values(tabular, discount, 0.0, limit)
    return float(tabular.start_probability @ values[tabular.start_states])


def optimal_episode(tabular: Tabular, limit: int = 200) -> list[int]:
    """Return the states of an episode of the best policy that ends in success, without the last state.

    Random outcomes are sampled with a fixed seed. Return [] if none of 100 episodes of at most `limit` steps succeeds.
    """
    policy, rng = value_iteration(tabular).policy, np.random.default_rng(0)
    chances = cumulative_probabilities(tabular.probability[np.arange(tabular.n_states), policy])
    for _ in range(100):
        start, states = (cumulative_probabilities(tabular.start_probability) <= rng.random()).sum(), list[int]()
        state = int(tabular.start_states[start])
        while len(states) < limit:
            states.append(state)
            at = state, policy[state], (chances[state] <= rng.random()).sum()
            if tabular.terminated[at]:
                break
            state = int(tabular.next_state[at])
        if tabular.terminated[at] == 1:
            return states
    return []


def _iterate_values(
    tabular: Tabular, discount: float, tolerance: float, max_sweeps: int
) -> tuple[NDArray[np.float64], float]:
    """Return the values after at most `max_sweeps` sweeps, and the greatest change in the last sweep.

    The sweeps end as soon as no value changes by more than `tolerance`.
    """
    values = np.zeros(tabular.n_states)
    read = (*flat_arrays(tabular), *tabular.next_state.shape[1:], discount, tolerance, max_sweeps)
    change = run_loop("settle", read, (values, np.zeros_like(values)))
    return values, change


def _best_mask(action_values: NDArray[np.float64]) -> NDArray[np.bool_]:
    values = action_values.max(axis=1, keepdims=True)
    best: NDArray[np.bool_] = action_values >= values - MARGIN * (1.0 + float(np.abs(values).max()))
    return best
