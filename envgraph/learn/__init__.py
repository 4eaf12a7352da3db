"""Tabular agents, curricula, training and evaluation.

Environments come as `envgraph.env.Tabular`. `run_experiment` trains one agent for each curriculum and seed and
evaluates it on the target; `train_curriculum` and `evaluate` are its parts. The defaults of `TrainingSettings` are
the published settings. `value_iteration` gives the best policy of a known table, `chain_transfer` predicts from the
tables alone how well a family teaches.

>>> from envgraph.learn import TrainingSettings, sequences
>>> [curriculum.label for curriculum in sequences(["E1", "E2", "E3"], "suffixes")]
['E1-E3', 'E2-E3']
"""

from envgraph.errors import shorten
from envgraph.learn._comparison import SIGNIFICANT, BestWay, Comparison, best_way, compare, findings
from envgraph.learn._controls import CONTROLS, controls, optimistic_values, other_starts
from envgraph.learn._curricula import Curriculum, sequences
from envgraph.learn._experiment import FamilyMember, run_experiment, run_families, run_stages, train_run
from envgraph.learn._intervals import (
    bootstrap_interval,
    interquartile_mean,
    newcombe_interval,
    performance_profile,
    probability_of_improvement,
    wilson_interval,
)
from envgraph.learn._journal import Journal, fingerprint
from envgraph.learn._results import Experiment, RunResult, Summary, read_csv, write_csv
from envgraph.learn._significance import FEWEST_UNITS, holm, mean_test, permutation_test
from envgraph.learn._teachers import EXACT, TEACHERS
from envgraph.solve import (
    Evaluation,
    Optimum,
    chain_transfer,
    evaluate,
    evaluate_policy,
    mixture,
    optimal_return,
    value_iteration,
)
from envgraph.solve.learning import (
    STUDENTS,
    Curve,
    Epsilon,
    InProgram,
    ProgramTraining,
    Training,
    TrainingSettings,
    available_backends,
    play_program,
    train_curriculum,
    train_program,
)

__all__ = [
    "CONTROLS",
    "EXACT",
    "FEWEST_UNITS",
    "SIGNIFICANT",
    "STUDENTS",
    "TEACHERS",
    "BestWay",
    "Comparison",
    "Curriculum",
    "Curve",
    "Epsilon",
    "Evaluation",
    "Experiment",
    "FamilyMember",
    "InProgram",
    "Journal",
    "Optimum",
    "ProgramTraining",
    "RunResult",
    "Summary",
    "Training",
    "TrainingSettings",
    "available_backends",
    "best_way",
    "bootstrap_interval",
    "chain_transfer",
    "compare",
    "controls",
    "evaluate",
    "evaluate_policy",
    "findings",
    "fingerprint",
    "holm",
    "interquartile_mean",
    "mean_test",
    "mixture",
    "newcombe_interval",
    "optimal_return",
    "optimistic_values",
    "other_starts",
    "performance_profile",
    "permutation_test",
    "play_program",
    "probability_of_improvement",
    "read_csv",
    "run_experiment",
    "run_families",
    "run_stages",
    "sequences",
    "train_curriculum",
    "train_program",
    "train_run",
    "value_iteration",
    "wilson_interval",
    "write_csv",
]

shorten(globals(), __all__)
