"""A domain: the content of a family's files, prepared for a search and for environments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from itertools import chain
from math import comb, inf
from typing import TYPE_CHECKING, TypeVar, cast, get_args

from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes
from envgraph.code import dataclass
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Source, has_errors, sort_diagnostics
from envgraph.graph import Model, model_from_json, model_to_json
from envgraph.lang import (
    EXPRESSION_KIND,
    LARGEST_NUMBER,
    NEED_ENVIRONMENT,
    Bundle,
    ComponentOptions,
    ComponentSpec,
    FamilySpec,
    Files,
    LocatedName,
    ModelText,
    OptimiseSpec,
    TextFiles,
    Workspace,
    find_family,
    load_workspace,
)
from envgraph.metamodel import Metamodel
from envgraph.rewrite import Engine
from envgraph.search.curricula import BeginKind, CurriculumSettings
from envgraph.search.domain._components import ComponentContext, Components, ObjectiveMaker
from envgraph.search.domain._constraints import constraints_of
from envgraph.search.domain._initial_model import check_initial
from envgraph.search.evolution._evolution_settings import EvolutionSettings, SampleSettings
from envgraph.search.evolution._survivor_selection import ExactSelection, SurvivorSelection
from envgraph.search.problem._individual_measures import DEFAULT_STEP_LIMIT, CachedCertifier
from envgraph.search.problem._objective import Objective
from envgraph.search.problem._objective_parser import parse_objective
from envgraph.search.problem._problem import IndividualMeasure, Problem
from envgraph.search.problem._statistics import BinnedEntropy, Statistic

if TYPE_CHECKING:
    from envgraph.search.optimising import Strategy

DEFAULT_EFFORT = 1_000_000_000
"""Default effort of a curriculum search in training steps, up to half a minute; and the largest number of lanes."""

ParsedFile = TypeVar("ParsedFile", ModelText, Behaviour)


@dataclass(frozen=True, slots=True)
class Domain:
    """The files of a family, read and checked.

    Attributes:
        spec: the family file as data.
        workspace: the content of all files.
        components: the factories of the components named in the family file.
        overrides: settings that replace those of the family file, such as "search.population=10".
    """

    spec: FamilySpec
    workspace: Workspace
    components: Components = field(default_factory=Components)
    overrides: tuple[str, ...] = ()

    @classmethod
    def load(cls, location: str, components: Components | None = None, overrides: Iterable[str] = ()) -> Domain:
        """Read a family file, a directory that contains one, or a bundled domain.

        Raises:
            LoadError: the files have errors; it contains all of them.
        """
        return cls._load_checked(find_family(location), None, components or Components(), tuple(overrides))

    @classmethod
    def of_environment(cls, model: str, environment: str) -> Domain:
        """Read the files of a model and of an environment without a family file, which searches and measures need.

        Raises:
            LoadError: the files have errors; it contains all of them.
            InvalidArgument: the files do not define exactly one model and one environment.
        """
        workspace = load_workspace([model, environment])
        behaviour, models = workspace.behaviour(), workspace.models
        if len(models) != 1:
            raise InvalidArgument(f"`{model}` and `{environment}` define {len(models)} models, but must define one")
        assert models[0].span and behaviour.span, "both were read from files"
        files = [LocatedName(one.source.name) for one in (models[0].span, behaviour.span)]
        return cls(FamilySpec(behaviour.name, files[0], files[1]), workspace)

    @classmethod
    def from_bundle(cls, bundle: Bundle, components: Components | None = None, overrides: Iterable[str] = ()) -> Domain:
        """Read a domain from the texts stored in a run or in an exported family.

        Raises:
            LoadError: the texts have errors; it contains all of them.
        """
        files = TextFiles(bundle.texts)
        return cls._load_checked(bundle.roots[0], files, components or Components(), tuple(overrides))

    @classmethod
    def _load_checked(
        cls, path: str, files: Files | None, components: Components, overrides: tuple[str, ...]
    ) -> Domain:
        workspace = load_workspace([path], files=files, components=components.known_kinds(), overrides=overrides)
        if workspace.errors:
            wrong = [one for spec in workspace.families for one in check_component_options(spec, workspace)]
            raise LoadError([*workspace.diagnostics, *wrong])
        if not workspace.families:
            place = Source(path, workspace.sources.get(path, "")).span_between(0, 0)
            hint = "name a `family.toml`"
            raise LoadError([Diagnostic("no-family", f"`{path}` is not a family file", place, hint)])
        domain = cls(workspace.families[0], workspace, components, overrides)
        problems = domain.check_options()  # so that they are reported when the files are read
        if has_errors(problems):
            raise LoadError(problems)
        return domain

    def check_options(self) -> list[Diagnostic]:
        """Return diagnostics for all invalid options of components, sorted and without duplicates."""
        problems: list[Diagnostic] = []
        for make in (
            self._measures, self.settings, self.objective, self.curriculum_search, self.samples, self.strategy
        ):  # fmt: skip
            try:
                make()
            except LoadError as error:
                problems += error.diagnostics
        return sort_diagnostics(dict.fromkeys(problems))  # duplicates occur if two components read the same option

    def __reduce__(self) -> tuple[Callable[..., Domain], tuple[Bundle, Components, tuple[str, ...]]]:
        """Return the data from which pickle rebuilds the domain: its texts."""
        return Domain.from_bundle, (self.workspace.bundle(), self.components, self.overrides)

    def __repr__(self) -> str:
        return f"<Domain {self.spec.name}: {self.spec.path}>"

    @property
    def metamodel(self) -> Metamodel:
        """Return the metamodel of the models."""
        metamodel = self.workspace.metamodel
        assert metamodel is not None, "a family names a model, and a model has a metamodel"
        return metamodel

    @property
    def behaviour(self) -> Behaviour | None:
        """Return the behaviour of the environment; None if the family has no environment."""
        return _definition_in_file(self.workspace.behaviours, self.spec.environment) if self.spec.environment else None

    def initial(self) -> Model:
        """Return a new copy of the initial model, with the same ids and order."""
        return model_from_json(model_to_json(self._initial_model()), self.metamodel)

    @property
    def model_text(self) -> ModelText:
        """Return the initial model with its text and spans."""
        return _definition_in_file(self.workspace.models, self.spec.model)

    def _initial_model(self) -> Model:
        model = self.model_text.model
        assert model is not None, "the files have no errors"
        return model

    def engine(self, model: Model | None = None) -> Engine:
        """Return an engine with all definitions of the files, on `model` or on a copy of the initial model."""
        engine = self.workspace.engine_on(self.initial() if model is None else model, self.spec.seed)
        for name, code in self.components.function.items():
            engine.function(name, code)
        return engine

    def keys(self, models: Iterable[Model] = ()) -> KeyIndex:
        """Return the numbers of the objects that the environment indexes, in the initial model and then `models`."""
        behaviour = self.behaviour
        classes = indexed_classes(behaviour, self.metamodel) if behaviour else ()
        return KeyIndex.of_models(chain([self._initial_model()], models), classes, self.metamodel)

    def problem(self, engine: Engine) -> Problem:
        """Return the search problem for an engine of this domain.

        Raises:
            LoadError: options of components are invalid; it contains all problems.
        """
        measures, otherwise, diversity = self._measures()
        return Problem(
            engine=engine,
            mutations=tuple(str(rule) for rule in self.spec.mutation.rules),
            constraints=constraints_of(self, engine, measures.values()),
            measures=measures,
            diversity=diversity,
            diversity_measure_name=str(self.spec.diversity.options["of"]),
            otherwise=otherwise,
            objective=self.objective() if self.spec.uses_genetic_algorithm else None,
            behaviour=self.behaviour,
            order_measure_name=None if self.spec.curriculum.order is None else str(self.spec.curriculum.order),
            target_last=self.spec.curriculum.initial == "last",
        )

    def objective(self) -> Objective | None:
        """Return the objective of the family; None if `[objective]` has no expressions.

        Raises:
            LoadError: the objective is invalid; it contains all problems.
        """
        spec, search = self.spec.objective, self.spec.search
        if spec is None or not has_expressions(spec):
            return None
        measures, otherwise, diversity = self._measures()
        others = {name: (one, otherwise.get(name, inf)) for name, one in measures.items()}
        context = replace(self._component_context(), others=others, diversity=diversity)
        objective, problems = parse_objective(spec, context, self.components.family)
        if not self.spec.searches_whole_families:
            problems += _finish_options(_objective_options(spec))
            for key, given in (("target", search.target), ("stagnation", search.stagnation)):
                if given is not None:
                    message = f"`{key}` refers to the diversity, but the family has an objective"
                    hint = "remove it: the search ends after `generations`, or at the maximum of the objective"
                    problems.append(Diagnostic("bad-objective", message, spec.span(), hint))
        if has_errors(problems):
            raise LoadError(problems)
        return objective

    def _measures(self) -> tuple[dict[str, IndividualMeasure], dict[str, float], Statistic]:
        """Return the measures and substitutes for missing values by name, and the diversity; or raise `LoadError`."""
        spec, context, problems = self.spec, self._component_context(), list[Diagnostic]()
        measures: dict[str, IndividualMeasure] = {}
        otherwise: dict[str, float] = {}
        for measure in spec.measures:
            options = ComponentOptions(measure)
            if options.is_given("otherwise"):
                otherwise[measure.name] = options.number("otherwise", 0.0, -LARGEST_NUMBER, LARGEST_NUMBER)
            others = {name: (one, otherwise.get(name, inf)) for name, one in measures.items()}
            made = self.components.measure[measure.kind](options, replace(context, others=others))
            measures[measure.name] = made
            problems += _finish_options(options)
        # The option "of" names the measure, and is not an option of the diversity itself.
        of = str(spec.diversity.options["of"])
        options = ComponentOptions(_without_option(spec.diversity, "of"))
        context = replace(context, measured=measures[of])
        diversity = self.components.diversity[spec.diversity.kind](options, context)
        problems += _finish_options(options)
        if has_errors(problems):
            raise LoadError(problems)
        return measures, otherwise, diversity

    def settings(self) -> EvolutionSettings:
        """Return the parameters of the genetic algorithm.

        Raises:
            LoadError: options of components are invalid; it contains all problems.
        """
        spec, context = self.spec, self._component_context()
        parents, survivors = ComponentOptions(spec.search.parents), ComponentOptions(spec.search.survivors)
        chosen = self.components.parents[spec.search.parents.kind](parents, context)
        survival = self.components.survivors[spec.search.survivors.kind](survivors, context)
        problems = _finish_options(parents) + _finish_options(survivors) + self._check_family_count(survival)
        if has_errors(problems):
            raise LoadError(problems)
        return EvolutionSettings(
            population=spec.search.population,
            parents=chosen,
            survivors=survival,
            rate=spec.mutation.rate,
            initial_applications=spec.mutation.initial_applications,
            max_attempts=spec.mutation.max_attempts,
            strength=spec.mutation.strength,
            keep_initial=spec.search.keep_initial,
            generations=spec.search.generations,
            seconds=spec.search.time_limit,
            target=spec.search.target,
            stagnation=spec.search.stagnation,
        )

    def _check_family_count(self, survival: SurvivorSelection) -> list[Diagnostic]:
        """Return an error if exact survivor selection may have to try more families than its limit."""
        search = self.spec.search
        bins = self.spec.diversity.kind == "binned_entropy" and self.spec.objective is None
        if bins or not isinstance(survival, ExactSelection) or not self.spec.uses_genetic_algorithm:
            return []
        free = search.population - search.keep_initial
        families = comb(free + search.population, free)
        if families <= survival.limit:
            return []
        message = f"up to {families:,} families must be tried in each generation, but `limit` is {survival.limit:,}"
        hint = (
            'write `survivors = { name = "hill_climbing" }`, a smaller `population`, or `binned_entropy` in '
            "`[diversity]`, which does not need to try every family"
        )
        if self.spec.objective is not None:
            hint = 'write `survivors = { name = "hill_climbing" }`, or a smaller `population`'
        return [Diagnostic("too-many-families", message, search.survivors.span(), hint)]

    def curriculum_search(self) -> tuple[ObjectiveMaker, CurriculumSettings] | None:
        """Return a function that makes the objective, and the settings of the search; None for the genetic algorithm.

        The function takes the levels and a number of threads.

        Raises:
            LoadError: options are invalid; it contains all problems.
        """
        spec, search = self.spec.objective, self.spec.search
        if spec is None or not self.spec.searches_whole_families:
            return None
        options, objective = _objective_options(spec), self.objective()
        settings = _curriculum_settings(options, self.spec)
        made: ObjectiveMaker
        if objective is None or not objective.terms:
            made = self.components.objective[spec.kind](options, self._component_context())
        else:
            from envgraph.search.curricula import MeasureObjective

            last = MeasureObjective(objective.terms[-1], search.population)
            made = lambda levels, workers: last  # noqa: E731
        problems = _finish_options(options)
        if search.population < 2 or not search.keep_initial or self.spec.curriculum.initial != "last":
            message = "with this objective the family needs at least 2 members, the last of them the initial model"
            hint = "write `population = 2` or more, and remove `keep_initial` and `initial`"
            problems.append(Diagnostic("bad-objective", message, spec.span(), hint))
        if has_errors(problems):
            raise LoadError(problems)
        return made, settings

    def samples(self) -> SampleSettings | None:
        """Return the settings of sampling; None if the file has no `[samples]`.

        Raises:
            LoadError: options are invalid; it contains all problems.
        """
        spec, problems = self.spec.samples, list[Diagnostic]()
        if spec is None:
            return None
        measures, _, diversity = self._measures()
        cover = []
        for one in spec.cover:
            options, measure = ComponentOptions(one), measures[one.name]
            known = getattr(measure, "range", None)
            if known is None and str(self.spec.diversity.options["of"]) == one.name:
                known = (diversity.low, diversity.high) if isinstance(diversity, BinnedEntropy) else None
            if known is None and not options.is_given("range"):
                message, hint = (
                    f"the range of `{one.name}` is unknown",
                    f"{one.name} = {{ bins = 10, range = [0, 64] }}",
                )
                problems.append(Diagnostic("missing-key", message, one.span("bins"), f"write `{hint}`"))
            low, high = options.range("range", known or (0.0, 1.0))
            bins = options.integer("bins", 10, 1, "members")
            problems += _finish_options(options)
            cover.append((one.name, BinnedEntropy(bins, low, high, whole=getattr(measure, "whole", False))))
        if has_errors(problems):
            raise LoadError(problems)
        best, attempts = spec.maximise or spec.minimise, spec.attempts or 10 * spec.count
        sense = 1 if spec.maximise else -1
        return SampleSettings(spec.count, cover, [str(one) for one in best], sense, attempts)

    def strategy(self) -> Strategy:
        """Return the search strategy of `[optimise]`, or the default strategy without this table.

        Raises:
            LoadError: options are invalid; it contains all problems.
        """
        spec = (self.spec.optimise or OptimiseSpec()).strategy
        options = ComponentOptions(spec)
        made = self.components.strategy[spec.kind](options, self._component_context())
        problems = _finish_options(options)
        if problems:
            raise LoadError(problems)
        return made

    def check_initial(self, problem: Problem | None = None, search: bool = True) -> list[Diagnostic]:
        """Check that the initial model satisfies every constraint and has a value of every measure; return warnings.

        Constraints that visit states, and measures, are checked last, if there is no error, and only with `search`.
        The engine of `problem`, by default a new one, is at the initial model.

        Raises:
            LoadError: a constraint is violated, a measure has no value, or the model cannot be the start of episodes.
        """
        return check_initial(self, problem or self.problem(self.engine()), search)

    def _component_context(self) -> ComponentContext:
        spec, behaviour, registration = self.spec, self.behaviour, self.workspace.registration
        assert registration is not None, "there are no errors"
        limit = spec.limit or (behaviour.limit if behaviour else None) or DEFAULT_STEP_LIMIT
        certifier = CachedCertifier(behaviour, limit) if behaviour else None
        library, initial = registration.library, self._initial_model()
        return ComponentContext(self.metamodel, spec, behaviour, None, library, initial, certifier)


def _definition_in_file(definitions: Sequence[ParsedFile], file: LocatedName) -> ParsedFile:
    """Return the model or behaviour that the family's own file `file` defines. Other files may define further ones."""
    return next(one for one in definitions if one.span and one.span.source.name == file.text)


