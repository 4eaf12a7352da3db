"""Train learners on tables and in compiled programs: tabular Q-learning over a sequence of environments.

`train_curriculum` trains one learner on tables, in a Python or a compiled loop. `train_program` trains it in a
compiled program if there are too many states for tables, and `play_program` plays the policy of a network there.
`LearnerGroup` and `ProgramLearnerGroup` train many learners at once, for searches that measure how well a family
teaches. `PolicyLearner` learns on many levels from features of their states, so that its policy generalises to others.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.solve.learning._learners import (
        LearnerGroup as LearnerGroup,
        ProgramLearnerGroup as ProgramLearnerGroup,
        TargetResults as TargetResults,
    )
    from envgraph.solve.learning._policy_settings import PolicySettings as PolicySettings
    from envgraph.solve.learning._ppo import (
        LevelTables as LevelTables,
        PlayStatistics as PlayStatistics,
        PolicyLearner as PolicyLearner,
    )
    from envgraph.solve.learning._programs import (
        InProgram as InProgram,
        ProgramTraining as ProgramTraining,
        train_program as train_program,
        train_stage as train_stage,
    )
    from envgraph.solve.learning._rollouts import play_program as play_program
    from envgraph.solve.learning._stage import (
        Stage as Stage,
        StageResult as StageResult,
        TransitionTable as TransitionTable,
        flatten_tabular as flatten_tabular,
        with_starts as with_starts,
    )
    from envgraph.solve.learning._training import (
        Backend as Backend,
        Training as Training,
        action_values as action_values,
        available_backends as available_backends,
        choose_backend as choose_backend,
        initial_values as initial_values,
        prepare as prepare,
        renumber_occurring as renumber_occurring,
        train_curriculum as train_curriculum,
        training_loop as training_loop,
    )
    from envgraph.solve.learning._training_settings import (
        STUDENTS as STUDENTS,
        Epsilon as Epsilon,
        TrainingSettings as TrainingSettings,
    )
    from envgraph.solve.learning._training_turns import (
        Curve as Curve,
        StageMembers as StageMembers,
        take_turns as take_turns,
    )

export_lazily(globals())
