"""The commands `envgraph train` and `envgraph report`: train agents on a family, and write its HTML report."""

from __future__ import annotations

import platform
import shutil
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from envgraph import __version__
from envgraph.cli._family_actions import REPORT, TRAINING, run_directory
from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.env import FloatRange, Tabular, TooManyStates
from envgraph.env.compiled import NotCompiled
from envgraph.errors import (
    LIMITS,
    EvaluationError,
    InvalidArgument,
    check_known,
    list_names,
    parse_int_within,
)
from envgraph.files import replace_file, write_lock
from envgraph.learn import (
    CONTROLS,
    EXACT_SCHEDULES,
    STUDENTS,
    TEACHERS,
    Curriculum,
    Experiment,
    FamilyMember,
    InProgram,
    TrainingJournal,
    TrainingSettings,
    compare,
    controls,
    findings,
    fingerprint,
    optimistic_values,
    other_starts,
    read_csv,
    run_experiment,
    run_families,
    run_stages,
    sequences,
    write_csv,
)
from envgraph.report import SearchRecord, TrainingResults, family_report, render_html, stage_rows, stage_table
from envgraph.search import (
    Domain,
    Family,
    RunStore,
    find_run_store,
    lineage_lengths,
    open_family,
    order_measure,
    random_families,
)

STAGES = "stages"
"""Name of the directory, below that of a budget, for families that end with each environment."""

_CURRICULUM_KINDS = ("suffixes", "full", "baselines", "direct")

_TRAINING_OPTIONS = {
    "steps": str,
    "seeds": int,
    "seed_offset": int,
    "curricula": str,
    "controls": str,
    "student": str,
    "members": int,
    "overrides": list,
}
"""Options of a training, with their types: `--resume` uses those of the interrupted training."""

_RANDOM_CONTROL = "random"
"""The control with one random family for each seed; it must be named, since it explores all their states."""

_TABLE_CONTROLS = ("optimistic", "randomised", "backplay", "exploring", _RANDOM_CONTROL, *EXACT_SCHEDULES)
"""Controls that need transition tables of the environments."""

_STUDENT_DIRECTORIES = {student: student.removeprefix("tabular").replace(":", "-") for student in STUDENTS}
"""Directory of each student below `training`; "" for the tabular student, whose results are there directly."""

UNFINISHED = "unfinished.jsonl"
"""Name of the journal of an unfinished training, which holds its agents so far for `--resume`."""


def train_agents(
    run: str,
    directory: Path,
    *,
    steps: str | None,
    seeds: int | None,
    seed_offset: int | None,
    curricula: str | None,
    controls: str | None,
    student: str | None,
    members: int | None,
    overrides: Sequence[str],
    workers: int,
    resume: bool,
    force: bool,
) -> None:
    """Train and evaluate agents with each budget, write CSV files, and print a summary.

    Existing results of the same budgets, and an interrupted training, are replaced only with `force`. If the training
    is interrupted, its agents so far are kept, so that `resume` can continue it.
    """
    given = (steps, seeds, seed_offset, curricula, controls, student, members, [*overrides] or None)
    wanted: dict[str, Any] = dict(zip(_TRAINING_OPTIONS, given, strict=True))
    with write_lock(Path(run) if run.endswith(".json") else find_run_store(run, directory)):
        _train_family(run, directory, wanted, workers, resume, force)


