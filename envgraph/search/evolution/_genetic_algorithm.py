"""The genetic algorithm: vary a population of models, reject what violates constraints, and select for diversity.

The algorithm is the paper's (section "Generating families of environments"), each step behind a small protocol:
initialisation (4.1), parent selection (4.2), mutation with validation, rollback and bounded re-attempts (4.3),
survivor selection (4.4), termination (4.5).

Every random decision has its own generator, spawned from (seed, generation, child). So a result depends on the seed
alone, and a resumed run does not depend on anything before its last stored generation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from math import inf
from typing import Any

from numpy.random import Generator, SeedSequence, default_rng

from envgraph.code import dataclass
from envgraph.graph import Version, model_to_json
from envgraph.search._run_store import Generation, Individual, RunStore, Trace, dump_json
from envgraph.search.curricula import LevelFactory, ModelLevel
from envgraph.search.evolution._evolution_settings import EvolutionSettings
from envgraph.search.evolution._mutation import PrepareMeasures, Variation, Varied, Vary
from envgraph.search.problem._candidate_pool import Candidate, FamilyMeasure, Pool
from envgraph.search.problem._problem import Problem

_SELECTION_SPAWN_KEY = 1 << 32
"""Spawn key of the survivor selection of a generation. It is larger than any child's number."""

_TOLERANCE = 1e-12
"""Tolerance for comparing diversities, which are sums of floating-point terms."""


@dataclass(slots=True)
class _PopulationMember:
    """A member of the population, with its model as a version that the engine can check out."""

    individual: Individual
    level: ModelLevel


class _ScoreLosses(Sequence[float]):
    """Fitness for parent selection: the loss of the family's score if a member is removed, computed on first access."""

    def __init__(self, measure: FamilyMeasure, pool: Pool) -> None:
        self._measure, self._pool = measure, pool

    def __len__(self) -> int:
        return len(self._pool)

    @cached_property
    def _losses(self) -> list[float]:
        score, family, members = self._measure.score, self._pool.family_of, [*range(len(self._pool))]
        whole = score(family(members))
        return [whole - score(family([*members[:place], *members[place + 1 :]])) for place in members]

    def __getitem__(self, place: Any) -> Any:
        return self._losses[place]


def vary_initial_model(variation: Variation, settings: EvolutionSettings, rng: Generator) -> Varied | None:
    """Vary the initial model to a member of the first generation; None if all attempts fail."""
    return variation.vary_until_valid(rng, lambda rng: variation.apply_several(rng, settings.initial_applications))


def vary_parent(variation: Variation, settings: EvolutionSettings, rng: Generator) -> Varied | None:
    """Vary a parent to a child; None if all attempts fail, or if the child is a copy, which is in the pool already."""
    return variation.vary_until_valid(rng, variation.mutate) if rng.random() < settings.rate else None


