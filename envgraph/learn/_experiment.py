"""Curricula times seeds: train, evaluate on the target, collect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from math import isfinite

import numpy as np
from joblib import Parallel, delayed

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import Program
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.learn._curricula import Curriculum, Kind, sequences
from envgraph.learn._programs import InProgram, ProgramTraining, train_program
from envgraph.learn._results import Experiment, RunResult
from envgraph.solve import Evaluation, evaluate
from envgraph.solve.learning import (
    Backend,
    Table,
    Training,
    TrainingSettings,
    choose_backend,
    initial_values,
    prepare,
    train,
)

TRAINING, EVALUATION = 0, 1


@dataclass(frozen=True, slots=True, eq=False)
class FamilyMember:
    """An environment of a family.

    Attributes:
        name: what curricula call it.
        tabular: its table; or its place in a compiled program, where there are too many states for one.
        complexity: what the family is ordered by, where it is known; not used in training.
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
) -> Experiment:
    """Train on each curriculum with each seed, and evaluate each agent on the last environment of the family.

    A run's randomness depends on its seed and on the environments of its curriculum alone. So neither the number of
    workers, nor the loop, nor which other curricula and seeds are run, changes a result.

    Args:
        family: the environments from the easiest to the target.
        settings: how to train.
        curricula: by default the suffixes and the baselines, as in the paper.
        seeds: whole numbers from 0; by default 0, 1, ... as many as the settings say.
        workers: how many runs go on at a time; joblib decides where, by default in processes for the loop on lists
            and in threads for the compiled one.
        backend: which loop trains.
        progress: called with the number of finished runs and of all runs, after each run.
        known: results of this experiment from an earlier time that was interrupted; they are taken as they are, and
            those of other curricula and seeds left aside.
        found: called with each new result, as it ends.

    Raises:
        InvalidArgument: the environments disagree, a curriculum names one that is not there, or a number is wrong.
    """
    names = [member.name for member in family]
    if curricula is None:
        curricula = (*sequences(names, "suffixes"), *sequences(names, "baselines"))
    seeds = range(settings.seeds) if seeds is None else seeds
    _check(names, curricula, seeds, workers)
    steps = (
        settings.steps_per_environment * sum(sum(curriculum.shares) for curriculum in curricula) * len(seeds)
    )
    backend = choose_backend(backend, steps)
    prepared = _prepare(family)
    wanted = {(one.kind, one.label, seed): (one, seed) for one in curricula for seed in seeds}
    results = {key: result for result in known if (key := _key(result)) in wanted}
    tasks = [
        (prepared, curriculum, settings, seed, backend)
        for key, (curriculum, seed) in wanted.items()
        if key not in results
    ]
    for result in _run_all(tasks, workers, backend):
        results[_key(result)] = result
        if found:
            found(result)
        if progress:
            progress(len(results), len(wanted))
    return Experiment(tuple(results[key] for key in wanted))


def _key(result: RunResult) -> tuple[Kind, str, int]:
    """What tells the runs of an experiment apart."""
    return result.kind, result.label, result.seed


