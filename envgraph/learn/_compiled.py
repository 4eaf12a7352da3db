"""The training loop compiled with numba; the same numbers as the loop on lists, bit for bit.

Nothing here may be reordered without the other: no `fastmath`, and each expression as it stands there. Imported only
when it is used, because numba takes about a second to import and compile.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from envgraph.learn._stage import Stage, StageOutcome, Table

# Rows of random numbers at a time: they stay in the second-level cache.
BLOCK = 32_768


def run_stage(table: Table, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageOutcome:
    """Train on a table; `q` [observations, actions] is changed in place. Releases the interpreter lock."""
    limit, several = stage.settings.limit, len(table.start_states) > 1
    start = int(np.searchsorted(table.start_cumulative, rng.random(), "right")) if several else 0
    points = np.array(stage.points, np.int64)
    curve = (np.empty(len(points)), np.empty(len(points), np.int64), np.empty(len(points), np.int64))
    # Step, point, state, observation, steps left, episodes, successes; epsilon, total reward.
    counts = np.array(
        [0, 0, table.start_states[start], table.start_observations[start], limit, 0, 0], np.int64
    )
    levels = np.array([stage.epsilon, 0.0])
    arrays = (
        table.next_state,
        table.next_observation,
        table.reward,
        table.terminated,
        table.cumulative,
        table.start_states,
        table.start_observations,
        table.start_cumulative,
    )
    for first in range(0, stage.steps, BLOCK):
        draws = rng.random((min(BLOCK, stage.steps - first), table.draws))
        _run_block(q, arrays, table.n_outcomes, draws, stage.factors, limit, counts, levels, points, curve)
    columns: list[list[Any]] = [column.tolist() for column in curve]
    return StageOutcome(float(levels[0]), list(zip(*columns, strict=True)))


# Inlined before compilation: left to the compiler's own inlining, training is a third slower.
@numba.njit(nogil=True, inline="always")
def _greedy(q: NDArray[np.float64], seen: int) -> int:
    action = 0
    for other in range(1, q.shape[1]):
        if q[seen, other] > q[seen, action]:
            action = other
    return action


@numba.njit(nogil=True, inline="always")
def _best(q: NDArray[np.float64], seen: int) -> float:
    """The value of the greedy action: a chain of maxima, which is quicker than finding the action first."""
    best: float = q[seen, 0]
    for other in range(1, q.shape[1]):
        best = max(best, q[seen, other])
    return best


@numba.njit(nogil=True, inline="always")
def _pick(cumulative: NDArray[np.float64], first: int, draw: float) -> int:
    found = 0
    while cumulative[first + found] <= draw:
        found += 1
    return found


@numba.njit(nogil=True)
def _run_block(
    q: NDArray[np.float64],
    arrays: tuple[NDArray[Any], ...],
    n_outcomes: int,
    draws: NDArray[np.float64],
    factors: tuple[float, ...],
    limit: int,
    counts: NDArray[np.int64],
    levels: NDArray[np.float64],
    points: NDArray[np.int64],
    curve: tuple[NDArray[Any], ...],
) -> None:
    next_state, following, rewards, terminated, cumulative, starts, start_seen, start_cumulative = arrays
    rate, discount, step_decay, episode_decay, minimum = factors
    step, point, state, seen, left, episodes, successes = counts
    epsilon, total = levels
    n_actions, several = q.shape[1], len(starts) > 1
    for row in range(len(draws)):
        u = draws[row, 0]
        if u < epsilon:
            action = int(u / epsilon * n_actions)
        else:
            action = _greedy(q, seen)
        at = (state * n_actions + action) * n_outcomes
        if n_outcomes > 1:
            at += _pick(cumulative, at, draws[row, 1])
        reward, state, after, ended = rewards[at], next_state[at], following[at], terminated[at]
        total += reward
        target = reward
        if ended == 0:
            target = reward + discount * _best(q, after)
        old = q[seen, action]
        q[seen, action] = old + rate * (target - old)
        seen = after
        left -= 1
        epsilon = max(minimum, epsilon * step_decay)
        if ended != 0 or left == 0:
            episodes += 1
            successes += ended == 1
            epsilon = max(minimum, epsilon * episode_decay)
            left = limit
            start = _pick(start_cumulative, 0, draws[row, -1]) if several else 0
            state, seen = starts[start], start_seen[start]
        step += 1
        if step == points[point]:
            curve[0][point], curve[1][point], curve[2][point] = total, episodes, successes
            point += 1
    counts[:] = step, point, state, seen, left, episodes, successes
    levels[:] = epsilon, total
