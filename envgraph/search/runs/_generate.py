"""Generate, resume and export families: whole runs from the files of a family to a run store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from envgraph.env import DrawGrid, GridScene
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Source, list_names
from envgraph.files import report_progress
from envgraph.graph import model_to_json
from envgraph.lang import FamilySpec
from envgraph.search._run_store import Generation, Individual, RunStore, dump_json
from envgraph.search.curricula import CurriculumProgress, CurriculumSearch, LevelFactory
from envgraph.search.domain._components import Components
from envgraph.search.domain._domain import Domain
from envgraph.search.evolution._genetic_algorithm import Evolution
from envgraph.search.evolution._model_sampler import ModelSampler, SampleProgress
from envgraph.search.families._member_family import Family, load_stored_domain, load_stored_family
from envgraph.search.problem._objective import Objective
from envgraph.search.problem._problem import Problem
from envgraph.search.runs._ga4cl import GridVariant, format_ga4cl, grid_rows
from envgraph.search.runs._parallel_measures import MeasureWorkers
from envgraph.search.runs._reward_schedule import reward_schedule

OnGeneration = Callable[[Generation], None]
OnCurriculumProgress = Callable[[CurriculumProgress], None]
OnSampleProgress = Callable[[SampleProgress], None]
OnWarnings = Callable[[Sequence[Diagnostic]], None]


def generate(
    location: str,
    store_path: Path,
    *,
    seed: int | None = None,
    generations: int | None = None,
    population: int | None = None,
    samples: int | None = None,
    overrides: Sequence[str] = (),
    components: Components | None = None,
    overwrite: bool = False,
    progress: OnGeneration = lambda generation: None,
    climbing: OnCurriculumProgress = lambda progress: None,
    drawing: OnSampleProgress = lambda progress: None,
    warn: OnWarnings = lambda diagnostics: None,
    workers: int = 1,
) -> Family:
    """Generate a family by a search or by sampling, and store the run.

    Args:
        location: a family file, a directory that contains one, or the name of a bundled domain.
        store_path: path of the new run store.
        seed, generations, population: replacements for the values in the family file.
        samples: number of distinct valid members to sample, instead of searching for a family.
        overrides: further settings that replace those of the family file, such as "mutation.rate=0.5", as for `--set`.
        components: the components that the family file may name; by default the built-in ones.
        overwrite: True if an existing run is to be replaced.
        progress: called after every generation.
        climbing: called regularly during a curriculum search.
        drawing: called regularly during sampling.
        warn: called at the start with the warnings.
        workers: number of threads for learners of an objective, or of processes for measures. It does not affect the
            result.

    Returns:
        The family of the last generation. See `Outcome.of` for its diversity, and `why_low` for the reason if it is
        low.

    Raises:
        LoadError: the files have errors, or the initial model violates a constraint or lacks a value.
        InvalidArgument: the store exists already, and `overwrite` is False.
    """
    given = {
        "seed": seed,
        "search.generations": generations,
        "search.population": population,
        "samples.count": samples,
    }
    chosen = [f"{key}={value}" for key, value in given.items() if value is not None]
    return generate_from_domain(
        Domain.load(location, components, [*chosen, *overrides]),
        store_path,
        overwrite=overwrite,
        progress=progress,
        climbing=climbing,
        drawing=drawing,
        warn=warn,
        workers=workers,
    )


def generate_from_domain(
    domain: Domain,
    store_path: Path,
    *,
    overwrite: bool = False,
    progress: OnGeneration = lambda generation: None,
    climbing: OnCurriculumProgress = lambda progress: None,
    drawing: OnSampleProgress = lambda progress: None,
    warn: OnWarnings = lambda diagnostics: None,
    workers: int = 1,
) -> Family:
    """Generate a family of a domain, as `generate` does."""
    if domain.spec.optimise is not None:
        place = Source(domain.spec.path, "").span_between(0, 0)
        message, hint = "the file describes an optimisation, not a family", "use `envgraph optimise`"
        raise LoadError([Diagnostic("no-family", message, place, hint)])
    problem = domain.problem(domain.engine())
    with report_progress():  # one progress display for all individuals whose states are visited
        warn(domain.check_initial(problem))
        search = _search_function(
            domain, problem, progress, climbing, drawing, workers
        )  # errors are raised before the run is created
        with RunStore.create(store_path, *stored_settings_and_texts(domain), overwrite=overwrite) as store:
            search(store)
            return _load_run_family(store, domain)


def _load_run_family(store: RunStore, domain: Domain) -> Family:
    """Return the family of a run. Its domain includes the numbers of members and steps chosen by the search."""
    if domain.overrides != store.overrides:
        domain = load_stored_domain(store.bundle(), store.overrides, str(store.path), domain.components)
    return load_stored_family(store, domain)


def stored_settings_and_texts(domain: Domain) -> tuple[dict[str, Any], Mapping[str, str]]:
    """Return the settings and the texts of a domain that are stored when a run is created."""
    bundle = domain.workspace.bundle()
    settings = {"name": domain.spec.name, "roots": list(bundle.roots), "overrides": list(domain.overrides)}
    return settings, bundle.texts


def resume(
    store_path: Path,
    *,
    generations: int | None = None,
    components: Components | None = None,
    progress: OnGeneration = lambda generation: None,
    climbing: OnCurriculumProgress = lambda progress: None,
    drawing: OnSampleProgress = lambda progress: None,
    workers: int = 1,
) -> Family:
    """Resume an interrupted run from its stored texts. The result is the same as without the interruption.

    Args:
        store_path: path of the run store.
        generations: last generation to run, even if the run had ended before.
        components: the components that the family file may name; by default the built-in ones.
        progress: called after every generation.
        climbing, drawing, workers: see `generate`.

    Raises:
        InvalidArgument: the run does not exist, is an imported family, or has reached the generation already. Another
            reason is that `generations` is given for a run with an objective or samples.
    """
    with RunStore.open(store_path, writing=True) as store:
        if store.imported is not None:
            raise InvalidArgument(f"{store_path} contains an imported family, which cannot be resumed")
        last = store.last_generation()
        if generations is not None and last is not None and generations <= last.number:
            raise InvalidArgument(f"{store_path} has {last.number} generations already: give more, as `generations`")
        overrides = list(store.overrides)
        domain = load_stored_domain(store.bundle(), overrides, str(store.path), components)
        if generations is not None and not domain.spec.uses_genetic_algorithm:
            what = "an objective" if domain.spec.searches_whole_families else "samples"
            raise InvalidArgument(f"{store_path} has {what} and thus no generations: leave `generations` out")
        if generations not in (None, domain.spec.search.generations):
            overrides.append(f"search.generations={generations}")
            domain = load_stored_domain(store.bundle(), overrides, str(store.path), components)
            store.set_setting("overrides", overrides)
        if domain.spec.uses_genetic_algorithm or last is None:
            with report_progress():
                _search_function(domain, domain.problem(domain.engine()), progress, climbing, drawing, workers)(store)
        return _load_run_family(store, domain)


def _search_function(
    domain: Domain,
    problem: Problem,
    progress: OnGeneration,
    climbing: OnCurriculumProgress,
    drawing: OnSampleProgress,
    workers: int,
) -> Callable[[RunStore], object]:
    """Return a function that makes a family, by evolution, curriculum search or sampling, and writes it to a store."""
    search, settings, seed = domain.curriculum_search(), domain.settings(), domain.spec.seed
    wanted, pool = domain.samples(), MeasureWorkers(domain, workers) if workers > 1 else None
    if wanted is not None:
        return lambda store: _sample_and_write(ModelSampler(problem, settings, wanted, seed, pool), drawing, store)
    if search is None:
        return lambda store: Evolution(problem, settings, seed, store, pool).run(progress)
    assert domain.behaviour is not None, "check_family demands an environment for an objective"
    make, climb = search
    levels = LevelFactory(problem, domain.behaviour)
    objective = domain.objective() or Objective(())
    judged, before = make(levels, workers), objective.measures[:-1] if objective.terms else objective.measures
    whole = CurriculumSearch(levels, judged, climb, seed, climbing, before)
    return lambda store: _write_curriculum(store, levels, whole.run(), objective, domain.spec)


def _sample_and_write(sampler: ModelSampler, drawing: OnSampleProgress, store: RunStore) -> None:
    sampler.run(drawing)
    sampler.write_run(store)


def _write_curriculum(
    store: RunStore, levels: LevelFactory, result: CurriculumProgress, objective: Objective, spec: FamilySpec
) -> None:
    """Write a family from a curriculum search: the target, and the trace from the target to each other member.

    If the search chose the number of members or steps, write these numbers as overrides of the family file.
    """
    born = []
    for id_, level in enumerate([result.family[-1], *result.family[:-1]]):
        parent = None if id_ == 0 else 0
        state = f"{level.state:016x}"
        levels.check_out(level.version)
        model = dump_json(model_to_json(levels.engine.model))
        born.append(Individual(id_, 0, id_ - 1, parent, level.trace, level.measures, state, model))
    members = (*range(1, len(born)), 0)
    rejected = dict(sorted(levels.rejection_counts.items()))
    diversity = levels.family_diversity(result.family)
    # A stored generation marks the run as finished, so everything is written in one transaction.
    worth = {"values": objective.term_values(result.family)} if objective.terms else {"value": result.value}
    about = {
        **worth,
        "learnt": dict(result.learning_results),
        "lacking": objective.violated_conditions(result.family),
        "families": result.families_judged,
        "origin": str(result.origin),
        "exempted": [*levels.dropped_constraints],
    }
    chosen = [] if len(born) == spec.search.population else [f"search.population={len(born)}"]
    if "steps" in result.learning_results and not spec.has_key("training", "steps_per_environment"):
        chosen.append(f"training.steps_per_environment={round(result.learning_results['fewest'] / len(born))}")
    settings = {"objective": about, "overrides": [*store.overrides, *chosen]}
    store.write_generation(Generation(0, members, diversity, len(born), rejected), born, settings)


def export_ga4cl(family: Family) -> str:
    """Return the family as the text of a ga4cl file, with its members in order as env_1, env_2, ...

    Raises:
        InvalidArgument: the behaviour does not draw a grid, or has several agents; or a member has more than the format
            can express: cells, and one token on the only cell of its class.
    """
    if family.behaviour.agents:
        raise InvalidArgument(
            f"family `{family.name}` has `agent` blocks, but the ga4cl format has rewards for a single agent"
        )
    draw = family.behaviour.draw
    if not isinstance(draw, DrawGrid):
        raise InvalidArgument(f"family `{family.name}` does not draw a grid, which the ga4cl format needs")
    order = str(family.domain.spec.curriculum.order or family.domain.spec.diversity.options["of"])
    schedule, variants = reward_schedule(family), list[GridVariant]()
    for place, member in enumerate(family.members, start=1):
        scene = family.scene(member)
        assert isinstance(scene, GridScene)
        lost = _lost_tokens(scene)
        if lost:
            message = f"the ga4cl format cannot express {list_names(lost)} of `{member.name}`"
            raise InvalidArgument(message, "use `--format family`")
        variants.append(GridVariant(f"env_{place}", grid_rows(scene), schedule, member.measures[order]))
    return format_ga4cl(variants)


def _lost_tokens(scene: GridScene) -> list[str]:
    """Return the names of the tokens that the format loses: all but a token on the only cell of its class."""
    marks = scene.marks
    if len(marks) == 1:
        column, row = marks[0].place
        if scene.cells.count(scene.cells[row * scene.width + column]) == 1:
            return []
    return [mark.name for mark in marks]