def _train_family(run: str, directory: Path, wanted: dict[str, Any], workers: int, resume: bool, force: bool) -> None:
    base = run_directory(run, directory) / TRAINING
    again = f"envgraph train {run} --directory {directory} --resume"
    journal = None
    if resume:
        if force:
            raise InvalidArgument("`--resume` and `--force` cannot be combined")
        if not (base / UNFINISHED).exists():
            raise InvalidArgument(f"`{run}` has no interrupted training to resume")
        journal = TrainingJournal.open(base / UNFINISHED)
        begun = _original_options(journal)
        for name, value in wanted.items():
            if value not in (None, begun[name]):
                was = "the defaults" if begun[name] is None else f"`{begun[name]}`"
                message = f"the interrupted training has other {name}: {was}, not `{value}`"
                option = f"--{name.replace('_', '-')}"
                raise InvalidArgument(message, f"leave `{option}` out, or start again with `--force`")
        wanted = begun
    elif (base / UNFINISHED).exists() and not force:
        raise InvalidArgument(
            f"{base / UNFINISHED} holds the {len(TrainingJournal.open(base / UNFINISHED))} agents of a "
            "training that was interrupted: resume it with --resume, or replace it with --force"
        )
    family = _select_members(open_family(run, directory), run, wanted["members"])
    family = _with_training_settings(family, wanted["overrides"] or ())
    chosen = _select_curricula(family, wanted["curricula"])
    compared = _select_controls(wanted["controls"])
    wanted_steps = [None] if wanted["steps"] is None else parse_budgets(wanted["steps"])
    budgets = [_training_settings(family, budget, wanted["seeds"], wanted["student"]) for budget in wanted_steps]
    results = base / _STUDENT_DIRECTORIES[budgets[0].student]
    if not resume and not force:
        _refuse_results(results, budgets)
    members = _member_tables(family)
    schedules = [one.text for one in family.domain.spec.curriculum.schedules]
    chosen, starts = _add_controls(chosen, compared, members, budgets[0], schedules)
    first = wanted["seed_offset"] or 0
    numbers = range(first, first + budgets[0].seeds)
    random = _random_families(family, run, directory, len(numbers)) if compared and _RANDOM_CONTROL in compared else []
    made_of = fingerprint({member.name: member.tabular for member in members}, __version__, *budgets)
    if journal is None:
        journal = TrainingJournal.create(base / UNFINISHED, {**wanted, "made_of": made_of})
    elif journal.about.get("made_of") != made_of:
        raise InvalidArgument(
            f"{journal.path} has other environments, settings or another version of envgraph: start again with --force"
        )
    try:
        trained = [
            _train_budget(family, members, settings, chosen, starts, numbers, workers, journal, results, random)
            for settings in budgets
        ]
    except BaseException as error:
        if len(journal) or isinstance(error, KeyboardInterrupt):
            sys.stderr.write(f"{len(journal)} agents are saved: `{again}` resumes the training\n")
        else:
            journal.path.unlink()  # No agent was trained, so nothing can be resumed.
        raise
    journal.path.unlink()
    _print_summary(family, trained, results)


def _select_members(family: Family, run: str, count: int | None) -> Family:
    """Return the family of the members to train on: all, or a number of them, which a line on standard error tells.

    Raises:
        InvalidArgument: `count` is above the number of members, or more than a curriculum has.
    """
    available, most = len(family.members), LIMITS["curriculum"]
    if count is None and available <= most:
        return family
    count = family.domain.spec.search.population if count is None else count
    if count > min(most, available):
        limit = f"a curriculum has at most {most}" if count > most else f"`{run}` has {available} environments"
        raise InvalidArgument(f"`--members` is {count}, but {limit}")
    sys.stderr.write(
        f"{count} of the {available:,} environments of `{run}`, evenly spaced by `{order_measure(family.domain)}`; "
        "the others are left out\n"
    )
    return family.spaced(count)


def _with_training_settings(family: Family, overrides: Sequence[str]) -> Family:
    """Return the family with other settings of `[training]`.

    Raises:
        InvalidArgument: an override is not one of `[training]`.
        LoadError: an override is unknown, or its value is wrong.
    """
    if not overrides:
        return family
    others = [one for one in overrides if not one.strip().startswith("training.")]
    if others:
        hint = "only those of `[training]` can be replaced, such as `training.learning_rate=0.2`"
        raise InvalidArgument(f"`--set {others[0]}` is no setting of a training", hint)
    domain = Domain.from_bundle(family.bundle, family.domain.components, [*family.overrides, *overrides])
    return replace(family, domain=domain, overrides=domain.overrides, _keys=family.keys)


def _refuse_results(base: Path, budgets: list[TrainingSettings]) -> None:
    """Raise InvalidArgument if results of one of the budgets exist."""
    steps = [str(one.steps_per_environment) for one in budgets]
    there = [str(base / one) for one in steps if (base / one / "runs.csv").exists()]
    if there:
        verb, them = ("exists", "it") if len(there) == 1 else ("exist", "them")
        hint = f"replace {them} with --force, or choose other --steps"
        raise InvalidArgument(f"{list_names(there)} {verb} already: {hint}")


def _original_options(journal: TrainingJournal) -> dict[str, Any]:
    """Return the options with which an interrupted training was started; raise InvalidArgument if they are invalid."""
    wanted = {name: journal.about.get(name) for name in _TRAINING_OPTIONS}
    known = all(value is None or isinstance(value, _TRAINING_OPTIONS[name]) for name, value in wanted.items())
    if not known or not all(isinstance(one, str) for one in wanted["overrides"] or ()):
        raise InvalidArgument(f"{journal.path}:1: these are not the options of a training")
    try:
        parse_budgets(wanted["steps"] or "1")
        parse_int_within(str(wanted["seeds"] or 1), 1, "members")
        parse_int_within(str(wanted["members"] or 2), 2, "members")
    except InvalidArgument as error:
        raise InvalidArgument(f"{journal.path}:1: {error.message}", error.hint) from None
    return wanted


