"""Small tables for the tests: by hand, and at random."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from envgraph.env import Tabular

# Probability, next state, reward, how the episode ends.
Outcome = tuple[float, int, float, int]


def table(
    rows: Sequence[Sequence[Sequence[Outcome]]],
    starts: Mapping[int, float] | None = None,
    observation: Sequence[int] | None = None,
) -> Tabular:
    """The table with outcomes `rows[state][action]`; each state is its own observation unless told otherwise."""
    starts = starts or {0: 1.0}
    outcomes = max(len(choice) for row in rows for choice in row)
    filled = np.array([[[*choice, *[(0.0, 0, 0.0, 0)] * (outcomes - len(choice))] for choice in row] for row in rows])
    seen = np.arange(len(rows)) if observation is None else np.array(observation)
    return Tabular(
        next_state=filled[..., 1].astype(np.int32),
        probability=filled[..., 0],
        reward=filled[..., 2],
        terminated=filled[..., 3].astype(np.int8),
        observation=seen.astype(np.int32),
        start_states=np.array(list(starts), np.int32),
        start_probability=np.array(list(starts.values())),
        n_observations=int(seen.max()) + 1,
        observation_shape=(int(seen.max()) + 1,),
        action_names=tuple(f"a{action}" for action in range(len(rows[0]))),
    )


def random_table(seed: int, outcomes: int = 3, starts: int = 2) -> Tabular:
    """Twelve states of which the last is terminal, three actions, seven observations; some outcomes are padding."""
    rng = np.random.default_rng(seed)
    shape = (12, 3, outcomes)
    probability = rng.random(shape) * (rng.random(shape) < 0.7)
    probability[..., 0] += 0.1
    probability /= probability.sum(axis=-1, keepdims=True)
    next_state = rng.integers(12, size=shape)
    terminated = np.where(next_state == 11, rng.integers(1, 3, size=shape), 0)
    reward = rng.integers(-10, 11, size=shape) / 10
    next_state[11], terminated[11], reward[11] = 11, 0, 0.0
    weights = rng.random(starts) + 0.1
    return Tabular(
        next_state=next_state.astype(np.int32),
        probability=probability,
        reward=reward,
        terminated=terminated.astype(np.int8),
        observation=rng.integers(7, size=12).astype(np.int32),
        start_states=rng.choice(11, size=starts, replace=False).astype(np.int32),
        start_probability=weights / weights.sum(),
        n_observations=7,
        observation_shape=(7,),
        action_names=("a", "b", "c"),
    )
