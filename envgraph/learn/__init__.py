"""Tabular agents, curricula, training and evaluation.

Environments are tables (`envgraph.env.Tabular`). `run_experiment` trains one agent for each curriculum and seed and
evaluates it on the target; `train_curriculum` and `evaluate` are its parts. The defaults of `TrainingSettings` are
the published settings. `value_iteration` computes the best policy of a known table. `chain_transfer` predicts from
the tables alone how well a family teaches.

>>> from envgraph.learn import TrainingSettings, sequences
>>> [curriculum.label for curriculum in sequences(["E1", "E2", "E3"], "suffixes")]
['E1-E3', 'E2-E3']
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.learn._comparison import (
        SIGNIFICANT as SIGNIFICANT,
        BestWay as BestWay,
        Comparison as Comparison,
        best_way as best_way,
        compare as compare,
        findings as findings,
    )
    from envgraph.learn._controls import (
        CONTROLS as CONTROLS,
        controls as controls,
        optimistic_values as optimistic_values,
        other_starts as other_starts,
    )
    from envgraph.learn._curricula import Curriculum as Curriculum, sequences as sequences
    from envgraph.learn._experiment import (
        FamilyMember as FamilyMember,
        run_experiment as run_experiment,
        run_families as run_families,
        run_stages as run_stages,
        train_run as train_run,
    )
    from envgraph.learn._regret import EXACT_SCHEDULES as EXACT_SCHEDULES, TEACHERS as TEACHERS
    from envgraph.learn._results import (
        Experiment as Experiment,
        RunResult as RunResult,
        Summary as Summary,
        read_csv as read_csv,
        write_csv as write_csv,
        write_table as write_table,
    )
    from envgraph.learn._significance import (
        FEWEST_UNITS as FEWEST_UNITS,
        holm as holm,
        mean_test as mean_test,
    )
    from envgraph.learn._training_journal import (
        TrainingJournal as TrainingJournal,
        fingerprint as fingerprint,
    )
    from envgraph.solve import (
        Evaluation as Evaluation,
        OptimalPolicy as OptimalPolicy,
        bootstrap_interval as bootstrap_interval,
        chain_transfer as chain_transfer,
        evaluate as evaluate,
        evaluate_policy as evaluate_policy,
        interquartile_mean as interquartile_mean,
        mixture as mixture,
        optimal_return as optimal_return,
        performance_profile as performance_profile,
        probability_of_improvement as probability_of_improvement,
        value_iteration as value_iteration,
        wilson_interval as wilson_interval,
    )
    from envgraph.solve.learning import (
        STUDENTS as STUDENTS,
        Curve as Curve,
        Epsilon as Epsilon,
        InProgram as InProgram,
        ProgramTraining as ProgramTraining,
        Training as Training,
        TrainingSettings as TrainingSettings,
        available_backends as available_backends,
        play_program as play_program,
        train_curriculum as train_curriculum,
        train_program as train_program,
    )

export_lazily(globals())
