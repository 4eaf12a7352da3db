"""Sample thousands of distinct, valid environments, spread over the values of a measure.

    python -m benchmarks samples

10,000 forests of 8x8 through `envgraph.search.generate`, run store included, each in a process of its own, whose peak
memory is told; beside it the same walk hand-written on strings of letters, which keeps no traces or store. Then how the
length of a walk matters, and what other domains give in a minute. Times are CPU seconds, since other programs share the
machine.
"""

from __future__ import annotations

import random
import resource
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import NamedTuple
from unittest.mock import patch

from benchmarks.bench_family import TARGET, complexity, mutate, valid
from envgraph.search import Domain, ModelSampler, SampleSettings, generate


class Sizes(NamedTuple):
    """Forests to sample, bins of their complexity, lengths of walks, and members of other domains."""

    forests: int
    bins: int
    walks: tuple[int, ...]
    domains: dict[str, int]


FULL = Sizes(10_000, 20, (1, 4, 16, 64, 256), {"keydoor": 500, "network": 2000})
QUICK = Sizes(40, 4, (1, 16), {"keydoor": 5, "network": 5})


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"{sizes.forests:,} forests of 8 x 8, distinct and valid: to be 2 s and 500 MB")
    print(f"{'':34}{'CPU s':>8}{'peak MB':>10}{'fewest and most in a bin':>28}")
    for name, job in (
        ("envgraph", partial(_sampled, sizes.forests)),
        (f"envgraph, {sizes.bins} bins covered", partial(_sampled, sizes.forests, sizes.bins)),
        ("hand-written", partial(_by_hand, sizes.forests)),
    ):
        seconds, megabytes, counts = _alone(job, sizes.bins)
        print(f"{name:34}{seconds:8.2f}{megabytes:10.0f}{f'{min(counts):,} and {max(counts):,}':>28}")
    print_walks(sizes)
    print_domains(sizes)


def print_walks(sizes: Sizes) -> None:
    """What the length of walks costs, and how far members are from each other."""
    print(f"\n{'models on a walk':>16}{'microseconds a member':>24}{'tiles that two members differ in':>36}")
    for length in sizes.walks:
        with patch("envgraph.search.evolution._model_sampler.WALK_LENGTH", length):
            seconds, distance = _walked(sizes.forests)
        print(f"{length:16}{seconds / sizes.forests * 1e6:24.0f}{distance:36.1f}", flush=True)


def print_domains(sizes: Sizes) -> None:
    """Other domains, and a larger forest."""
    print("\nCPU ms a member, start included")
    for name, count in sizes.domains.items():
        with TemporaryDirectory() as folder:
            started = process_time()
            found = generate(f"{name}/diverse.toml", Path(folder) / "run.sqlite", samples=count)
            seconds = process_time() - started
        print(
            f"{name:>10}{seconds / len(found.members) * 1e3:10.2f}, {len(found.members):,} members",
            flush=True,
        )


Result = tuple[float, float, list[int]]


def _alone(job: Callable[[], list[float]], bins: int) -> Result:
    """CPU seconds and peak memory of a job in a process of its own, and how many values fall into each bin."""
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(_measured, (job, bins))


def _measured(job: Callable[[], list[float]], bins: int) -> Result:
    started = process_time()
    values = job()
    seconds = process_time() - started
    counts = [0] * bins
    for value in values:
        counts[min(int(value * bins), bins - 1)] += 1
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, counts


def _sampled(count: int, covered: int | None = None) -> list[float]:
    """Return the complexities of forests; with `covered`, that many bins get as many forests each."""
    overrides = () if covered is None else (f"samples.cover={{ complexity = {covered} }}",)
    with TemporaryDirectory() as folder:
        family = generate("burning_forest/paper.toml", Path(folder) / "run.sqlite", samples=count, overrides=overrides)
    assert len(family.members) == count
    return [member.measures["complexity"] for member in family.members]


def _by_hand(count: int) -> list[float]:
    """Walks of 16 forests from one that was met before, by one to five retypings each."""
    rng = random.Random(1)
    found, values = [TARGET], {TARGET: complexity(TARGET)}
    while len(found) < count:
        cells = rng.choice(found)
        for _ in range(16):
            while True:
                child = cells
                for _ in range(rng.randint(1, 5)):
                    child = mutate(child, rng)
                if valid(child):
                    break
            cells = child
            if cells not in values:
                values[cells] = complexity(cells)
                found.append(cells)
    return [*values.values()][:count]


def _walked(count: int) -> tuple[float, float]:
    """Return the CPU seconds of sampling alone, and the mean distance of pairs of members."""
    domain = Domain.load("burning_forest/paper.toml")
    problem = domain.problem(domain.engine())
    sampler = ModelSampler(problem, domain.settings(), SampleSettings(count, (), (), 1, 10 * count), 1)
    started = process_time()
    sampler.run()
    seconds = process_time() - started
    rng = random.Random(1)
    members = sampler.archive_members()
    rng.shuffle(members)
    maps = []
    for _, version in members[:200]:
        problem.engine.checkout(version, discard=True)
        model = problem.engine.model
        maps.append([model.graph.class_of(node) for node in sorted(model.graph.extent("Tile"))])
    distances = [sum(one != other for one, other in zip(*pair, strict=True)) for pair in pairwise(maps)]
    return seconds, sum(distances) / len(distances)
