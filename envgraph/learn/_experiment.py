"""Run experiments: train an agent for each curriculum and seed, evaluate it on the target, and collect the results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from types import MappingProxyType

import numpy as np

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.errors import InvalidArgument, check_known
from envgraph.files import run_in_workers
from envgraph.learn._curricula import Curriculum, Kind, sequences
from envgraph.learn._deep import DeepAgent
from envgraph.learn._results import Experiment, RunResult
from envgraph.learn._table_agents import ProgramAgent, ProgramFamily, TableAgent, TableFamily
from envgraph.solve import Evaluation, mixture
from envgraph.solve.learning import (
    Backend,
    InProgram,
    ProgramTraining,
    StageMembers,
    Training,
    TrainingSettings,
    choose_backend,
    prepare,
    renumber_occurring,
    take_turns,
    with_starts,
)

TRAINING, EVALUATION, BEFORE, CHOOSING = 0, 1, 2, 3

_MIXED_STAGE = 2**16
"""A number above all positions. With the size of a mixed stage added, it marks the stage in the key of a generator."""


@dataclass(frozen=True, slots=True, eq=False)
class FamilyMember:
    """An environment of a family.

    Attributes:
        name: the name of the environment in curricula.
        tabular: its table; or its number in a compiled program, if there are too many states for a table.
        complexity: the measure by which the family is ordered, if known; not used in training.
    """

    name: str
    tabular: Tabular | InProgram
    complexity: float | None = None

    def __post_init__(self) -> None:
        if self.complexity is not None and not isfinite(self.complexity):
            raise InvalidArgument(f"the complexity of `{self.name}` is not finite")


def run_experiment(
    family: Sequence[FamilyMember],
    settings: TrainingSettings,
    curricula: Sequence[Curriculum] | None = None,
    *,
    seeds: Sequence[int] | None = None,
    workers: int = 1,
    backend: Backend = "auto",
    progress: Callable[[int, int], None] | None = None,
    known: Iterable[RunResult] = (),
    found: Callable[[RunResult], None] | None = None,
    starts: Mapping[str, Tabular] = MappingProxyType({}),
) -> Experiment:
    """Train on each curriculum with each seed, and evaluate each agent on the last environment of the family.

    The randomness of a run depends only on its seed and on the environments of its curriculum. So results do not depend
    on the number of workers, on the loop, or on the other curricula and seeds. Curricula with the same environments in
    the same order, but other initial values, draw the same random numbers.

    Args:
        family: the environments from the easiest to the target.
        settings: the settings of the training.
        curricula: the curricula; by default the suffixes and the baselines, as in the paper.
        seeds: whole numbers from 0; by default 0, 1, ... up to the number in the settings.
        workers: number of runs at a time. Joblib runs them by default in processes for the loop on lists, and in
            threads for the compiled loop.
        backend: the training loop.
        progress: called after each run with the number of finished runs and of all runs.
        known: results of this experiment that an interrupted call has left; they are not computed again. Results of
            other curricula and seeds are ignored.
        found: called with each new result as soon as its run has ended.
        starts: copies of the target with other start states, by the names that controls use: see `other_starts`.

    Raises:
        InvalidArgument: the environments do not agree, a curriculum has an unknown name, or a number is not valid.
        EnvgraphError: a worker process died; `found` has been called with all results before.
    """
    names = [member.name for member in family]
    if curricula is None:
        curricula = (*sequences(names, "suffixes"), *sequences(names, "baselines"))
    seeds = range(settings.seeds) if seeds is None else seeds
    _check_arguments([*names, *starts], curricula, seeds, workers)
    steps = sum(sum(curriculum.stage_steps(settings.steps_per_environment)) for curriculum in curricula)
    backend = choose_backend(backend, steps * len(seeds), settings)
    prepared = _prepare_family(family, curricula, starts)
    wanted = {(one.kind, one.label, seed): (one, seed) for one in curricula for seed in seeds}
    results = {key: result for result in known if (key := _run_key(result)) in wanted}
    tasks = [
        (prepared, curriculum, settings, seed, backend)
        for key, (curriculum, seed) in wanted.items()
        if key not in results
    ]
    threads = settings.student == "tabular" and (backend == "numba" or isinstance(prepared.ready, ProgramFamily))
    for result in run_in_workers(_train_result, tasks, workers, threads=threads):
        results[_run_key(result)] = result
        if found:
            found(result)
        if progress:
            progress(len(results), len(wanted))
    return Experiment(tuple(results[key] for key in wanted))


def _run_key(result: RunResult) -> tuple[Kind, str, int]:
    """Return the kind, label and seed of a run, which identify it in an experiment."""
    return result.kind, result.label, result.seed


def run_stages(
    family: Sequence[FamilyMember],
    settings: TrainingSettings,
    *,
    seeds: Sequence[int] | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
    known: Callable[[str], Iterable[RunResult]] = lambda target: (),
    found: Callable[[str, RunResult], None] = lambda target, result: None,
) -> Experiment:
    """Train on the first environments of a family, for each number of them, and evaluate on the last one.

    The curricula are labelled "E1", "E1-E2", ..., "E1-E6". The arguments are those of `run_experiment`, but `known` and
    `found` also get the name of the environment that agents are evaluated on.
    """
    names = [member.name for member in family]
    runs: list[RunResult] = []
    total = len(family) * (settings.seeds if seeds is None else len(seeds))
    for count in range(1, len(family) + 1):
        target = names[count - 1]
        runs += run_experiment(
            family[:count],
            settings,
            sequences(names[:count], "full"),
            seeds=seeds,
            workers=workers,
            progress=_offset_progress(progress, len(runs), total),
            known=known(target),
            found=partial(found, target),
        ).runs
    return Experiment(tuple(runs))


def run_families(
    families: Sequence[Sequence[FamilyMember]],
    settings: TrainingSettings,
    label: str,
    *,
    seeds: Sequence[int] | None = None,
    backend: Backend = "auto",
    progress: Callable[[int, int], None] | None = None,
    known: Iterable[RunResult] = (),
    found: Callable[[RunResult], None] | None = None,
) -> Experiment:
    """Train one agent on the whole of each family, by default the first with seed 0, the next with seed 1 and so on.

    With another random family for each seed, the result can be compared with a family trained with the same seeds. All
    runs are controls with this label; the other arguments are those of `run_experiment`.
    """
    steps, known = settings.steps_per_environment * sum(map(len, families)), tuple(known)
    backend, runs = choose_backend(backend, steps, settings), list[RunResult]()
    seeds = range(len(families)) if seeds is None else seeds
    for seed, family in zip(seeds, families, strict=True):
        names = tuple(member.name for member in family)
        runs += run_experiment(
            family,
            settings,
            [Curriculum("control", label, names, (1,) * len(names))],
            seeds=[seed],
            backend=backend,
            progress=_offset_progress(progress, len(runs), len(families)),
            known=known,
            found=found,
        ).runs
    return Experiment(tuple(runs))


def _offset_progress(
    progress: Callable[[int, int], None] | None, before: int, total: int
) -> Callable[[int, int], None] | None:
    """Return a progress callback for a part of the runs that reports the progress of the whole; None for None."""
    if progress is None:
        return None
    return lambda done, _: progress(before + done, total)


def train_run(
    family: Sequence[FamilyMember],
    curriculum: Curriculum,
    settings: TrainingSettings,
    seed: int,
    *,
    backend: Backend = "auto",
    starts: Mapping[str, Tabular] = MappingProxyType({}),
) -> tuple[RunResult, Training | ProgramTraining]:
    """Return the result of one run of an experiment, as `run_experiment` does, together with the trained agent.

    If there are more observations than a table of values can have rows, its rows are the observations that occur in the
    family, in order.

    Raises:
        InvalidArgument: as for `run_experiment`.
    """
    _check_arguments([*(member.name for member in family), *starts], [curriculum], [seed], workers=1)
    steps = sum(curriculum.stage_steps(settings.steps_per_environment))
    prepared = _prepare_family(family, [curriculum], starts)
    return _train_and_evaluate(prepared, curriculum, settings, seed, choose_backend(backend, steps, settings))


@dataclass(frozen=True, slots=True, eq=False)
class _PreparedFamily:
    """A family prepared once for all its runs, with the position of each name, on which random streams depend."""

    positions: dict[str, int]
    ready: TableFamily | ProgramFamily


def _prepare_family(
    family: Sequence[FamilyMember], curricula: Iterable[Curriculum], starts: Mapping[str, Tabular]
) -> _PreparedFamily:
    positions = {name: place for place, name in enumerate((*(one.name for one in family), *starts))}
    tables = [member.tabular for member in family if isinstance(member.tabular, Tabular)]
    placed = [member.tabular for member in family if isinstance(member.tabular, InProgram)]
    stages = [_stage_members(curriculum, positions) for curriculum in curricula if curriculum.schedule is None]
    drawn = {place: None for one in stages for place in one if len(place) > 1}
    if not placed:
        parts: dict[StageMembers, Tabular] = {(place,): one for place, one in enumerate(tables)}
        parts |= {place: mixture([tables[one] for one in place]) for place in drawn}
        numbered = renumber_occurring([*parts.values()])
        ready = dict(zip(parts, prepare(numbered), strict=True))
        for place, (name, one) in enumerate(starts.items(), start=len(family)):
            if one.n_states != tables[-1].n_states:
                raise InvalidArgument(f"`{name}` of `starts` must be the target with other start states")
            parts[place,], ready[place,] = one, with_starts(ready[len(family) - 1,], one)
        return _PreparedFamily(positions, TableFamily(ready, numbered[: len(family)], parts))
    if tables or len({id(one.program) for one in placed}) > 1:
        raise InvalidArgument("all environments must be tables, or all must be members of one program")
    if drawn or starts:
        raise InvalidArgument(
            "mixed stages and `starts` need tables, but the environments have too many states for tables"
        )
    program = placed[0].program
    program.functions_for("learn")  # compile before threads ask for it
    return _PreparedFamily(positions, ProgramFamily(program, tuple(one.member for one in placed)))


def _stage_members(curriculum: Curriculum, positions: dict[str, int]) -> tuple[StageMembers, ...]:
    return tuple(tuple(positions[name] for name in names) for names in curriculum.members)


def _train_result(
    prepared: _PreparedFamily, curriculum: Curriculum, settings: TrainingSettings, seed: int, backend: Backend
) -> RunResult:
    """Return the result of a run without the agent, which would be costly to send back from a worker process."""
    return _train_and_evaluate(prepared, curriculum, settings, seed, backend)[0]


def _train_and_evaluate(
    prepared: _PreparedFamily, curriculum: Curriculum, settings: TrainingSettings, seed: int, backend: Backend
) -> tuple[RunResult, Training | ProgramTraining]:
    curriculum = curriculum.for_seed(seed)
    stages = _stage_members(curriculum, prepared.positions)
    value = settings.initial_value if curriculum.initial_value is None else curriculum.initial_value
    settings = replace(settings, initial_value=value, epsilon=curriculum.epsilon or settings.epsilon)
    steps = curriculum.stage_steps(settings.steps_per_environment)
    parts = [part for part in zip(steps, stages, strict=True) if part[0]]
    tabular, ready, rng = settings.student == "tabular", prepared.ready, _run_generator(seed, TRAINING, stages)
    agent: TableAgent | ProgramAgent
    agent = ready.new_agent(settings, backend) if tabular else DeepAgent(ready, settings, rng)
    before: list[Evaluation] = []

    def on_stage_begin(stage: int) -> None:
        if stage == len(parts) - 1:
            before.append(agent.evaluate_on_target(_run_generator(seed, BEFORE, stages)))

    several = next((place for place in stages if len(place) > 1), ())
    schedule = agent.new_schedule(curriculum.schedule, several) if curriculum.schedule else None
    turn = partial(agent.train_stage, rng)
    choosing = _run_generator(seed, CHOOSING, stages)
    training = agent.training_result(*take_turns(turn, settings, parts, choosing, on_stage_begin, schedule))
    found = agent.evaluate_on_target(_run_generator(seed, EVALUATION, stages))
    alone = stages[-1] == (len(prepared.ready.members) - 1,)
    result = RunResult(
        kind=curriculum.kind,
        label=curriculum.label,
        seed=seed,
        steps=sum(steps),
        episodes=training.curve.episodes[-1],
        success_rate=found.success_rate,
        mean_return=found.mean_return,
        mean_length=found.mean_length,
        steps_before=sum(steps[:-1]) if alone else sum(steps),
        success_before=before[0].success_rate,
        curve=training.curve,
    )
    return result, training


def _run_generator(seed: int, role: int, stages: Sequence[StageMembers]) -> np.random.Generator:
    """Return a random generator that is independent for each role, seed and sequence of environments."""
    marked = (place if len(place) == 1 else (_MIXED_STAGE + len(place), *place) for place in stages)
    key = (number for place in marked for number in place)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(role, *key)))


def _check_arguments(names: Sequence[str], curricula: Sequence[Curriculum], seeds: Sequence[int], workers: int) -> None:
    if not names or len(set(names)) != len(names):
        raise InvalidArgument("`family` must be one or more environments with different names")
    for curriculum in curricula:
        for name in (name for stage in curriculum.members for name in stage):
            check_known(name, names, f"no environment is called `{name}`")
    labels = [(curriculum.kind, curriculum.label) for curriculum in curricula]
    if not labels or len(set(labels)) != len(labels):
        raise InvalidArgument("`curricula` must be one or more curricula with different labels")
    if not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise InvalidArgument("`seeds` must be one or more different numbers, at least 0")
    if workers < 1:
        raise InvalidArgument(f"`workers` is {workers}, it must be at least 1")
