"""Settings of the genetic algorithm and of sampling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.code import dataclass

if TYPE_CHECKING:
    from envgraph.lang import Strength
    from envgraph.search.evolution._survivor_selection import ParentSelection, SurvivorSelection
    from envgraph.search.problem._statistics import BinnedEntropy


@dataclass(frozen=True, slots=True)
class EvolutionSettings:
    """Parameters of the genetic algorithm.

    Attributes:
        population: number of members, at least 2.
        parents: the parent selection.
        survivors: the survivor selection.
        rate: probability that a child is mutated; otherwise it is a copy of its parent.
        initial_applications: smallest and largest number of rule applications that create an initial member.
        max_attempts: number of mutations to try for one child.
        strength: number of rule applications of a mutation, "single" or "heavy_tailed".
        keep_initial: True if the initial model is always a member of the family.
        generations: number of generations after which the run stops, or None.
        seconds: time since the start or resumption after which the run stops, or None.
        target: diversity at which the run stops. None: the largest possible diversity. Infinity: never.
        stagnation: number of generations without a higher diversity after which the run stops, or None.
    """

    population: int
    parents: ParentSelection
    survivors: SurvivorSelection
    rate: float = 0.85
    initial_applications: tuple[int, int] = (1, 5)
    max_attempts: int = 50
    strength: Strength = "single"
    keep_initial: bool = True
    generations: int | None = 1000
    seconds: float | None = None
    target: float | None = None
    stagnation: int | None = None


@dataclass(frozen=True, slots=True)
class SampleSettings:
    """Settings of sampling.

    Attributes:
        count: number of members with the initial model, at least 2.
        covered_measures: names of measures with their bins; the members are spread evenly over the bins.
        ranking_measures: names of the measures that rank members of the same bins, in order of precedence.
        sense: 1 if larger values are better, -1 if smaller ones are.
        attempts: number of models to try.
    """

    count: int
    covered_measures: Sequence[tuple[str, BinnedEntropy]]
    ranking_measures: Sequence[str]
    sense: int
    attempts: int
