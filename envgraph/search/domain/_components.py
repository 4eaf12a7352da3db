"""The factories of search components, such as measures and selections, by their names in family files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, fields, replace
from functools import reduce
from itertools import takewhile
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from envgraph.code import dataclass
from envgraph.errors import LIMITS, Diagnostic, LoadError, Note
from envgraph.graph import Model
from envgraph.lang import ComponentOptions, numeric_parameters
from envgraph.metamodel import Metamodel, Scalar
from envgraph.pattern import Constant, Library
from envgraph.search.evolution._survivor_selection import (
    BeamSearch,
    ElitistParents,
    ExactSelection,
    HillClimbing,
    ParentSelection,
    RandomParents,
    SimulatedAnnealing,
    SurvivorSelection,
    TournamentParents,
)
from envgraph.search.optimising import Annealing, Beam, HillClimb, Strategy, TreeSearch
from envgraph.search.problem._expression_measures import ExpressionMeasure, named_measures, parse_measure_expression
from envgraph.search.problem._family_measures import ChainTransfer
from envgraph.search.problem._individual_measures import (
    CachedCertifier,
    CertifiedMeasure,
    DistanceToModel,
    MatchCount,
    PatternValue,
    ShortestPath,
    ShortestPlan,
)
from envgraph.search.problem._objective_parser import FAMILY_MEASURES, FamilyFactory
from envgraph.search.problem._path_complexity import PathComplexity
from envgraph.search.problem._problem import IndividualMeasure
from envgraph.search.problem._statistics import BinnedEntropy, Gini, Statistic, Variance
from envgraph.solve.learning import TrainingSettings

T = TypeVar("T")

if TYPE_CHECKING:
    from envgraph.behaviour import Behaviour
    from envgraph.lang import FamilySpec
    from envgraph.search.curricula import CurriculumObjective, LevelFactory


@dataclass(frozen=True, slots=True)
class ComponentContext:
    """Data about a family that the factory of a component may use.

    Attributes:
        metamodel: metamodel of the models.
        spec: the family file as data.
        behaviour: the behaviour of the environment, or None.
        measured: the measure on which the diversity is computed; only for factories of diversities.
        library: the patterns of the family; None if they have errors.
        initial: the initial model; None if it has errors.
        certifier: the certifier that all measures of the family share; None without an environment.
        others: the measures above the measure to make, or all for an objective, by name. Each comes with its substitute
            if a model has no value; infinity means no substitute.
        diversity: the diversity of a family; only for objectives.
    """

    metamodel: Metamodel
    spec: FamilySpec
    behaviour: Behaviour | None
    measured: IndividualMeasure | None = None
    library: Library | None = None
    initial: Model | None = None
    certifier: CachedCertifier | None = None
    others: Mapping[str, tuple[IndividualMeasure, float]] = field(default_factory=dict)
    diversity: Statistic | None = None


Factory = Callable[[ComponentOptions, ComponentContext], T]
MeasureFactory = Factory[IndividualMeasure]
ObjectiveMaker = Callable[["LevelFactory", int], "CurriculumObjective"]
"""Makes the objective, given the levels and the number of threads."""


def _make_path_complexity(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
    return PathComplexity(
        metamodel=context.metamodel,
        start=options.name("from"),
        goal=options.name("to"),
        along=options.names("along"),
        avoid=options.name("avoid"),
        transform="sqrt" if options.word("transform", "linear", ("sqrt", "linear")) == "sqrt" else "linear",
    )


def _make_shortest_path(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
    return ShortestPath(
        metamodel=context.metamodel,
        along=options.names("along"),
        start=options.name_or_none("from"),
        goal=options.name_or_none("to"),
        avoid=options.name_or_none("avoid"),
    )


def _make_shortest_plan(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
    assert context.behaviour is not None, "check_family demands an environment for this measure"
    return ShortestPlan(context.behaviour, options.name_or_none("guide"))


def _make_expression_measure(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
    above = [one.name for one in takewhile(lambda one: one is not options.spec, context.spec.measures)]
    text, place = options.name("of"), options.spec.span("of")
    expression, problems = parse_measure_expression(text, above, context.metamodel, place) if text else (None, [])
    options.problems += problems
    if expression is None:
        return ExpressionMeasure(Constant(0.0), {})
    return ExpressionMeasure(
        expression, {name: context.others[name] for name in named_measures(expression) if context.others}
    )


def _certified_measure_factory(certificate: str, range: tuple[float, float] | None = None) -> MeasureFactory:
    """Return a factory for a measure that uses the certifier of the family."""

    def make_measure(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
        assert context.certifier is not None, "check_family demands an environment for this measure"
        return CertifiedMeasure(context.certifier, options.spec, certificate, range)

    return make_measure


def _make_pattern_value(options: ComponentOptions, context: ComponentContext) -> IndividualMeasure:
    pattern = options.name("of")
    named = options.name_or_none("parameter")
    numbers = (numeric_parameters(context.library, pattern) if context.library else None) or {}
    place, type_ = numbers.get(named or next(iter(numbers), ""), (0, Scalar.INT))
    return PatternValue(pattern, place, whole=type_ is Scalar.INT)


def _make_binned_entropy(options: ComponentOptions, context: ComponentContext) -> Statistic:
    low, high = options.range("range", getattr(context.measured, "range", None) or (0.0, 1.0))
    bins = options.integer("bins", context.spec.search.population, 1, "members")
    return BinnedEntropy(bins, low, high, whole=getattr(context.measured, "whole", False))


def _learning_objective_maker(options: ComponentOptions, context: ComponentContext) -> ObjectiveMaker:
    spec, training = context.spec, context.spec.training
    steps = () if spec.chooses_steps else options.integers("steps", [training.steps_per_environment], 1, "episodes")
    limit = context.spec.limit or (context.behaviour.limit if context.behaviour else None)
    settings = TrainingSettings.from_spec(context.spec.training, limit=limit)
    seed = context.spec.seed

    def make_objective(levels: LevelFactory, workers: int) -> CurriculumObjective:
        from envgraph.env import TooManyStates
        from envgraph.env.compiled import NotCompiled
        from envgraph.search.curricula import LearningObjective

        try:
            return LearningObjective(settings, levels.target, steps, seed, workers)
        except NotCompiled as reason:
            name, note = levels.behaviour.name, Note("this construct cannot be compiled", reason.span)
            message = f"`{name}` has too many states for tables, and cannot be compiled: {reason}"
            hint = (
                "remove this construct, or make the target smaller: a table has at most "
                f"{LIMITS['searched states']:,} states"
            )
            notes = (note,) if reason.span else ()
            place = options.spec.span()
            raise LoadError([Diagnostic("not-compiled", message, place, hint, notes=notes)]) from reason
        except TooManyStates as error:
            hint = "observe less, such as a smaller window in `observe around`; without `[objective]` there is no limit"
            raise LoadError([Diagnostic("too-many-states", error.message, options.spec.span(), hint)]) from error

    return make_objective


def _chain_transfer_objective_maker(options: ComponentOptions, context: ComponentContext) -> ObjectiveMaker:
    def make_objective(levels: LevelFactory, workers: int) -> CurriculumObjective:
        from envgraph.env import TooManyStates
        from envgraph.search.curricula import MeasureObjective

        del workers
        try:
            levels.target.tabular  # noqa: B018  # report too many states before the run starts
        except TooManyStates as error:
            hint = 'write `kind = "learning"`, which needs no table, or make the target smaller'
            place = options.spec.span()
            raise LoadError([Diagnostic("too-many-states", error.message, place, hint)]) from error
        return MeasureObjective(ChainTransfer(), context.spec.search.population)

    return make_objective


def _factory_of(component: type[T]) -> Factory[T]:
    """Return a factory of a data class. The factory reads the fields of the data class from the options."""
    return lambda options, context: options.read(component)


def _role_field(**factories: Callable[..., object]) -> Any:
    """Return a dataclass field for a role, with the built-in factories as its default."""
    usual = MappingProxyType(factories)
    return field(default_factory=lambda: usual)


@dataclass(frozen=True, slots=True)
class Components:
    """Factories of components by role and kind, and the Python code of declared functions.

    Instances are immutable: `with_` returns a copy with one more factory.

    >>> from envgraph.search import Gini
    >>> mine = Components().with_("diversity", "mine", lambda options, context: Gini())
    >>> sorted(mine.diversity)
    ['binned_entropy', 'gini', 'mine', 'variance']
    """

    measure: Mapping[str, MeasureFactory] = _role_field(
        path_complexity=_make_path_complexity,
        shortest_path=_make_shortest_path,
        shortest_plan=_make_shortest_plan,
        random_success=_certified_measure_factory("random_success", (0.0, 1.0)),
        optimal_return=_certified_measure_factory("optimal_return"),
        distance=lambda options, context: DistanceToModel(context.initial),
        expression=_make_expression_measure,
        count=lambda options, context: MatchCount(options.name("of")),
        value=_make_pattern_value,
    )
    diversity: Mapping[str, Factory[Statistic]] = _role_field(
        binned_entropy=_make_binned_entropy,
        gini=lambda options, context: Gini(),
        variance=lambda options, context: Variance(),
    )
    family: Mapping[str, FamilyFactory] = _role_field(**FAMILY_MEASURES)
    objective: Mapping[str, Factory[ObjectiveMaker]] = _role_field(
        learning=_learning_objective_maker, chain_transfer=_chain_transfer_objective_maker
    )
    parents: Mapping[str, Factory[ParentSelection]] = _role_field(
        random=lambda options, context: RandomParents(),
        tournament=_factory_of(TournamentParents),
        elitist=_factory_of(ElitistParents),
    )
    survivors: Mapping[str, Factory[SurvivorSelection]] = _role_field(
        simulated_annealing=_factory_of(SimulatedAnnealing),
        hill_climbing=lambda options, context: HillClimbing(),
        beam=_factory_of(BeamSearch),
        exact=_factory_of(ExactSelection),
    )
    strategy: Mapping[str, Factory[Strategy]] = _role_field(
        simulated_annealing=_factory_of(Annealing),
        hill_climbing=_factory_of(HillClimb),
        beam=_factory_of(Beam),
        tree_search=_factory_of(TreeSearch),
    )
    function: Mapping[str, Callable[..., object]] = _role_field()

    def __reduce__(self) -> tuple[Callable[..., Components], tuple[object, ...]]:
        """Return the data from which pickle rebuilds the components: the factories that were added."""
        usual = Components()
        added = [
            (role.name, kind, factory)
            for role in fields(self)
            for kind, factory in getattr(self, role.name).items()
            if getattr(usual, role.name).get(kind) is not factory
        ]
        return _components_with, (added,)

    def known_kinds(self) -> dict[str, tuple[str, ...]]:
        """Return the known kinds by role, for checking a family file, without the roles "family" and "function"."""
        roles = ("measure", "diversity", "objective", "parents", "survivors", "strategy")
        return {role: tuple(getattr(self, role)) for role in roles}

    def with_(self, role: str, kind: str, factory: Callable[..., object]) -> Components:
        """Return a copy with one more factory. It replaces a factory of the same role and kind.

        The roles are "measure", "diversity", "family", "objective", "parents", "survivors" and "strategy". A factory
        receives its options and the context; a factory of the role "family" receives a `FamilyCall` and the context.
        With the role "function", `factory` is the Python code of the function `kind` that the domain's queries declare.
        """
        known = getattr(self, role)
        return replace(self, **{role: MappingProxyType({**known, kind: factory})})


def _components_with(added: Iterable[tuple[str, str, Callable[..., object]]]) -> Components:
    """Return the built-in components with further factories, given as triples of role, kind and factory."""
    return reduce(lambda components, one: components.with_(*one), added, Components())
