"""Train the paper's family, its random families, and families of our own, with many seeds."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean, pstdev
from tempfile import TemporaryDirectory
from time import process_time
from typing import Final

from envgraph.code import dataclass
from envgraph.env.compiled import TableBuilder
from envgraph.errors import InvalidArgument, Source
from envgraph.files import replace_file
from envgraph.lang import data_path
from envgraph.learn import (
    Curriculum,
    Experiment,
    FamilyMember,
    TrainingSettings,
    controls,
    optimistic_values,
    run_experiment,
    sequences,
)
from envgraph.report.reproduction._published import BUDGETS, TIMES, published_files
from envgraph.search import Family, generate, import_ga4cl
from envgraph.solve.learning import Backend, choose_backend

FAMILY: Final = "burning_forest/paper.toml"

CURVE_POINTS: Final = 20
"""Number of points of a learning curve on each environment."""

Progress = Callable[[str, int, int], None]
"""A callback that gets the name of the current task, the number of parts done, and the number of all parts."""


@dataclass(frozen=True, slots=True)
class FamilySample:
    """The results of agents that were each trained on one family of a set.

    Attributes:
        success, returns: success and return on the target; for each family the mean over its agents.
        agents: the number of agents for each family.
        steps, reward, spread: the learning curves: mean and standard deviation over the families of the cumulative
            reward up to a step.
    """

    success: tuple[float, ...]
    returns: tuple[float, ...]
    agents: int
    steps: tuple[int, ...]
    reward: tuple[float, ...]
    spread: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class BudgetResults:
    """The results of training with one budget.

    Attributes:
        steps: training steps for each environment.
        experiment: the published family: its suffixes, its environments alone, and controls.
        samples: "random" and "ordered": the 30 published random families as generated and by complexity; "own" and
            "own, reversed": families generated with the paper's configuration, one for each seed.
    """

    steps: int
    experiment: Experiment
    samples: Mapping[str, FamilySample]


@dataclass(frozen=True, slots=True)
class Reproduction:
    """All results of training and measuring.

    Attributes:
        family: the published family.
        seeds: the number of training seeds of the published family, and of families of our own.
        budgets: the results by budget, the smallest first.
        diversity: entropy of each family of our own, in bits.
        times: CPU seconds of `generation_times`; {} if not measured.
    """

    family: Family
    seeds: int
    budgets: tuple[BudgetResults, ...]
    diversity: tuple[float, ...]
    times: Mapping[int, Mapping[int, float]]


def reproduce(
    *,
    seeds: int = 200,
    budgets: Sequence[int] = BUDGETS,
    times: bool = True,
    workers: int = 1,
    progress: Progress = lambda what, done, total: None,
) -> Reproduction:
    """Train agents on the published family with its controls, on the published random families, and on our own.

    Each of the 30 random families gets a tenth of the seeds, at least one. Equal arguments give equal results, except
    for the times.

    Args:
        seeds: the number of agents for each curriculum, and of searches for families of our own.
        budgets: training steps for each environment.
        times: measure the time that generating families takes.
        workers: the number of agents that learn at a time; changes no result.
        progress: a callback that is called from time to time.

    Raises:
        InvalidArgument: a number is not positive.
    """
    if seeds < 1 or not budgets or min(budgets) < 1:
        raise InvalidArgument("`seeds` and `budgets` must be positive")
    with TemporaryDirectory() as folder:
        file, files = published_files()
        published = _import_family(file, Path(folder) / "published.sqlite")
        drawn = []
        for place, source in enumerate(files):
            progress("published random families", place, len(files))
            drawn.append(_import_family(source, Path(folder) / f"random {place}.sqlite"))
        own = []
        for seed in range(seeds):
            progress("families of our own", seed, seeds)
            own.append(generate(FAMILY, Path(folder) / f"own {seed}.sqlite", seed=seed))
        made_of = partial(_members_with_tables, TableBuilder(published.behaviour))
        families = {
            "random": [made_of(family, in_file_order=True) for family in drawn],
            "ordered": [made_of(family) for family in drawn],
            "own": [made_of(family) for family in own],
        }
        families["own, reversed"] = [[*one[-2::-1], one[-1]] for one in families["own"]]
        members = made_of(published)
        trained = [_train_budget(steps, members, families, seeds, workers, progress) for steps in sorted({*budgets})]
        diversity = tuple(family.diversity() for family in own)
    return Reproduction(published, seeds, tuple(trained), diversity, generation_times(progress) if times else {})


def _import_family(file: Source, store: Path) -> Family:
    return import_ga4cl(file, FAMILY, store)[0]


def _members_with_tables(tables: TableBuilder, family: Family, *, in_file_order: bool = False) -> list[FamilyMember]:
    """Return the members of a family with tables, by complexity or, if `in_file_order`, in the order of the file."""
    found = sorted(family.members, key=lambda one: one.individual or 0) if in_file_order else family.members
    engines = [family.domain.engine(family.model(one)) for one in found]
    return [
        FamilyMember(f"E{place}", tables.build(engine, family.keys)) for place, engine in enumerate(engines, start=1)
    ]


def _train_budget(
    steps: int,
    published: Sequence[FamilyMember],
    families: Mapping[str, Sequence[Sequence[FamilyMember]]],
    seeds: int,
    workers: int,
    progress: Progress,
) -> BudgetResults:
    settings = TrainingSettings(steps_per_environment=steps, checkpoint=max(steps // CURVE_POINTS, 1))
    names = [member.name for member in published]
    optimism = optimistic_values(published[-1].tabular, settings)  # type: ignore[arg-type]
    chosen: dict[tuple[str, str], Curriculum] = {}
    for one in (
        *sequences(names, "suffixes"),
        *sequences(names, "baselines"),
        *controls(names, optimism=optimism),
    ):
        chosen.setdefault((one.kind, one.label), one)
    label = f"{steps:,} steps an environment"
    experiment = run_experiment(
        published,
        settings,
        [*chosen.values()],
        seeds=range(seeds),
        workers=workers,
        progress=lambda done, total: progress(f"published family, {label}", done, total),
    )
    samples = {}
    for name, sample in families.items():
        agents = 1 if name.startswith("own") else max(seeds // 10, 1)
        backend = choose_backend("auto", len(sample) * agents * len(published) * steps, settings)
        found = []
        for place, family in enumerate(sample):
            progress(f"{name} families, {label}", place, len(sample))
            first = place if agents == 1 else 0
            found.append(_train_on_family(family, settings, range(first, first + agents), backend))
        samples[name] = _summarize_sample(found, agents)
    return BudgetResults(steps, experiment, samples)


def _train_on_family(
    family: Sequence[FamilyMember], settings: TrainingSettings, seeds: Sequence[int], backend: Backend
) -> Experiment:
    """Return the results of agents that are trained on all members of a family, in order."""
    names = [member.name for member in family]
    order = Curriculum("curriculum", "whole", tuple(names), (1,) * len(names))
    return run_experiment(family, settings, [order], seeds=seeds, backend=backend)


def _summarize_sample(found: Sequence[Experiment], agents: int) -> FamilySample:
    curves = [
        [fmean(rewards) for rewards in zip(*(run.curve.reward for run in one.runs), strict=True)] for one in found
    ]
    return FamilySample(
        success=tuple(fmean(run.success_rate for run in one.runs) for one in found),
        returns=tuple(fmean(run.mean_return for run in one.runs) for one in found),
        agents=agents,
        steps=tuple(found[0].runs[0].curve.steps),
        reward=tuple(map(fmean, zip(*curves, strict=True))),
        spread=tuple(map(pstdev, zip(*curves, strict=True))),
    )


def generation_times(
    progress: Progress = lambda what, done, total: None,
    *,
    sizes: Sequence[int] = tuple(TIMES[6]),
    populations: Sequence[int] = tuple(TIMES),
    generations: int = 1_000,
) -> dict[int, dict[int, float]]:
    """Return the CPU seconds of all threads for the generations of a run, by population and map size.

    The runs use the paper's configuration. The paper's larger maps were not published: E6 is put into the upper left
    corner of roads with the goal in the opposite corner. As in the paper, the run continues after the diversity reaches
    its maximum.
    """
    found: dict[int, dict[int, float]] = {population: {} for population in populations}
    with TemporaryDirectory() as folder:
        for place, (population, size) in enumerate((one, other) for one in populations for other in sizes):
            progress("time of generation", place, len(sizes) * len(populations))
            _write_forest(Path(folder), size)
            started = process_time()
            generate(
                f"{folder}/paper.toml",
                Path(folder) / "run.sqlite",
                population=population,
                generations=generations,
                overrides=["search.target=false", 'constraints.require=["solvable", "truckOnStart"]'],
            ).diversity()
            found[population][size] = process_time() - started
            (Path(folder) / "run.sqlite").unlink()
    return found


def _write_forest(folder: Path, size: int) -> None:
    """Write the files of the domain to a folder, with a target of `size` x `size` tiles."""
    for file in data_path("rules", FAMILY).parent.glob("*.*"):
        text = file.read_text("utf-8")
        if file.name == "target_8x8.model":
            text = re.sub(r"(?m)^( +[A-Z]{8}\n)+", lambda rows: _grow_map(rows[0], size), text)
        replace_file(folder / file.name, text)


def _grow_map(text: str, size: int) -> str:
    r"""Return rows of letters, extended to `size` with roads; the goal moves to the lower right corner.

    >>> _grow_map("  SV\n  VG\n", 3)
    '  SVR\n  VRR\n  RRG\n'
    """
    rows = text.replace("G", "R").splitlines()
    indent = rows[0][: len(rows[0]) - len(rows[0].lstrip())]
    tiles = [row.strip().ljust(size, "R") for row in rows]
    tiles += ["R" * size] * (size - len(tiles))
    tiles[-1] = tiles[-1][:-1] + "G"
    return "".join(f"{indent}{row}\n" for row in tiles)
