"""The agents of an experiment: learners in tables, and learners in compiled programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import CompiledProgram, Learner
from envgraph.env.schedules import Schedule
from envgraph.learn._regret import EXACT_SCHEDULES, ExactScore, new_schedule
from envgraph.solve import Evaluation, evaluate
from envgraph.solve.learning import (
    Backend,
    Curve,
    InProgram,
    ProgramTraining,
    Stage,
    StageMembers,
    StageResult,
    Training,
    TrainingSettings,
    TransitionTable,
    action_values,
    initial_values,
    train_stage,
    training_loop,
)


@dataclass(frozen=True, slots=True, eq=False)
class TableFamily:
    """A family as tables; a stage is given by the numbers of the members in which its episodes take place.

    `tables` has the prepared table of each stage; `members` the environments with renumbered observations; `stages` the
    environment of each stage with its own observation numbers.
    """

    tables: dict[StageMembers, TransitionTable]
    members: Sequence[Tabular]
    stages: dict[StageMembers, Tabular]

    def new_agent(self, settings: TrainingSettings, backend: Backend) -> TableAgent:
        """Return a new, untrained agent."""
        return TableAgent(self, settings, backend)


class TableAgent:
    """An agent that learns in tables."""

    def __init__(self, family: TableFamily, settings: TrainingSettings, backend: Backend) -> None:
        self._family, self._settings = family, settings
        self._loop = training_loop(backend, settings)
        self._learned = initial_values(family.tables[(0,)], settings)
        self._exact: ExactScore | None = None

    def train_stage(self, rng: np.random.Generator, members: StageMembers, stage: Stage) -> StageResult:
        """Train for a stage in the members numbered `members`; each episode takes place in one of them."""
        if self._exact:
            self._exact.epsilon = stage.epsilon
        return self._loop(self._family.tables[members], stage, self._learned, rng)

    def evaluate_on_target(self, rng: np.random.Generator) -> Evaluation:
        """Return the evaluation of the agent on the target, the last member."""
        settings, target = self._settings, self._family.members[-1]
        return evaluate(self._action_values(), target, settings.evaluation_episodes, settings.limit, rng)

    def new_schedule(self, name: str, member_numbers: StageMembers) -> Schedule:
        """Return a new schedule for the members numbered `member_numbers`; exact scores use the agent's current
        values.
        """
        if name in EXACT_SCHEDULES:
            members = [self._family.members[one] for one in member_numbers]
            self._exact = ExactScore(name, members, self._settings, self._action_values)
        return new_schedule(name, len(member_numbers), self._exact)

    def training_result(self, curve: Curve, epsilon: float) -> Training:
        """Return a training result: the agent's current values, its learning curve and its last epsilon."""
        return Training(self._action_values(), curve, epsilon)

    def _action_values(self) -> NDArray[np.float64]:
        return action_values(self._learned, self._family.members[0].n_actions)


@dataclass(frozen=True, slots=True, eq=False)
class ProgramFamily:
    """A family in a compiled program, given by the numbers of its members in the program."""

    program: CompiledProgram
    members: tuple[int, ...]

    def new_agent(self, settings: TrainingSettings, backend: Backend) -> ProgramAgent:
        """Return a new, untrained agent. `backend` has no effect: a program has only one training loop."""
        return ProgramAgent(self, settings)


class ProgramAgent:
    """An agent that learns in a compiled program."""

    def __init__(self, family: ProgramFamily, settings: TrainingSettings) -> None:
        self._family, self._settings = family, settings
        self._learner = Learner(family.program, settings.initial_value + 0.0)

    def train_stage(self, rng: np.random.Generator, members: StageMembers, stage: Stage) -> StageResult:
        """Train for a stage in one member; `members` contains its number."""
        (member,) = members
        return train_stage(self._learner, InProgram(self._family.program, self._family.members[member]), stage, rng)

    def evaluate_on_target(self, rng: np.random.Generator) -> Evaluation:
        """Return the evaluation of the agent on the target, the last member."""
        episodes, limit = self._settings.evaluation_episodes, self._settings.limit
        played = self._learner.play(self._family.members[-1], episodes, limit, rng)
        return Evaluation(*played, episodes, exact=False)

    def new_schedule(self, name: str, members: StageMembers) -> Schedule:
        """Return a new schedule for as many members as `members` has."""
        return new_schedule(name, len(members))

    def training_result(self, curve: Curve, epsilon: float) -> ProgramTraining:
        """Return a training result: the agent's learner, its learning curve and its last epsilon."""
        return ProgramTraining(self._learner, curve, epsilon)