def _train_budget(
    family: Family,
    members: list[FamilyMember],
    settings: TrainingSettings,
    chosen: list[Curriculum],
    starts: dict[str, Tabular],
    seeds: Sequence[int],
    workers: int,
    journal: TrainingJournal,
    base: Path,
    random: list[list[FamilyMember]],
) -> TrainingResults:
    """Train the agents of one budget that the journal lacks; add each to the journal, and finally write all results."""
    steps, target = settings.steps_per_environment, members[-1].name
    part, label = str(steps), f"agents, {steps} steps an environment"
    with progress_bar(label, len(chosen) * len(seeds)) as advance:
        experiment = run_experiment(
            members,
            settings,
            chosen,
            seeds=seeds,
            workers=workers,
            progress=lambda done, _: advance(done),
            known=journal.results_of(part, target),
            found=partial(journal.add, part, target),
            starts=starts,
        )
    if random:
        with progress_bar(f"{label}, random families", len(random)) as advance:
            others = run_families(
                random,
                settings,
                "random families",
                seeds=seeds,
                progress=lambda done, _: advance(done),
                known=journal.results_of(part, target),
                found=partial(journal.add, part, target),
            )
        experiment = Experiment((*experiment.runs, *others.runs))
    stages = None
    if any(curriculum.kind == "curriculum" for curriculum in chosen):
        with progress_bar(f"{label}, families that end with each environment", len(members) * len(seeds)) as advance:
            stages = run_stages(
                members,
                settings,
                seeds=seeds,
                workers=workers,
                progress=lambda done, _: advance(done),
                known=partial(journal.results_of, part),
                found=partial(journal.add, part),
            )
    trained = TrainingResults(steps, experiment, stages, family.behaviour.can_succeed, settings.student)
    _write_results(trained, base)
    return trained


def _write_results(trained: TrainingResults, base: Path) -> None:
    """Write the CSV files of a budget; replace earlier files, and delete earlier results of stages without new ones."""
    directory = base / str(trained.steps)
    write_csv(trained.experiment, directory)
    if trained.stages is not None:
        write_csv(trained.stages, directory / STAGES)
    else:
        shutil.rmtree(directory / STAGES, ignore_errors=True)


def write_report(run: str, directory: Path, output: Path | None) -> None:
    """Write the HTML report of a family, and print a short table of its environments."""
    family = open_family(run, directory)
    base = run_directory(run, directory)
    trained = [
        one
        for student in STUDENTS
        for one in _read_results(base / TRAINING / _STUDENT_DIRECTORIES[student], family, student)
    ]
    search = None
    if Path(run).suffix != ".json":
        with RunStore.open(find_run_store(run, directory)) as store:
            search = SearchRecord.of(family, store)
    searched = search is not None and len(search.history) > 1
    facts = _report_facts(family, trained, searched=searched)
    page = family_report(family, search=search, trained=trained, facts=facts)
    path = output or base / REPORT
    replace_file(path, render_html(page))
    if print_json(lambda: {"name": family.name, "report": str(path), "environments": stage_rows(family, trained)}):
        return
    table = stage_table(family, trained)
    print_table(family.name, table.columns, table.rows, table.numeric)
    print_line(f"report: {path}")


def _read_results(directory: Path, family: Family, student: str) -> list[TrainingResults]:
    """Return the stored results of a student, one for each budget, the smallest budget first."""
    budgets = sorted(int(path.name) for path in directory.glob("*") if path.name.isdecimal())
    return [
        TrainingResults(
            steps,
            read_csv(directory / str(steps)),
            read_csv(stages) if (stages := directory / str(steps) / STAGES).is_dir() else None,
            family.behaviour.can_succeed,
            student,
        )
        for steps in budgets
    ]


def parse_budgets(steps: str) -> list[int]:
    """Parse the training budgets, numbers separated by commas; return them sorted and without duplicates.

    Raises:
        InvalidArgument: an item is not a number within the limits.
    """
    try:
        return sorted({parse_int_within(word.strip(), 1, "steps") for word in steps.split(",")})
    except InvalidArgument as error:
        hint = error.hint or "write one, or several such as `10000,50000`"
        raise InvalidArgument(f"in `--steps` {error.message}", hint) from None


