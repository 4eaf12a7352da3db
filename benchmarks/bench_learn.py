"""Train on curricula: speed of both loops, and how often published and other curricula succeed.

    python -m benchmarks learn

The maps are those in `envgraph/report/reproduction/data`. Expected figures come from a re-implementation of the
published trainer and are printed beside ours; a success rate over n seeds has a standard deviation of
sqrt(p (1 - p) / n).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np

from envgraph.env import Tabular
from envgraph.learn import (
    FamilyMember,
    Summary,
    TrainingSettings,
    available_backends,
    chain_transfer,
    run_experiment,
    sequences,
    train_curriculum,
)
from envgraph.solve.learning import Backend
from tests.unit.learn.forest_tables import DATA, family, published_family

PUBLISHED_LOOP = 0.11e6
BACKEND = available_backends()[0]
PEERS = ("numba",)


class Sizes(NamedTuple):
    """How much is trained.

    Attributes:
        steps: on each environment, to measure the speed of each backend.
        reproduction: seeds of the paper's table.
        budgets: seeds of each length of training.
        random: seeds of each random family.
        families: how many of the 30 random families.
        break_even: whether to measure in new processes from how many steps on compiling pays.
    """

    steps: dict[str, int]
    reproduction: int
    budgets: int
    random: int
    families: int
    break_even: bool


FULL = Sizes(
    {"numba": 1_000_000, "python": 100_000},
    reproduction=20,
    budgets=200,
    random=50,
    families=30,
    break_even=True,
)
QUICK = Sizes({"numba": 1_000, "python": 1_000}, reproduction=1, budgets=1, random=2, families=3, break_even=False)


def main(sizes: Sizes) -> None:
    """Print every table."""
    print_speed(sizes.steps)
    if sizes.break_even:
        print_break_even(sizes.steps)
    print_reproduction(sizes.reproduction)
    print_budgets(sizes.budgets)
    print_random_families(sizes.random, sizes.families)


def print_speed(steps: dict[str, int]) -> None:
    """Steps a second on the published family; the second of two runs, so without compilation."""
    tabulars = published_family()
    print(f"{'training loop':24}{'million steps/s':>16}{'x the published loop':>22}")
    for backend in reversed(available_backends()):
        settings = TrainingSettings(steps_per_environment=steps[backend])
        for _ in range(2):
            started = perf_counter()
            train_curriculum(tabulars, settings, np.random.default_rng(1), backend=backend)
            rate = len(tabulars) * settings.steps_per_environment / (perf_counter() - started)
        print(f"{backend:24}{rate / 1e6:16.1f}{rate / PUBLISHED_LOOP:22.0f}")
    print()


def print_break_even(steps: dict[str, int]) -> None:
    """Print the number of steps from which importing numba pays, with compiling the loop and with loading it."""
    if BACKEND != "numba":
        return
    print(f"{'break-even, million steps':28}{'nothing compiled yet':>22}{'compiled before':>18}")
    for label, settings in {
        "q_learning": {},
        "sarsa": {"agent": "sarsa"},
        "random ties": {"ties": "random"},
    }.items():
        slow = seconds_of({**settings, "steps_per_environment": steps["python"]}, "python") / steps["python"]
        with TemporaryDirectory() as cache:
            costs = [seconds_of(settings | {"steps_per_environment": 1}, "numba", cache) for _ in range(2)]
        print(f"{label:28}" + "".join(f"{cost / slow / 1e6:>{w}.2f}" for cost, w in zip(costs, (22, 18), strict=True)))
    print()


def seconds_of(settings: dict[str, Any], backend: Backend, cache: str | None = None) -> float:
    """Return the processor time of training on the target of the published family, in a new process."""
    environment = os.environ | ({"ENVGRAPH_CACHE": cache} if cache else {})
    code = f"from benchmarks.bench_learn import train_alone; train_alone({settings!r}, {backend!r})"
    found = subprocess.run([sys.executable, "-c", code], env=environment, check=True, stdout=subprocess.PIPE)
    return float(found.stdout)


def train_alone(settings: dict[str, Any], backend: Backend) -> None:
    """Train an agent, and print the processor time in seconds."""
    tabulars = published_family()[-1:]
    started = process_time()
    train_curriculum(tabulars, TrainingSettings(**settings), np.random.default_rng(1), backend=backend)
    print(process_time() - started)


def print_reproduction(seeds: int) -> None:
    """The paper's table: 50,000 steps an environment, evaluated on the target."""
    members = named(published_family())
    started = perf_counter()
    found = run_experiment(members, TrainingSettings(), seeds=range(seeds), backend=BACKEND)
    elapsed = perf_counter() - started
    steps = sum(run.steps for run in found.runs)
    print(f"published family, 50,000 steps an environment, {seeds} seeds ({steps:,} steps in {elapsed:.1f} s)")
    print(f"{'':24}{'success':>10}{'95 % interval':>16}{'return':>10}")
    for one in found.summaries():
        low, high = one.success_interval
        label = f"{one.kind} {one.label}"
        print(f"{label:24}{one.success_rate:10.2f}{f'{low:.2f} - {high:.2f}':>16}{one.mean_return:10.2f}")
    print()


