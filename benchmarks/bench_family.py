"""Evolve families of environments, the paper's Burning Forest first.

    python -m benchmarks family

1,000 generations at 8x8, simulated annealing of 500 rounds, through `envgraph.search.generate`, run store included,
beside the same algorithm hand-written on strings of letters, which keeps no traces, versions or store. Then forests of
all sizes, fire on a quarter of the tiles, until the family has the maximum of entropy, with mutations of heavy-tailed
strength; and the other bundled domains. Times are CPU seconds, since other programs share the machine; wall time is
printed next to them.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import wraps
from math import exp, log2, sqrt
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any, NamedTuple
from unittest.mock import patch

from envgraph.graph.history._history import History
from envgraph.graph.history._version_tree import VersionTree
from envgraph.lang import bundled_domain
from envgraph.rewrite import Engine
from envgraph.search import (
    BinnedEntropy,
    Domain,
    Evolution,
    Generation,
    Problem,
    RunStore,
    SimulatedAnnealing,
    generate,
    why_low,
)

TO_THE_END = ("search.target=false",)
"""As published: also where the family cannot become more diverse."""

PUBLISHED = {6: 47, 10: 208, 20: 1594}
"""Seconds in the paper's table of generation times, 8x8, by population."""

TARGET = "SVVVRVRVBRRRRBVBBVBRRRBVRVRBVVVBVRRBBBRBBBVWRBVRVVRBBBVBVBRVRVVG"


FORESTS = ((8, 6, 30, 0.2), (12, 20, 10, 2.0), (16, 20, 10, 5.0), (32, 20, 10, 20.0), (100, 20, 3, 120.0))
"""Tiles on a side, population, seeds, and the seconds that it should take at most."""

REACHED = {"keydoor": 3, "network": 6, "warehouse": 4}
"""Bins of the bundled domains that any model is known to fall into, of six."""


class Sizes(NamedTuple):
    """How much is evolved.

    Attributes:
        generations: of the paper's job.
        populations: of the paper's job.
        repeats: runs of the paper's job that a median is of.
        forests: see `FORESTS`.
        domains: bundled domains, see `REACHED`.
        seeds: runs of each bundled domain.
        period: seconds of CPU of each such run.
    """

    generations: int
    populations: tuple[int, ...]
    repeats: int
    forests: tuple[tuple[int, int, int, float], ...]
    domains: tuple[str, ...]
    seeds: int
    period: float


FULL = Sizes(1000, tuple(PUBLISHED), 3, FORESTS, tuple(REACHED), 3, 30.0)
QUICK = Sizes(2, (6,), 1, ((8, 6, 1, 0.2),), ("keydoor",), 1, 0.0)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"{sizes.generations} generations, 8x8: seconds of CPU (and of wall time), median of {sizes.repeats}")
    print(f"{'population':>10}{'envgraph':>20}{'hand-written':>20}{'ratio':>8}{'published':>12}")
    for population in sizes.populations:
        published = PUBLISHED[population]
        ours = _median(lambda: _generate(population, sizes.generations), sizes.repeats)  # noqa: B023
        plain = _median(lambda: evolve(TARGET, population, sizes.generations, seed=1), sizes.repeats)  # noqa: B023
        print(f"{population:10}{_seconds(ours):>20}{_seconds(plain):>20}{ours[0] / plain[0]:8.1f}{published:10} s")
    start = _median(lambda: _generate(6, 0), sizes.repeats)
    print(f"of which reading files, compiling patterns, making the store: {start[0]:.2f} s")
    print_phases(sizes.generations)
    print_sizes(sizes.forests)
    print_domains(sizes)


def print_phases(generations: int) -> None:
    """CPU time of each step of the algorithm in one run; the clock itself costs about a microsecond a call.

    To check out costs about a microsecond for each change between two members, so that row follows the search: a family
    whose members have less in common takes longer.
    """
    clock: dict[str, float] = {}
    walked: list[int] = []
    with _clocked(clock) as children, _counted(walked), TemporaryDirectory() as folder:
        generate(
            "burning_forest/paper.toml",
            Path(folder) / "run.sqlite",
            generations=generations,
            overrides=TO_THE_END,
        )
        born = len(children)
    print(f"\npopulation 6, {born} children: microseconds a child")
    for name, seconds in clock.items():
        print(f"{name:34}{seconds / born * 1e6:10.1f}")
    print(f"{'changes between versions':34}{sum(walked) / born:10.1f}")


_PHASES: list[tuple[str, object, tuple[str, ...]]] = [
    ("choose and apply", Engine, ("choose", "fire")),
    ("validate and measure", Problem, ("measures_or_rejection",)),
    ("measure", Problem, ("compute_measures",)),
    ("commit and check out", Engine, ("commit", "checkout")),
    ("savepoints", History, ("savepoint", "release", "rollback")),
    ("random generators", Evolution, ("_random_generator",)),
    ("survivor selection", SimulatedAnnealing, ("select",)),
    ("store", RunStore, ("write_generation",)),
]


