"""Learn action values in a compiled program, with memory for the keys that were seen, not for all states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np

from envgraph.code import dataclass
from envgraph.env._size_errors import check_observation_count
from envgraph.env.compiled.batches._batch import padded_to
from envgraph.env.compiled.batches._program_player import ProgramPlayer
from envgraph.env.compiled.kernels._learning_kernels import OUTCOMES, SPACE, STARTS, WRONG
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.programs._compiled_program import CompiledProgram
from envgraph.errors import InvalidArgument


@dataclass(frozen=True, slots=True)
class LearningRates:
    """The hyperparameters of learning, in the order of `learn`: see `TrainingSettings` of `envgraph.learn`.

    Attributes:
        agent: 0 for Q-learning, 1 for SARSA, 2 for expected SARSA.
        samples_ties: True to sample among equally good actions; False to take the lowest.
    """

    agent: int
    samples_ties: bool
    rate: float
    discount: float
    step_decay: float
    episode_decay: float
    minimum: float


class Learner:
    """A learner of the action values of a program's environments.

    Values of observations can be kept for other programs of the behaviour: see `switch_program`.

    Args:
        program: the compiled behaviour.
        initial: the first value of every action.
        of_states: True for values of states, False for values of observations.

    Raises:
        TooManyStates: values of observations, which have no index of 64 bits.

    Attributes:
        count: number of known keys.
        keys: int64 [space, ..]; each of the first `count` rows is a state or an observation.
        values: float64 [space, actions].
    """

    def __init__(self, program: CompiledProgram, initial: float = 0.0, *, of_states: bool = False) -> None:
        if not of_states:
            check_observation_count(program.behaviour, program.observation_shape, program.observation_names)
        self._initial, self._of_states = initial, of_states
        self._player = ProgramPlayer(program, "learn")
        width = program.arrays.ints.shape[1] + program.arrays.floats.shape[1] if of_states else 1
        self.count = 0
        self.keys = np.zeros((COSTS.first_keys, width), dtype=np.int64)
        self.values = np.zeros((COSTS.first_keys, len(program.action_names)))
        self._hashed = np.full(4 * COSTS.first_keys, -1, dtype=np.int64)

    def switch_program(self, program: CompiledProgram) -> None:
        """Use another program from now on, and keep the learned values. Member numbers then mean its members.

        Raises:
            InvalidArgument: the actions or observations of the programs differ, or values are of states.
        """
        known = self._player.program
        if program is known:
            return
        same = (program.action_names, program.observation_shape) == (
            known.action_names,
            known.observation_shape,
        )
        if self._of_states or not same:
            raise InvalidArgument(
                "both programs need the same actions and observations, and the learner must have `of_states=False`"
            )
        self._player = ProgramPlayer(program, "learn")

    def train(
        self,
        member: int,
        points: Sequence[int],
        rates: LearningRates,
        epsilon: float,
        limit: int,
        rng: np.random.Generator,
        *,
        draws: int = OUTCOMES | STARTS,
    ) -> tuple[float, list[tuple[float, int, int]]]:
        """Learn in the environment of a member, beginning with a new episode.

        Args:
            member: the number of the member.
            points: numbers of steps at which a point of the curve is recorded; training ends at the last.
            rates: hyperparameters.
            epsilon: exploration rate at the beginning.
            limit: steps after which an episode is truncated.
            rng: a generator over PCG64, which is advanced.
            draws: bit set of `OUTCOMES` and `STARTS`: random numbers to draw besides those for actions. Results equal
                those of a trainer over tables that draws the same numbers.

        Returns:
            The exploration rate at the end; and for each point total reward, finished episodes and successful ones.

        Raises:
            EvaluationError: an expression has no value in a state, or a rule cannot be applied.
        """
        marks = np.asarray(points, dtype=np.int64)
        curve = np.zeros(len(marks)), np.zeros(len(marks), np.int64), np.zeros(len(marks), np.int64)
        counts = np.array([0, 0, self.count, 0, limit, 0, 0, 0, -1, 0], dtype=np.int64)
        levels = np.array([epsilon, 0.0, 0.0])
        how = SPACE
        while how == SPACE:
            if self.count + 2 >= len(self.keys):
                self._grow()
            how = self._player.call_function(
                "learn", member, rng, self.keys, self._hashed, self.values, self._initial, self._of_states, draws,
                *astuple(rates), limit, marks, *curve, counts, levels,
            )  # fmt: skip
            self._player.check_success(how != WRONG)
            self.count = int(counts[2])
        rows = zip(*(column.tolist() for column in curve), strict=True)
        return float(levels[0]), [(total, episodes, reached) for total, episodes, reached in rows]

    def play(self, member: int, episodes: int, limit: int, rng: np.random.Generator) -> tuple[float, float, float]:
        """Play episodes with the greedy policy. Return the success rate (0 to 1), mean return and mean steps.

        Args:
            member: the number of the member.
            episodes: number of episodes.
            limit: steps after which an episode is truncated.
            rng: a generator over PCG64, which is advanced.

        Raises:
            EvaluationError: as `train`.
        """
        if self.count + 1 >= len(self.keys):
            self._grow()
        policy = self.keys, self._hashed, self.values, self._of_states, self.count
        return self._player.play_episodes(member, policy, episodes, limit, rng)

    def _grow(self) -> None:
        """Enlarge the arrays of keys and values to four times the space, and rebuild the hash table."""
        size = 4 * len(self.keys)
        self.keys, self.values = padded_to(self.keys, size), padded_to(self.values, size)
        self._hashed = np.full(4 * size, -1, dtype=np.int64)
        nothing = np.zeros((size, 0), dtype=np.int64)
        self._player.program.functions_for("learn")["hash_all"](self.keys, nothing, self._hashed, 0, self.count)
