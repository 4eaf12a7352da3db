"""Distances of states to success."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular


def steps_to_success(tabular: Tabular) -> NDArray[np.int64]:
    """Return int64 [states]: the fewest steps to a success; the number of states plus one if success cannot be reached.

    An outcome counts if it is possible. The method is a breadth-first search backward from success.
    """
    never = tabular.n_states + 1
    possible = tabular.probability > 0.0
    distance = np.full(tabular.n_states, never, np.int64)
    distance[np.any(possible & (tabular.terminated == 1), axis=(1, 2))] = 1
    onward = possible & (tabular.terminated == 0)
    origin, target = np.nonzero(onward)[0], tabular.next_state[onward]
    for steps in range(1, never):
        found = origin[(distance[target] == steps) & (distance[origin] == never)]
        if not found.size:
            break
        distance[found] = steps + 1
    return distance
