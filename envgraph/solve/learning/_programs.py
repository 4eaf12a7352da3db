"""Q-learning in compiled environments, for those with too many states for a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from envgraph.code import dataclass
from envgraph.env.compiled import CompiledProgram, Learner, LearningRates
from envgraph.errors import InvalidArgument
from envgraph.solve.learning._stage import Stage, StageResult
from envgraph.solve.learning._training_settings import AGENTS, TrainingSettings
from envgraph.solve.learning._training_turns import Curve, take_turns


@dataclass(frozen=True, slots=True, eq=False)
class InProgram:
    """An environment in a compiled program.

    Attributes:
        program: the compiled behaviour with its family.
        member: number of the member in the program.
    """

    program: CompiledProgram
    member: int


@dataclass(frozen=True, slots=True, eq=False)
class ProgramTraining:
    """An agent that was trained in a compiled environment.

    Attributes:
        learner: holds the action values, and plays episodes.
        curve: the learning curve.
        epsilon: exploration rate at the end.
    """

    learner: Learner
    curve: Curve
    epsilon: float


def train_program(
    program: CompiledProgram,
    settings: TrainingSettings,
    rng: np.random.Generator,
    *,
    members: Sequence[int] | None = None,
    steps: Sequence[int] | None = None,
    of: Literal["observation", "state"] = "observation",
    begins: Callable[[int, Learner], None] = lambda stage, learner: None,
) -> ProgramTraining:
    """Train an agent as `train_curriculum` does, but in a compiled program and with a hash table of its action values.

    Args:
        program: the compiled behaviour with its family.
        settings: the settings of the training.
        rng: over PCG64, as `numpy.random.default_rng` makes it; is advanced.
        members: numbers of the members in the order of training; all of them by default.
        steps: length of each stage; by default `settings.steps_per_environment`.
        of: "observation" for values of observations, "state" for values of whole states, with a single member only.
        begins: called before each stage, with its index and the learner.

    Raises:
        InvalidArgument: an argument does not fit the program.
        EvaluationError: an expression has no value in a state, or a rule cannot be applied.
    """
    stages = list(range(len(program.members))) if members is None else list(members)
    lengths = [settings.steps_per_environment] * len(stages) if steps is None else list(steps)
    if not stages or not all(0 <= stage < len(program.members) for stage in stages):
        raise InvalidArgument(f"`members` must be one or more numbers from 0 to {len(program.members) - 1}")
    if len(lengths) != len(stages) or min(lengths) < 1:
        raise InvalidArgument(f"`steps` is {lengths}, but must have a positive length for each of {len(stages)} stages")
    if of not in ("observation", "state"):
        raise InvalidArgument(f'`of` must be "observation" or "state", not {of!r}')
    if of == "state" and len(set(stages)) > 1:
        raise InvalidArgument("values of states need a single member: choose one, or values of observations")
    learner = Learner(program, settings.initial_value + 0.0, of_states=of == "state")
    return train_learner(learner, [InProgram(program, one) for one in stages], settings, lengths, rng, begins)


def train_learner(
    learner: Learner,
    environments: Sequence[InProgram],
    settings: TrainingSettings,
    lengths: Sequence[int],
    rng: np.random.Generator,
    begins: Callable[[int, Learner], None] = lambda stage, learner: None,
) -> ProgramTraining:
    """Train a learner on one environment after the other, for `lengths[i]` steps each.

    The programs of the environments must have the same observations and actions.

    Raises:
        EvaluationError: an expression has no value in a state, or a rule cannot be applied.
    """
    curve, epsilon = take_turns(
        lambda places, stage: train_stage(learner, environments[places[0]], stage, rng),
        settings,
        [(length, (place,)) for place, length in enumerate(lengths)],
        rng,
        lambda stage: begins(stage, learner),
    )
    return ProgramTraining(learner, curve, epsilon)


def train_stage(learner: Learner, environment: InProgram, stage: Stage, rng: np.random.Generator) -> StageResult:
    """Train a learner in an environment for a stage, which changes the learner, and return the curve and last epsilon.

    Raises:
        InvalidArgument: the kind of agent can learn only in tables.
        EvaluationError: an expression has no value in a state, or a rule cannot be applied.
    """
    learner.switch_program(environment.program)
    rates, limit = learning_rates_of(stage), stage.settings.limit
    return StageResult(*learner.train(environment.member, stage.curve_points, rates, stage.epsilon, limit, rng))


def learning_rates_of(stage: Stage) -> LearningRates:
    """Return the hyperparameters of a stage in the form that a learner in a program takes.

    Raises:
        InvalidArgument: the stage uses double Q-learning or n-step learning, which need tables.
    """
    settings = stage.settings
    if settings.agent == "double_q_learning" or settings.n_step > 1:
        what = "double Q-learning" if settings.n_step == 1 else "n-step learning"
        raise InvalidArgument(
            f"{what} needs tables, but the environment has too many states for a table",
            "use `q_learning`, `sarsa` or `expected_sarsa` with `n_step = 1`",
        )
    return LearningRates(AGENTS.index(settings.agent), settings.ties == "random", *stage.factors)