def _member_tables(family: Family) -> list[FamilyMember]:
    """Return the members with their transition tables; if one has too many states, use a compiled program for all."""
    order = order_measure(family.domain)
    members = []
    try:
        with progress_bar("environments", len(family.members)) as advance:
            for place, member in enumerate(family.members):
                advance(place, member.name)
                tabular = family.explored(member).tabular
                members.append(FamilyMember(member.name, tabular, member.measures[order]))
    except TooManyStates as error:
        return _compiled_members(family, order, error)
    return members


def _compiled_members(family: Family, order: str, error: TooManyStates) -> list[FamilyMember]:
    """Return the members as parts of one compiled program, and print a note about this on standard error.

    Args:
        order: the measure whose values order the members.
        error: the reason for which tables cannot be used, for the note.

    Raises:
        EvaluationError: the environment cannot be compiled, or observes floats.
    """
    try:
        program = family.program(family.members)
    except NotCompiled as refused:
        raise EvaluationError(
            f"{error.message}, and it cannot be compiled: {refused}",
            refused.span,
            "reduce the number of states, or remove this construct from the environment",
        ) from None
    if any(isinstance(size, FloatRange) for size in program.observation_shape):
        hint = "`train` learns values of numbered observations: train a network with `envgraph.sb3.make_vec` instead"
        raise EvaluationError(error.message, hint=hint)
    sys.stderr.write(f"{error.message}: agents learn in the compiled program instead of in tables\n")
    return [
        FamilyMember(member.name, InProgram(program, number), member.measures[order])
        for number, member in enumerate(family.members)
    ]


def _training_settings(family: Family, steps: int | None, seeds: int | None, student: Any) -> TrainingSettings:
    settings = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    return replace(
        settings,
        steps_per_environment=steps or settings.steps_per_environment,
        seeds=seeds or settings.seeds,
        student=student or settings.student,
    )


def _select_curricula(family: Family, kinds: str | None) -> list[Curriculum]:
    names = [member.name for member in family.members]
    default = [family.domain.spec.curriculum.sequences, "baselines"]
    wanted = default if kinds is None else [kind.strip() for kind in kinds.split(",")]
    chosen: dict[tuple[str, str], Curriculum] = {}
    for kind in wanted:
        check_known(kind, _CURRICULUM_KINDS, f"unknown curricula `{kind}`")
        for one in sequences(names, kind):  # type: ignore[arg-type]
            chosen.setdefault((one.kind, one.label), one)
    return list(chosen.values())


def _select_controls(controls: str | None) -> list[str] | None:
    """Return the names of the controls in the option (`all` and `none` are expanded); None if it was not given."""
    known = (*CONTROLS, _RANDOM_CONTROL, *TEACHERS)
    if controls is None or controls.strip() in ("none", "all"):
        return None if controls is None else [*CONTROLS, _RANDOM_CONTROL] if controls.strip() == "all" else []
    kinds = [kind.strip() for kind in controls.split(",")]
    for kind in kinds:
        check_known(kind, (*known, "all", "none"), f"unknown control `{kind}`")
    return kinds


def _add_controls(
    chosen: list[Curriculum],
    kinds: list[str] | None,
    members: list[FamilyMember],
    settings: TrainingSettings,
    schedules: Sequence[str],
) -> tuple[list[Curriculum], dict[str, Tabular]]:
    """Return the curricula and their controls, and the variants of the target (by name) in which controls start.

    Without a choice (`kinds` is None), use all controls that the environments allow, and the schedules of the family
    file. Print a note for each control that is skipped.

    Raises:
        InvalidArgument: a chosen control needs tables, but there are too many states.
    """
    target, starts, optimism = members[-1].tabular, dict[str, Tabular](), tuple[float, ...]()
    if kinds is None:
        kinds = [*CONTROLS, *schedules] if any(one.kind == "curriculum" for one in chosen) else []
        if not isinstance(target, Tabular) and (missing := [kind for kind in kinds if kind in _TABLE_CONTROLS]):
            kinds = [kind for kind in kinds if kind not in missing]
            sys.stderr.write(f"skipped controls that need tables of all states: {', '.join(missing)}\n")
    if settings.student != "tabular" and "optimistic" in kinds:
        kinds = [kind for kind in kinds if kind != "optimistic"]
        sys.stderr.write(f"`{settings.student}` has no table of values: `optimistic` is skipped\n")
    if isinstance(target, Tabular) and kinds:
        optimism = optimistic_values(target, settings)
        starts = other_starts(members[-1].name, target, settings.limit)
        if "backplay" in kinds and len(starts) == 1:
            sys.stderr.write("`backplay` is skipped: no optimal episode of two steps or more ends in success\n")
    elif needed := [kind for kind in kinds if kind in _TABLE_CONTROLS]:
        raise InvalidArgument(f"`--controls {','.join(needed)}` needs tables of all states, but there are too many")
    other = [kind for kind in kinds if kind != _RANDOM_CONTROL]
    found = controls([one.name for one in members], other, optimism=optimism, starts=[*starts])
    return list({(one.kind, one.label): one for one in (*chosen, *found)}.values()), starts


