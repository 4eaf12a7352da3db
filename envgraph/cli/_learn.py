"""`envgraph train` and `report`."""

from __future__ import annotations

import platform
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from envgraph import __version__
from envgraph.cli._family import run_directory
from envgraph.cli._output import OutputFormat, print_json, print_table, progress_bar
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.learn import (
    Curriculum,
    Experiment,
    FamilyMember,
    TrainingSettings,
    read_csv,
    run_experiment,
    run_stages,
    sequences,
    write_csv,
)
from envgraph.report import family_report, render_html, stage_table
from envgraph.search import Family, RunStore, open_family, run_file

_KINDS = ("suffixes", "full", "baselines", "direct")


def train_agents(
    run: str,
    directory: Path,
    *,
    steps: int | None,
    seeds: int | None,
    curricula: str,
    workers: int,
    format: OutputFormat,
) -> None:
    """Train, evaluate, write CSV files, and print a summary."""
    family = open_family(run, directory)
    chosen = _curricula(family, curricula)
    settings = _settings(family, steps, seeds)
    members = _members(family)
    with progress_bar("agents", None) as advance:
        experiment = run_experiment(
            members,
            settings,
            chosen,
            workers=workers,
            progress=lambda done, total: advance(done, f"of {total}"),
        )
    with progress_bar("agents along the curriculum", None) as advance:
        stages = run_stages(
            members, settings, workers=workers, progress=lambda done, total: advance(done, f"of {total}")
        )
    target = run_directory(run, directory) / "training"
    write_csv(experiment, target)
    write_csv(stages, target / "stages")
    _print_summary(family, experiment, target, format)


def write_report(run: str, directory: Path, output: Path | None) -> None:
    """Write the page, and print the short table."""
    family = open_family(run, directory)
    base = run_directory(run, directory)
    experiment, stages = _read(base / "training"), _read(base / "training" / "stages")
    history: list[tuple[int, float, int, int]] = []
    if Path(run).suffix != ".json":
        with RunStore.open(run_file(run, directory)) as store:
            history = store.history()
    page = family_report(
        family, history=history, experiment=experiment, stages=stages, facts=_facts(family, experiment)
    )
    path = output or base / "report.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(render_html(page), encoding="utf-8")
    table = stage_table(family, stages, experiment)
    print_table(family.name, table.columns, table.rows, table.numeric)
    print(f"report: {path}")


def _read(directory: Path) -> Experiment | None:
    """The results in a directory, or None where nothing has been trained."""
    return read_csv(directory) if (directory / "runs.csv").is_file() else None


def _members(family: Family) -> list[FamilyMember]:
    """The environments as tables; this enumerates their states."""
    order = str(family.domain.spec.curriculum.order or family.domain.spec.diversity.options["of"])
    with progress_bar("environments", len(family.members)) as advance:
        members = []
        for place, member in enumerate(family.members, start=1):
            members.append(FamilyMember(member.name, family.explored(member).tabular, member.measures[order]))
            advance(place, member.name)
    return members


def _settings(family: Family, steps: int | None, seeds: int | None) -> TrainingSettings:
    settings = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    return replace(
        settings,
        steps_per_environment=steps or settings.steps_per_environment,
        seeds=seeds or settings.seeds,
    )


def _curricula(family: Family, kinds: str) -> list[Curriculum]:
    names = [member.name for member in family.members]
    wanted = [kind.strip() for kind in kinds.split(",")] if kinds != "all" else ["suffixes", "baselines"]
    chosen: dict[tuple[str, str], Curriculum] = {}
    for kind in wanted:
        if kind not in _KINDS:
            hint = did_you_mean(kind, _KINDS) or f"there are all, {', '.join(_KINDS)}"
            raise InvalidArgument(f"unknown curricula `{kind}`; {hint}")
        for one in sequences(names, kind):  # type: ignore[arg-type]
            chosen.setdefault((one.kind, one.label), one)
    return list(chosen.values())


def _print_summary(family: Family, experiment: Experiment, directory: Path, format: OutputFormat) -> None:
    summaries = experiment.summaries()
    if format is OutputFormat.JSON:
        results = [
            {
                "kind": one.kind,
                "label": one.label,
                "seeds": one.runs,
                "success_rate": one.success_rate,
                "success_interval": list(one.success_interval),
                "mean_return": one.mean_return,
            }
            for one in summaries
        ]
        print_json({"name": family.name, "directory": str(directory), "results": results})
        return
    rows = [
        (
            f"{one.kind} {one.label}",
            str(one.runs),
            f"{one.success_rate:.0%}",
            f"{one.success_interval[0]:.0%} to {one.success_interval[1]:.0%}",
            f"{one.mean_return:.2f}",
        )
        for one in summaries
    ]
    columns = ("trained on", "seeds", "success", "95 % interval", "return")
    print_table(f"{family.name}: agents on {family.members[-1].name}", columns, rows, (1, 2, 3, 4))
    print(f"results: {directory}")


def _facts(family: Family, experiment: Experiment | None) -> dict[str, str]:
    spec = family.domain.spec
    facts = {
        "family file": spec.path,
        "seed": str(spec.seed),
        "population": str(spec.search.population),
        "generations": str(spec.search.generations),
        "envgraph": __version__,
        "Python": platform.python_version(),
        "NumPy": version("numpy"),
    }
    if experiment is not None:
        runs = experiment.runs
        facts["training steps"] = (
            f"{min(run.steps for run in runs)} to {max(run.steps for run in runs)} an agent"
        )
        facts["training seeds"] = f"{min(run.seed for run in runs)} to {max(run.seed for run in runs)}"
    return facts
