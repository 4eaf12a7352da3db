"""Sample episodes of a random walk without a table; a program and the live engine sample equal episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Simulator
from envgraph.env.compiled import CompiledBatch, CompiledProgram
from envgraph.errors import InvalidArgument

PROGRAM_STEPS, LIVE_STEPS, BLOCK_STEPS = 2_000_000, 20_000, 200_000
"""Steps in a program, and on the live engine, which take one or two seconds; and steps of episodes sampled together."""


def sample_walks(
    environment: CompiledProgram | Simulator,
    limit: int,
    episodes: int | None = None,
    *,
    seed: int = 0,
    legal: bool = False,
    progress: Callable[[int, int], None] = lambda episodes, _: None,
) -> NDArray[np.float64]:
    """Sample episodes in which each action is sampled uniformly from all actions, also those without an effect.

    Episode `i` draws its actions and then the reset and steps from `numpy.random.default_rng([seed, i])`.

    Args:
        environment: a live engine, or a program, of which the first member is used.
        limit: steps after which an episode is truncated.
        episodes: None for 10,000, or as few as have at most 2,000,000 steps (20,000 live), but at least 100.
        legal: sample each action from those that the action mask allows in the state.
        progress: called from time to time with the number of episodes, and 0.

    Returns:
        For each episode 1 if it ended in success else 0, the sum of its rewards, and its steps: float64 [episodes, 3].

    Raises:
        InvalidArgument: `limit` is not positive.
        RuleError, EvaluationError: as steps do.
    """
    if limit < 1:
        raise InvalidArgument(f"`limit` is {limit}, but must be at least 1")
    is_live, choices = isinstance(environment, Simulator), len(environment.action_names)
    count = episodes or min(max((LIVE_STEPS if is_live else PROGRAM_STEPS) // limit, 100), 10_000)
    found, size = np.zeros((count, 3)), 1 if is_live else max(1, BLOCK_STEPS // limit)
    for first in range(0, count, size):
        rows = found[first : first + size]
        rngs = [np.random.default_rng([seed, first + number]) for number in range(len(rows))]
        drawn = [rng.random(limit) if legal else rng.integers(choices, size=limit) for rng in rngs]
        running = np.ones(len(rows), np.bool_)
        for ended, reward in _iterate_steps(environment, rngs, np.stack(drawn, axis=1)):
            rows[running] += np.stack([ended == 1, reward, running], axis=1)[running]
            running &= ended == 0
            if not running.any():
                break
        progress(first + len(rows), 0)
    return found


def _iterate_steps(
    environment: CompiledProgram | Simulator, rngs: Sequence[np.random.Generator], actions: NDArray[Any]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Do actions [limit, episodes], or legal ones at places in [0, 1); yield ends and rewards, ended episodes too."""
    legal = actions.dtype == np.float64
    if isinstance(environment, Simulator):
        environment.reset(rngs[0])
        for row in actions:
            (action,) = _legal_actions(row, environment.action_mask()[None]) if legal else row
            outcome = environment.step(int(action), rngs[0])
            yield np.array([outcome.terminated]), np.array([outcome.reward])
        return
    batch = CompiledBatch(environment, np.zeros(len(rngs), np.int64))
    batch.seed(rngs)
    batch.reset(np.ones(len(rngs), np.bool_))
    for row in actions:
        batch.step(_legal_actions(row, batch.action_masks()) if legal else row, resets_ended=True, limit=len(actions))
        yield batch.ended, batch.reward


def _legal_actions(places: NDArray[np.float64], masks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the actions at places from 0 to 1, exclusive, among those that the masks allow."""
    found: NDArray[np.int64] = (masks.cumsum(axis=1) <= np.floor(places * masks.sum(axis=1))[:, None]).sum(axis=1)
    return found
