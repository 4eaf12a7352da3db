"""The best policy of an environment whose table is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.solve._evaluation import evaluate_policy

MOST_ITERATIONS = 1_000_000

# Actions are equally good below this difference, relative to the largest value: well above the tolerance of the
# values, well below what a step costs at any sensible discount.
MARGIN = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """The best that an agent who sees the state can do.

    Attributes:
        values: float64 [states], expected discounted return.
        action_values: float64 [states, actions], the same when the next action is given.
        policy: intp [states], a best action; the lowest of equals, up to rounding.
        iterations: how many sweeps it took.
    """

    values: NDArray[np.float64]
    action_values: NDArray[np.float64]
    policy: NDArray[np.intp]
    iterations: int

    @property
    def best_actions(self) -> NDArray[np.bool_]:
        """Which actions are best [states, actions]; of equals, up to rounding, all."""
        return _best(self.action_values)


def value_iteration(tabular: Tabular, discount: float = 0.99, tolerance: float = 1e-10) -> Optimum:
    """Solve an environment without a time limit. Sutton and Barto 2018, section 4.4.

    Args:
        tabular: the environment.
        discount: in [0, 1]; 1 needs an environment in which no reward can be collected for ever.
        tolerance: distance of the values from the true ones, relative to the largest reward (at least 1). With
            discount 1 it bounds the change in the last sweep instead.

    Raises:
        InvalidArgument: the discount or the tolerance is outside its range.
        EvaluationError: the values do not settle, which happens with a discount at or close to 1.
    """
    if not 0.0 <= discount <= 1.0 or not tolerance > 0.0:
        raise InvalidArgument("`discount` must be from 0 to 1, and `tolerance` positive")
    scale = max(1.0, float(np.abs(tabular.reward).max()))
    enough = scale * tolerance * ((1.0 - discount) / discount if 0.0 < discount < 1.0 else 1.0)
    reward = (tabular.probability * tabular.reward).sum(axis=2)
    weight = np.where(tabular.terminated == 0, discount * tabular.probability, 0.0)
    values = np.zeros(tabular.n_states)
    for iteration in range(1, MOST_ITERATIONS + 1):
        action_values = reward + (weight * values[tabular.next_state]).sum(axis=2)
        change = float(np.abs(action_values.max(axis=1) - values).max())
        values = action_values.max(axis=1)
        if change <= enough:
            return Optimum(values, action_values, np.argmax(_best(action_values), axis=1), iteration)
    raise EvaluationError(f"values do not settle in {MOST_ITERATIONS} sweeps at discount {discount}")


def _best(action_values: NDArray[np.float64]) -> NDArray[np.bool_]:
    values = action_values.max(axis=1, keepdims=True)
    best: NDArray[np.bool_] = action_values >= values - MARGIN * (1.0 + float(np.abs(values).max()))
    return best


def greedy_return(tabular: Tabular, discount: float = 0.99, limit: int = 200) -> float:
    """Expected undiscounted return, within `limit` steps, of the policy that value iteration finds."""
    policy = value_iteration(tabular, discount).policy
    return evaluate_policy(tabular, np.eye(tabular.n_actions)[policy], limit).mean_return
