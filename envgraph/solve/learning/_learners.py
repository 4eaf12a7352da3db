"""Train many learners in the same way, to measure how well a family teaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import Learner, set_generator_state
from envgraph.errors import InvalidArgument
from envgraph.solve._distance import steps_to_success
from envgraph.solve.learning._programs import InProgram, train_learner
from envgraph.solve.learning._stage import Stage, TransitionTable, compact_observations, flatten_tabular
from envgraph.solve.learning._training import action_values, available_backends, initial_values
from envgraph.solve.learning._training_settings import TrainingSettings

EPISODES = 16
"""The number of episodes that are played if starts or outcomes are random; otherwise one episode suffices."""


@dataclass(frozen=True, slots=True, eq=False)
class TargetResults:
    """The results of learners on the target, with an entry for each learner.

    Attributes:
        scores: float64, mean over episodes: 1 for a success, else a quarter of the share of the distance to success
            that the learner came closer; 0 for other episodes in programs, where distances are unknown.
        successes: float64, share of the episodes that succeed.
    """

    scores: NDArray[np.float64]
    successes: NDArray[np.float64]


class LearnerGroup:
    """A trainer of many learners, each with its own random stream, that then play a target.

    A learner does what `train_curriculum` does with `numpy.random.Generator(PCG64(..))` over its stream, bit for bit.

    Args:
        settings: the settings of the learners; `steps_per_environment` is an argument of `train_and_play` instead.
        target: the environment to play at the end, with the observations and actions of all training environments.

    Raises:
        InvalidArgument: numba is not installed.
    """

    def __init__(self, settings: TrainingSettings, target: Tabular) -> None:
        _check_numba()
        self._settings = settings
        self._target = flatten_tabular(target)
        self._distance = steps_to_success(target)
        self._episodes = 1 if target.deterministic and len(target.start_states) == 1 else EPISODES

    def train_and_play(
        self, tables: Sequence[TransitionTable], streams: NDArray[np.uint64], steps: int
    ) -> TargetResults:
        """Train learners on each of the tables in order, then play the target greedily, and return the results.

        Args:
            tables: the environments of a curriculum.
            streams: uint64 [learners, 4], the random streams, see `envgraph.env.compiled.streams`; not changed.
            steps: number of steps on each table.
        """
        from envgraph.solve.learning._compiled_loop import learn_stage, run_compiled

        settings, count = replace(self._settings, checkpoint=steps), len(streams)
        *tables, target = compact_observations((*tables, self._target))
        rows = streams.copy()
        values = np.repeat(initial_values(target, settings)[None], count, axis=0)
        epsilons = np.full(count, settings.epsilon.start)
        stage = Stage(steps, 0.0, settings)
        for table in tables:
            if settings.epsilon.reset == "stage":
                epsilons[:] = settings.epsilon.start
            learn_stage(table, stage, values, rows, epsilons)
        found, q = TargetResults(np.empty(count), np.empty(count)), action_values(values, target.n_actions)
        how = self._distance, settings.limit, self._episodes
        run_compiled("play", settings, target.arrays, q, rows, *how, found.scores, found.successes)
        return found


class ProgramLearnerGroup:
    """A trainer of many learners in compiled programs, for environments with too many states for tables.

    A learner does what `train_program` does with `numpy.random.Generator(PCG64(..))` over its stream, bit for bit.

    Args:
        settings: the settings of the learners; `steps_per_environment` is an argument of `train_and_play` instead.
        target: the environment to play at the end, with the observations and actions of all training environments.

    Raises:
        InvalidArgument: numba is not installed, without which training is too slow.
        TooManyStates: the observations have no index of 64 bits.
    """

    def __init__(self, settings: TrainingSettings, target: InProgram) -> None:
        _check_numba()
        Learner(target.program)  # to report too many observations before the search
        self._settings, self._target = settings, target

    def train_and_play(
        self, environments: Sequence[InProgram], streams: NDArray[np.uint64], steps: int
    ) -> TargetResults:
        """Train learners in each of the environments in order, then play the target greedily, and return the results.

        Args:
            environments: the environments of a curriculum.
            streams: uint64 [learners, 4], the random streams, see `envgraph.env.compiled.streams`; not changed.
            steps: number of steps in each environment.

        Raises:
            EvaluationError: an expression has no value in a state, or a rule cannot be applied.
        """
        settings, target, found = self._settings, self._target, np.empty(len(streams))
        rng = np.random.Generator(np.random.PCG64(0))
        for number, row in enumerate(streams):
            set_generator_state(rng, row)
            learner = Learner(environments[0].program, settings.initial_value + 0.0)
            train_learner(learner, environments, settings, [steps] * len(environments), rng)
            learner.switch_program(target.program)
            found[number], *_ = learner.play(target.member, EPISODES, settings.limit, rng)
        return TargetResults(found, found)


def _check_numba() -> None:
    if "numba" not in available_backends():
        raise InvalidArgument("training many learners at once needs numba: pip install 'envgraph[fast]'")
