"""An environment as arrays: every reachable state, every action, every outcome."""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.draw import html_table
from envgraph.env._prepared_clauses import MAX_REWARD
from envgraph.errors import TOLERANCE, InvalidArgument

_MAX_STEP_REWARD = 1e10 * MAX_REWARD
"""Largest absolute value of the reward of a step: 1e10 matches with the largest reward."""


@dataclass(frozen=True, slots=True, eq=False)
class Tabular:
    """A Markov decision process with observations; S states, A actions, at most K outcomes of an action.

    An action with fewer than K outcomes is padded with outcomes of probability 0. A state in which an episode has
    ended is an absorbing row: it leads to itself with reward 0 and `terminated` 0, and is never stepped from.

    Two tables are equal only if they are the same object, as for the arrays in them.

    Attributes:
        next_state: int32 [S, A, K], a state from 0.
        probability: float64 [S, A, K]; sums to 1 over K.
        reward: float64 [S, A, K], in the units of the behaviour's `reward` clauses; from -1e110 to 1e110.
        terminated: int8 [S, A, K]; the outcome continues (0), ends the episode in success (1) or in failure (2), or
            truncates it (-1).
        observation: int64 [S]; the observation of a state, an index from 0. States may have equal observations.
        start_states: int32 [N], distinct states.
        start_probability: float64 [N]; sums to 1.
        n_observations: the number of possible observations, the same for all members of a family.
        observation_shape: sizes of the components of an observation; the first varies fastest in the index.
        action_names: one name for each action, in the order of the indices.
        agent_names: the agents that take turns, in the order in which they act; () for a single agent.
        turn: int32 [S], the agent that acts in a state; None for a single agent.
        observation_names: the names of the components of an observation; () for numbers from 1.
        allowed: bool [S, A], the actions that do something in a state, or all if none does; None for all.
    """

    next_state: NDArray[np.int32]
    probability: NDArray[np.float64]
    reward: NDArray[np.float64]
    terminated: NDArray[np.int8]
    observation: NDArray[np.int64]
    start_states: NDArray[np.int32]
    start_probability: NDArray[np.float64]
    n_observations: int
    observation_shape: tuple[int, ...]
    action_names: tuple[str, ...]
    agent_names: tuple[str, ...] = ()
    turn: NDArray[np.int32] | None = None
    allowed: NDArray[np.bool_] | None = None
    observation_names: tuple[str, ...] = ()

    @property
    def n_states(self) -> int:
        """Return S, the number of states."""
        return int(self.next_state.shape[0])

    @property
    def n_actions(self) -> int:
        """Return A, the number of actions."""
        return int(self.next_state.shape[1])

    @property
    def deterministic(self) -> bool:
        """Return True if every action has one outcome (K is 1); the start state may still be random."""
        return int(self.next_state.shape[2]) == 1

    @property
    def action_masks(self) -> NDArray[np.bool_]:
        """Return `allowed`, or an all-True array [S, A] if it is None."""
        return np.ones((self.n_states, self.n_actions), np.bool_) if self.allowed is None else self.allowed

    def __repr__(self) -> str:
        return f"<Tabular: {', '.join(f'{number:,} {what}' for what, number in self._counts().items())}>"

    def _repr_html_(self) -> str:
        rows = [*((what, f"{number:,}") for what, number in self._counts().items())]
        rows += [("names of actions", ", ".join(self.action_names)), ("agents", ", ".join(self.agent_names))]
        return html_table(row for row in rows if row[1])

    def _counts(self) -> dict[str, int]:
        return {
            "states": self.n_states,
            "actions": self.n_actions,
            "outcomes": int(np.count_nonzero(self.probability)),
            "observations": self.n_observations,
            "start states": len(self.start_states),
        }

    def check(self) -> None:
        """Check that the arrays are consistent with the documented attributes.

        Raises:
            InvalidArgument: a shape, an index, a probability or a name is wrong; the message names it.
        """
        self._check_shapes()
        self._check_indices()
        self._check_distribution("probability", self.probability)
        self._check_distribution("start_probability", self.start_probability)
        bounded = bool((np.abs(self.reward) <= _MAX_STEP_REWARD).all())
        _require(
            bounded, f"`reward` has values outside of the range from {-_MAX_STEP_REWARD:g} to {_MAX_STEP_REWARD:g}"
        )

    def _check_shapes(self) -> None:
        shape, starts = self.next_state.shape, self.start_states.shape
        _require(len(shape) == 3, "`next_state` needs three axes: state, action, outcome")
        _require(0 not in shape, "`next_state` needs at least one state, one action and one outcome")
        for name in ("probability", "reward", "terminated"):
            found = getattr(self, name).shape
            _require(found == shape, f"`{name}` has shape {found}, but `next_state` {shape}")
        _require(self.observation.shape == (self.n_states,), "`observation` needs one value for each state")
        _require(len(starts) == 1 and starts[0] > 0, "`start_states` needs one axis and at least one state")
        _require(self.start_probability.shape == starts, "`start_probability` needs one value for each start state")
        _require(len(self.action_names) == self.n_actions, "`action_names` needs one name for each action")
        _require(len(set(self.action_names)) == self.n_actions, "`action_names` contains a name twice")
        size, count = prod(self.observation_shape), self.n_observations
        _require(size == count, f"`observation_shape` gives {size} observations, `n_observations` is {count}")
        names = self.observation_names
        fits = not names or len(set(names)) == len(self.observation_shape)
        _require(fits, "`observation_names` needs one distinct name for each component")
        both = (self.turn is None) == (not self.agent_names)
        _require(both, "`turn` must be given if and only if `agent_names` is not empty")
        if self.turn is not None:
            _require(self.turn.shape == (self.n_states,), "`turn` needs one agent for each state")
        if self.allowed is not None:
            _require(self.allowed.shape == shape[:2], "`allowed` needs the shape [states, actions]")
            _require(bool(self.allowed.any(axis=1).all()), "`allowed` has a state without an allowed action")

    def _check_indices(self) -> None:
        _require(_all_in_range(self.next_state, self.n_states), "`next_state` contains a state that does not exist")
        _require(_all_in_range(self.start_states, self.n_states), "`start_states` contains a state that does not exist")
        distinct = len(np.unique(self.start_states)) == len(self.start_states)
        _require(distinct, "`start_states` contains a state twice")
        observed = _all_in_range(self.observation, self.n_observations)
        _require(observed, "`observation` has a value outside of 0..`n_observations` - 1")
        _require(_all_in_range(self.terminated + 1, 4), "`terminated` must contain only 0, 1, 2 and -1")
        if self.turn is not None:
            acting = _all_in_range(self.turn, len(self.agent_names))
            _require(acting, "`turn` contains an agent that does not exist")

    @staticmethod
    def _check_distribution(name: str, values: NDArray[np.float64]) -> None:
        _require(bool((values >= 0.0).all()), f"`{name}` has negative values")
        close = np.abs(values.sum(axis=-1) - 1.0) <= TOLERANCE
        _require(bool(close.all()), f"`{name}` does not sum to 1")


def nonempty_masks(allowed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return action masks [.., actions] in which a row without a True is replaced by all True."""
    return allowed | ~allowed.any(axis=-1, keepdims=True)


def cumulative_sums(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return cumulative sums along the last axis, for `searchsorted(.., u, "right")`.

    From the last possible outcome on, the sum is exactly 1, so that rounding never selects an impossible outcome.
    """
    sums = np.cumsum(probability, axis=-1)
    possible = np.cumsum(probability[..., ::-1] > 0.0, axis=-1)[..., ::-1] > 0
    later = np.concatenate([possible[..., 1:], np.zeros_like(possible[..., :1])], axis=-1)
    sums[~later] = 1.0
    return sums


def _all_in_range(values: NDArray[np.int32] | NDArray[np.int64] | NDArray[np.int8], size: int) -> bool:
    return bool(((values >= 0) & (values < size)).all())


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise InvalidArgument(message)
