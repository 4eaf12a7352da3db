"""What learners come to on tables: tabular Q-learning over a sequence of environments.

`train_curriculum` trains one learner, on plain lists or compiled; `Learners` are many side by side, which a search asks
what they make of a family.
"""

from envgraph.solve.learning._learners import Judgement, Learners
from envgraph.solve.learning._settings import Epsilon, TrainingSettings
from envgraph.solve.learning._stage import Stage, StageOutcome, Table, flatten
from envgraph.solve.learning._training import (
    Backend,
    Curve,
    Training,
    available_backends,
    choose_backend,
    initial_values,
    joined,
    occurring,
    prepare,
    train,
    train_curriculum,
)

__all__ = [
    "Backend",
    "Curve",
    "Epsilon",
    "Judgement",
    "Learners",
    "Stage",
    "StageOutcome",
    "Table",
    "Training",
    "TrainingSettings",
    "available_backends",
    "choose_backend",
    "flatten",
    "initial_values",
    "joined",
    "occurring",
    "prepare",
    "train",
    "train_curriculum",
]
