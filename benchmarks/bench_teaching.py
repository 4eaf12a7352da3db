"""Families that teach: searched for by how often learners solve the target, judged on seeds that nothing has seen.

    python -m benchmarks.bench_teaching [targets of 8x8] [targets of 12x12]

Targets are random: a quarter to two fifths of the tiles burn (a quarter on 12x12), and a random walk of 200 steps finds
the goal once in 100,000 episodes or less (500,000 on 12x12). Beside each family stand controls with as many steps:
direct training from values of 0 and from optimistic ones, the order reversed, and domain randomisation. Seconds are
those of all threads.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from envgraph.env.compiled import explored
from envgraph.errors import LoadError
from envgraph.lang import data_path
from envgraph.learn import (
    FamilyMember,
    TrainingSettings,
    controls,
    optimistic_value,
    run_experiment,
    sequences,
    wilson_interval,
)
from envgraph.search import Domain, Family, generate
from envgraph.solve import hit_probability

SEEDS = 1_000
COMPARED = "direct", "optimistic", "reversed", "randomised"
BUNDLED = data_path("rules", "burning_forest")
FIXED = '"startTileFixedLocation", "goalTileFixedLocation", "waterTileFixedLocation", '


def main(targets: int = 2, large: int = 1) -> None:
    """Print a line for each family and each length of training that it is judged at."""
    print(
        f"{'target':26}{'entropy':>8}{'search s':>9}{'steps':>7}  success  95 % interval"
        + "".join(f"{name:>12}" for name in COMPARED)
    )
    show("paper's E6, 2k", BUNDLED / "teaching.toml", (), (1_500, 2_000))
    lengths = (3_000, 5_000, 10_000, 20_000, 50_000)
    show("paper's E6, each of five", BUNDLED / "budgets.toml", (), lengths)
    for name, lengths in (("keydoor", (200, 600)), ("network", (500,)), ("sokoban", (3_000,))):
        show(name, data_path("rules", name) / "teaching.toml", (), lengths)
    free = ("objective.lanes=2", "objective.effort=2e9")
    for number in range(targets):
        with target(8, number, (0.25, 0.4), 1e-5) as path:
            show(f"random 8x8, {number}", path, (*free, "objective.steps=[10_000]"), (10_000,))
    for number in range(large):
        with target(12, 100 + number, (0.25, 0.25), 2e-6) as path:
            show(f"random 12x12, {100 + number}", path, (*free, "objective.steps=[20_000]"), (20_000,))


def show(name: str, path: Path, overrides: tuple[str, ...], lengths: tuple[int, ...]) -> None:
    """Search for a family, and judge it at some lengths of training."""
    with TemporaryDirectory() as folder:
        started = process_time()
        family = generate(str(path), Path(folder) / "run.sqlite", overrides=overrides, workers=2)
        spent = process_time() - started
        for steps in lengths:
            order, *others = successes(family, steps)
            low, high = wilson_interval(order, SEEDS)
            print(
                f"{name:26}{family.diversity():8.3f}{spent:9.0f}{steps:7,}{order:9.3f}   {low:.3f} to {high:.3f}"
                + "".join(f"{rate:12.3f}" for rate in others)
            )


def successes(family: Family, steps: int) -> list[float]:
    """Success of the order, and of what it is compared with, which has as many steps."""
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names = [one.name for one in members]
    own = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    settings = replace(own, steps_per_environment=steps)
    optimism = optimistic_value(family.explored(family.members[-1]).tabular, settings)
    compared = *sequences(names, "full"), *controls(names, COMPARED, optimism=optimism or 0.0)
    runs = run_experiment(members, settings, compared, seeds=range(SEEDS), backend="numba").runs
    return [
        float(np.mean([run.success_rate for run in runs if run.label == one.label]))
        for one in compared
        if one.label in (compared[0].label, names[-1], *COMPARED)
    ]


@contextmanager
def target(size: int, seed: int, fire: tuple[float, float], hit: float) -> Iterator[Path]:
    """A family file whose target is random and hard."""
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as folder:
        for file in BUNDLED.glob("burning_forest.*"):
            copy(file, folder)
        path = Path(folder) / "teaching.toml"
        text = (BUNDLED / "teaching.toml").read_text().replace("target_8x8", "target").replace(FIXED, "")
        path.write_text(text.replace('diversity = "maximum"', ""))
        while True:
            (Path(folder) / "target.model").write_text(model(size, rng, rng.uniform(*fire)))
            try:
                domain = Domain.load(str(path))
                domain.check_initial()
            except LoadError:  # no way to the goal
                continue
            behaviour = domain.behaviour
            assert behaviour is not None
            table = explored(domain.engine(), behaviour, domain.keys()).tabular
            if hit_probability(table) <= hit:
                yield path
                return


def model(size: int, rng: np.random.Generator, fire: float) -> str:
    """A grid, of which a share burns, and some of the rest is vegetation."""
    vegetation, (x, y) = rng.uniform(0.2, 0.5), rng.integers(1, size - 1, 2)
    rows = [
        ["B" if rng.random() < fire else "V" if rng.random() < vegetation else "R" for _ in range(size)]
        for _ in range(size)
    ]
    rows[0][0], rows[-1][-1], rows[y][x] = "S", "G", "W"
    grid = "\n".join("".join(row) for row in rows)
    return f"""import "burning_forest.metamodel"
model target : burning_forest {{
    forest : Forest {{
        states = grid tile {{ column x next right row y next down rows \"\"\"
{grid}
\"\"\" }}
        agent = truck : FireTruck {{ currentState = tile[0, 0] }}
    }}
}}
"""


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
