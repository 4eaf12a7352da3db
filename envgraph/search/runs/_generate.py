"""A whole run: from the files of a family to a run store, and back from an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from envgraph.env import DrawGrid, GridScene, Scene
from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, Source, listed
from envgraph.files import telling
from envgraph.graph import model_to_json
from envgraph.lang import FamilySpec
from envgraph.search._store import Generation, Individual, RunStore, dump_json
from envgraph.search.curricula import CurriculumProgress, CurriculumSearch, Levels
from envgraph.search.domain._components import Components
from envgraph.search.domain._domain import Domain
from envgraph.search.evolution._evolution import Evolution
from envgraph.search.evolution._samples import SampleProgress, Sampler
from envgraph.search.families._family import Family, domain_of, family_of
from envgraph.search.problem._objective import Objective
from envgraph.search.problem._problem import Problem
from envgraph.search.runs._ga4cl import GridVariant, grid_rows, read_ga4cl, retype_grid, write_ga4cl
from envgraph.search.runs._rewards import reward_schedule

Progress = Callable[[Generation], None]
Climbing = Callable[[CurriculumProgress], None]
Drawing = Callable[[SampleProgress], None]
Warn = Callable[[Sequence[Diagnostic]], None]

_SAME = 1e-9
"""A published measure and ours may differ by this much before it is worth a word."""


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
    progress: Progress = lambda generation: None,
    climbing: Climbing = lambda progress: None,
    drawing: Drawing = lambda progress: None,
    warn: Warn = lambda diagnostics: None,
    workers: int = 1,
) -> Family:
    """Evolve a family.

    Args:
        location: a family file, a directory that holds one, or the name of a bundled domain.
        store_path: where the run store is made.
        seed, generations, population: instead of those in the family file.
        samples: draw so many members, all valid and no two the same, instead of searching for a family.
        overrides: what else holds instead of what the family file says, such as "mutation.rate=0.5", as `--set` has it.
        components: what the names in the family file mean; by default the ones that come with envgraph.
        progress: called after every generation.
        climbing: called now and then while a family with an objective is searched for.
        drawing: called now and then while samples are drawn.
        workers: threads for learners of an objective; they change no result.
        warn: called at the start, with what looks wrong.

    Returns:
        The family of the last generation. `Outcome.of` says how diverse it is, `why_low` why it is not more so.

    Raises:
        LoadError: all that is wrong with the files, or the initial model violates a constraint, or lacks a value.
        InvalidArgument: the store exists already.
    """
    given = {
        "seed": seed,
        "search.generations": generations,
        "search.population": population,
        "samples.count": samples,
    }
    chosen = [f"{key}={value}" for key, value in given.items() if value is not None]
    return evolve(
        Domain.load(location, components, [*chosen, *overrides]),
        store_path,
        progress=progress,
        climbing=climbing,
        drawing=drawing,
        warn=warn,
        workers=workers,
    )


def evolve(
    domain: Domain,
    store_path: Path,
    *,
    overwrite: bool = False,
    progress: Progress = lambda generation: None,
    climbing: Climbing = lambda progress: None,
    drawing: Drawing = lambda progress: None,
    warn: Warn = lambda diagnostics: None,
    workers: int = 1,
) -> Family:
    """`generate` of a domain that has been read, in place of another run if that is to be overwritten."""
    if domain.spec.optimise is not None:
        place = Source(domain.spec.path, "").span(0, 0)
        message, hint = "the file asks for one model, not for a family", "`envgraph optimise` finds it"
        raise LoadError([Diagnostic("no-family", message, place, hint)])
    problem = domain.problem(domain.engine())
    with telling():  # the individuals whose states are visited are pieces of one work
        warn(domain.check_initial(problem))
        search = _search(
            domain, problem, progress, climbing, drawing, workers
        )  # what is wrong is said before there is a run
        with RunStore.create(store_path, *stored(domain), overwrite=overwrite) as store:
            search(store)
            return _found(store, domain)


def _found(store: RunStore, domain: Domain) -> Family:
    """Return the family of a run, with the numbers of members and steps that the search chose."""
    if domain.overrides != store.overrides:
        domain = domain_of(store.bundle(), store.overrides, str(store.path), domain.components)
    return family_of(store, domain)


def stored(domain: Domain) -> tuple[dict[str, Any], Mapping[str, str]]:
    """What a run store has of its domain: settings, and the texts."""
    bundle = domain.workspace.bundle()
    settings = {"name": domain.spec.name, "roots": list(bundle.roots), "overrides": list(domain.overrides)}
    return settings, bundle.texts


def resume(
    store_path: Path,
    *,
    generations: int | None = None,
    components: Components | None = None,
    progress: Progress = lambda generation: None,
    climbing: Climbing = lambda progress: None,
    drawing: Drawing = lambda progress: None,
    workers: int = 1,
) -> Family:
    """Go on with an interrupted run, from the texts that it keeps; the result is that of an uninterrupted one.

    Args:
        store_path: of the run.
        generations: go on to this one, also where the run had come to its end.
        components: what the names in the family file mean; by default the ones that come with envgraph.
        progress: called after every generation.
        climbing, drawing, workers: see `generate`.

    Raises:
        InvalidArgument: there is no such run, it is an imported family, or has so many generations already; or
            generations are asked for, and it has an objective or samples.
    """
    with RunStore.open(store_path, writing=True) as store:
        if store.imported is not None:
            raise InvalidArgument(f"{store_path} holds an imported family: there is nothing to go on with")
        last = store.last_generation()
        if generations is not None and last is not None and generations <= last.number:
            raise InvalidArgument(f"{store_path} has {last.number} generations already: ask for more")
        overrides = list(store.overrides)
        domain = domain_of(store.bundle(), overrides, str(store.path), components)
        if generations is not None and not domain.spec.evolves:
            what = "an objective" if domain.spec.climbs else "samples"
            raise InvalidArgument(f"{store_path} has {what}, and no generations to go on to")
        if generations not in (None, domain.spec.search.generations):
            overrides.append(f"search.generations={generations}")
            domain = domain_of(store.bundle(), overrides, str(store.path), components)
            store.set("overrides", overrides)
        if domain.spec.evolves or last is None:
            with telling():
                _search(domain, domain.problem(domain.engine()), progress, climbing, drawing, workers)(store)
        return _found(store, domain)


def _search(
    domain: Domain, problem: Problem, progress: Progress, climbing: Climbing, drawing: Drawing, workers: int
) -> Callable[[RunStore], object]:
    """What makes the family of a run: of single models, or, with an objective, as a whole; or samples."""
    search, settings, seed = domain.curriculum_search(), domain.settings(), domain.spec.seed
    wanted = domain.samples()
    if wanted is not None:
        return lambda store: _drawn(Sampler(problem, settings, wanted, seed), drawing, store)
    if search is None:
        return lambda store: Evolution(problem, settings, seed, store).run(progress)
    assert domain.behaviour is not None, "check_family demands an environment for an objective"
    make, climb = search
    levels = Levels(problem, domain.behaviour)
    objective = domain.objective() or Objective(())
    judged, before = make(levels, workers), objective.measures[:-1] if objective.terms else objective.measures
    whole = CurriculumSearch(levels, judged, climb, seed, climbing, before)
    return lambda store: _store(store, levels, whole.run(), objective, domain.spec)


def _drawn(sampler: Sampler, drawing: Drawing, store: RunStore) -> None:
    sampler.run(drawing)
    sampler.write(store)


def _store(
    store: RunStore, levels: Levels, found: CurriculumProgress, objective: Objective, spec: FamilySpec
) -> None:
    """Write a family that was searched for as a whole: the target, and for each other member its trace from the target.

    If the search chose the number of members or steps, write these numbers as overrides of the family file.
    """
    born = []
    for id_, level in enumerate([found.family[-1], *found.family[:-1]]):
        parent = None if id_ == 0 else 0
        state = f"{level.state:016x}"
        levels.go_to(level.version)
        model = dump_json(model_to_json(levels.engine.model))
        born.append(Individual(id_, 0, id_ - 1, parent, level.trace, level.measures, state, model))
    members = (*range(1, len(born)), 0)
    rejected = dict(sorted(levels.rejected.items()))
    diversity = levels.diversity(found.family)
    # A stored generation marks the run as ended, so everything is written in one transaction.
    worth = {"values": objective.values(found.family)} if objective.terms else {"value": found.value}
    about = {
        **worth,
        "learnt": dict(found.learnt),
        "lacking": objective.lacking(found.family),
        "families": found.tried,
        "origin": str(found.origin),
        "exempted": [*levels.exempted],
    }
    chosen = [] if len(born) == spec.search.population else [f"search.population={len(born)}"]
    if "steps" in found.learnt and not spec.has_key("training", "steps_per_environment"):
        chosen.append(f"training.steps_per_environment={round(found.learnt['fewest'] / len(born))}")
    settings = {"objective": about, "overrides": [*store.overrides, *chosen]}
    store.write_generation(Generation(0, members, diversity, len(born), rejected), born, settings)


def import_ga4cl(
    source: Source,
    location: str,
    store_path: Path,
    *,
    overwrite: bool = False,
    overrides: Sequence[str] = (),
) -> tuple[Family, tuple[Diagnostic, ...]]:
    """Read a family of the ga4cl format into a run store.

    Each map becomes the initial model of the domain with its cells retyped. No constraint is checked. The measures are
    computed; a published complexity that differs from the measure that orders the curriculum by more than 1e-9, and
    rewards that differ from the behaviour's, are warnings.

    Args:
        source: the text of the file.
        location: the domain: a family file, its directory, or a bundled domain.
        store_path: where the run store is made.
        overwrite: whether an existing run makes room.
        overrides: what holds instead of what the family file says.

    Raises:
        LoadError: all that is wrong with the file, or with the domain's.
        InvalidArgument: the store exists already, or the domain has no grid.
    """
    domain = Domain.load(location, None, overrides)
    draw = domain.behaviour.draw if domain.behaviour else None
    if not isinstance(draw, DrawGrid):
        raise InvalidArgument(f"domain `{domain.spec.name}` draws no grid: there are no letters to read")
    variants = read_ga4cl(source)
    individuals = tuple(_imported(domain, draw, variants))
    settings, texts = stored(domain)
    settings["imported"] = source.name
    problem = domain.problem(domain.engine())
    score = problem.diversity.score([one.measures[problem.diversity_of] for one in individuals])
    with RunStore.create(store_path, settings, texts, overwrite=overwrite) as store:
        ids = tuple(one.id for one in individuals)
        store.write_generation(Generation(0, ids, score, len(ids)), individuals)
        family = family_of(store, domain)
    return family, tuple(_differences(family, variants, individuals))


def _imported(domain: Domain, draw: DrawGrid, variants: Sequence[GridVariant]) -> Iterator[Individual]:
    problems: list[Diagnostic] = []
    for place, variant in enumerate(variants):
        engine = domain.engine()
        try:
            retype_grid(engine.model, draw, variant)
        except LoadError as error:
            problems.extend(error.diagnostics)
            continue
        yield Individual(
            id=place,
            generation=0,
            child=place,
            parent=None,
            trace=(),
            measures=domain.problem(engine).measure(),
            state_hash=f"{engine.model.state_hash():016x}",
            model=dump_json(model_to_json(engine.model)),
        )
    if problems:
        raise LoadError(problems)


def _differences(
    family: Family, variants: Sequence[GridVariant], individuals: Sequence[Individual]
) -> Iterator[Diagnostic]:
    order = family.domain.spec.curriculum.order or family.domain.spec.diversity.options["of"]
    schedule = reward_schedule(family) if any(variant.rewards for variant in variants) else ()
    for variant, individual in zip(variants, individuals, strict=True):
        span = variant.row_spans[0] if variant.row_spans else None
        measured = individual.measures[str(order)]
        if variant.complexity is not None and abs(variant.complexity - measured) > _SAME:
            message = f"`{variant.name}`: `{order}` is {measured!r}, the file says {variant.complexity!r}"
            hint = "the family keeps what was measured; the file may have been made with another measure"
            yield Diagnostic("different-measure", message, span, hint, Severity.WARNING)
        if variant.rewards and variant.rewards != schedule:
            said = list(variant.rewards)
            message = f"`{variant.name}`: the behaviour's rewards are {list(schedule)}, the file says {said}"
            hint = "the rewards of the behaviour are used"
            yield Diagnostic("different-rewards", message, span, hint, Severity.WARNING)


def export_ga4cl(family: Family) -> str:
    """The family as the text of a ga4cl file: members in the order of the curriculum, as env_1, env_2, ...

    Raises:
        InvalidArgument: the behaviour draws no grid, or has several agents; or a member has more than the format:
            cells, and one token on the only cell of its class.
    """
    if family.behaviour.agents:
        raise InvalidArgument(
            f"family `{family.name}` has `agent` blocks: the ga4cl format has rewards for one agent"
        )
    draw = family.behaviour.draw
    if not isinstance(draw, DrawGrid):
        raise InvalidArgument(f"family `{family.name}` draws no grid: it cannot be written as letters")
    for member in family.members:
        lost = _lost(family.scene(member))
        if lost:
            message = f"the ga4cl format has maps of letters: `{member.name}` would lose {listed(lost)}"
            raise InvalidArgument(message, "`--format family` keeps all there is")
    order = str(family.domain.spec.curriculum.order or family.domain.spec.diversity.options["of"])
    schedule = reward_schedule(family)
    return write_ga4cl(
        [
            GridVariant(
                f"env_{place}", grid_rows(family.model(member), draw), schedule, member.measures[order]
            )
            for place, member in enumerate(family.members, start=1)
        ]
    )


def _lost(scene: Scene | None) -> list[str]:
    """What stands on the cells of a member, unless it is one token on the only cell of its class: the start."""
    assert isinstance(scene, GridScene)
    marks = scene.marks
    if len(marks) == 1:
        column, row = marks[0].place
        if scene.cells.count(scene.cells[row * scene.width + column]) == 1:
            return []
    return [mark.name for mark in marks]