def check_component_options(spec: FamilySpec, workspace: Workspace) -> list[Diagnostic]:
    """Return diagnostics for invalid options of built-in components, except at positions that have errors already."""
    if workspace.metamodel is None:
        return []
    known = Components()
    factories: list[tuple[ComponentSpec, Mapping[str, Callable[[ComponentOptions, ComponentContext], object]]]] = [
        *((one, known.measure) for one in spec.measures if one.kind not in NEED_ENVIRONMENT),
        (_without_option(spec.diversity, "of"), known.diversity),
        (spec.search.parents, known.parents),
        (spec.search.survivors, known.survivors),
        *([(spec.optimise.strategy, known.strategy)] if spec.optimise else []),
    ]
    context, problems = ComponentContext(workspace.metamodel, spec, None), list[Diagnostic]()
    for component, made in factories:
        if component.kind in made:
            options = ComponentOptions(component)
            if made is known.measure and options.is_given("otherwise"):
                options.number("otherwise", 0.0, -LARGEST_NUMBER, LARGEST_NUMBER)
            made[component.kind](options, context)
            problems += _finish_options(options)
    if spec.objective is not None:
        options = _objective_options(spec.objective)
        if has_expressions(spec.objective):
            problems += parse_objective(spec.objective, context, known.family)[1]
        if spec.searches_whole_families:
            _curriculum_settings(options, spec)
        if spec.objective.kind in known.objective:
            known.objective[spec.objective.kind](options, context)
        if spec.objective.kind in (EXPRESSION_KIND, *known.objective):
            problems += _finish_options(options)
    reported = {one.span for one in workspace.diagnostics}
    return [one for one in problems if one.span not in reported]


