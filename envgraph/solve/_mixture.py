"""Combine several environments into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument


def mixture(tabulars: Sequence[Tabular]) -> Tabular:
    """Return the environment in which each episode takes place in one of several, sampled uniformly when it begins.

    Its states are those of the first, then those of the second and so on. The agent does not observe which
    environment it is in. Training on a mixture is domain randomisation (Tobin et al. 2017). Agents that take turns
    may differ between the environments; agents of the same name are the same.

    Args:
        tabulars: at least one; they must agree in observations and actions.

    Raises:
        InvalidArgument: they do not agree.
    """
    if not tabulars:
        raise InvalidArgument("`tabulars` is empty, but a mixture needs at least one environment")
    first = tabulars[0]
    for place, other in enumerate(tabulars[1:], start=2):
        for name in ("n_observations", "observation_shape", "action_names"):
            if getattr(other, name) != getattr(first, name):
                message = f"environment {place} of the mixture has other `{name}` than environment 1"
                raise InvalidArgument(message)
        if bool(other.agent_names) != bool(first.agent_names):
            raise InvalidArgument("either all environments of a mixture must have agents that take turns, or none")
    agents = tuple(dict.fromkeys(name for one in tabulars for name in one.agent_names))
    outcomes = max(one.next_state.shape[2] for one in tabulars)
    before = np.cumsum([0, *(one.n_states for one in tabulars[:-1])])

    def padded(name: str) -> NDArray[np.float64]:
        arrays = (getattr(one, name) for one in tabulars)
        return np.concatenate([np.pad(array, ((0, 0), (0, 0), (0, outcomes - array.shape[2]))) for array in arrays])

    places = [np.full(one.n_states, shift) for one, shift in zip(tabulars, before, strict=True)]
    starts = [one.start_states + shift for one, shift in zip(tabulars, before, strict=True)]
    return replace(
        first,
        next_state=(padded("next_state") + np.concatenate(places)[:, None, None]).astype(np.int32),
        probability=padded("probability"),
        reward=padded("reward"),
        terminated=padded("terminated").astype(np.int8),
        observation=np.concatenate([one.observation for one in tabulars]),
        start_states=np.concatenate(starts).astype(np.int32),
        start_probability=np.concatenate([one.start_probability for one in tabulars]) / len(tabulars),
        agent_names=agents,
        turn=np.concatenate([_turn_indices(one, agents) for one in tabulars]) if agents else None,
        allowed=np.concatenate([one.action_masks for one in tabulars]),
    )


def _turn_indices(one: Tabular, agents: tuple[str, ...]) -> NDArray[np.int32]:
    """Return for each state the index in `agents` of the agent whose turn it is."""
    places = [agents.index(name) for name in one.agent_names]
    return np.array(places, dtype=np.int32)[one.turn]