def run_stages(
    family: Sequence[FamilyMember],
    settings: TrainingSettings,
    *,
    seeds: Sequence[int] | None = None,
    workers: int = 1,
    backend: Backend = "auto",
    progress: Callable[[int, int], None] | None = None,
    known: Callable[[str], Iterable[RunResult]] = lambda target: (),
    found: Callable[[str, RunResult], None] = lambda target, result: None,
) -> Experiment:
    """For each environment, train on the family up to it, and evaluate there: how far the curriculum carries.

    The curricula are labelled "E1", "E1-E2", ..., "E1-E6"; the arguments are those of `run_experiment`, but `known` and
    `found` are also given the environment up to which agents were trained.
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
            backend=backend,
            progress=_shifted(progress, len(runs), total),
            known=known(target),
            found=partial(found, target),
        ).runs
    return Experiment(tuple(runs))


def _shifted(
    progress: Callable[[int, int], None] | None, before: int, total: int
) -> Callable[[int, int], None] | None:
    """Progress of a part, told as that of the whole."""
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
) -> tuple[RunResult, Training | ProgramTraining]:
    """One run of an experiment, with the agent that it trained; the result is the one in the experiment.

    Raises:
        InvalidArgument: as for `run_experiment`.
    """
    _check([member.name for member in family], [curriculum], [seed], workers=1)
    steps = settings.steps_per_environment * sum(curriculum.shares)
    return _run(_prepare(family), curriculum, settings, seed, choose_backend(backend, steps))


@dataclass(frozen=True, slots=True, eq=False)
class _Tables:
    """Tables of a family, made ready once for all runs."""

    tables: tuple[Table, ...]
    target: Tabular

    def run(
        self,
        stages: Sequence[int],
        steps: Sequence[int],
        settings: TrainingSettings,
        seed: int,
        backend: Backend,
    ) -> tuple[Training, Evaluation]:
        """Train on some of them, and evaluate on the last one."""
        tables = [self.tables[stage] for stage in stages]
        rng = _generator(seed, TRAINING, stages)
        training = train(tables, settings, rng, steps, initial_values(tables[0], settings), backend)
        rng = _generator(seed, EVALUATION, stages)
        found = evaluate(training.q, self.target, settings.evaluation_episodes, settings.limit, rng)
        return training, found


@dataclass(frozen=True, slots=True, eq=False)
class _Programs:
    """A family in a compiled program, by the numbers of its members there."""

    program: Program
    members: tuple[int, ...]

    def run(
        self,
        stages: Sequence[int],
        steps: Sequence[int],
        settings: TrainingSettings,
        seed: int,
        backend: Backend,
    ) -> tuple[ProgramTraining, Evaluation]:
        """Train on some of them, and evaluate on the last one; there is one loop."""
        members = [self.members[stage] for stage in stages]
        rng = _generator(seed, TRAINING, stages)
        training = train_program(self.program, settings, rng, members=members, steps=steps)
        rng, episodes = _generator(seed, EVALUATION, stages), settings.evaluation_episodes
        played = training.learner.play(self.members[-1], episodes, settings.limit, rng)
        return training, Evaluation(*played, episodes, exact=False)


@dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """A family made ready once for all its runs, and a position for each name."""

    positions: dict[str, int]
    ready: _Tables | _Programs


def _prepare(family: Sequence[FamilyMember]) -> _Prepared:
    positions = {member.name: position for position, member in enumerate(family)}
    tables = [member.tabular for member in family if isinstance(member.tabular, Tabular)]
    placed = [member.tabular for member in family if isinstance(member.tabular, InProgram)]
    if not placed:
        return _Prepared(positions, _Tables(prepare(tables), tables[-1]))
    if tables or len({id(one.program) for one in placed}) > 1:
        raise InvalidArgument("a family is in one program, or has a table of each member")
    program = placed[0].program
    program.functions("learn")  # compiled before threads ask for it
    return _Prepared(positions, _Programs(program, tuple(one.member for one in placed)))


_Task = tuple[_Prepared, Curriculum, TrainingSettings, int, Backend]


def _run_all(tasks: Sequence[_Task], workers: int, backend: Backend) -> Iterator[RunResult]:
    """Results as they end."""
    if workers == 1:
        yield from (_run_result(*task) for task in tasks)
        return
    threads = backend == "numba" or (tasks and isinstance(tasks[0][0].ready, _Programs))
    parallel = partial(Parallel, n_jobs=workers, prefer="threads" if threads else "processes")
    try:
        pool = parallel(return_as="generator_unordered")
    except (
        ValueError
    ):  # Ray gives whole lists alone: one for as many as run at a time, to have something soon
        for first in range(0, len(tasks), workers):
            yield from parallel()(delayed(_run_result)(*task) for task in tasks[first : first + workers])
    else:
        yield from pool(delayed(_run_result)(*task) for task in tasks)


def _run_result(
    prepared: _Prepared, curriculum: Curriculum, settings: TrainingSettings, seed: int, backend: Backend
) -> RunResult:
    """Without the agent, which a worker process would have to send back."""
    return _run(prepared, curriculum, settings, seed, backend)[0]


def _run(
    prepared: _Prepared, curriculum: Curriculum, settings: TrainingSettings, seed: int, backend: Backend
) -> tuple[RunResult, Training | ProgramTraining]:
    stages = tuple(prepared.positions[stage] for stage in curriculum.stages)
    steps = [share * settings.steps_per_environment for share in curriculum.shares]
    training, found = prepared.ready.run(stages, steps, settings, seed, backend)
    result = RunResult(
        kind=curriculum.kind,
        label=curriculum.label,
        seed=seed,
        steps=sum(steps),
        episodes=training.curve.episodes[-1],
        success_rate=found.success_rate,
        mean_return=found.mean_return,
        mean_length=found.mean_length,
        curve=training.curve,
    )
    return result, training


def _generator(seed: int, role: int, stages: Sequence[int]) -> np.random.Generator:
    """Independent streams for training and evaluation, for each seed and sequence of environments."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(role, *stages)))


def _check(names: Sequence[str], curricula: Sequence[Curriculum], seeds: Sequence[int], workers: int) -> None:
    if not names or len(set(names)) != len(names):
        raise InvalidArgument("a family needs environments with different names")
    for curriculum in curricula:
        for stage in curriculum.stages:
            if stage not in names:
                hint = did_you_mean(stage, names)
                raise InvalidArgument(f"no environment is called `{stage}`", hint)
    labels = [(curriculum.kind, curriculum.label) for curriculum in curricula]
    if not labels or len(set(labels)) != len(labels):
        raise InvalidArgument("an experiment needs curricula with different labels")
    if not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise InvalidArgument("an experiment needs different seeds from 0")
    if workers < 1:
        raise InvalidArgument(f"`workers` is {workers}, it must be at least 1")
