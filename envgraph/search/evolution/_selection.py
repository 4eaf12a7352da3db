"""Choosing parents, and choosing the survivors that together are the most diverse family.

`Pool` says which family is better. What is equal is drawn at random, so that a population drifts where nothing tells
its members apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations, product
from math import comb, exp, fsum
from typing import TYPE_CHECKING, Protocol

from envgraph.code import dataclass
from envgraph.errors import MOST_STEPS, InvalidArgument
from envgraph.lang import Options, key
from envgraph.search.problem._diversity import BinnedEntropy, Swaps
from envgraph.search.problem._pool import DIGITS, TIE, Over, Pool

if TYPE_CHECKING:
    from numpy.random import Generator


class ParentSelection(Protocol):
    """Which members of a population are varied."""

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """`count` indices into the population, repetitions allowed. Larger fitness is better."""


class SurvivorSelection(Protocol):
    """Which of a pool of candidates form the next population."""

    def select(
        self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator
    ) -> list[int]:
        """The chosen indices into the pool, ascending.

        Args:
            pool: the candidates, and what families of them are worth.
            size: how many to choose, at most the size of the pool.
            pinned: candidates that must be chosen.
            start: a family to start from, `size` candidates that include the pinned ones.
            rng: source of all random choices.
        """


@dataclass(frozen=True, slots=True)
class RandomParents:
    """Every member equally likely, with replacement (the paper's)."""

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Uniform draws."""
        return [int(index) for index in rng.integers(len(fitness), size=count)]


@dataclass(frozen=True, slots=True)
class TournamentParents:
    """The fittest of `rounds` uniform draws, for each parent; ties go to the first drawn."""

    rounds: int = key(2, Options.integer, low=1, most=1_000)

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Winners of independent tournaments."""
        draws = rng.integers(len(fitness), size=(count, self.rounds)).tolist()
        return [max(entrants, key=lambda index: fitness[index]) for entrants in draws]


@dataclass(frozen=True, slots=True)
class ElitistParents:
    """The best members in turn, from the fittest down; ties go to the earlier member."""

    share: float = key(0.5, Options.number, low=0.0, high=1.0)

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """The upper `share` of the population, cycled through."""
        del rng  # nothing is random here
        ranked = sorted(range(len(fitness)), key=lambda index: -fitness[index])
        elite = ranked[: max(1, round(self.share * len(ranked)))]
        return [elite[turn % len(elite)] for turn in range(count)]


def acceptance(delta: float, temperature: float) -> float:
    """Probability of moving to a family whose score is lower by `delta`: exp(-delta / temperature).

    Metropolis rule of Kirkpatrick et al. 1983, p. 672.

    Args:
        delta: score(current) - score(candidate), >= 0, in units of the score.
        temperature: >= 0, in units of the score; at 0 nothing worse is accepted.

    >>> acceptance(0.1, 0.1) == exp(-1.0)
    True
    """
    return exp(-delta / temperature) if temperature > 0 else float(delta <= 0)


@dataclass(frozen=True, slots=True)
class SimulatedAnnealing:
    """Random exchanges, worse ones with a probability that falls as the temperature cools; keeps the best family.

    Attributes:
        rounds: number of exchanges tried.
        initial_temperature: in units of the family measure.
        cooling_rate: temperature after a round over temperature before it, in (0, 1].
    """

    rounds: int = key(500, Options.integer, low=0, most=1_000_000)
    initial_temperature: float = key(0.1, Options.number, low=1e-9, high=1e9)
    cooling_rate: float = key(0.95, Options.number, low=1e-9, high=1.0)

    def __post_init__(self) -> None:
        if self.rounds < 0 or self.initial_temperature <= 0 or not 0 < self.cooling_rate <= 1:
            raise InvalidArgument(
                "annealing needs rounds >= 0, initial_temperature > 0, 0 < cooling_rate <= 1"
            )

    def select(
        self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator
    ) -> list[int]:
        """The best family met, the last one among equals."""
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = [index for index in range(len(pool)) if index not in start]
        best = list(free)
        if not free or not rest or size <= len(fixed):
            return sorted([*fixed, *best])
        first, *others = pool.swaps([*fixed, *free])
        leaving = rng.integers(len(free), size=self.rounds).tolist()
        entering = rng.integers(len(rest), size=self.rounds).tolist()
        now, found = [0.0] * (1 + len(others)), [0.0] * (1 + len(others))
        later, between = [*enumerate(others, 1)], others[:-1]
        for place, other, lowest in zip(leaving, entering, self._lowest_accepted(rng), strict=True):
            out, into = free[place], rest[other]
            delta = first.delta(out, into)
            if (_decisive(delta, between, out, into) if between else delta) >= lowest:
                now[0] += delta
                first.swap(out, into)
                for number, one in later:
                    now[number] += one.delta(out, into)
                    one.swap(out, into)
                free[place], rest[other] = into, out
                if now[0] >= found[0] - TIE and not _worse(now, found):
                    best, found = free[:], [max(now[0], found[0]), *now[1:]]
        return sorted([*fixed, *best])

    def _lowest_accepted(self, rng: Generator) -> list[float]:
        """For each round the smallest change of the score, at most 0, that is accepted.

        `luck < acceptance(-delta, temperature)` solved for delta: all logarithms together take no time.
        """
        import numpy as np

        temperatures = self.initial_temperature * self.cooling_rate ** np.arange(self.rounds)
        with np.errstate(divide="ignore"):  # luck may be 0: then everything is accepted
            lowest: list[float] = (temperatures * np.log(rng.random(self.rounds))).tolist()
        return lowest


def _decisive(delta: float, others: Sequence[Swaps], out: int, into: int) -> float:
    """What an exchange changes by the first measure that it changes."""
    later = (one.delta(out, into) for one in others)
    return next((one for one in chain((delta,), later) if abs(one) > TIE), 0.0)


def _worse(scores: Sequence[float], others: Sequence[float]) -> bool:
    """Whether the first scores that are not the same are less."""
    for one, other in zip(scores, others, strict=True):
        if one > other + TIE:
            return False
        if one < other - TIE:
            return True
    return False


@dataclass(frozen=True, slots=True)
class HillClimbing:
    """The best single exchange, again and again, until none helps."""

    def select(
        self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator
    ) -> list[int]:
        """A family that no single exchange improves.

        Before the climb each member in turn makes room for a random candidate, where that loses nothing.
        """
        del size  # the start has it
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = rng.permutation([index for index in range(len(pool)) if index not in start]).tolist()
        swaps = pool.swaps([*fixed, *free])

        def gain(out: int, into: int) -> tuple[float, ...]:
            return tuple([round(one.delta(free[out], rest[into]), DIGITS) for one in swaps])

        def exchange(out: int, into: int) -> None:
            for one in swaps:
                one.swap(free[out], rest[into])
            free[out], rest[into] = rest[into], free[out]

        nothing = (0.0,) * len(swaps)
        if rest:
            for out, into in enumerate(rng.integers(len(rest), size=len(free)).tolist()):
                if gain(out, into) >= nothing:
                    exchange(out, into)
        steps = list(product(range(len(free)), range(len(rest))))
        while steps:
            best = max(steps, key=lambda step: gain(*step))
            if gain(*best) <= nothing:
                break
            exchange(*best)
        return sorted([*fixed, *free])


@dataclass(frozen=True, slots=True)
class BeamSearch:
    """Families grown one candidate at a time; only the most promising ones are grown further.

    Attributes:
        width: how many families are kept at each size.
    """

    width: int = key(16, Options.integer, low=1, most=100_000)

    def select(
        self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator
    ) -> list[int]:
        """The best family found; the start, if that is better."""
        order = rng.permutation(len(pool)).tolist()  # the first of equals is any of them
        beam: list[tuple[int, ...]] = [tuple(sorted(pinned))]
        for _ in range(size - len(pinned)):
            # A dict, and a sort that keeps the order of equals: no set decides.
            grown = dict.fromkeys(
                tuple(sorted((*family, index))) for family in beam for index in order if index not in family
            )
            beam = sorted(grown, key=pool.rank, reverse=True)[: self.width]
        return sorted(max([*beam, start], key=pool.rank))


def _filled(
    values: Sequence[float], wanted: int, pinned: Sequence[int], others: Sequence[int], measure: BinnedEntropy
) -> list[int]:
    """A family of the most entropy: again and again a candidate of a bin that has the fewest.

    What a bin adds to the entropy grows ever more slowly with its members, so nothing is lost by taking what adds the
    most. Of equal bins, and in a bin, what is farthest from the mean comes first.
    """
    mean = fsum(values) / len(values)
    counts, waiting = measure.counts([values[index] for index in pinned]), dict[int, list[int]]()
    for index in sorted(others, key=lambda index: abs(values[index] - mean)):
        waiting.setdefault(measure.bin(values[index]), []).append(index)
    chosen = list(pinned)
    for _ in range(wanted):
        bin = min(waiting, key=lambda bin: (counts[bin], -abs(values[waiting[bin][-1]] - mean)))
        counts[bin] += 1
        chosen.append(waiting[bin].pop())
        if not waiting[bin]:
            del waiting[bin]
    return chosen


@dataclass(frozen=True, slots=True)
class ExactSelection:
    """The best of all families, by trying them all; for small pools, and as the yardstick of the others.

    Where there are too many to try, bins are filled: that gives the most entropy, and of such families one whose values
    vary much, though maybe not the most.

    Attributes:
        limit: more families than this are not tried, and refused where the measure has no bins.
    """

    limit: int = key(200_000, Options.integer, low=1, most=MOST_STEPS)

    def select(
        self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator
    ) -> list[int]:
        """A family that is as good as any."""
        del start
        order = rng.permutation(len(pool)).tolist()  # the first of equals is any of them
        others = [index for index in order if index not in pinned]
        wanted = size - len(pinned)
        if comb(len(others), wanted) > self.limit:
            match pool.measures:
                case (Over(statistic=BinnedEntropy() as bins, of=of),):
                    return sorted(_filled(pool.values(of), wanted, pinned, others, bins))
            raise InvalidArgument(f"{comb(len(others), wanted)} families are too many to try: use annealing")
        return sorted(max(([*pinned, *chosen] for chosen in combinations(others, wanted)), key=pool.rank))
