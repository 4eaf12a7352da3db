"""Thousands of environments at once: distinct, valid, and spread over the values of a measure.

    python -m benchmarks samples

10,000 forests of 8x8 through `envgraph.search.generate`, run store included, each in a process of its own, whose peak
memory is told; beside it the same walk hand-written on strings of letters, which keeps no traces or store. Then how the
length of a walk matters, and what other domains give in a minute. Times are CPU seconds, since other programs share the
machine.
"""

from __future__ import annotations

import random
import resource
from collections.abc import Callable, Sequence
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from unittest.mock import patch

from benchmarks.bench_family import TARGET, complexity, mutate, valid
from envgraph.search import Domain, Family, Sampler, SampleSettings, generate

COUNT = 10_000
BINS = 20
COVERED = f"samples.cover={{ complexity = {BINS} }}"


def main() -> None:
    """Print the figures."""
    print(f"{COUNT:,} forests of 8 x 8, distinct and valid: to be 2 s and 500 MB")
    print(f"{'':34}{'CPU s':>8}{'peak MB':>10}{'fewest and most in a bin':>28}")
    for name, job in (
        ("envgraph", _drawn),
        (f"envgraph, {BINS} bins covered", _covered),
        ("hand-written", _by_hand),
    ):
        seconds, megabytes, counts = _alone(job)
        print(f"{name:34}{seconds:8.2f}{megabytes:10.0f}{f'{min(counts):,} and {max(counts):,}':>28}")
    print_walks()
    print_domains()


def print_walks() -> None:
    """What the length of walks costs, and how far members are from each other."""
    print(f"\n{'models on a walk':>16}{'microseconds a member':>24}{'tiles that two members differ in':>36}")
    for length in (1, 4, 16, 64, 256):
        with patch("envgraph.search._samples.WALK", length):
            seconds, distance = _walked()
        print(f"{length:16}{seconds / COUNT * 1e6:24.0f}{distance:36.1f}", flush=True)


def print_domains() -> None:
    """Other domains, and a larger forest."""
    print("\nCPU ms a member, start included")
    for name, count in (("keydoor", 500), ("network", 2000)):
        with TemporaryDirectory() as folder:
            started = process_time()
            found = generate(name, Path(folder) / "run.sqlite", samples=count)
            seconds = process_time() - started
        print(
            f"{name:>10}{seconds / len(found.members) * 1e3:10.2f}, {len(found.members):,} members",
            flush=True,
        )


Result = tuple[float, float, list[int]]


def _alone(job: Callable[[], list[float]]) -> Result:
    """CPU seconds and peak memory of a job in a process of its own, and how many values fall into each bin."""
    with get_context("spawn").Pool(1) as pool:
        return pool.apply(_measured, (job,))


def _measured(job: Callable[[], list[float]]) -> Result:
    started = process_time()
    values = job()
    seconds = process_time() - started
    counts = [0] * BINS
    for value in values:
        counts[min(int(value * BINS), BINS - 1)] += 1
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, counts


def _drawn(overrides: Sequence[str] = ()) -> list[float]:
    with TemporaryDirectory() as folder:
        family = generate("burning_forest", Path(folder) / "run.sqlite", samples=COUNT, overrides=overrides)
    return _values(family)


def _covered() -> list[float]:
    return _drawn((COVERED,))


def _values(family: Family) -> list[float]:
    assert len(family.members) == COUNT
    return [member.measures["complexity"] for member in family.members]


def _by_hand() -> list[float]:
    """Walks of 16 forests from one that was met before, by one to five retypings each."""
    rng = random.Random(1)
    found, values = [TARGET], {TARGET: complexity(TARGET)}
    while len(found) < COUNT:
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
    return [*values.values()][:COUNT]


def _walked() -> tuple[float, float]:
    """CPU seconds of the drawing alone, and the mean distance of pairs of members."""
    domain = Domain.load("burning_forest")
    problem = domain.problem(domain.engine())
    sampler = Sampler(problem, domain.settings(), SampleSettings(COUNT, (), (), 1, 10 * COUNT), 1)
    started = process_time()
    sampler.run()
    seconds = process_time() - started
    rng = random.Random(1)
    members = sampler.members()
    rng.shuffle(members)
    maps = []
    for _, version in members[:200]:
        problem.engine.checkout(version, discard=True)
        model = problem.engine.model
        maps.append([model.class_of(node) for node in sorted(model.extent("Tile"))])
    distances = [sum(one != other for one, other in zip(*pair, strict=True)) for pair in pairwise(maps)]
    return seconds, sum(distances) / len(distances)


if __name__ == "__main__":
    main()
