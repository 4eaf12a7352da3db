"""A learner whose policy generalises to unseen levels: a network on features of states, trained with PPO."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import generator_states, has_numba, load_functions
from envgraph.env.compiled.kernels import step_kernels
from envgraph.errors import InvalidArgument
from envgraph.solve.learning import _ppo_kernels
from envgraph.solve.learning._policy_settings import PolicySettings

LOOP_NAMES: Final = ("forget", "collect", "advantages", "measure", "improve", "expect")

LEVELS_AT_ONCE: Final = 64
"""Levels that are evaluated at a time, so that the outputs for their states stay in the processor's cache."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LevelTables:
    """Many environments with the same actions in flat arrays, one after the other; L levels, S states in all.

    The features of a state are a set of inputs, which are 1; other inputs are 0. States are numbered through all
    levels. `of` builds the arrays from tables.

    Attributes:
        first: int64 [L + 1], where the states of a level begin.
        start_first: int64 [L + 1], where its start states begin.
        starts, start_chance: int64 and float64, the start states of all levels, and their probabilities.
        to, chance, reward, ended: int32, float64, float64 and int8 [S * A * K], as in `Tabular`.
        seen_first: int64 [S + 1], where the inputs of a state begin.
        seen: int32, the inputs that are 1.
        inputs, actions, width: the number of inputs; of actions, A; of outcomes of an action, K.
    """

    first: Ints
    start_first: Ints
    starts: Ints
    start_chance: Floats
    to: NDArray[np.int32]
    chance: Floats
    reward: Floats
    ended: NDArray[np.int8]
    seen_first: Ints
    seen: NDArray[np.int32]
    inputs: int
    actions: int
    width: int

    @classmethod
    def of(
        cls,
        levels: Sequence[Tabular],
        seen: Sequence[Sequence[Sequence[int]]] | None = None,
        *,
        inputs: int | None = None,
        scale: float = 1.0,
        width: int = 1,
    ) -> LevelTables:
        """Build the tables of some environments.

        Args:
            levels: the environments, which must have the same actions; their order gives their numbers.
            seen: for each level, for each of its states the inputs that are 1; by default there is one input for each
                value of each component of an observation.
            inputs: number of inputs; by default up to the last one that is used.
            scale: factor for rewards.
            width: the least K; K is at least that of the widest level.

        Raises:
            InvalidArgument: there is no level, or the levels differ in actions, or, if `seen` is not given, in
                observations.
        """
        alike = {(one.action_names, None if seen else one.observation_shape) for one in levels}
        if len(alike) != 1:
            raise InvalidArgument("`levels` must be one or more levels with the same actions and observations")
        if seen is None:
            inputs = sum(levels[0].observation_shape)
            seen = [_component_inputs(one) for one in levels]
        rows = [row for level in seen for row in level]
        if inputs is None:
            inputs = 1 + max((one for row in rows for one in row), default=0)
        width = max(width, *(one.next_state.shape[2] for one in levels))
        begins = np.cumsum([0, *(one.n_states for one in levels)])

        def padded(name: str, kind: type[np.generic]) -> NDArray[Any]:
            parts = [getattr(one, name) for one in levels]
            return np.concatenate(
                [np.pad(part, ((0, 0), (0, 0), (0, width - part.shape[2]))).ravel() for part in parts]
            ).astype(kind)

        moved = np.repeat(begins[:-1], np.diff(begins) * levels[0].n_actions * width)
        return cls(
            first=begins,
            start_first=np.cumsum([0, *(len(one.start_states) for one in levels)]),
            starts=np.concatenate([one.start_states + at for one, at in zip(levels, begins, strict=False)]),
            start_chance=np.concatenate([one.start_probability for one in levels]),
            to=(padded("next_state", np.int64) + moved).astype(np.int32),
            chance=padded("probability", np.float64),
            reward=padded("reward", np.float64) * scale,
            ended=padded("terminated", np.int8),
            seen_first=np.cumsum([0, *map(len, rows)]),
            seen=np.array([one for row in rows for one in row], np.int32),
            inputs=inputs,
            actions=levels[0].n_actions,
            width=width,
        )

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays, in the order that the loops expect."""
        return tuple(getattr(self, one.name) for one in fields(self)[:10])

    def __len__(self) -> int:
        return len(self.first) - 1

    def extended_by(self, other: LevelTables) -> LevelTables:
        """Return these levels followed by others with the same inputs, actions and width."""
        states = self.first[-1]
        moved = {
            "first": other.first[1:] + states,
            "start_first": other.start_first[1:] + self.start_first[-1],
            "starts": other.starts + states,
            "to": other.to + np.int32(states),
            "seen_first": other.seen_first[1:] + self.seen_first[-1],
        }
        names = [one.name for one in fields(self)[:10]]
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), moved.get(name, getattr(other, name))]) for name in names
        }
        return replace(self, **joined)

    def count_states(self, chosen: Ints) -> int:
        """Return the total number of states of some levels."""
        return int((self.first[chosen + 1] - self.first[chosen]).sum())


def _component_inputs(level: Tabular) -> list[list[int]]:
    """Return for each state the inputs that are 1: for each component of its observation, the input of its value."""
    shape = level.observation_shape
    values = np.unravel_index(level.observation, shape, order="F")
    begins = np.cumsum([0, *shape[:-1]])
    return (np.stack(values, axis=1) + begins).tolist()  # type: ignore[no-any-return]


@dataclass(frozen=True, slots=True, eq=False)
class PlayStatistics:
    """Statistics of levels that were played; float64, an entry for each level.

    Attributes:
        length: int64, number of steps.
        returns: mean discounted return of the finished episodes.
        positive: mean of the positive part of the advantage (positive value loss, Jiang et al. 2021b).
        absolute: mean of its absolute value (L1 value loss, Jiang et al. 2021a).
        best_return: mean of the best return ever seen on the level minus the value (MaxMC, Jiang et al. 2021b).
        negative: minus the mean of the lambda-average of n-step advantages, each the minimum of those up to it; 0 if no
            episode ended in success.
        success: share of the finished episodes that ended in success.
    """

    length: Ints
    returns: Floats
    positive: Floats
    absolute: Floats
    best_return: Floats
    negative: Floats
    success: Floats

    @property
    def steps(self) -> int:
        """Return the total number of steps."""
        return int(self.length.sum())


class PolicyLearner:
    """A policy with a value function on levels, as a network with one hidden layer.

    All randomness comes from one stream of numbers. Numba and Python give the same results bit for bit; Python is
    hundreds of times slower.

    Args:
        tables: the levels.
        settings: hyperparameters.
        seed: the seed for the weights and for all sampling.
        native: True to compile the loops with numba; None for True if numba is installed.

    Attributes:
        parameters: float64, see `_policy_loop`.
        best: float64 [levels], the greatest return seen on each level; minus infinity if none was.
    """

    def __init__(self, tables: LevelTables, settings: PolicySettings, seed: int, *, native: bool | None = None) -> None:
        self._tables, self._settings = tables, settings
        self._native = native = has_numba() if native is None else native
        self._do = load_functions("", (step_kernels, _ppo_kernels), LOOP_NAMES, native=native)
        inputs, hidden, outputs = tables.inputs, settings.hidden, tables.actions + 1
        self._shape = inputs, hidden, outputs, tables.width
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
        seen = max(1.0, len(tables.seen) / max(1, len(tables.seen_first) - 1))
        second = rng.standard_normal((hidden, outputs)) / np.sqrt(hidden)
        second[:, :-1] *= 0.01
        first = rng.standard_normal((inputs, hidden)) * np.sqrt(2.0 / seen)
        self.parameters = np.concatenate([first.ravel(), np.zeros(hidden), second.ravel(), np.zeros(outputs)])
        self._streams = generator_states([np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2,)))])
        self._rows = np.full(len(tables.seen_first) - 1, -1, np.int32)
        self._moments = [np.zeros_like(self.parameters) for _ in range(3)]
        self._time = np.ones(2)
        self.best = np.full(len(tables), -np.inf)
        self._capacity = 0
        self._tracks: tuple[NDArray[Any], ...] = ()
        self._advantages = np.zeros(0)
        self._most = 0
        self._student: tuple[Any, ...] = ()
        self._ensure_capacity(1)

    def copy_with_seed(self, seed: int) -> PolicyLearner:
        """Return a new learner for the same levels that has a copy of the parameters, and its own random stream."""
        found = PolicyLearner(self._tables, self._settings, seed, native=self._native)
        found.parameters[:] = self.parameters
        return found

    def replace_levels(self, tables: LevelTables) -> None:
        """Replace the levels by tables that begin with all present levels and add new ones; clear cached outputs."""
        self._do["forget"](self._tables.arrays, self._student)
        self._tables = tables
        more = len(tables.seen_first) - 1 - len(self._rows)
        self._rows = np.append(self._rows, np.full(more, -1, np.int32))
        self._student = self._student[0], self._rows, *self._student[2:]
        self.best = np.append(self.best, np.full(len(tables) - len(self.best), -np.inf))

    def play(self, chosen: Ints, episodes: int | None = None) -> PlayStatistics:
        """Play levels with sampled actions, update `best`, and return statistics of each level.

        Args:
            chosen: int64, the levels; `improve` can learn from them if they are as many as in a batch.
            episodes: number of whole episodes of each level; None to play `settings.steps` steps of each.
        """
        settings = self._settings
        most = settings.steps if episodes is None else episodes * settings.limit
        self._clear_outputs(chosen)
        self._ensure_tracks(len(chosen), most)
        tracks = self._tracks
        arrays, student = self._tables.arrays, self._student
        self._do["collect"](arrays, student, chosen, self._streams, most, episodes or most + 1, settings.limit, tracks)
        discount, smoothing = settings.discount, settings.smoothing
        self._do["advantages"](student, tracks, most, discount, smoothing, self._advantages)
        scores, best = np.zeros((len(chosen), 7)), self.best[chosen]
        self._do["measure"](student, tracks, most, discount, smoothing, self._advantages, best, scores)
        np.maximum.at(self.best, chosen, best)
        finished = np.maximum(scores[:, 4], 1.0)
        positive, absolute, best_return, negative = scores[:, :4].T
        returns, success = scores[:, 6] / finished, scores[:, 5] / finished
        return PlayStatistics(tracks[5].copy(), returns, positive, absolute, best_return, negative, success)

    def improve(self, rng: np.random.Generator) -> None:
        """Learn from the steps that were played last; `rng` shuffles the levels."""
        settings, tracks, arrays, student = self._settings, self._tracks, self._tables.arrays, self._student
        count = len(tracks[5])
        size = count // settings.minibatches
        rates = settings.learning_rate, settings.norm, settings.clip, settings.entropy, settings.value
        optimiser = *self._moments, *self._scratch, self._time
        for _ in range(settings.epochs):
            order = rng.permutation(count)
            for begin in range(0, size * settings.minibatches, size):
                played = tracks, self._most, self._advantages, order, (begin, begin + size)
                self._do["improve"](arrays, student, optimiser, *played, rates)

    def evaluate(self, chosen: Ints | Sequence[int], *, greedy: bool = False) -> tuple[Floats, Floats]:
        """Return the exact success probability and discounted return within the limit, for each of some levels.

        The distribution over states is computed step by step, as in `envgraph.solve.evaluate_policy`.

        Args:
            chosen: the levels.
            greedy: True to take the likeliest action always, instead of sampling.
        """
        chosen = np.asarray(chosen, np.int64)
        found = np.zeros((len(chosen), 2))
        sizes = np.diff(self._tables.first)
        present, after = np.zeros(sizes.max()), np.zeros(sizes.max())
        limit, discount = self._settings.limit, self._settings.discount
        for begin in range(0, len(chosen), LEVELS_AT_ONCE):
            part = chosen[begin : begin + LEVELS_AT_ONCE]
            self._clear_outputs(part)
            arrays, student, rows = self._tables.arrays, self._student, found[begin : begin + LEVELS_AT_ONCE]
            self._do["expect"](arrays, student, part, limit, discount, greedy, present, after, rows)
        return found[:, 0], found[:, 1]

    # --- room

    def _clear_outputs(self, chosen: Ints) -> None:
        """Discard cached outputs of all states, and make room for the states of some levels."""
        self._do["forget"](self._tables.arrays, self._student)
        self._ensure_capacity(self._tables.count_states(np.unique(chosen)))

    def _ensure_capacity(self, states: int) -> None:
        if states <= self._capacity:
            return
        self._capacity = states = max(states, 2 * self._capacity)
        _, hidden, outputs, _ = self._shape
        visited, count = np.zeros(states, np.int64), np.zeros(1, np.int64)
        known = np.zeros(states * hidden), np.zeros(states * outputs)
        self._student = self.parameters, self._rows, visited, count, *known, self._shape
        slots, used = np.full(states, -1, np.int64), np.zeros(states, np.int64)
        sums = np.zeros(states * (outputs + 1))
        self._scratch = np.zeros(states * hidden), np.zeros(states * outputs), slots, used, sums

    def _ensure_tracks(self, levels: int, most: int) -> None:
        if self._tracks and (len(self._tracks[5]), self._most) == (levels, most):
            return
        self._most, size = most, levels * most
        at, after, action, how = (np.zeros(size, np.int64) for _ in range(4))
        self._tracks = at, after, action, np.zeros(size), how, np.zeros(levels, np.int64)
        self._advantages = np.zeros(size)
