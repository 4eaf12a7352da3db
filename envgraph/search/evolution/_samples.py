"""Sampling of many members: random walks over valid models, whose models are offered to an archive.

A walk starts at a member of the archive, from a uniformly sampled cell. It moves from one valid model to the next. Each
move applies as many rules as create an initial member of a search, or is a heavy-tailed mutation if that is the
strength. Every new model on the walk is offered to the archive. So all members descend from the initial model, and
their rule applications are stored like those of any individual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from numpy.random import Generator, SeedSequence, default_rng

from envgraph.code import dataclass
from envgraph.graph import Version
from envgraph.search._store import Generation, Individual, RunStore, Trace
from envgraph.search.evolution._archive import Archive
from envgraph.search.evolution._settings import SampleSettings, Settings
from envgraph.search.evolution._variation import Variation
from envgraph.search.problem._problem import Problem

WALK: Final = 16
"""Number of models on a walk: at about this length members differ most, and longer walks save little time
(`benchmarks/bench_samples.py`)."""

_REPORTED: Final = 256
"""Number of attempts after which progress is reported."""

REPEATED: Final = "the model was found before"
"""Reason for which a model that is not new is rejected."""


@dataclass(frozen=True, slots=True)
class SampleProgress:
    """The progress of sampling.

    Attributes:
        members: number of members in the archive.
        cells: number of non-empty cells.
        attempts: number of attempts so far.
        share: progress from 0 to 1, by members, or by attempts once there are enough members.
    """

    members: int
    cells: int
    attempts: int
    share: float


@dataclass(frozen=True, slots=True)
class Offered:
    """A valid new model that is offered to the archive.

    Attributes:
        parent: number of the member from which it descends; -1 for the initial model itself.
        trace: the rule applications that lead from the parent to it.
        measures: value of every measure, by name.
        state: hash of the model.
        version: version of the model; None if it is the engine's current model.
    """

    parent: int
    trace: Trace
    measures: dict[str, float]
    state: int
    version: Version | None = None


class Sampler:
    """A sampler of members by random walks from the initial model.

    Args:
        problem: the search problem; its engine is at the initial model.
        settings: parameters of mutations.
        wanted: the number of members and the measures to cover.
        seed: the only source of randomness; each walk has its own generator.
    """

    def __init__(self, problem: Problem, settings: Settings, wanted: SampleSettings, seed: int) -> None:
        self._problem, self._settings, self._wanted, self._seed = problem, settings, wanted, seed
        self._variation = Variation(problem, settings.max_attempts, settings.strength)
        self._archive = Archive(wanted.count, [bins for _, bins in wanted.cover])
        self._versions: dict[int, Version] = {}
        self._individuals: list[Individual] = []
        self._met: set[int] = set()
        self._tried = self._walks = 0
        measures, state = problem.measure(), problem.engine.model.state_hash()
        self._met.add(state)
        self.put(Offered(-1, (), measures, state), self._quality(measures), self.generator())

    def run(self, progress: Callable[[SampleProgress], None] = lambda progress: None) -> Archive:
        """Sample until there are enough members or the attempts are used up, and return the archive.

        `write` stores the result.
        """
        reported = 0
        while not self._over():
            self._walk(WALK, self._offer)
            if self._tried >= reported:
                reported = self._tried + _REPORTED
                progress(self.progress)
        progress(replace(self.progress, share=1.0))
        return self._archive

    def candidates(self, count: int) -> list[Offered]:
        """Return new valid models, each one move away from a member of the archive. The archive is not changed.

        Args:
            count: number of models. Fewer are returned if `100 * count` attempts do not find enough.
        """
        found: list[Offered] = []

        def note(candidate: Offered, rng: Generator) -> None:
            del rng  # this callback needs no random numbers
            found.append(replace(candidate, version=self._problem.engine.commit()))

        last = self._tried + 100 * count
        while len(found) < count and self._tried < last:
            self._walk(1, note)
        return found

    def members(self) -> list[tuple[Individual, Version]]:
        """Return the members of the archive with their versions, in the order in which they were added."""
        return [(self._individuals[number], self._versions[number]) for number in self._archive]

    @property
    def progress(self) -> SampleProgress:
        """Return the current numbers of members, cells and attempts."""
        members, wanted = len(self._archive), self._wanted
        share = members / wanted.count if members < wanted.count else self._tried / wanted.attempts
        return SampleProgress(members, len(self._archive.counts()), self._tried, min(1.0, share))

    def write(self, store: RunStore) -> None:
        """Write the members and all their ancestors to a store, as the only generation of a run."""
        members = [*self._archive]
        kept = dict.fromkeys(members)
        for number in reversed(range(len(self._individuals))):
            parent = self._individuals[number].parent
            if number in kept and parent is not None:
                kept[parent] = None
        born = [self._individuals[number] for number in sorted(kept)]
        of = self._problem.diversity_of
        values = [self._individuals[number].measures[of] for number in members]
        reasons = dict(sorted(self._variation.reasons.items()))
        diversity = self._problem.diversity.score(values)
        store.write_generation(Generation(0, tuple(members), diversity, len(self._met), reasons), born)

    def _over(self) -> bool:
        enough = self._archive.level and not self._wanted.best
        return enough or self._tried >= self._wanted.attempts

    def _walk(self, length: int, offer: Callable[[Offered, Generator], int | None]) -> None:
        """Walk from a sampled member of the archive over at most `length` valid models, and offer the new ones."""
        engine, variation, rng = self._problem.engine, self._variation, self.generator()
        parent, since = self._archive.draw(rng), Trace()
        engine.checkout(self._versions[parent], discard=True)
        for _ in range(length):
            before = variation.reasons.total()
            step = variation.attempts(rng, self._vary)
            self._tried += variation.reasons.total() - before + (step is not None)
            if step is None:
                return
            trace, measures = step
            since += trace
            state = engine.model.state_hash()
            if state in self._met:
                variation.reasons[REPEATED] += 1
                continue
            self._met.add(state)
            found = offer(Offered(parent, since, measures, state), rng)
            if found is not None:
                parent, since = found, ()
            if self._over():
                return

    def _vary(self, rng: Generator) -> Trace | None:
        if self._settings.strength == "heavy_tailed":
            return self._variation.mutation(rng)
        return self._variation.several(rng, self._settings.initial_applications)

    def _offer(self, found: Offered, rng: Generator) -> int | None:
        return self.put(found, self._quality(found.measures), rng)

    def _quality(self, measures: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(self._wanted.sense * measures[name] for name in self._wanted.best)

    def put(self, offered: Offered, quality: float | tuple[float, ...], rng: Generator) -> int | None:
        """Offer a model to the archive; return the number of the new member, or None if it is not added.

        Args:
            offered: the model. Without a version it must be the engine's current model.
            quality: larger is better.
            rng: see `Archive.put`.
        """
        cell = self._archive.cell([offered.measures[name] for name, _ in self._wanted.cover])
        found = self._archive.put(cell, quality, rng)
        if found is None:
            return None
        number, left = found
        self._versions[number] = offered.version or self._problem.engine.commit()
        if left is not None:
            del self._versions[left]
        parent = offered.parent if number else None
        state = f"{offered.state:016x}"
        self._individuals.append(
            Individual(number, 0, number - 1, parent, offered.trace, offered.measures, state)
        )
        return number

    def generator(self) -> Generator:
        """Return a new random generator. Each call counts as a walk and gives another generator."""
        self._walks += 1
        return default_rng(SeedSequence(self._seed, spawn_key=(self._walks - 1,)))
