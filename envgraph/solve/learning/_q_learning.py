"""The training loop for Q-learning on Python lists. It needs no compiler; tests compare the compiled loop with it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from itertools import pairwise, repeat

import numpy as np
from numpy.typing import NDArray

from envgraph.solve.learning._stage import Stage, StageResult, TransitionTable

DRAWS_AT_ONCE = 16_384


def run_stage(table: TransitionTable, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageResult:
    """Train on a table for a stage; `q` [observations, actions] is changed in place."""
    rate, discount, step_decay, episode_decay, minimum = stage.factors
    each_step, stochastic, n_actions = step_decay != 1.0, table.n_outcomes > 1, table.n_actions
    known = table.cached_outcomes
    starts = start_observations(table)
    start_chances = table.start_cumulative.tolist()

    # The greedy action of each observation and its value are cached, to save two passes over a row in each step.
    rows: list[list[float]] = q[table.seen].tolist()
    best = [max(row) for row in rows]
    greedy = [row.index(top) for row, top in zip(rows, best, strict=True)]

    epsilon, limit, total, episodes, successes = stage.epsilon, stage.settings.limit, 0.0, 0, 0
    left = limit
    curve: list[tuple[float, int, int]] = []
    state, seen = starts[bisect_right(start_chances, rng.random())] if len(starts) > 1 else starts[0]
    for before, after in pairwise([0, *stage.curve_points]):
        for u, v, w in random_rows(table, after - before, rng):
            action = int(u / epsilon * n_actions) if u < epsilon else greedy[seen]
            at = state * n_actions + action
            chances, choice = known[at] or table.outcomes_at(at)
            reward, state, following, ended = choice[bisect_right(chances, v)] if stochastic else choice[0]
            total += reward
            row = rows[seen]
            old = row[action]
            target = reward if ended > 0 else reward + discount * best[following]
            row[action] = new = old + rate * (target - old)
            if action == greedy[seen]:
                if new < old:
                    best[seen] = top = max(row)
                    greedy[seen] = row.index(top)
                else:
                    best[seen] = new
            elif new > best[seen] or (new == best[seen] and action < greedy[seen]):
                best[seen], greedy[seen] = new, action
            seen = following
            left -= 1
            if each_step:
                epsilon = max(minimum, epsilon * step_decay)
            if ended or not left:
                episodes += 1
                successes += ended == 1
                epsilon = max(minimum, epsilon * episode_decay)
                left = limit
                state, seen = starts[bisect_right(start_chances, w)]
        curve.append((total, episodes, successes))
    q[table.seen] = rows
    return StageResult(epsilon, curve)


def start_observations(table: TransitionTable) -> list[tuple[int, int]]:
    """Return the states in which an episode begins, with the indices of their observations in `table.seen`."""
    return list(zip(table.start_states.tolist(), table.observation_index[table.start_states].tolist(), strict=True))


def random_rows(table: TransitionTable, steps: int, rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """Yield a row (u, v, w) of random numbers for each step; 0 for numbers that the table does not need."""
    for start in range(0, steps, DRAWS_AT_ONCE):
        block = rng.random((min(DRAWS_AT_ONCE, steps - start), table.draws_per_step))
        columns: list[Iterable[float]] = block.T.tolist()
        if table.n_outcomes == 1:
            columns.insert(1, repeat(0.0))
        if len(table.start_states) == 1:
            columns.append(repeat(0.0))
        yield from zip(*columns, strict=False)
