"""Search over models: measures, constraints, the genetic algorithm, runs and families.

`generate` evolves a family from the files of a domain into a run store. `resume` continues an interrupted run, and
`open_family` returns the family of a run. `Evolution` is the algorithm itself, for any `Problem`.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.lang import Options as Options
    from envgraph.search._store import (
        Generation as Generation,
        Individual as Individual,
        RunStore as RunStore,
        Trace as Trace,
    )
    from envgraph.search.domain._components import Components as Components, Context as Context
    from envgraph.search.domain._constraints import Reachable as Reachable
    from envgraph.search.domain._domain import (
        Domain as Domain,
        domain_problems as domain_problems,
        option_problems as option_problems,
    )
    from envgraph.search.domain._optimise_file import (
        optimise_domain as optimise_domain,
        problem_of as problem_of,
    )
    from envgraph.search.evolution._archive import Archive as Archive
    from envgraph.search.evolution._evolution import Evolution as Evolution
    from envgraph.search.evolution._samples import SampleProgress as SampleProgress, Sampler as Sampler
    from envgraph.search.evolution._selection import (
        BeamSearch as BeamSearch,
        ElitistParents as ElitistParents,
        ExactSelection as ExactSelection,
        HillClimbing as HillClimbing,
        ParentSelection as ParentSelection,
        RandomParents as RandomParents,
        SimulatedAnnealing as SimulatedAnnealing,
        SurvivorSelection as SurvivorSelection,
        TournamentParents as TournamentParents,
        acceptance as acceptance,
    )
    from envgraph.search.evolution._settings import SampleSettings as SampleSettings, Settings as Settings
    from envgraph.search.evolution._variation import Variation as Variation
    from envgraph.search.families._environment import (
        make as make,
        make_aec as make_aec,
        make_environment as make_environment,
        make_parallel as make_parallel,
        make_vec as make_vec,
        make_vector_environment as make_vector_environment,
        register as register,
    )
    from envgraph.search.families._family import (
        Family as Family,
        Member as Member,
        domain_of as domain_of,
        run_file as run_file,
    )
    from envgraph.search.families._file import (
        family_schema as family_schema,
        open_family as open_family,
        read_family as read_family,
        write_family as write_family,
    )
    from envgraph.search.families._shown import (
        caption as caption,
        family_svg as family_svg,
        measure_texts as measure_texts,
    )
    from envgraph.search.optimising import (
        Annealing as Annealing,
        Beam as Beam,
        Goal as Goal,
        HillClimb as HillClimb,
        Optimum as Optimum,
        Solution as Solution,
        Strategy as Strategy,
        TreeSearch as TreeSearch,
        Walk as Walk,
        optimise as optimise,
    )
    from envgraph.search.problem._diversity import (
        BinnedEntropy as BinnedEntropy,
        Bounded as Bounded,
        Gini as Gini,
        Statistic as Statistic,
        Variance as Variance,
    )
    from envgraph.search.problem._measures import (
        MatchCount as MatchCount,
        ShortestPath as ShortestPath,
        ShortestPlan as ShortestPlan,
    )
    from envgraph.search.problem._objective import (
        Condition as Condition,
        Objective as Objective,
        Term as Term,
    )
    from envgraph.search.problem._objective_text import FamilyCall as FamilyCall, WrongCall as WrongCall
    from envgraph.search.problem._paths import PathComplexity as PathComplexity
    from envgraph.search.problem._pool import (
        Candidate as Candidate,
        FamilyMeasure as FamilyMeasure,
        Over as Over,
        Pool as Pool,
    )
    from envgraph.search.problem._problem import (
        Constraint as Constraint,
        Forbid as Forbid,
        IndividualMeasure as IndividualMeasure,
        Problem as Problem,
        Require as Require,
    )
    from envgraph.search.runs._certified import (
        Searched as Searched,
        Verification as Verification,
        apart as apart,
        certificate_texts as certificate_texts,
        certificates as certificates,
        keep_certificates as keep_certificates,
        verify as verify,
    )
    from envgraph.search.runs._generate import (
        evolve as evolve,
        export_ga4cl as export_ga4cl,
        generate as generate,
        import_ga4cl as import_ga4cl,
        resume as resume,
    )
    from envgraph.search.runs._lineage import lineage as lineage
    from envgraph.search.runs._outcome import (
        Outcome as Outcome,
        describe_search as describe_search,
        why_low as why_low,
    )
    from envgraph.search.runs._random_families import (
        lineage_lengths as lineage_lengths,
        random_families as random_families,
    )
    from envgraph.search.runs._rewards import reward_schedule as reward_schedule
    from envgraph.search.runs._sampling import Sampling as Sampling

later(globals())