def print_budgets(seeds: int) -> None:
    """Success on the target at several budgets, of the curriculum and of direct training, plain and optimistic."""
    members = named(published_family())
    names = [member.name for member in members]
    plain, optimistic = TrainingSettings(), TrainingSettings(initial_value=1.0)
    cases = (
        (
            "curriculum E1-E6",
            plain,
            "full",
            {2_000: 0.0, 5_000: 0.0, 10_000: 0.47, 20_000: 0.97, 50_000: 1.0},
        ),
        ("E6 alone", plain, "direct", {2_000: 0.0, 5_000: 0.0, 10_000: 0.0, 20_000: 0.0, 50_000: 0.0}),
        ("E6 alone, Q0 = 1", optimistic, "direct", {2_000: 0.22, 3_000: 1.0, 5_000: 1.0, 10_000: 1.0}),
    )
    print(f"success by steps an environment, {seeds} seeds (expected)")
    for label, settings, kind, expected in cases:
        cells = []
        for steps, figure in expected.items():
            budget = replace(settings, steps_per_environment=steps)
            found = run_experiment(members, budget, sequences(names, kind), seeds=range(seeds), backend=BACKEND)
            cells.append(f"{steps // 1000}k {found.summaries()[0].success_rate:.2f} ({figure:.2f})")
        print(f"{label:24}" + "   ".join(cells))
    print()


def print_random_families(seeds: int, count: int) -> None:
    """Print how often random published families succeed, and what chain transfer says of them."""
    names = sorted(path.name for path in (DATA / "random-families").glob("*.json"))[:count]
    families = [family(f"random-families/{name}") for name in names]
    chain_transfer(published_family())  # imports what it needs
    started = perf_counter()
    transfers = [chain_transfer(tabulars) for tabulars in [*families, published_family()]]
    each = 1e3 * (perf_counter() - started) / len(transfers)
    print(f"{count} published random families, ordered, {seeds} seeds; chain transfer takes {each:.1f} ms a family")
    for steps, expected in ((10_000, 0.09), (50_000, 0.55)):
        settings = TrainingSettings(steps_per_environment=steps)
        successes = [success(tabulars, settings, seeds) for tabulars in [*families, published_family()]]
        correlation = spearman(transfers, successes)
        print(
            f"  {steps:,} steps: mean success {fmean(successes[:-1]):.2f} ({expected:.2f});"
            f" rank correlation with chain transfer, published family included, {correlation:.2f}"
        )


def named(tabulars: Sequence[Tabular]) -> list[FamilyMember]:
    """The members of a family, called E1, E2, ..."""
    return [FamilyMember(f"E{number}", tabular) for number, tabular in enumerate(tabulars, start=1)]


def success(tabulars: Sequence[Tabular], settings: TrainingSettings, seeds: int) -> float:
    """How many seeds succeed on the last environment after the whole curriculum."""
    members = named(tabulars)
    curricula = sequences([member.name for member in members], "full")
    found: tuple[Summary, ...] = run_experiment(
        members, settings, curricula, seeds=range(seeds), backend=BACKEND
    ).summaries()
    return found[0].success_rate


def spearman(one: Sequence[float], other: Sequence[float]) -> float:
    """Rank correlation; equal values share the mean of their ranks."""
    return float(np.corrcoef(ranks(one), ranks(other))[0, 1])


def ranks(values: Sequence[float]) -> list[float]:
    """Rank of each value from 0, counting equal ones by half."""
    array = np.array(values)
    return [float((array < value).sum() + ((array == value).sum() - 1) / 2) for value in values]
