"""Search over models: measures, constraints, the genetic algorithm, runs and families.

`generate` evolves a family from the files of a domain into a run store, `resume` goes on with an interrupted run,
`open_family` gives what a run made. `Evolution` is the algorithm itself, over any `Problem`.
"""

from envgraph.errors import shorten
from envgraph.lang import Options
from envgraph.search._archive import Archive
from envgraph.search._certified import (
    Searched,
    Verification,
    apart,
    certificate_texts,
    certificates,
    keep_certificates,
    verify,
)
from envgraph.search._components import Components, Context
from envgraph.search._constraints import Reachable
from envgraph.search._diversity import BinnedEntropy, Bounded, Gini, Statistic, Swaps, Variance
from envgraph.search._domain import Domain, domain_problems, option_problems
from envgraph.search._environment import (
    make,
    make_aec,
    make_environment,
    make_parallel,
    make_vec,
    make_vector_environment,
    register,
)
from envgraph.search._evolution import Evolution, Settings
from envgraph.search._families import Candidate, FamilyMeasure, Over, Pool
from envgraph.search._family import Family, Member, domain_of, family_of, run_file
from envgraph.search._family_file import family_schema, open_family, read_family, write_family
from envgraph.search._ga4cl import GridVariant, read_ga4cl, retype_grid
from envgraph.search._generate import evolve, export_ga4cl, generate, import_ga4cl, resume
from envgraph.search._lineage import LineageStep, lineage
from envgraph.search._measures import MatchCount, PatternValue, ShortestPath, ShortestPlan
from envgraph.search._objective import Condition, Objective, Term
from envgraph.search._objective_text import FamilyCall, WrongCall
from envgraph.search._optimise_file import optimise_domain, problem_of
from envgraph.search._outcome import Outcome, describe_search, why_low
from envgraph.search._paths import PathComplexity, count_paths
from envgraph.search._problem import (
    Constraint,
    CountWithin,
    Forbid,
    IndividualMeasure,
    NoValue,
    Problem,
    Require,
)
from envgraph.search._random_families import lineage_lengths, random_families
from envgraph.search._rewards import reward_schedule
from envgraph.search._samples import SampleProgress, Sampler, SampleSettings
from envgraph.search._sampling import Sampling
from envgraph.search._selection import (
    BeamSearch,
    ElitistParents,
    ExactSelection,
    HillClimbing,
    ParentSelection,
    RandomParents,
    SimulatedAnnealing,
    SurvivorSelection,
    TournamentParents,
    acceptance,
)
from envgraph.search._shown import caption, family_svg, measure_texts
from envgraph.search._store import Generation, Individual, RunStore, Trace
from envgraph.search._variation import Variation
from envgraph.search.optimising import (
    Annealing,
    Beam,
    Goal,
    HillClimb,
    Optimum,
    Solution,
    Strategy,
    TreeSearch,
    Walk,
    optimise,
)

__all__ = [
    "Annealing",
    "Archive",
    "Beam",
    "BeamSearch",
    "BinnedEntropy",
    "Bounded",
    "Candidate",
    "Components",
    "Condition",
    "Constraint",
    "Context",
    "CountWithin",
    "Domain",
    "ElitistParents",
    "Evolution",
    "ExactSelection",
    "Family",
    "FamilyCall",
    "FamilyMeasure",
    "Forbid",
    "Generation",
    "Gini",
    "Goal",
    "GridVariant",
    "HillClimb",
    "HillClimbing",
    "Individual",
    "IndividualMeasure",
    "LineageStep",
    "MatchCount",
    "Member",
    "NoValue",
    "Objective",
    "Optimum",
    "Options",
    "Outcome",
    "Over",
    "ParentSelection",
    "PathComplexity",
    "PatternValue",
    "Pool",
    "Problem",
    "RandomParents",
    "Reachable",
    "Require",
    "RunStore",
    "SampleProgress",
    "SampleSettings",
    "Sampler",
    "Sampling",
    "Searched",
    "Settings",
    "ShortestPath",
    "ShortestPlan",
    "SimulatedAnnealing",
    "Solution",
    "Statistic",
    "Strategy",
    "SurvivorSelection",
    "Swaps",
    "Term",
    "TournamentParents",
    "Trace",
    "TreeSearch",
    "Variance",
    "Variation",
    "Verification",
    "Walk",
    "WrongCall",
    "acceptance",
    "apart",
    "caption",
    "certificate_texts",
    "certificates",
    "count_paths",
    "describe_search",
    "domain_of",
    "domain_problems",
    "evolve",
    "export_ga4cl",
    "family_of",
    "family_schema",
    "family_svg",
    "generate",
    "import_ga4cl",
    "keep_certificates",
    "lineage",
    "lineage_lengths",
    "make",
    "make_aec",
    "make_environment",
    "make_parallel",
    "make_vec",
    "make_vector_environment",
    "measure_texts",
    "open_family",
    "optimise",
    "optimise_domain",
    "option_problems",
    "problem_of",
    "random_families",
    "read_family",
    "read_ga4cl",
    "register",
    "resume",
    "retype_grid",
    "reward_schedule",
    "run_file",
    "verify",
    "why_low",
    "write_family",
]

shorten(globals(), __all__)
