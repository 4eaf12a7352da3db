"""The agents of an experiment: learners in tables, and learners in compiled programs."""

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
    """A family as tables; a stage is given by the numbers of the members in which its episodes take place.

    `tables` has the prepared table of each stage; `members` the environments with renumbered observations; `stages` the
    environment of each stage with its own observation numbers.
    """

    tables: dict[Place, Table]
    members: Sequence[Tabular]
    stages: dict[Place, Tabular]

    def agent(self, settings: TrainingSettings, backend: Backend) -> TableAgent:
        """Return a new, untrained agent."""
        return TableAgent(self, settings, backend)


class TableAgent:
    """An agent that learns in tables."""

    def __init__(self, family: Tables, settings: TrainingSettings, backend: Backend) -> None:
        self._family, self._settings = family, settings
        self._loop = loop_of(backend, settings)
        self._learned = initial_values(family.tables[(0,)], settings)
        self._exact: ExactScore | None = None

    def turn(self, rng: np.random.Generator, place: Place, stage: Stage) -> StageOutcome:
        """Train for a stage in the members numbered `place`; each episode takes place in one of them."""
        if self._exact:
            self._exact.epsilon = stage.epsilon
        return self._loop(self._family.tables[place], stage, self._learned, rng)

    def evaluated(self, rng: np.random.Generator) -> Evaluation:
        """Return the evaluation of the agent on the target, the last member."""
        settings, target = self._settings, self._family.members[-1]
        return evaluate(self._values(), target, settings.evaluation_episodes, settings.limit, rng)

    def teacher(self, name: str, place: Place) -> Schedule:
        """Return a new schedule for the members numbered `place`; exact scores use the agent's current values."""
        if name in EXACT:
            members = [self._family.members[one] for one in place]
            self._exact = ExactScore(name, members, self._settings, self._values)
        return teacher(name, len(place), self._exact)

    def trained(self, curve: Curve, epsilon: float) -> Training:
        """Return a training result: the agent's current values, its learning curve and its last epsilon."""
        return Training(self._values(), curve, epsilon)

    def _values(self) -> NDArray[np.float64]:
        return action_values(self._learned, self._family.members[0].n_actions)


@dataclass(frozen=True, slots=True, eq=False)
class Programs:
    """A family in a compiled program, given by the numbers of its members in the program."""

    program: Program
    members: tuple[int, ...]

    def agent(self, settings: TrainingSettings, backend: Backend) -> ProgramAgent:
        """Return a new, untrained agent. `backend` has no effect: a program has only one training loop."""
        return ProgramAgent(self, settings)


class ProgramAgent:
    """An agent that learns in a compiled program."""

    def __init__(self, family: Programs, settings: TrainingSettings) -> None:
        self._family, self._settings = family, settings
        self._learner = Learner(family.program, settings.initial_value + 0.0)

    def turn(self, rng: np.random.Generator, place: Place, stage: Stage) -> StageOutcome:
        """Train for a stage in one member; `place` contains its number."""
        (member,) = place
        return train_stage(
            self._learner, InProgram(self._family.program, self._family.members[member]), stage, rng
        )

    def evaluated(self, rng: np.random.Generator) -> Evaluation:
        """Return the evaluation of the agent on the target, the last member."""
        episodes, limit = self._settings.evaluation_episodes, self._settings.limit
        played = self._learner.play(self._family.members[-1], episodes, limit, rng)
        return Evaluation(*played, episodes, exact=False)

    def teacher(self, name: str, place: Place) -> Schedule:
        """Return a new schedule for as many members as `place` has."""
        return teacher(name, len(place))

    def trained(self, curve: Curve, epsilon: float) -> ProgramTraining:
        """Return a training result: the agent's learner, its learning curve and its last epsilon."""
        return ProgramTraining(self._learner, curve, epsilon)