def check_domain(spec: FamilySpec, workspace: Workspace, search: bool = True) -> list[Diagnostic]:
    """Return the problems of a family with correct files: invalid options, or constraints that the model violates.

    Constraints are checked only if all options are valid and the family has no `[optimise]`. `search` is that of
    `Domain.check_initial`.
    """
    domain = Domain(spec, workspace)
    problems = domain.check_options()
    if not problems and spec.optimise is None:  # an optimisation may start at an invalid model
        try:
            problems += domain.check_initial(search=search)
        except LoadError as error:
            problems += error.diagnostics
    return problems


def has_expressions(spec: ComponentSpec) -> bool:
    """Return True if an objective has expressions over family measures."""
    return spec.kind == EXPRESSION_KIND or "subject_to" in spec.options


def _objective_options(spec: ComponentSpec) -> ComponentOptions:
    """Return the options of an objective. Its expressions are marked as read, because `parse_objective` parses them."""
    options = ComponentOptions(spec)
    for key in ("maximise", "minimise") if spec.kind == EXPRESSION_KIND else ():
        options.is_given(key)
    options.is_given("subject_to")
    if spec.kind == EXPRESSION_KIND:
        options.word("search", "evolve", ("evolve", "climb"))
    return options


def _curriculum_settings(options: ComponentOptions, spec: FamilySpec) -> CurriculumSettings:
    """Return the settings of a curriculum search from the options of an objective. Problems are added to `options`."""
    demanded, written = options.number_or_word("diversity", "maximum"), spec.has_key("search", "population")
    return CurriculumSettings(
        population=max(2, spec.search.population) if written or demanded is not None else None,
        effort=int(options.number("effort", DEFAULT_EFFORT, 1, 1e15)),
        lanes=options.integer("lanes", 4, 1, "rounds"),
        enough=options.number("enough", 1.0, -LARGEST_NUMBER, LARGEST_NUMBER) if options.is_given("enough") else None,
        least_diversity=inf if isinstance(demanded, str) else demanded,
        begin=cast(BeginKind, options.word("begin", "auto", get_args(BeginKind))),
    )


def _finish_options(options: ComponentOptions) -> list[Diagnostic]:
    options.finish()
    return options.problems


def _without_option(component: ComponentSpec, option: str) -> ComponentSpec:
    options: Mapping[str, object] = {name: value for name, value in component.options.items() if name != option}
    return replace(component, options=options)
