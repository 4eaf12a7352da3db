"""The data that all training loops share: a flat table, a stage, and the random numbers of its steps.

All loops consume the same random numbers, so they give the same result bit for bit. A stage first takes one number for
the start of its first episode (only if there are several start states). Then each step takes one row of numbers in
[0, 1):

    u            explore where u < epsilon; u / epsilon is uniform again and picks the action
    v            picks the outcome, only in stochastic tables
    w            picks the start of the next episode if this step ends one; only if there are several starts

Rows are drawn in blocks; the numbers do not depend on the size of the blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.solve._evaluation import cumulative_probabilities
from envgraph.solve.learning._training_settings import TrainingSettings

OutcomeRow = tuple[float, int, int, int]
"""Reward, next state, index of its observation in `Table.seen`, and how the episode ends (0: it does not end)."""


@dataclass(frozen=True, slots=True, eq=False)
class TransitionTable:
    """A `Tabular` in the form that training loops sample from, with only the outcomes that can happen.

    The outcomes of action a in state s begin at `offset[s * A + a]` and end at the next offset. If some steps have many
    outcomes, most of a `Tabular` is padding.

    Attributes:
        n_outcomes: the number of outcomes of an action in the `Tabular`.
        cumulative: the outcome is the first whose value is above v. The last one of an action has infinity, so that
            rounding never leads beyond it.
        seen: the distinct observations of the states, ascending.
        observation_index: for each state, the index of its observation in `seen`.
        cached_outcomes: cached results of `outcomes_at`; None for those not computed yet.
        next_observation: observation of the next state.
        start_cumulative: like `cumulative`, for the start states.
    """

    n_observations: int
    n_actions: int
    n_outcomes: int
    offset: NDArray[np.int64]
    next_state: NDArray[np.int64]
    next_observation: NDArray[np.int64]
    reward: NDArray[np.float64]
    terminated: NDArray[np.int64]
    cumulative: NDArray[np.float64]
    seen: NDArray[np.int64]
    observation_index: NDArray[np.int64]
    start_states: NDArray[np.int64]
    start_observations: NDArray[np.int64]
    start_cumulative: NDArray[np.float64]
    cached_outcomes: list[tuple[list[float], list[OutcomeRow]] | None] = field(repr=False)

    @property
    def draws_per_step(self) -> int:
        """Return the number of random numbers that a step takes."""
        return 1 + int(self.n_outcomes > 1) + int(len(self.start_states) > 1)

    def outcomes_at(self, at: int) -> tuple[list[float], list[OutcomeRow]]:
        """Return the cumulative probabilities and the outcomes at `at` = s * A + a, action a in state s, as lists.

        The lists are cached in `cached_outcomes`. Only needed entries are converted, since an agent visits few of the
        states of a large table.
        """
        here = slice(self.offset[at], self.offset[at + 1])
        following = self.next_state[here]
        columns: Any = self.reward[here], following, self.observation_index[following], self.terminated[here]
        read = [column.tolist() for column in columns]
        found = self.cached_outcomes[at] = self.cumulative[here].tolist(), list(zip(*read, strict=True))
        return found

    @property
    def arrays(self) -> tuple[Any, ...]:
        """Return the arguments of the compiled loop: all arrays, and one pair, the numbers of actions and outcomes."""
        return (
            self.offset,
            self.next_state,
            self.next_observation,
            self.reward,
            self.terminated,
            self.cumulative,
            self.start_states,
            self.start_observations,
            self.start_cumulative,
            (self.n_actions, self.n_outcomes),
        )


@dataclass(frozen=True, slots=True)
class Stage:
    """A part of the training that takes place on one table.

    Attributes:
        steps: its length.
        epsilon: exploration rate at its beginning.
        settings: all other settings.
        learn: False to play without learning.
    """

    steps: int
    epsilon: float
    settings: TrainingSettings
    learn: bool = True

    @property
    def factors(self) -> tuple[float, float, float, float, float]:
        """Return learning rate (0 to only play), discount, decay of epsilon per step and per episode, least epsilon."""
        settings, epsilon = self.settings, self.settings.epsilon
        decays = (1.0, epsilon.decay) if epsilon.per == "episode" else (epsilon.decay, 1.0)
        return settings.learning_rate if self.learn else 0.0, settings.discount, *decays, epsilon.minimum

    @property
    def curve_points(self) -> list[int]:
        """Return the steps of the stage after which the learning curve is recorded; the last is the stage's end."""
        inner = range(self.settings.checkpoint, self.steps, self.settings.checkpoint)
        return [*inner, self.steps]


@dataclass(frozen=True, slots=True)
class StageResult:
    """The results of a stage, beside the Q-values.

    Attributes:
        epsilon: exploration rate at its end.
        curve: at each of its points, totals since its beginning: reward, finished episodes, successes among them.
    """

    epsilon: float
    curve: list[tuple[float, int, int]]


def flatten_tabular(tabular: Tabular) -> TransitionTable:
    """Return the table of an environment for the training loops."""
    possible = tabular.probability > 0.0
    next_state = tabular.next_state[possible].astype(np.int64)
    observation = tabular.observation.astype(np.int64)
    seen, place = np.unique(observation, return_inverse=True)
    starts = tabular.start_states.astype(np.int64)
    return TransitionTable(
        n_observations=tabular.n_observations,
        n_actions=tabular.n_actions,
        n_outcomes=int(tabular.next_state.shape[2]),
        offset=np.concatenate([[0], np.cumsum(possible.sum(axis=2))]),
        next_state=next_state,
        next_observation=observation[next_state],
        reward=tabular.reward[possible],
        terminated=tabular.terminated[possible].astype(np.int64),
        cumulative=cumulative_probabilities(tabular.probability)[possible],
        seen=seen,
        observation_index=place,
        start_states=starts,
        start_observations=observation[starts],
        start_cumulative=cumulative_probabilities(tabular.start_probability),
        cached_outcomes=[None] * (tabular.n_states * tabular.n_actions),
    )


def with_starts(table: TransitionTable, tabular: Tabular) -> TransitionTable:
    """Return the table with the start states of another environment, which must have the same states."""
    starts = tabular.start_states.astype(np.int64)
    seen, cumulative = table.seen[table.observation_index[starts]], cumulative_probabilities(tabular.start_probability)
    return replace(table, start_states=starts, start_observations=seen, start_cumulative=cumulative)


def compact_observations(tables: Sequence[TransitionTable]) -> Sequence[TransitionTable]:
    """Return the tables with only those observations that occur in one of them, renumbered in order.

    Learning is the same, with fewer rows of values if many possible observations never occur.
    """
    seen = np.unique(np.concatenate([table.seen for table in tables]))
    if len(seen) == tables[0].n_observations:
        return tables
    return [
        replace(
            table,
            n_observations=len(seen),
            next_observation=np.searchsorted(seen, table.next_observation),
            start_observations=np.searchsorted(seen, table.start_observations),
            seen=np.searchsorted(seen, table.seen),
        )
        for table in tables
    ]
