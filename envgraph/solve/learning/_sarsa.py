"""SARSA and expected SARSA on plain Python lists: what the compiled loop is compared with."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from envgraph.solve.learning._q_learning import draws_of, starts_of
from envgraph.solve.learning._stage import Stage, StageOutcome, Table


def run_stage(table: Table, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageOutcome:
    """Train on a table; `q` [observations, actions] is changed in place."""
    settings = stage.settings
    _, rate, discount, step_decay, episode_decay, minimum = stage.factors
    known = table.known
    starts = starts_of(table)
    start_chances = table.start_cumulative.tolist()
    rows: list[list[float]] = q[table.seen].tolist()

    epsilon, limit, total, episodes, successes = stage.epsilon, settings.limit, 0.0, 0, 0
    left, steps = limit, stage.steps
    pending: tuple[list[float], int, float] | None = None  # a step of SARSA that waits for the next action
    curve: list[tuple[float, int, int]] = []
    state, seen = starts[bisect_right(start_chances, rng.random())] if len(starts) > 1 else starts[0]
    for before, after in pairwise([0, *stage.points]):
        for u, v, w in draws_of(table, after - before, rng):
            row = rows[seen]
            action = int(u / epsilon * len(row)) if u < epsilon else row.index(max(row))
            if pending is not None:
                earlier, chosen, earned = pending
                earlier[chosen] += rate * (earned + discount * row[action] - earlier[chosen])
                pending = None
            at = state * len(row) + action
            chances, choice = known[at] or table.outcomes(at)
            reward, state, following, ended = (
                choice[bisect_right(chances, v)] if len(choice) > 1 else choice[0]
            )
            total += reward
            left, steps = left - 1, steps - 1
            if settings.agent == "sarsa" and not ended and left and steps:
                pending = row, action, reward
            else:
                target = reward if ended > 0 else reward + discount * _expected(rows[following], epsilon)
                row[action] += rate * (target - row[action])
            seen = following
            epsilon = max(minimum, epsilon * step_decay)
            if ended or not left:
                episodes += 1
                successes += ended == 1
                epsilon = max(minimum, epsilon * episode_decay)
                left = limit
                state, seen = starts[bisect_right(start_chances, w)]
        curve.append((total, episodes, successes))
    q[table.seen] = rows
    return StageOutcome(epsilon, curve)


def _expected(row: list[float], epsilon: float) -> float:
    """The value of what an agent does that explores so often; `sum` is more exact than the compiled loop."""
    total = 0.0
    for value in row:
        total += value
    return (1.0 - epsilon) * max(row) + epsilon * (total / len(row))
