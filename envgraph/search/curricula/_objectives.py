"""Objectives of a curriculum search: scores of a whole family."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from math import inf
from typing import ClassVar, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from envgraph.env import TooManyStates
from envgraph.env.compiled import generator_states
from envgraph.files import ordered_starmap
from envgraph.search.curricula._model_levels import ModelLevel
from envgraph.search.problem._candidate_pool import FamilyMeasure
from envgraph.search.problem._statistics import BoundedMeasure
from envgraph.solve.learning import LearnerGroup, ProgramLearnerGroup, TargetResults, TrainingSettings

SEARCH_SPAWN_KEY: Final = 2
"""Spawn key of the random streams of a search's learners; experiments use other keys (`learn/_experiment.py`)."""

Judge = Callable[[NDArray[np.uint64], int], TargetResults]


class CurriculumObjective(Protocol):
    """An objective that scores families; larger is better."""

    @property
    def drawn(self) -> bool:
        """Return True if scores depend on the seed. If False, a single seed is enough."""

    @property
    def most(self) -> float:
        """Return the largest possible value of a family; infinity if it is unknown."""

    def scores(self, family: Sequence[ModelLevel], seeds: range) -> NDArray[np.float64]:
        """Return the scores of a family as an array [criteria, seeds]. The target is the last member of the family."""

    @property
    def effort(self) -> int:
        """Return the number of training steps per seed and member."""


def value_of_scores(scores: NDArray[np.float64]) -> float:
    """Return the value of scores [criteria, seeds]: the average of the mean and the minimum over the criteria.

    >>> value_of_scores(np.array([[1.0, 0.0], [1.0, 1.0]]))
    0.625
    """
    means = scores.mean(axis=1)
    return float(0.5 * (means.mean() + means.min()))


class LearningObjective:
    """An objective: the performance on the target of learners that were trained on one member after the other.

    Each training length is a criterion. Learners use tables if the target has one, else compiled programs.
    See `envgraph.solve.learning.TargetResults` for the scores.

    Args:
        settings: the learning algorithm and its parameters.
        target: the last member of each family.
        steps: training lengths, in steps per member. Empty: the search chooses a length (`is_steps_free`).
        seed: seed of the search.
        workers: number of threads, or of workers of a cluster, which does not affect the results.

    Raises:
        EvaluationError, RuleError: a state of the target causes an error.
        NotCompiled: the target has too many states for a table, and its behaviour cannot be compiled.
        TooManyStates: the target has too many observations to number them.
        InvalidArgument: numba is not installed.
    """

    drawn: ClassVar[bool] = True
    most: ClassVar[float] = 1.0

    def __init__(
        self,
        settings: TrainingSettings,
        target: ModelLevel,
        steps: Sequence[int],
        seed: int,
        workers: int = 1,
    ) -> None:
        self._judge = self._judge_maker(settings, target)
        self.steps, self.is_steps_free = tuple(steps) or (settings.steps_per_environment,), not steps
        self._seed, self._workers = seed, workers
        self._starmap = ordered_starmap(workers)

    def with_steps(self, steps: int) -> LearningObjective:
        """Return a copy of this objective with another number of training steps on each member."""
        found = copy(self)
        found.steps = (steps,)
        return found

    @property
    def effort(self) -> int:
        return sum(self.steps)

    @staticmethod
    def _judge_maker(settings: TrainingSettings, target: ModelLevel) -> Callable[[Sequence[ModelLevel]], Judge]:
        """Return a function from a family to its judge, a function of random streams and the steps per member."""
        try:
            on_tables = LearnerGroup(settings, target.tabular)
        except TooManyStates:
            in_programs = ProgramLearnerGroup(settings, target.program_place)
            return lambda family: partial(in_programs.train_and_play, [level.program_place for level in family])
        return lambda family: partial(on_tables.train_and_play, [level.table for level in family])

    def scores(self, family: Sequence[ModelLevel], seeds: range) -> NDArray[np.float64]:
        return self._judgement_values(family, seeds, "scores")

    def success_rate(self, family: Sequence[ModelLevel], seeds: range) -> float:
        """Return the share of learners that solve the target; with several training lengths the smallest share."""
        return float(self._judgement_values(family, seeds, "successes").mean(axis=1).min())

    def _judgement_values(
        self, family: Sequence[ModelLevel], seeds: range, kind: Literal["scores", "successes"]
    ) -> NDArray[np.float64]:
        """Return the field `kind` of the judgements of all learners, as an array [training lengths, seeds]."""
        judge = self._judge(family)
        sequences = (np.random.SeedSequence(self._seed, spawn_key=(SEARCH_SPAWN_KEY, seed)) for seed in seeds)
        rows = generator_states([np.random.Generator(np.random.PCG64(one)) for one in sequences])
        parts = np.array_split(rows, min(self._workers, len(rows)))
        tasks = [(part, steps) for steps in self.steps for part in parts]
        judged = [getattr(one, kind) for one in self._starmap(judge, tasks)]
        return np.concatenate(judged).reshape(len(self.steps), len(rows))


class MeasureObjective:
    """An objective whose only score is the value of a family measure, without learners."""

    drawn: ClassVar[bool] = False
    effort: ClassVar[int] = 0

    def __init__(self, measure: FamilyMeasure, size: int) -> None:
        self._measure = measure
        self.most = measure.maximum(size) if isinstance(measure, BoundedMeasure) else inf

    def scores(self, family: Sequence[ModelLevel], seeds: range) -> NDArray[np.float64]:
        return np.full((1, len(seeds)), self._measure.score(family))
