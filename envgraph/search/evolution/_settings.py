"""Define the settings of the genetic algorithm and of drawing samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.code import dataclass

if TYPE_CHECKING:
    from envgraph.lang import Strength
    from envgraph.search.evolution._selection import ParentSelection, SurvivorSelection
    from envgraph.search.problem._diversity import BinnedEntropy


@dataclass(frozen=True, slots=True)
class Settings:
    """Parameters of the genetic algorithm.

    Attributes:
        population: number of members, at least 2.
        rate: probability that a child is a mutated parent, and not a mere copy.
        initial_applications: lowest and highest number of rule applications that make an initial member.
        max_attempts: mutations tried for one child before it is given up.
        strength: how many applications of rules a mutation takes.
        keep_initial: the initial model is a fixed member of the family.
        generations: stop after so many, or None.
        seconds: stop when this much time has passed since the start (or resumption), or None.
        target: stop when the diversity is at least this, or, for None, at its maximum; infinity is never.
        stagnation: stop after so many generations without a higher diversity, or None.
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
    """What is to be drawn.

    Attributes:
        count: members, at least 2, the initial model among them.
        cover: measures and their bins, which are to have as many members each.
        best: the measures by which one member is better than another in the same bins; the first counts most.
        sense: 1 where more of it is better, else -1.
        attempts: how many models are tried.
    """

    count: int
    cover: Sequence[tuple[str, BinnedEntropy]]
    best: Sequence[str]
    sense: int
    attempts: int
