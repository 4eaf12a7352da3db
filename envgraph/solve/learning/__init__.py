"""What learners come to on tables: tabular Q-learning over a sequence of environments.

`train_curriculum` trains one learner on tables, on plain lists or compiled; `train_program` trains it where there are
too many states for these, and there `play_program` plays what a network says. `Learners` and `ProgramLearners` are
many, which a search asks what they make of a family.
`PolicyLearner` learns on many levels by what it sees of them, so that it knows what to do on others.
"""

from envgraph.solve.learning._learners import Judgement, Learners, ProgramLearners
from envgraph.solve.learning._policy import LevelTables, Played, PolicyLearner, PolicySettings
from envgraph.solve.learning._programs import (
    InProgram,
    ProgramTraining,
    train_learner,
    train_program,
    train_stage,
)
from envgraph.solve.learning._rollouts import play_program
from envgraph.solve.learning._settings import STUDENTS, Epsilon, TrainingSettings
from envgraph.solve.learning._stage import Stage, StageOutcome, Table, flatten, with_starts
from envgraph.solve.learning._training import (
    Backend,
    Curve,
    Training,
    action_values,
    available_backends,
    choose_backend,
    initial_values,
    loop_of,
    occurring,
    prepare,
    train,
    train_curriculum,
)
from envgraph.solve.learning._turns import Place, take_turns

__all__ = [
    "STUDENTS",
    "Backend",
    "Curve",
    "Epsilon",
    "InProgram",
    "Judgement",
    "Learners",
    "LevelTables",
    "Place",
    "Played",
    "PolicyLearner",
    "PolicySettings",
    "ProgramLearners",
    "ProgramTraining",
    "Stage",
    "StageOutcome",
    "Table",
    "Training",
    "TrainingSettings",
    "action_values",
    "available_backends",
    "choose_backend",
    "flatten",
    "initial_values",
    "loop_of",
    "occurring",
    "play_program",
    "prepare",
    "take_turns",
    "train",
    "train_curriculum",
    "train_learner",
    "train_program",
    "train_stage",
    "with_starts",
]
