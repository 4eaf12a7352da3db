"""Search for models and for families of them.

`generate` evolves a family from the files of a domain into a run store. `resume` continues an interrupted run, and
`open_family` returns the family of a run. `Evolution` is the algorithm itself, for any `Problem`.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.lang import ComponentOptions as ComponentOptions
    from envgraph.search._run_store import (
        Generation as Generation,
        Individual as Individual,
        RunStore as RunStore,
        Trace as Trace,
    )
    from envgraph.search.domain._components import (
        ComponentContext as ComponentContext,
        Components as Components,
    )
    from envgraph.search.domain._constraints import OutcomeReachable as OutcomeReachable
    from envgraph.search.domain._domain import (
        Domain as Domain,
        check_component_options as check_component_options,
        check_domain as check_domain,
    )
    from envgraph.search.domain._optimisation_file import (
        optimisation_problem as optimisation_problem,
        optimise_domain as optimise_domain,
    )
    from envgraph.search.evolution._bin_archive import Archive as Archive
    from envgraph.search.evolution._evolution_settings import (
        EvolutionSettings as EvolutionSettings,
        SampleSettings as SampleSettings,
    )
    from envgraph.search.evolution._genetic_algorithm import Evolution as Evolution
    from envgraph.search.evolution._model_sampler import (
        ModelSampler as ModelSampler,
        SampleProgress as SampleProgress,
    )
    from envgraph.search.evolution._mutation import Variation as Variation
    from envgraph.search.evolution._survivor_selection import (
        BeamSearch as BeamSearch,
        ElitistParents as ElitistParents,
        ExactSelection as ExactSelection,
        HillClimbing as HillClimbing,
        ParentSelection as ParentSelection,
        RandomParents as RandomParents,
        SimulatedAnnealing as SimulatedAnnealing,
        SurvivorSelection as SurvivorSelection,
        TournamentParents as TournamentParents,
        acceptance_probability as acceptance_probability,
    )
    from envgraph.search.families._certificate_texts import format_certificates as format_certificates
    from envgraph.search.families._family_file import (
        family_schema as family_schema,
        open_family as open_family,
        read_family as read_family,
        write_family as write_family,
    )
    from envgraph.search.families._family_pictures import (
        family_svg as family_svg,
        format_measure as format_measure,
        format_measures as format_measures,
    )
    from envgraph.search.families._make import (
        make as make,
        make_aec as make_aec,
        make_environment as make_environment,
        make_parallel as make_parallel,
        make_vec as make_vec,
        make_vector_environment as make_vector_environment,
        register as register,
    )
    from envgraph.search.families._member_family import (
        Family as Family,
        Member as Member,
        find_run_store as find_run_store,
        load_stored_domain as load_stored_domain,
        order_measure as order_measure,
    )
    from envgraph.search.families._playable import find_playable as find_playable, play_episode as play_episode
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
    from envgraph.search.problem._candidate_pool import (
        Candidate as Candidate,
        FamilyMeasure as FamilyMeasure,
        Pool as Pool,
        StatisticMeasure as StatisticMeasure,
    )
    from envgraph.search.problem._individual_measures import (
        MatchCount as MatchCount,
        ShortestPath as ShortestPath,
        ShortestPlan as ShortestPlan,
    )
    from envgraph.search.problem._objective import (
        FamilyCondition as FamilyCondition,
        Objective as Objective,
        ObjectiveTerm as ObjectiveTerm,
    )
    from envgraph.search.problem._objective_parser import FamilyCall as FamilyCall, WrongCall as WrongCall
    from envgraph.search.problem._path_complexity import PathComplexity as PathComplexity
    from envgraph.search.problem._problem import (
        Constraint as Constraint,
        Forbid as Forbid,
        IndividualMeasure as IndividualMeasure,
        Problem as Problem,
        Require as Require,
    )
    from envgraph.search.problem._statistics import (
        BinnedEntropy as BinnedEntropy,
        BoundedMeasure as BoundedMeasure,
        Gini as Gini,
        Statistic as Statistic,
        Variance as Variance,
    )
    from envgraph.search.runs._ask_and_tell import Sampling as Sampling
    from envgraph.search.runs._certificates_check import (
        Verification as Verification,
        certificates as certificates,
        differing_members as differing_members,
        store_certificates as store_certificates,
        verify as verify,
    )
    from envgraph.search.runs._generate import (
        export_ga4cl as export_ga4cl,
        generate as generate,
        generate_from_domain as generate_from_domain,
        resume as resume,
    )
    from envgraph.search.runs._level_models import (
        LevelModel as LevelModel,
        import_ga4cl as import_ga4cl,
        import_levels as import_levels,
        level_models as level_models,
    )
    from envgraph.search.runs._lineage import (
        LineageBranch as LineageBranch,
        lineage as lineage,
        lineage_tree as lineage_tree,
    )
    from envgraph.search.runs._outcome import (
        Outcome as Outcome,
        describe_search as describe_search,
        why_low as why_low,
    )
    from envgraph.search.runs._random_families import (
        lineage_lengths as lineage_lengths,
        random_families as random_families,
    )
    from envgraph.search.runs._reward_schedule import reward_schedule as reward_schedule

export_lazily(globals())
