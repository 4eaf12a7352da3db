"""Agents of an experiment: in tables, and in compiled programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import Learner, Program
from envgraph.env.schedules import Schedule
from envgraph.learn._teachers import EXACT, ExactScore, teacher
from envgraph.solve import Evaluation, evaluate
from envgraph.solve.learning import (
    Backend,
    Curve,
    InProgram,
    Place,
    ProgramTraining,
    Stage,
    StageOutcome,
    Table,
    Training,
    TrainingSettings,
    action_values,
    initial_values,
    loop_of,
    train_stage,
)


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """Prepared tables of stages, and the members, with renumbered observations; `stages`: with their own numbers."""

    tables: dict[Place, Table]
    members: Sequence[Tabular]
    stages: dict[Place, Tabular]

    def agent(self, settings: TrainingSettings, backend: Backend) -> TableAgent:
        """One that has learned nothing."""
        return TableAgent(self, settings, backend)


class TableAgent:
    """Learns in tables."""

    def __init__(self, family: Tables, settings: TrainingSettings, backend: Backend) -> None:
        self._family, self._settings = family, settings
        self._loop = loop_of(backend, settings)
        self._learned = initial_values(family.tables[(0,)], settings)
        self._exact: ExactScore | None = None

    def turn(self, rng: np.random.Generator, place: Place, stage: Stage) -> StageOutcome:
        """Learn in a place for a stage."""
        if self._exact:
            self._exact.epsilon = stage.epsilon
        return self._loop(self._family.tables[place], stage, self._learned, rng)

    def evaluated(self, rng: np.random.Generator) -> Evaluation:
        """What it does on the target."""
        settings, target = self._settings, self._family.members[-1]
        return evaluate(self._values(), target, settings.evaluation_episodes, settings.limit, rng)

    def teacher(self, name: str, place: Place) -> Schedule:
        """A schedule of some members, which may know all of the agent."""
        if name in EXACT:
            members = [self._family.members[one] for one in place]
            self._exact = ExactScore(name, members, self._settings, self._values)
        return teacher(name, len(place), self._exact)

    def trained(self, curve: Curve, epsilon: float) -> Training:
        """The agent as it is at the end."""
        return Training(self._values(), curve, epsilon)

    def _values(self) -> NDArray[np.float64]:
        return action_values(self._learned, self._family.members[0].n_actions)


@dataclass(frozen=True, slots=True, eq=False)
class Programs:
    """A family in a compiled program, by the numbers of its members there."""

    program: Program
    members: tuple[int, ...]

    def agent(self, settings: TrainingSettings, backend: Backend) -> ProgramAgent:
        """One that has learned nothing; there is one loop."""
        return ProgramAgent(self, settings)


class ProgramAgent:
    """Learns in a compiled program."""

    def __init__(self, family: Programs, settings: TrainingSettings) -> None:
        self._family, self._settings = family, settings
        self._learner = Learner(family.program, settings.initial_value + 0.0)

    def turn(self, rng: np.random.Generator, place: Place, stage: Stage) -> StageOutcome:
        """Learn in a place for a stage."""
        (member,) = place
        return train_stage(
            self._learner, InProgram(self._family.program, self._family.members[member]), stage, rng
        )

    def evaluated(self, rng: np.random.Generator) -> Evaluation:
        """What it does on the target."""
        episodes, limit = self._settings.evaluation_episodes, self._settings.limit
        played = self._learner.play(self._family.members[-1], episodes, limit, rng)
        return Evaluation(*played, episodes, exact=False)

    def teacher(self, name: str, place: Place) -> Schedule:
        """A schedule of some members."""
        return teacher(name, len(place))

    def trained(self, curve: Curve, epsilon: float) -> ProgramTraining:
        """The agent as it is at the end."""
        return ProgramTraining(self._learner, curve, epsilon)
