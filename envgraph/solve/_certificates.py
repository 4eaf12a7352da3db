"""Certificates: exact properties of an environment in one record, and the worst case of a family."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.draw import html_fields
from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve._evaluation import evaluate_policy
from envgraph.solve._running import flat_arrays, run_loop
from envgraph.solve._value_iteration import optimal_return


@dataclass(frozen=True, slots=True)
class Certificates:
    """Exact properties of an environment, and of a policy in it. All returns are expected discounted sums of rewards.

    Probabilities and returns are exact up to rounding.

    Attributes:
        limit: steps after which an episode is truncated.
        discount: a reward after t steps counts `discount ** t` times.
        shortest_plan: fewest steps after which an episode can end in success, infinite if none can; independent of
            `limit`.
        random_success: probability that a random walk ends in success within the limit.
        optimal_return: the greatest return of any agent within the limit, including agents that count the steps.
        success: probability that the policy ends in success within the limit.
        policy_return: the return of the policy within the limit.
    """

    limit: int
    discount: float
    shortest_plan: float
    random_success: float
    optimal_return: float
    success: float
    policy_return: float

    _repr_html_ = html_fields

    @property
    def solvable(self) -> bool:
        """Return True if an episode can end in success within the limit."""
        return self.shortest_plan <= self.limit

    @property
    def regret(self) -> float:
        """Return the optimal return minus the policy's return, never negative but for rounding (Dennis et al. 2020)."""
        return self.optimal_return - self.policy_return

    @property
    def learnability(self) -> float:
        """Return p (1 - p) for the probability p that the policy succeeds (Rutherford et al. 2024)."""
        return self.success * (1.0 - self.success)

    def values(self) -> dict[str, float | None]:
        """Return the values that depend on no policy, by name, ready for JSON; None for an infinite value."""
        values = {name: getattr(self, name) for name in ("limit", "shortest_plan", "random_success", "optimal_return")}
        return {name: value if isfinite(value) else None for name, value in values.items()}


def certify(
    tabular: Tabular, policy: NDArray[Any] | None = None, *, limit: int = 200, discount: float = 1.0
) -> Certificates:
    """Compute the certificates of an environment, and of a policy in it.

    Args:
        tabular: the environment.
        policy: as in `evaluate_policy`, for each state: int [states], or float64 [states, actions]; by default a
            random walk.
        limit: steps after which an episode is truncated; that of a behaviour is its `limit`.
        discount: in [0, 1], for all returns.

    Raises:
        InvalidArgument: the policy does not fit the environment, or a number is outside its range.
    """
    best = optimal_return(tabular, limit, discount=discount)
    random = evaluate_policy(tabular, None, limit, discount=discount)
    followed = random if policy is None else evaluate_policy(tabular, policy, limit, discount=discount)
    return Certificates(
        limit=limit,
        discount=discount,
        shortest_plan=shortest_plan(tabular),
        random_success=random.success_rate,
        optimal_return=best,
        success=followed.success_rate,
        policy_return=followed.mean_return,
    )


def shortest_plan(tabular: Tabular, outcome: int = 1, *, native: bool | None = None) -> float:
    """Return the fewest steps after which an episode can end in success, or in failure; infinite if none can.

    Random outcomes count if their probability is positive.

    Args:
        tabular: the environment.
        outcome: how the episode ends: 1 for success, 2 for failure.
        native: True to use numba; None for True if numba is installed. Loading numba takes longer than one search in
            Python.
    """
    following, chance, _, ended = flat_arrays(tabular)
    starts = tabular.start_states, tabular.start_probability
    read = (following, chance, ended, *starts, *tabular.next_state.shape[1:], outcome)
    known = np.zeros(tabular.n_states, np.int64), np.zeros(tabular.n_states, np.int64)
    return float(run_loop("search", read, known, native=native) or inf)


def cvar(values: Sequence[float] | NDArray[np.float64], alpha: float) -> float:
    """Return the conditional value at risk: the mean of the worst values of a family, a share `alpha` of all.

    If `alpha` times their number is not whole, the last of the worst counts in part (Rockafellar and Uryasev 2002).
    With 1 the result is the mean, with 0 the worst case.

    Args:
        values: one for each member; more is better, so pass the negative of regrets.
        alpha: in [0, 1].

    Raises:
        InvalidArgument: there are no values, or `alpha` is outside its range.

    >>> family = [0.9, 0.2, 1.0, 0.4]
    >>> cvar(family, 0.0), round(cvar(family, 0.5), 6), round(cvar(family, 0.3), 6)
    (0.2, 0.3, 0.233333)
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    if not ordered.size or not 0.0 <= alpha <= 1.0:
        raise InvalidArgument(f"`alpha` ({alpha!r}) must be from 0 to 1, and `values` must not be empty")
    weights = np.clip(alpha * ordered.size - np.arange(ordered.size), 0.0, 1.0)
    worst = ordered[weights > 0.0]
    return float(np.average(worst, weights=weights[: worst.size]) if worst.size else ordered[0])
