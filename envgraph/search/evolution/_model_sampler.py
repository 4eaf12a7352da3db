"""Sampling of many members: random walks over valid models, whose models are offered to an archive.

A walk starts at a member of the archive, from a uniformly sampled cell. It moves from one valid model to the next. Each
move applies as many rules as create an initial member of a search, or is a heavy-tailed mutation if that is the
strength. Every new model on the walk is offered to the archive. So all members descend from the initial model, and
their rule applications are stored like those of any individual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from numpy.random import Generator, SeedSequence, default_rng

from envgraph.code import dataclass
from envgraph.graph import Version
from envgraph.search._run_store import Generation, Individual, RunStore, Trace
from envgraph.search.evolution._bin_archive import Archive
from envgraph.search.evolution._evolution_settings import EvolutionSettings, SampleSettings
from envgraph.search.evolution._mutation import PrepareMeasures, Variation, Varied
from envgraph.search.problem._problem import Problem

WALK_LENGTH: Final = 16
"""Number of models on a walk: at about this length members differ most, and longer walks save little time
(`benchmarks/bench_samples.py`)."""

MOST_WALKS: Final = 64
"""The largest number of walks that begin at the members of the same archive, and so can be prepared in parallel."""

REPEATED_MODEL_REASON: Final = "the model was found before"
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
class OfferedModel:
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


def vary_model(variation: Variation, settings: EvolutionSettings, rng: Generator) -> Varied | None:
    """Vary a model to the next one of a walk; None if all attempts fail."""
    if settings.strength == "heavy_tailed":
        return variation.vary_until_valid(rng, variation.mutate)
    return variation.vary_until_valid(rng, lambda rng: variation.apply_several(rng, settings.initial_applications))


def walk(variation: Variation, settings: EvolutionSettings, rng: Generator) -> None:
    """Vary a model to all models of a walk."""
    for _ in range(WALK_LENGTH):
        if vary_model(variation, settings, rng) is None:
            return


class _Walk(NamedTuple):
    """The beginning of a walk: number and version of its first model, and its random generator."""

    parent: int
    version: Version
    rng: Generator


class ModelSampler:
    """A sampler of members by random walks from the initial model.

    Args:
        problem: the search problem; its engine is at the initial model.
        settings: parameters of mutations.
        sample_settings: the number of members and the measures to cover.
        seed: the only source of randomness; each walk has its own generator.
        prepare: prepares the measures of the models of several walks in parallel; None: nothing is prepared.
    """

    def __init__(
        self,
        problem: Problem,
        settings: EvolutionSettings,
        sample_settings: SampleSettings,
        seed: int,
        prepare: PrepareMeasures | None = None,
    ) -> None:
        self._prepare = prepare
        self._problem, self._settings, self._sample_settings, self._seed = problem, settings, sample_settings, seed
        self._variation = Variation(problem, settings.max_attempts, settings.strength)
        self._archive = Archive(sample_settings.count, [bins for _, bins in sample_settings.covered_measures])
        self._versions: dict[int, Version] = {}
        self._individuals: list[Individual] = []
        self._known_states: set[int] = set()
        self._attempts = self._walks = 0
        measures, state = problem.compute_measures(), problem.engine.model.state_hash()
        self._known_states.add(state)
        self.offer_model(OfferedModel(-1, (), measures, state), self._quality(measures), self.next_generator())

    def run(self, progress: Callable[[SampleProgress], None] = lambda progress: None) -> Archive:
        """Sample until there are enough members or the attempts are used up, and return the archive.

        `write_run` stores the result.
        """
        while not self._is_over():
            walks = [self._begin_walk() for _ in range(min(MOST_WALKS, 1 + len(self._archive) // WALK_LENGTH))]
            if self._prepare:
                self._prepare(self._problem, walk, [(self._trace_of(one.parent), one.rng) for one in walks])
            for one in walks:
                if not self._is_over():
                    self._walk_models(one, WALK_LENGTH, self._offer_with_quality)
                    progress(self.progress)
        progress(replace(self.progress, share=1.0))
        return self._archive

    def sample_candidates(self, count: int) -> list[OfferedModel]:
        """Return new valid models, each one move away from a member of the archive. The archive is not changed.

        Args:
            count: number of models. Fewer are returned if `100 * count` attempts do not find enough.
        """
        found: list[OfferedModel] = []

        def keep_candidate(candidate: OfferedModel, rng: Generator) -> None:
            del rng  # this callback needs no random numbers
            found.append(replace(candidate, version=self._problem.engine.commit()))

        last = self._attempts + 100 * count
        while len(found) < count and self._attempts < last:
            self._walk_models(self._begin_walk(), 1, keep_candidate)
        return found

    def archive_members(self) -> list[tuple[Individual, Version]]:
        """Return the members of the archive with their versions, in the order in which they were added."""
        return [(self._individuals[number], self._versions[number]) for number in self._archive]

    @property
    def progress(self) -> SampleProgress:
        """Return the current numbers of members, cells and attempts."""
        members, wanted = len(self._archive), self._sample_settings
        share = members / wanted.count if members < wanted.count else self._attempts / wanted.attempts
        return SampleProgress(members, len(self._archive.members_per_cell()), self._attempts, min(1.0, share))

    def write_run(self, store: RunStore) -> None:
        """Write the members and all their ancestors to a store, as the only generation of a run."""
        members = [*self._archive]
        kept = dict.fromkeys(members)
        for number in reversed(range(len(self._individuals))):
            parent = self._individuals[number].parent
            if number in kept and parent is not None:
                kept[parent] = None
        born = [self._individuals[number] for number in sorted(kept)]
        of = self._problem.diversity_measure_name
        values = [self._individuals[number].measures[of] for number in members]
        reasons = dict(sorted(self._variation.rejection_counts.items()))
        diversity = self._problem.diversity.score(values)
        store.write_generation(Generation(0, tuple(members), diversity, len(self._known_states), reasons), born)

    def _is_over(self) -> bool:
        enough = self._archive.is_evenly_filled and not self._sample_settings.ranking_measures
        return enough or self._attempts >= self._sample_settings.attempts

    def _begin_walk(self) -> _Walk:
        """Return a walk from a sampled member of the archive."""
        rng = self.next_generator()
        parent = self._archive.sample_member(rng)
        return _Walk(parent, self._versions[parent], rng)

    def _trace_of(self, number: int) -> Trace:
        """Return the rule applications that lead from the initial model to a model."""
        steps, place = Trace(), number
        while (individual := self._individuals[place]).parent is not None:
            steps, place = individual.trace + steps, individual.parent
        return steps

    def _walk_models(self, begun: _Walk, length: int, offer: Callable[[OfferedModel, Generator], int | None]) -> None:
        """Walk over at most `length` valid models, and offer the new ones."""
        engine, variation, parent, rng, since = self._problem.engine, self._variation, begun.parent, begun.rng, Trace()
        offers = rng.spawn(1)[0]  # whether a model is added changes nothing on the rest of the walk
        engine.checkout(begun.version, discard=True)
        for _ in range(length):
            before = variation.rejection_counts.total()
            step = vary_model(variation, self._settings, rng)
            self._attempts += variation.rejection_counts.total() - before + (step is not None)
            if step is None:
                return
            trace, measures = step
            since += trace
            state = engine.model.state_hash()
            if state in self._known_states:
                variation.rejection_counts[REPEATED_MODEL_REASON] += 1
                continue
            self._known_states.add(state)
            found = offer(OfferedModel(parent, since, measures, state), offers)
            if found is not None:
                parent, since = found, ()
            if self._is_over():
                return

    def _offer_with_quality(self, offered: OfferedModel, rng: Generator) -> int | None:
        return self.offer_model(offered, self._quality(offered.measures), rng)

    def _quality(self, measures: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(self._sample_settings.sense * measures[name] for name in self._sample_settings.ranking_measures)

    def offer_model(self, offered: OfferedModel, quality: float | tuple[float, ...], rng: Generator) -> int | None:
        """Offer a model to the archive; return the number of the new member, or None if it is not added.

        Args:
            offered: the model. Without a version it must be the engine's current model.
            quality: larger is better.
            rng: see `Archive.put`.
        """
        cell = self._archive.cell_of([offered.measures[name] for name, _ in self._sample_settings.covered_measures])
        found = self._archive.offer_member(cell, quality, rng)
        if found is None:
            return None
        number, left = found
        self._versions[number] = offered.version or self._problem.engine.commit()
        if left is not None:
            del self._versions[left]
        parent = offered.parent if number else None
        state = f"{offered.state:016x}"
        self._individuals.append(Individual(number, 0, number - 1, parent, offered.trace, offered.measures, state))
        return number

    def next_generator(self) -> Generator:
        """Return a new random generator. Each call counts as a walk and gives another generator."""
        self._walks += 1
        return default_rng(SeedSequence(self._seed, spawn_key=(self._walks - 1,)))
