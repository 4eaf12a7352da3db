"""Compute the certificates of an environment by an independent method, to check those of `certify`."""

from __future__ import annotations

from math import inf

import numpy as np

from envgraph.env import Tabular
from envgraph.solve._certificates import Certificates
from envgraph.solve._distance import steps_to_success


def recomputed(tabular: Tabular, *, limit: int = 200, discount: float = 1.0) -> Certificates:
    """Return the certificates of a random walk, equal to those of `certify` up to rounding, without its loops.

    `certify` follows episodes from their start. This function computes values backward from the last step, in NumPy:
    p(n, s) = mean over actions of the sum over outcomes of chance x (1 for a success, p(n - 1, next) if the episode
    goes on, else 0). Returns are computed likewise, and the optimum with the best action in place of the mean. The
    shortest plan is searched for from success to the start.
    """
    chance = tabular.probability
    goes_on = tabular.terminated == 0
    succeeds = (chance * (tabular.terminated == 1)).sum(axis=2)
    gain = (chance * tabular.reward).sum(axis=2)
    success, walked, best = (np.zeros(tabular.n_states) for _ in range(3))
    onward = chance * goes_on
    for _ in range(limit):
        success = (succeeds + (onward * success[tabular.next_state]).sum(axis=2)).mean(axis=1)
        walked = (gain + discount * (onward * walked[tabular.next_state]).sum(axis=2)).mean(axis=1)
        best = (gain + discount * (onward * best[tabular.next_state]).sum(axis=2)).max(axis=1)
    starts, weights = tabular.start_states, tabular.start_probability
    steps = int(steps_to_success(tabular)[starts[weights > 0.0]].min())
    return Certificates(
        limit=limit,
        discount=discount,
        shortest_plan=float(steps) if steps <= tabular.n_states else inf,
        random_success=float(weights @ success[starts]),
        optimal_return=float(weights @ best[starts]),
        success=float(weights @ success[starts]),
        policy_return=float(weights @ walked[starts]),
    )
