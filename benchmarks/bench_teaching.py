"""Search for families that teach, and judge them on new seeds, beside other ways to train.

    python -m benchmarks teaching

The search asks how often learners solve the target. Of random targets a quarter to two fifths of the tiles burn (a
quarter on 12x12), and a random walk of 200 steps finds the goal once in 100,000 episodes or less (500,000 on 12x12).
Beside each family stand controls with as many steps: direct training from values of 0 and from optimistic ones, the
order reversed, and domain randomisation. Seconds are those of all threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory
from time import process_time
from typing import NamedTuple

import numpy as np

from benchmarks._peers import peer
from envgraph.env.compiled import explored
from envgraph.errors import LoadError
from envgraph.lang import data_path
from envgraph.learn import (
    FamilyMember,
    TrainingSettings,
    controls,
    optimistic_values,
    run_experiment,
    sequences,
    wilson_interval,
)
from envgraph.search import Domain, Family, generate
from envgraph.solve import hit_probability

PEERS = ("numba",)
COMPARED = "direct", "optimistic", "reversed", "randomised"
BUNDLED = data_path("rules", "burning_forest")
FIXED = '"startTileFixedLocation", "goalTileFixedLocation", "waterTileFixedLocation", '


class Sizes(NamedTuple):
    """How much is searched and judged.

    Attributes:
        seeds: on which each order is judged.
        bundled: for each family a name, its file and the lengths of training that it is judged at.
        random: for each random target the arguments of `target` and a length of training.
        effort: settings that limit every search.
    """

    seeds: int
    bundled: tuple[tuple[str, Path, tuple[int, ...]], ...]
    random: tuple[tuple[int, int, tuple[float, float], float, int], ...]
    effort: tuple[str, ...]


FULL = Sizes(
    1_000,
    (
        ("paper's E6, 2k", BUNDLED / "teaching.toml", (1_500, 2_000)),
        ("paper's E6, each of five", BUNDLED / "budgets.toml", (3_000, 5_000, 10_000, 20_000, 50_000)),
        ("keydoor", data_path("rules", "keydoor") / "family.toml", (200, 600)),
        ("network", data_path("rules", "network") / "family.toml", (500,)),
        ("sokoban", data_path("rules", "sokoban") / "family.toml", (3_000,)),
    ),
    (
        (8, 0, (0.25, 0.4), 1e-5, 10_000),
        (8, 1, (0.25, 0.4), 1e-5, 10_000),
        (12, 100, (0.25, 0.25), 2e-6, 20_000),
    ),
    (),
)
QUICK = Sizes(2, FULL.bundled[:1], FULL.random[:1], ("objective.effort=1e6",))


def main(sizes: Sizes) -> None:
    """Print a line for each family and each length of training that it is judged at."""
    if peer("numba") is None:
        return
    print(
        f"{'target':26}{'entropy':>8}{'search s':>9}{'steps':>7}  success  95 % interval"
        + "".join(f"{name:>12}" for name in COMPARED)
    )
    for name, path, lengths in sizes.bundled:
        show(name, path, (), lengths, sizes)
    for size, seed, fire, hit, steps in sizes.random:
        settings = ("objective.lanes=2", "objective.effort=2e9", f"objective.steps=[{steps}]")
        with target(size, seed, fire, hit) as path:
            show(f"random {size}x{size}, {seed}", path, settings, (steps,), sizes)


def show(name: str, path: Path, overrides: tuple[str, ...], lengths: tuple[int, ...], sizes: Sizes) -> None:
    """Search for a family, and judge it at some lengths of training."""
    with TemporaryDirectory() as folder:
        started = process_time()
        family = generate(
            str(path), Path(folder) / "run.sqlite", overrides=(*overrides, *sizes.effort), workers=2
        )
        spent = process_time() - started
        for steps in lengths:
            order, *others = successes(family, steps, sizes.seeds)
            low, high = wilson_interval(order, sizes.seeds)
            print(
                f"{name:26}{family.diversity():8.3f}{spent:9.0f}{steps:7,}{order:9.3f}   {low:.3f} to {high:.3f}"
                + "".join(f"{rate:12.3f}" for rate in others)
            )


def successes(family: Family, steps: int, seeds: int) -> list[float]:
    """Success of the order, and of what it is compared with, which has as many steps."""
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names = [one.name for one in members]
    own = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    settings = replace(own, steps_per_environment=steps)
    optimism = optimistic_values(family.explored(family.members[-1]).tabular, settings)
    compared = *sequences(names, "full"), *controls(names, COMPARED, optimism=optimism)
    found = run_experiment(members, settings, compared, seeds=range(seeds), backend="numba")
    return [
        one.success_rate
        for one in found.best_optimistic().summaries()
        if one.label.split()[0] in (compared[0].label, names[-1], *COMPARED)
    ]


@contextmanager
def target(size: int, seed: int, fire: tuple[float, float], hit: float) -> Iterator[Path]:
    """Give a family file whose target is random and hard.

    Args:
        size: tiles on a side.
        seed: of the random numbers.
        fire: the least and the greatest share of tiles that burn.
        hit: the greatest probability that a random walk finds the goal.
    """
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