class Evolution:
    """A run of the genetic algorithm. Invariant: the members are those of the last generation in the store.

    Args:
        problem: the search problem; its engine is at the initial model.
        settings: parameters of the algorithm.
        seed: the only source of randomness.
        store: an empty store, or one with complete generations of the same run, which is then resumed.
        prepare: prepares the measures of the children of a generation in parallel; None: nothing is prepared.
    """

    def __init__(
        self,
        problem: Problem,
        settings: EvolutionSettings,
        seed: int,
        store: RunStore,
        prepare: PrepareMeasures | None = None,
    ) -> None:
        self._problem = problem
        self._settings = settings
        self._seed = seed
        self._store = store
        self._prepare = prepare
        self._levels = LevelFactory(problem, problem.behaviour)
        self._next_id = store.next_id()
        self._started = time.monotonic()
        self._members: list[_PopulationMember] = []
        self._variation = Variation(problem, settings.max_attempts, settings.strength)
        last = store.last_generation()
        if last is None:
            self.current_generation = self._create_population()
        else:
            self.current_generation = last
            self._members = [self._restore_member(member) for member in last.members]
        self._best = (-1.0, 0)
        for number, diversity, _, _ in store.generation_statistics():
            self._update_best(number, diversity)

    def run(self, on_generation: Callable[[Generation], None] = lambda generation: None) -> Generation:
        """Run generations until a termination criterion holds, and return the last one.

        `on_generation` is called after every stored generation. At the end the models and the value of the objective
        are stored.
        """
        for generation in self:
            on_generation(generation)
        self._store.write_models(self.model_texts())
        objective = self._problem.objective
        if objective is not None:
            family = self.family()
            found = {
                "values": objective.term_values(family),
                "lacking": objective.violated_conditions(family),
            }
            self._store.set_setting("objective", found)
        return self.current_generation

    def __iter__(self) -> Iterator[Generation]:
        while not self._is_finished():
            self.current_generation = self._run_generation(self.current_generation.number + 1)
            yield self.current_generation

    def model_texts(self) -> dict[int, str]:
        """Return the model of every current member as JSON text, by id of the individual."""
        texts = {}
        for member in self._members:
            self._problem.engine.checkout(member.level.version, discard=True)
            texts[member.individual.id] = dump_json(model_to_json(self._problem.engine.model))
        return texts

    # --- the steps of the algorithm

    def _create_population(self) -> Generation:
        """Create and store the initial population (step 4.1), by random rule applications to the initial model."""
        problem, settings = self._problem, self._settings
        first = self._make_member(0, -1, None, (), self._current_level(self._levels.origin, problem.compute_measures()))
        members = [first] if settings.keep_initial else []
        born = [first.individual]
        children = range(settings.population - len(members))
        if self._prepare:
            starts = [((), self._random_generator(0, child)) for child in children]
            self._prepare(problem, vary_initial_model, starts)
        for child in children:
            found = self._vary_member(first, self._random_generator(0, child), vary_initial_model)
            if found is not None:
                members.append(self._make_member(0, child, first, *found))
                born.append(members[-1].individual)
        if not members:
            members = [first]
        self._members = members
        return self._write_generation(0, born)

    def _run_generation(self, number: int) -> Generation:
        """Run one generation (steps 4.2 to 4.4), and store it."""
        settings = self._settings
        parents = settings.parents.select(
            _ScoreLosses(self._problem.family_measures[0], self._make_pool(self._members)),
            settings.population,
            self._random_generator(number, _SELECTION_SPAWN_KEY + 1),
        )
        # By parent, so that consecutive checkouts are close to each other.
        children = sorted(range(len(parents)), key=parents.__getitem__)
        if self._prepare:
            lines = [self._trace_of(member) for member in self._members]
            self._prepare(
                self._problem,
                vary_parent,
                [(lines[parents[child]], self._random_generator(number, child)) for child in children],
            )
        found = {
            child: self._vary_member(self._members[parents[child]], self._random_generator(number, child), vary_parent)
            for child in children
        }
        pool, born = list(self._members), []
        known = {member.individual.state_hash for member in pool}
        for child, made in sorted(found.items()):
            if made is None:
                continue
            member = self._make_member(number, child, self._members[parents[child]], *made)
            born.append(member.individual)
            if member.individual.state_hash not in known:
                known.add(member.individual.state_hash)
                pool.append(member)
        self._members = self._select_survivors(pool, self._random_generator(number, _SELECTION_SPAWN_KEY))
        return self._write_generation(number, born)

    def _select_survivors(self, pool: list[_PopulationMember], rng: Generator) -> list[_PopulationMember]:
        """Select the survivors from the pool (step 4.4) by the survivor selection of the settings."""
        size = min(self._settings.population, len(pool))
        pinned = [0] if self._settings.keep_initial else []
        chosen = self._settings.survivors.select(self._make_pool(pool), size, pinned, list(range(size)), rng)
        return [pool[index] for index in chosen]

    def _make_pool(self, members: Sequence[_PopulationMember]) -> Pool:
        problem = self._problem
        key = None if problem.objective is None else self._curriculum_key
        return Pool([one.level for one in members], problem.family_measures, problem.diversity_measure_name, key)

    def _curriculum_key(self, member: Candidate) -> tuple[float, ...]:
        """Return the sort key of a member in the curriculum: its value of the measure for the order.

        The initial model is sorted last of all, or last among equal values, as the family file says.
        """
        problem = self._problem
        initial = isinstance(member, ModelLevel) and member.version is self._levels.origin
        order = member.measures[problem.order_measure_name or problem.diversity_measure_name]
        return (problem.target_last and initial, order, initial)

    def _is_finished(self) -> bool:
        """Update the best diversity, and return True if a termination criterion holds (step 4.5)."""
        settings, current = self._settings, self.current_generation
        self._update_best(current.number, current.diversity)
        return (
            (settings.generations is not None and current.number >= settings.generations)
            or (settings.target is not None and current.diversity >= settings.target - _TOLERANCE)
            or (settings.target != inf and self._is_at_maximum())
            or (settings.seconds is not None and time.monotonic() - self._started >= settings.seconds)
            or (settings.stagnation is not None and current.number - self._best[1] >= settings.stagnation)
        )

    def _is_at_maximum(self) -> bool:
        """Return True if the family has the wanted size and no family of this size can be better."""
        size, current, objective = self._settings.population, self.current_generation, self._problem.objective
        if len(current.members) < size:
            return False
        if objective is not None:
            return objective.is_at_maximum(self.family())
        return current.diversity >= self._problem.largest_diversity(size) - _TOLERANCE

    def family(self) -> list[Candidate]:
        """Return the members of the last generation, in the order of the curriculum."""
        return self._make_pool(self._members).family_of(range(len(self._members)))

    def _update_best(self, number: int, diversity: float) -> None:
        """Update the best diversity and the generation that first reached it, if `diversity` is larger."""
        if diversity > self._best[0] + _TOLERANCE:
            self._best = (diversity, number)

    # --- helpers of the steps

    def _trace_of(self, member: _PopulationMember) -> Trace:
        """Return the rule applications that lead from the initial model to a member."""
        return tuple(step for one in self._store.lineage(member.individual.id) for step in one.trace)

    def _vary_member(self, parent: _PopulationMember, rng: Generator, vary: Vary) -> tuple[Trace, ModelLevel] | None:
        """Vary the parent until the result is valid. Return the rule applications and the level, or None."""
        engine = self._problem.engine
        engine.checkout(parent.level.version, discard=True)
        found = vary(self._variation, self._settings, rng)
        return None if found is None else (found[0], self._current_level(engine.commit(), found[1]))

    def _current_level(self, version: Version, measures: Mapping[str, float]) -> ModelLevel:
        """Return the level of the engine's current model, of which `version` is the version."""
        return ModelLevel(version, (), self._problem.engine.model.state_hash(), measures, self._levels)

    def _make_member(
        self, generation: int, child: int, parent: _PopulationMember | None, trace: Trace, level: ModelLevel
    ) -> _PopulationMember:
        individual = Individual(
            id=self._next_id,
            generation=generation,
            child=child,
            parent=None if parent is None else parent.individual.id,
            trace=trace,
            measures=level.measures,
            state_hash=f"{level.state:016x}",
        )
        self._next_id += 1
        return _PopulationMember(individual, level)

    def _restore_member(self, id_: int) -> _PopulationMember:
        """Return a stored individual as a member, by replaying the traces of its ancestors from the initial model.

        Raise the error of a damaged store if the model is not the stored one, or if a measure is missing.
        """
        engine = self._problem.engine
        engine.checkout(self._levels.origin, discard=True)
        *_, individual = line = self._store.lineage(id_)
        for ancestor in line:
            engine.replay(ancestor.trace)
        if f"{engine.model.state_hash():016x}" != individual.state_hash:
            raise self._store.damage_error(f"the trace of individual {id_} leads to another model")
        lacking = [one for one in self._problem.measures if one not in individual.measures]
        if lacking:
            raise self._store.damage_error(f"individual {id_} has no measure `{lacking[0]}`")
        version = engine.commit() if individual.parent is not None else self._levels.origin
        return _PopulationMember(individual, self._current_level(version, individual.measures))

    def _random_generator(self, generation: int, child: int) -> Generator:
        return default_rng(SeedSequence(self._seed, spawn_key=(generation, child)))

    def _write_generation(self, number: int, individuals: Sequence[Individual]) -> Generation:
        members = tuple(member.individual.id for member in self._members)
        score = self._problem.diversity.score(
            [one.individual.measures[self._problem.diversity_measure_name] for one in self._members]
        )
        generation = Generation(
            number, members, score, len(individuals), dict(sorted(self._variation.rejection_counts.items()))
        )
        self._variation.rejection_counts.clear()
        self._store.write_generation(generation, individuals)
        return generation
