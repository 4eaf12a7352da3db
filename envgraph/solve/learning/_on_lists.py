"""Training loops on Python lists for all agents except the basic Q-learning of `_q_learning`. Tests compare the
compiled loop with them.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from envgraph.env.compiled.kernels import values
from envgraph.solve.learning._q_learning import random_rows, start_observations
from envgraph.solve.learning._stage import Stage, StageResult, TransitionTable
from envgraph.solve.learning._training_settings import TrainingSettings

drawn_action: Callable[..., tuple[int, float]] = values.drawn_action

PendingSteps = deque[tuple[list[float], int, float]]
"""Steps whose update waits for later rewards: the values of the observation, the index of the value, and the reward."""


def run_stage(table: TransitionTable, stage: Stage, q: NDArray[np.float64], rng: np.random.Generator) -> StageResult:
    """Train on a table for a stage; `q` is changed in place, see `initial_values` for its shape."""
    settings, n_actions, known = stage.settings, table.n_actions, table.cached_outcomes
    rate, discount, step_decay, episode_decay, minimum = stage.factors
    ties, sarsa, double = settings.ties == "random", settings.agent == "sarsa", q.shape[1] > n_actions
    starts, start_chances = start_observations(table), table.start_cumulative.tolist()
    rows: list[list[float]] = q[table.seen].tolist()

    epsilon, limit, total, episodes, successes = stage.epsilon, settings.limit, 0.0, 0, 0
    left, steps = limit, stage.steps
    waiting: PendingSteps = deque()
    curve: list[tuple[float, int, int]] = []
    state, seen = starts[bisect_right(start_chances, rng.random())] if len(starts) > 1 else starts[0]
    for before, after in pairwise([0, *stage.curve_points]):
        for u, v, w in random_rows(table, after - before, rng):
            row = rows[seen]
            if u >= epsilon and not ties and not double:
                action, free = row.index(max(row)), 0.0
            else:
                action, free = drawn_action(row, n_actions, u, epsilon, ties)
            if sarsa and len(waiting) == settings.n_step:
                _update_first(waiting, rate, discount, row[action])
            at = state * n_actions + action
            chances, choice = known[at] or table.outcomes_at(at)
            reward, state, seen, ended = choice[bisect_right(chances, v)] if len(choice) > 1 else choice[0]
            total += reward
            left, steps = left - 1, steps - 1
            side = n_actions if double and free >= 0.5 else 0
            waiting.append((row, side + action, reward))
            cut = ended or not left or not steps
            if cut or (not sarsa and len(waiting) == settings.n_step):
                value = 0.0 if ended > 0 else _next_value(rows[seen], n_actions, settings, epsilon, side)
                for _ in range(len(waiting) if cut else 1):
                    _update_first(waiting, rate, discount, value)
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


def _next_value(row: list[float], actions: int, settings: TrainingSettings, epsilon: float, side: int) -> float:
    if settings.agent == "q_learning":
        return max(row)
    if settings.agent == "double_q_learning":
        best = max(range(actions), key=row[side : side + actions].__getitem__)
        return row[actions - side + best]
    total = 0.0  # `sum` would be more exact than the compiled loop
    for value in row:
        total += value
    return (1.0 - epsilon) * max(row) + epsilon * (total / actions)


def _update_first(waiting: PendingSteps, rate: float, discount: float, value: float) -> None:
    """Remove the first waiting step, and update its value towards the waiting rewards plus a discounted `value`."""
    for _, _, reward in reversed(waiting):
        value = reward + discount * value
    row, place, _ = waiting.popleft()
    row[place] += rate * (value - row[place])
