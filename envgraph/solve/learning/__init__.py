"""Train learners on tables and in compiled programs: tabular Q-learning over a sequence of environments.

`train_curriculum` trains one learner on tables, in a Python or a compiled loop. `train_program` trains it in a
compiled program if there are too many states for tables, and `play_program` plays the policy of a network there.
`Learners` and `ProgramLearners` train many learners at once, for searches that measure how well a family teaches.
`PolicyLearner` learns on many levels from features of their states, so that its policy generalises to others.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.solve.learning._learners import (
        Judgement as Judgement,
        Learners as Learners,
        ProgramLearners as ProgramLearners,
    )
    from envgraph.solve.learning._policy import (
        LevelTables as LevelTables,
        Played as Played,
        PolicyLearner as PolicyLearner,
        PolicySettings as PolicySettings,
    )
    from envgraph.solve.learning._programs import (
        InProgram as InProgram,
        ProgramTraining as ProgramTraining,
        train_program as train_program,
        train_stage as train_stage,
    )
    from envgraph.solve.learning._rollouts import play_program as play_program
    from envgraph.solve.learning._settings import (
        STUDENTS as STUDENTS,
        Epsilon as Epsilon,
        TrainingSettings as TrainingSettings,
    )
    from envgraph.solve.learning._stage import (
        Stage as Stage,
        StageOutcome as StageOutcome,
        Table as Table,
        flatten as flatten,
        with_starts as with_starts,
    )
    from envgraph.solve.learning._training import (
        Backend as Backend,
        Curve as Curve,
        Training as Training,
        action_values as action_values,
        available_backends as available_backends,
        choose_backend as choose_backend,
        initial_values as initial_values,
        loop_of as loop_of,
        occurring as occurring,
        prepare as prepare,
        train as train,
        train_curriculum as train_curriculum,
    )
    from envgraph.solve.learning._turns import Place as Place, take_turns as take_turns

later(globals())