@contextmanager
def _clocked(clock: dict[str, float]) -> Iterator[list[object]]:
    """Add the time of every step to the clock; gives the list of children that were measured."""
    children: list[object] = []
    with ExitStack() as stack:
        for phase, owner, names in _PHASES:
            clock[phase] = 0.0
            for name in names:
                made = children if phase == "measure" else []
                timed = _timed(clock, phase, getattr(owner, name), made)
                stack.enter_context(patch.object(owner, name, timed))
        whole = _timed(clock, "all of a generation", Evolution._run_generation, [])
        clock["all of a generation"] = 0.0
        stack.enter_context(patch.object(Evolution, "_run_generation", whole))
        yield children


@contextmanager
def _counted(walked: list[int]) -> Iterator[None]:
    """Note how many changes are undone or made again on each way between two versions."""

    def counted(tree: VersionTree, vertex: Any, end: Any) -> None:
        walked.append(len(vertex.segment) // 4)
        turn(tree, vertex, end)

    turn = VersionTree._reverse_segment
    with patch.object(VersionTree, "_reverse_segment", counted):
        yield


def _timed(
    clock: dict[str, float], phase: str, function: Callable[..., Any], calls: list[object]
) -> Callable[..., Any]:
    @wraps(function)
    def timed(*arguments: Any, **options: Any) -> Any:
        started = process_time()
        result = function(*arguments, **options)
        clock[phase] += process_time() - started
        calls.append(None)
        return result

    return timed


TAILED = ("mutation.strength=heavy_tailed",)


def print_sizes(forests: tuple[tuple[int, int, int, float], ...]) -> None:
    """Until forests of random tiles have families of maximum entropy."""
    print("\nCPU seconds to the maximum of entropy, random forests")
    print(f"{'tiles':>10}{'population':>12}{'median':>10}{'slowest':>10}{'children':>10}{'to be':>8}{'reached':>10}")
    for size, population, seeds, wanted in forests:
        found = [_to_the_maximum(size, population, seed) for seed in range(seeds)]
        times = [seconds for seconds, _, _ in found]
        children = median(born for _, born, _ in found)
        reached = sum(low is None for _, _, low in found)
        print(
            f"{f'{size} x {size}':>10}{population:12}{median(times):10.2f}{max(times):10.2f}{children:10.0f}"
            f"{wanted:8.1f}{f'{reached} of {seeds}':>10}",
            flush=True,
        )


def _to_the_maximum(size: int, population: int, seed: int) -> tuple[float, int, object]:
    """CPU seconds, children, and why the family is not as diverse as can be."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.sqlite"
        forest(Path(folder), size, seed)
        started = process_time()
        family = generate(f"{folder}/paper.toml", path, seed=seed, population=population, overrides=TAILED)
        seconds = process_time() - started
        with RunStore.open(path) as store:
            return (
                seconds,
                sum(accepted for _, _, accepted, _ in store.generation_statistics()),
                why_low(family, store),
            )


def forest(folder: Path, size: int, seed: int) -> None:
    """Write a forest whose tiles are random, a quarter of them on fire, and that can be crossed."""
    for file in bundled_domain("burning_forest").glob("*.*"):
        (folder / file.name).write_text(re.sub(r'"\w+FixedLocation", ', "", file.read_text()))
    rng = random.Random(f"{size} {seed}")
    while True:
        tiles = rng.choices("BVR", (0.25, 0.26, 0.49), k=size * size)
        tiles[0], tiles[rng.randrange(1, size * size - 1)], tiles[-1] = "SWG"
        rows = ["".join(tiles[row : row + size]) for row in range(0, size * size, size)]
        (folder / "target_8x8.model").write_text(MODEL.format("\n".join(rows)))
        domain = Domain.load(f"{folder}/paper.toml")
        if domain.problem(domain.engine()).is_valid():
            return


MODEL = """
import "burning_forest.metamodel"
model target : burning_forest {{
    forest : Forest {{
        states = grid tile {{
            column x next right
            row y next down
            rows \"\"\"
{}
            \"\"\"
        }}
        agent = truck : FireTruck {{ currentState = tile[0, 0] }}
    }}
}}
"""


def print_domains(sizes: Sizes) -> None:
    """The bundled domains where not all bins can be reached, as far as they come in a time."""
    print(
        f"\nbits of entropy after {sizes.period:.0f} seconds of CPU, population 6, "
        f"and when they were reached, {sizes.seeds} seeds"
    )
    for name in sizes.domains:
        maximum = BinnedEntropy(REACHED[name]).maximum(6)
        for seed in range(sizes.seeds):
            bits, seconds = _within(name, seed, sizes.period)
            print(f"{name:>10}{bits:8.3f} of {maximum:.3f}{seconds:8.1f} s", flush=True)


class _Over(Exception):
    """The time is over."""


def _within(name: str, seed: int, period: float) -> tuple[float, float]:
    """The entropy that is reached, and when."""
    best, started = (0.0, 0.0), process_time()

    def watch(generation: Generation) -> None:
        nonlocal best
        now = process_time() - started
        if generation.diversity > best[0] + 1e-9:
            best = generation.diversity, now
        if now > period:
            raise _Over

    endless = "search.generations=1000000000"
    with TemporaryDirectory() as folder, suppress(_Over):
        generate(
            f"{name}/diverse.toml",
            Path(folder) / "run.sqlite",
            seed=seed,
            population=6,
            overrides=(*TAILED, endless),
            progress=watch,
        )
    return best


def _generate(population: int, generations: int) -> None:
    with TemporaryDirectory() as folder:
        generate(
            "burning_forest/paper.toml",
            Path(folder) / "run.sqlite",
            population=population,
            generations=generations,
            overrides=TO_THE_END,
        )


def _median(job: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Return the median CPU and wall seconds of some runs."""
    times = []
    for _ in range(repeats):
        cpu, wall = process_time(), perf_counter()
        job()
        times.append((process_time() - cpu, perf_counter() - wall))
    return median(cpu for cpu, _ in times), median(wall for _, wall in times)


def _seconds(times: tuple[float, float]) -> str:
    return f"{times[0]:.2f} ({times[1]:.2f})"


# --- the same algorithm by hand: a map is a string of 64 letters, row by row

SIZE = 8
MUTABLE = "RVB"
RETYPINGS = [(old, new) for old in MUTABLE for new in MUTABLE if old != new]


def evolve(target: str, population: int, generations: int, seed: int) -> list[str]:
    """The family after so many generations; the target is always its first member."""
    rng = random.Random(seed)
    members = [target]
    while len(members) < population:
        child = target
        for _ in range(rng.randint(1, 5)):
            child = mutate(child, rng)
        if valid(child):
            members.append(child)
    values = {member: complexity(member) for member in members}
    for _ in range(generations):
        pool = list(dict.fromkeys(members))
        for _ in range(population):
            parent = rng.choice(members)
            if rng.random() >= 0.85:
                continue
            for _ in range(50):
                child = mutate(parent, rng)
                if valid(child):
                    break
            else:
                continue
            if child not in pool:
                pool.append(child)
                values[child] = complexity(child)
        members = survivors(pool, values, population, rng)
        values = {member: values[member] for member in members}
    return members


def mutate(cells: str, rng: random.Random) -> str:
    """Retype one tile: first the kind of retyping is drawn, then the tile."""
    old, new = rng.choice([pair for pair in RETYPINGS if pair[0] in cells])
    place = rng.choice([place for place, cell in enumerate(cells) if cell == old])
    return cells[:place] + new + cells[place + 1 :]


def neighbours(place: int) -> list[int]:
    """The places beside a place."""
    x, y = place % SIZE, place // SIZE
    beside = [(x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)]
    return [v * SIZE + u for u, v in beside if 0 <= u < SIZE and 0 <= v < SIZE]


NEIGHBOURS = [neighbours(place) for place in range(SIZE * SIZE)]


def valid(cells: str) -> bool:
    """Start, goal and water are where they belong, and the goal can be reached without fire."""
    if cells[0] != "S" or cells[63] != "G" or cells[5 * SIZE + 3] != "W":
        return False
    seen, queue = {0}, [0]
    for place in queue:
        for beside in NEIGHBOURS[place]:
            if beside == 63:
                return True
            if beside not in seen and cells[beside] != "B":
                seen.add(beside)
                queue.append(beside)
    return False


def paths(cells: str) -> int:
    """Number of paths from the first to the last cell, to the right and down, that avoid fire."""
    ways = [0] * SIZE
    ways[0] = 1
    for row in range(0, SIZE * SIZE, SIZE):
        left = 0
        for x in range(SIZE):
            left = ways[x] = 0 if cells[row + x] == "B" else ways[x] + left
    return ways[-1]


ALL_PATHS = paths("R" * SIZE * SIZE)


def complexity(cells: str) -> float:
    """Blocked share of the paths, as in the published data."""
    return 1.0 - sqrt(paths(cells) / ALL_PATHS)


def survivors(pool: list[str], values: dict[str, float], size: int, rng: random.Random) -> list[str]:
    """Simulated annealing on the entropy of the complexities in `size` bins; the first of the pool stays."""
    if len(pool) <= size:
        return pool
    bins = [min(int(values[cells] * size), size - 1) for cells in pool]
    inside, outside = list(range(1, size)), list(range(size, len(pool)))
    counts = [0] * size
    for place in (0, *inside):
        counts[bins[place]] += 1
    term = [0.0] + [-(count / size) * log2(count / size) for count in range(1, size + 1)]
    best, best_score, score, temperature = inside[:], 0.0, 0.0, 0.1
    for _ in range(500):
        i, j = int(rng.random() * len(inside)), int(rng.random() * len(outside))
        out, into = bins[inside[i]], bins[outside[j]]
        delta = 0.0
        if out != into:
            left, entered = counts[out], counts[into]
            delta = term[left - 1] - term[left] + term[entered + 1] - term[entered]
        if delta >= 0 or rng.random() < exp(delta / temperature):
            counts[out] -= 1
            counts[into] += 1
            inside[i], outside[j] = outside[j], inside[i]
            score += delta
            if score > best_score - 1e-12:
                best, best_score = inside[:], max(score, best_score)
        temperature *= 0.95
    return [pool[place] for place in sorted([0, *best])]
