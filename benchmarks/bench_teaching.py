"""Search for families that teach, and judge them with new agents, beside controls with as many steps.

    python -m benchmarks teaching

Targets are drawn at random by `benchmarks/_targets.py`; nobody has chosen a setting of the search on them. A line for
each search names the target, the seed of the search, the CPU seconds of the search (all threads), members, steps in
all, and the success of new agents: of the family, and of the best control of each kind. Then follow tables: the least
success, and the mean difference between the family and each control. The interval of that mean has targets as units;
the searches of a target are averaged first, and the agents of a search before that. The full form takes hours; the
tables of docs/evidence/families.md say which part of it they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from time import process_time
from typing import NamedTuple

from benchmarks._peers import peer
from benchmarks._targets import DRAWN, Target, forest, known, written
from envgraph.env import Tabular
from envgraph.lang import data_path
from envgraph.learn import (
    FamilyMember,
    TrainingSettings,
    controls,
    mean_test,
    optimistic_values,
    other_starts,
    run_experiment,
    sequences,
)
from envgraph.search import Family, generate

PEERS = ("numba",)
KINDS = "direct", "optimistic", "reversed", "randomised", "backplay", "exploring"
WAYS = "the order", *KINDS[:4], "backplay", "backplay, stages", "exploring"
BUNDLED = data_path("rules", "burning_forest")
GOOD = 0.95
TOTALS = tuple(round(300 * 1.25**step) for step in range(30))
FIRST = 1_000
"""The first seed of agents; the searches draw what their learners do from other streams."""


class Part(NamedTuple):
    """Searches that are reported together.

    Attributes:
        name: of the part.
        targets: a family file, or a target that is drawn.
        searches: seeds of the search.
        lengths: steps on each member that agents are trained for; (): as many as the search has chosen.
        overrides: settings of the search.
        agents: new agents of each way to train.
    """

    name: str
    targets: tuple[Path | Target, ...]
    searches: tuple[int, ...]
    lengths: tuple[int, ...] = ()
    overrides: tuple[str, ...] = ()
    agents: int = 100


class Row(NamedTuple):
    """What came of a search at a length of training.

    Attributes:
        part: its name.
        target: its name.
        search: the seed of the search.
        seconds: CPU seconds of the search.
        members: of the family, the target included.
        steps: in all.
        searched: whether the search found something better than the reverse curriculum.
        success: of each of `WAYS` that there is; of several controls of a kind that of the best.
        backplay_steps: the fewest steps in all of `TOTALS` with which backplay has `GOOD`; 0 where none has.
    """

    part: str
    target: str
    search: int
    seconds: float
    members: int
    steps: int
    searched: bool
    success: Mapping[str, float]
    backplay_steps: int = 0


FIVE, TWO = tuple(range(1, 6)), (1, 2)
SHORT = ("objective.effort=300_000_000",)

FULL = (
    Part("E6, 2,000 steps", (BUNDLED / "teaching.toml",), tuple(range(1, 11)), (2_000,), agents=200),
    Part(
        "E6, three budgets",
        (BUNDLED / "budgets.toml",),
        tuple(range(1, 11)),
        (3_000, 5_000, 10_000),
        agents=200,
    ),
    Part("forest 8x8", tuple(forest(8, 0.3, seed) for seed in range(2001, 2011)), FIVE),
    Part("forest 12x12", tuple(forest(12, 0.25, seed) for seed in range(2001, 2006)), FIVE),
    Part("forest 16x16", tuple(forest(16, 0.25, seed) for seed in (2001, 2002)), FIVE),
    Part("forest 20x20", (forest(20, 0.25, 2001),), FIVE),
    *(
        Part(f"{name}, short search", tuple(drawn(seed) for seed in range(2001, 2011)), TWO, (), SHORT)
        for name, drawn in DRAWN.items()
    ),
    Part("others", tuple(known()), TWO),
)
QUICK = (
    Part("E6", FULL[0].targets, (1,), (50,), ("objective.effort=1e6",), 2),
    Part("forest 6x6", (forest(6, 0.3, 1), forest(6, 0.3, 2)), (1,), (), ("objective.effort=1e6",), 2),
)


def main(parts: Sequence[Part]) -> None:
    """Print a line for each search and length of training, and a table for each part."""
    if peer("numba") is None:
        return
    print(
        f"{'target':22}{'search':>7}{'CPU s':>7}{'members':>8}{'steps':>8}{'backplay needs':>15}"
        + "".join(map("{:>17}".format, WAYS))
    )
    for part in parts:
        found = []
        for target in part.targets:
            for search in part.searches:
                rows = measured(part, target, search)
                found += rows
                for row in rows:
                    print(line(row), flush=True)
        show(found)


def measured(part: Part, target: Path | Target, search: int) -> list[Row]:
    """Search for a family and train new agents; return a row for each length of training."""
    with TemporaryDirectory() as folder:
        path = target if isinstance(target, Path) else written(target, Path(folder))
        name = target.stem if isinstance(target, Path) else target.name
        started = process_time()
        family = generate(str(path), Path(folder) / "run.sqlite", seed=search, overrides=part.overrides)
        spent = process_time() - started
        searched, count = "unsearched" in family.objective, len(family.members)
        chosen = family.domain.spec.training.steps_per_environment
        agents = range(FIRST + search * part.agents, FIRST + (search + 1) * part.agents)
        own = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
        needed = backplay_needs(family.explored(family.members[-1]).tabular, own, agents)
        return [
            Row(part.name, name, search, spent, count, steps * count, searched, success, needed)
            for steps in part.lengths or (chosen,)
            for success in [successes(family, steps, agents)]
        ]


def successes(family: Family, steps: int, agents: Sequence[int]) -> dict[str, float]:
    """Return the success on the target of each way to train, with so many steps for each member."""
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names, target = [one.name for one in members], family.explored(family.members[-1]).tabular
    own = TrainingSettings.from_spec(family.domain.spec.training, limit=family.limit)
    settings = replace(own, steps_per_environment=steps)
    starts = other_starts(names[-1], target, settings.limit)
    compared = controls(names, KINDS, optimism=optimistic_values(target, settings), starts=[*starts])
    curricula = *sequences(names, "full"), *compared
    found = run_experiment(members, settings, curricula, seeds=agents, backend="numba", starts=starts)
    success = {way: list[float]() for way in WAYS}
    for one in found.summaries():
        success[_way(one.kind, one.label)].append(one.success_rate)
    if not success["backplay, stages"]:  # as many stages as the family has members
        success["backplay, stages"] = success["backplay"]
    return {way: max(rates) for way, rates in success.items() if rates}


def backplay_needs(target: Tabular, own: TrainingSettings, agents: Sequence[int]) -> int:
    """Return the fewest steps of `TOTALS` with which backplay on a target has a success of `GOOD`, or 0."""
    members = [FamilyMember("target", target)]
    starts = other_starts("target", target, own.limit)
    for total in TOTALS if len(starts) > 1 else ():
        settings = replace(own, steps_per_environment=total)
        curricula = controls(["target"], ["backplay"], starts=[*starts])
        found = run_experiment(members, settings, curricula, seeds=agents, backend="numba", starts=starts)
        if found.summaries()[0].success_rate >= GOOD:
            return total
    return 0


def _way(kind: str, label: str) -> str:
    """Return the one of `WAYS` that a curriculum belongs to."""
    if kind != "control":
        return {"curriculum": "the order", "baseline": "direct"}[kind]
    first, *more = label.replace(",", "").split()
    return "backplay, stages" if first == "backplay" and more else first


def line(row: Row) -> str:
    """Return a row as text; `*` marks a family that is better than the reverse curriculum it began with."""
    rates = "".join(f"{row.success[way]:17.2f}" if way in row.success else f"{'':17}" for way in WAYS)
    mark = "*" if row.searched else " "
    steps = f"{row.steps:8,}{row.backplay_steps:15,}"
    return f"{row.target:22}{row.search:7}{row.seconds:7.1f}{row.members:7}{mark}{steps}{rates}"


def show(rows: Sequence[Row]) -> None:
    """Print what the rows of a part say together."""
    orders = [row.success["the order"] for row in rows]
    steps, seconds = sorted(row.steps for row in rows), [row.seconds for row in rows]
    print(f"\n{rows[0].part}: {len(rows)} rows on {len(_targets(rows))} targets")
    print(f"  success {min(orders):.2f} to {max(orders):.2f}, at least .95 in {sum(one >= 0.95 for one in orders)}")
    print(f"  steps {steps[0]:,} to {steps[-1]:,}, median {steps[len(steps) // 2]:,}", end="; ")
    print(f"CPU s {min(seconds):.1f} to {max(seconds):.1f}; searched {sum(row.searched for row in rows)}")
    ratios = sorted(row.backplay_steps / row.steps for row in rows if row.backplay_steps)
    if ratios:
        middle, found = ratios[len(ratios) // 2], len(ratios)
        ends = f"{ratios[0]:.2f} to {ratios[-1]:.2f}"
        print(f"  for {GOOD} backplay needs {middle:.2f} times the steps (median of {found}), {ends}")
    for way in WAYS[1:]:
        of = [row for row in rows if way in row.success]
        if of:
            mean, low, high = difference(of, way)
            spread = f"{low:+.2f} to {high:+.2f}" if len(_targets(of)) > 1 else "one target"
            success = fmean(row.success[way] for row in of)
            print(f"  {way:17} {success:.2f}, the order is better by {mean:+.2f} ({spread})")
    print()


def difference(rows: Iterable[Row], way: str) -> tuple[float, float, float]:
    """Return by how much the order is better than a way on average, with a 95 % interval, over targets as units."""
    means = [fmean(row.success["the order"] - row.success[way] for row in of) for of in _targets(rows).values()]
    return (fmean(means), *mean_test(fmean(means), means)[:2])


def _targets(rows: Iterable[Row]) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.target, []).append(row)
    return found