def _random_families(family: Family, run: str, directory: Path, count: int) -> list[list[FamilyMember]]:
    """Return the tables of `count` random families with the same target; raise InvalidArgument without a run."""
    if Path(run).suffix == ".json":
        raise InvalidArgument(
            f"`--controls {_RANDOM_CONTROL}` needs a run: `{run}` does not record how its members were generated"
        )
    with RunStore.open(find_run_store(run, directory)) as store:
        applications = lineage_lengths(family, store)
    found = []
    with progress_bar("random families", count) as advance:
        for place, one in enumerate(random_families(family, count, applications, seed=family.domain.spec.seed)):
            advance(place)
            found.append([FamilyMember(each.name, one.explored(each).tabular) for each in one.members])
    return found


def _print_summary(family: Family, trained: list[TrainingResults], directory: Path) -> None:
    found = [(one.steps, each) for one in trained for each in one.experiment.best_optimistic().summaries()]
    best = [way for one in trained if (way := one.best_way(family.members[-1].name))]

    def data() -> dict[str, Any]:
        results = [{"steps_per_environment": steps, "seeds": one.runs, **asdict(one)} for steps, one in found]
        claims = [
            {"steps_per_environment": budget.steps, **asdict(one), "verdict": one.verdict, "text": str(one)}
            for budget in trained
            for one in compare(budget.experiment, can_succeed=budget.can_succeed)
        ]
        ways = [{"best": one.best, **asdict(one), "text": str(one)} for one in best]
        about = {"name": family.name, "student": trained[0].student, "directory": str(directory)}
        return {**about, "ways": ways, "results": results, "comparisons": claims}

    if print_json(data):
        return
    for way in best:
        print_line(str(way))
    rows = [
        (
            f"{one.kind} {one.label}",
            str(one.steps),
            str(one.runs),
            f"{one.success_rate:.0%}",
            f"{one.success_interval[0]:.0%} to {one.success_interval[1]:.0%}",
            f"{one.mean_return:z.2f}",
        )
        for _, one in found
    ]
    columns = ("trained on", "steps", "seeds", "success", "95 % interval", "return")
    title = f"{family.name}: agents on {family.members[-1].name}{trained[0].suffix}"
    print_table(title, columns, rows, (1, 2, 3, 4, 5))
    for budget in trained:
        comparisons = compare(budget.experiment, can_succeed=budget.can_succeed)
        for place, line in enumerate(findings(comparisons)):
            print_line(f"  {line}" if place else line)
    print_line(f"results: {directory}")


def _report_facts(family: Family, trained: list[TrainingResults], *, searched: bool) -> dict[str, str]:
    spec = family.domain.spec
    facts = {"domain": f"{spec.name}, {spec.path}; its files are stored in the run"}
    if searched:
        search, mutation = spec.search, spec.mutation
        facts["search"] = (
            f"seed {spec.seed}, population {search.population}, {search.generations} generations, mutation rate "
            f"{mutation.rate:g}, parents {search.parents.kind}, survivors {search.survivors.kind} "
            + " ".join(f"{name} {value}" for name, value in search.survivors.options.items())
        )
    if any(budget.student == "tabular" for budget in trained):
        agent = _training_settings(family, None, None, None)
        facts["agent"] = (
            f"tabular Q-learning, learning rate {agent.learning_rate:g}, discount {agent.discount:g}, epsilon "
            f"{agent.epsilon.start:g} to {agent.epsilon.minimum:g} by {agent.epsilon.decay:g} per "
            f"{agent.epsilon.per}, reset per {agent.epsilon.reset}, initial value {agent.initial_value:g}, "
            f"at most {agent.limit} steps an episode"
        )
    for budget in trained:
        seeds = sorted({run.seed for run in budget.experiment.runs})
        facts[f"training at {budget.steps} steps{budget.suffix}"] = f"seeds {seeds[0]} to {seeds[-1]}"
    facts["versions"] = f"envgraph {__version__}, Python {platform.python_version()}, NumPy {version('numpy')}"
    return facts
