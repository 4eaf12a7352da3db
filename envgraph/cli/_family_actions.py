"""Generate families, print families and runs, and import families of the ga4cl format."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Any

from envgraph.cli._inputs import as_overrides, check_file_format
from envgraph.cli._output import (
    print_diagnostics,
    print_json,
    print_line,
    print_lines,
    print_table,
    progress_bar,
)
from envgraph.env import scene_text
from envgraph.errors import SHOWN, Diagnostic, EnvgraphError, InvalidArgument
from envgraph.graph import value_text
from envgraph.lang import DiskFiles, read_source
from envgraph.search import (
    Domain,
    Family,
    Generation,
    Member,
    Outcome,
    RunStore,
    SampleProgress,
    describe_search,
    find_run_store,
    format_certificates,
    format_measure,
    format_measures,
    generate_from_domain,
    import_ga4cl,
    lineage,
    load_stored_domain,
    open_family,
    resume as resume_run,
    why_low,
)
from envgraph.search.curricula import CurriculumProgress

TRAINING, REPORT = "training", "report.html"
"""Names in the directory of a run: the directory of training results (with one for each budget), and the page."""


def generate_family(
    family: str,
    *,
    name: str | None,
    seed: int | None,
    generations: int | None,
    population: int | None,
    samples: int | None,
    overrides: Sequence[str],
    resume: bool,
    force: bool,
    directory: Path,
    workers: int,
    require: float | None,
) -> None:
    """Generate a family, or resume a run, and print the family.

    Args:
        family: a family file, its directory, or a bundled domain.
        name: name of the run; by default that of the family.
        seed, population, samples, overrides: values that replace those of the family file.
        generations: number of generations; for a resumed run, the generation at which it ends.
        resume: True to resume a run.
        force: True to replace an existing run and its results, as soon as the new run has a generation.
        directory: the directory of all runs.
        workers: number of threads for the learners of an objective.
        require: minimum value of the objective, or without an objective minimum diversity; None for no condition.

    Raises:
        EnvgraphError: the value is below `require`. The run is kept.
    """
    given = {
        "seed": seed,
        "search.generations": generations,
        "search.population": population,
        "samples.count": samples,
    }
    short = as_overrides(given)
    if resume and (len(short) > (generations is not None) or overrides or force):
        raise InvalidArgument("`--resume` allows only --generations: leave the other options out")
    domain = Domain.load(family, overrides=[] if resume else [*short, *overrides])
    path = run_path(directory, name or domain.spec.name)
    total = domain.spec.search.generations
    if resume:
        with RunStore.open(path) as store:
            kept = load_stored_domain(store.bundle(), store.overrides, str(path))
        total = generations or kept.spec.search.generations
    elif path.exists() and not force:
        hint = "resume it with --resume, replace it with --force, or choose another --name"
        raise InvalidArgument(f"{path} exists already: {hint}")
    elif generations is not None and domain.spec.searches_whole_families:
        hint = "leave `--generations` out: only a family file without `[objective]` has generations"
        raise InvalidArgument(
            f"`--generations` is not allowed: `{domain.spec.path}` has an objective for whole families", hint
        )
    is_old = path.exists() and not resume
    whole = not (kept if resume else domain).spec.uses_genetic_algorithm
    try:
        with progress_bar("% of the effort" if whole else "generations", 100 if whole else total) as advance:

            def show_generation(generation: Generation) -> None:
                nonlocal is_old
                is_old = False  # It is replaced with the first generation.
                advance(generation.number, f"diversity {generation.diversity:.3f}")

            def show_climbing(found: CurriculumProgress) -> None:
                known = f"best {found.value:.3f}" if found.value > -inf else "initial families"
                advance(int(100 * found.effort_share), f"{known}, {found.families_judged:,} tried")

            def show_sampling(found: SampleProgress) -> None:
                cells = f" in {found.cells:,} bins" if found.cells > 1 else ""
                advance(int(100 * found.share), f"{found.members:,} members{cells}, {found.attempts:,} tried")

            callbacks: dict[str, Any] = {
                "progress": show_generation,
                "climbing": show_climbing,
                "drawing": show_sampling,
                "workers": workers,
            }
            if resume:
                made = resume_run(path, generations=generations, **callbacks)
            else:
                made = generate_from_domain(domain, path, overwrite=force, warn=print_diagnostics, **callbacks)
    except KeyboardInterrupt:
        if is_old:
            sys.stderr.write(f"interrupted before the first generation: the old run in {path.parent} is unchanged\n")
        elif path.exists():
            words = f"envgraph generate {family} --name {path.parent.name} --directory {directory} --resume"
            sys.stderr.write(f"`{words}` {'starts again' if whole else 'resumes'}\n")
        raise
    with RunStore.open(path) as store:
        low, about = why_low(made, store), describe_search(made, store)
    print_family(made, path, low)
    for line in about:
        print_line(line)
    print_diagnostics([low] if low else [])
    value = Outcome.of(made).diversity if made.value is None else made.value
    if require is not None and not value >= require:
        raise EnvgraphError(f"the family has a value of {value:.3f}, but `--require` is {require:g}")


def run_path(directory: Path, name: str) -> Path:
    """Return the path of the run of this name. Raise `InvalidArgument` if it cannot be the name of a directory."""
    if Path(name).name != name or name == ".." or "\\" in name or "\0" in name:
        raise InvalidArgument(f"`{name}` cannot be the name of a run: leave out `/` and `\\`, or use --directory")
    return directory / name / "run.sqlite"


def show_family(run: str, directory: Path, variant: str | None) -> None:
    """Print the measures and maps of a family; with `variant`, only those of this member.

    For a family of more than 100 members, print only a summary of the measures.
    """
    family = open_family(run, directory)
    members = family.members if variant is None else (family.member(variant),)
    if print_json(
        lambda: {
            "name": family.name,
            **_outcome_data(Outcome.of(family)),
            "members": [_member_data(family, member, full=True) for member in members],
        }
    ):
        return
    if variant is None:
        print_family(family, None)
    if len(members) > SHOWN.rows:
        print_line(f"`--variant {members[0].name}` shows an environment")
        return
    for member in members:
        print_line("")
        print_line("  ".join([member.name, *(" ".join(fact) for fact in format_measures(family, member))]))
        print_lines(family.text(member))


def show_lineage(run: str, directory: Path, variant: str) -> None:
    """Print the rule applications that led to a member of a run, with their matches."""
    family = open_family(run, directory)
    member = family.member(variant)
    with _open_store(run, directory) as store:
        assert member.individual is not None, "members of runs are individuals"
        steps = [
            (step.generation, step.rule, {name: value_text(one) for name, one in step.match.items()})
            for step in lineage(store, family.domain, member.individual)
        ]
    names = ("generation", "rule", "match")
    if print_json(lambda: {"name": member.name, "steps": [dict(zip(names, step, strict=True)) for step in steps]}):
        return
    rows = [
        (str(place), str(generation), rule, ", ".join(f"{name} = {text}" for name, text in match.items()))
        for place, (generation, rule, match) in enumerate(steps, start=1)
    ]
    title = f"{member.name}: {len(rows)} application{'s' * (len(rows) != 1)} of rules from the initial model on"
    print_table(title, ("", "generation", "rule", "at"), rows, (0, 1)) if rows else print_line(title)


def show_rejections(run: str, directory: Path) -> None:
    """Print why candidate models were rejected, the most frequent reason first."""
    with _open_store(run, directory) as store:
        reasons = store.rejection_counts().most_common()
        accepted = sum(row[2] for row in store.generation_statistics())
    if print_json(lambda: {"accepted": accepted, "rejected": dict(reasons)}):
        return
    total = sum(count for _, count in reasons)
    rows = [(f"{count:,}", f"{count / total:.0%}", reason) for reason, count in reasons]
    title = f"{accepted:,} models were accepted, {total:,} attempts rejected"
    print_table(title, ("times", "share", "because"), rows, (0, 1)) if rows else print_line(title)


def _open_store(run: str, directory: Path) -> RunStore:
    if Path(run).suffix == ".json":
        raise InvalidArgument(f"`{run}` is a family file, which does not record how it was generated: name the run")
    return RunStore.open(find_run_store(run, directory))


def import_family(
    file: Path,
    domain: str,
    name: str | None,
    overrides: Sequence[str],
    directory: Path,
    force: bool,
) -> None:
    """Read a ga4cl file, store it as a run, and print its family; `force` replaces an existing run of this name."""
    check_file_format(str(file), ("json",), "a ga4cl family")
    source = read_source(DiskFiles(), str(file))
    path = run_path(directory, name or file.stem)
    family, warnings = import_ga4cl(source, domain, path, overwrite=force, overrides=overrides)
    print_diagnostics(warnings)
    print_family(family, path)


def _member_data(family: Family, member: Member, *, full: bool = False) -> dict[str, Any]:
    data: dict[str, Any] = {"name": member.name, "initial": member.initial, "measures": dict(member.measures)}
    if member.certificates:
        data["certificates"] = dict(member.certificates)
    scene = family.scene(member) if full else None
    if scene is not None:
        data["map"] = scene_text(scene).split("\n")
    return data


def _outcome_data(outcome: Outcome) -> dict[str, Any]:
    """Return the diversity and objective values of a family as JSON-ready data."""
    maximum = outcome.maximum if outcome.maximum < inf else None
    found: dict[str, Any] = {
        "diversity": outcome.diversity,
        "maximum": maximum,
        "bins": list(outcome.bins),
    }
    if outcome.objective:
        found["objective"] = dict(outcome.objective)
    return found


def print_family(family: Family, path: Path | None, low: Diagnostic | None = None) -> None:
    """Print the measures of a family: of each member, or a summary of more than 100."""
    outcome = Outcome.of(family)
    if print_json(
        lambda: {
            "name": family.name,
            "run": str(path) if path else None,
            **_outcome_data(outcome),
            "warning": low.to_dict() if low else None,
            "members": [_member_data(family, member) for member in family.members],
        }
    ):
        return
    if len(family.members) > SHOWN.rows:
        _print_summary(family, outcome)
        if path is not None:
            print_line(f"run: {path.parent}")
        return
    measures, counts = list(family.members[0].measures), family.differing_class_counts()
    certain = [dict(format_certificates(member, family.members)) for member in family.members]
    certificates = dict.fromkeys(name for one in certain for name in one)
    columns = ("environment", *measures, *counts, *certificates, "")
    rows = [
        (
            member.name,
            *(value for _, value in format_measures(family, member)),
            *(str(numbers[place]) for numbers in counts.values()),
            *(certain[place].get(name, "") for name in certificates),
            "initial environment" if member.initial else "",
        )
        for place, member in enumerate(family.members)
    ]
    found = str(outcome) or f"{len(rows)} environments"
    print_table(f"{family.name}: {found}", columns, rows, range(1, len(columns) - 1))
    if path is not None:
        print_line(f"run: {path.parent}")


def _print_summary(family: Family, outcome: Outcome) -> None:
    """Print a table with quantiles of each measure over the members."""
    names = ("measure", "least", "quarter", "half", "three quarters", "most", "different")
    rows = []
    for name in family.members[0].measures:
        values = sorted(member.measures[name] for member in family.members)
        shown = [values[round(share * (len(values) - 1))] for share in (0, 0.25, 0.5, 0.75, 1)]
        rows.append((name, *format_measure(shown), f"{len(set(values)):,}"))
    title = ", ".join(filter(None, (f"{family.name}: {len(family.members):,} environments", str(outcome))))
    print_table(title, names, rows, range(1, len(names)))


def run_directory(run: str, directory: Path) -> Path:
    """Return the directory for results about a run or family: that of the run, or the family file without `.json`."""
    path = Path(run)
    if path.suffix == ".json":
        return path.with_suffix("")
    return find_run_store(run, directory).parent
