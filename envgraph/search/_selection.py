"""Choosing parents, and choosing the survivors that together are the most diverse family.

Of families that are equally diverse, the one whose values vary most is chosen: with all members in one bin no exchange
changes the entropy, and chance alone may take thousands of generations to come to another bin. What is equal in that,
too, is drawn at random, so that a population drifts where nothing tells its members apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from math import comb, exp, fsum
from typing import Protocol

import numpy as np
from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.search._diversity import BinnedEntropy, FamilyMeasure, Variance

_DIGITS = 12
"""Scores that agree in so many decimals are the same: sums of swap deltas carry rounding errors."""

_TIE = 10**-_DIGITS


def _scaled(values: Sequence[float]) -> list[float]:
    """The values on [0, 1], so that `_TIE` is small beside differences of their variances."""
    low, high = min(values), max(values)
    width = high - low
    return [(value - low) / width if width > 0 else 0.0 for value in values]


class ParentSelection(Protocol):
    """Which members of a population are varied."""

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """`count` indices into the population, repetitions allowed. Larger fitness is better."""


class SurvivorSelection(Protocol):
    """Which of a pool of candidates form the next population."""

    def select(
        self, values: Sequence[float], size: int, pinned: Sequence[int], start: Sequence[int],
        measure: FamilyMeasure, rng: Generator,
    ) -> list[int]:  # fmt: skip
        """The chosen indices into the pool, ascending.

        Args:
            values: one number for each candidate, what the family measure reads.
            size: how many to choose, at most the size of the pool.
            pinned: candidates that must be chosen.
            start: a family to start from, `size` candidates that include the pinned ones.
            measure: what the chosen family maximises.
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

    rounds: int = 2

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Winners of independent tournaments."""
        draws = rng.integers(len(fitness), size=(count, self.rounds)).tolist()
        return [max(entrants, key=lambda index: fitness[index]) for entrants in draws]


@dataclass(frozen=True, slots=True)
class ElitistParents:
    """The best members in turn, from the fittest down; ties go to the earlier member."""

    share: float = 0.5

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

    rounds: int = 500
    initial_temperature: float = 0.1
    cooling_rate: float = 0.95

    def __post_init__(self) -> None:
        if self.rounds < 0 or self.initial_temperature <= 0 or not 0 < self.cooling_rate <= 1:
            raise InvalidArgument(
                "annealing needs rounds >= 0, initial_temperature > 0, 0 < cooling_rate <= 1"
            )

    def select(
        self, values: Sequence[float], size: int, pinned: Sequence[int], start: Sequence[int],
        measure: FamilyMeasure, rng: Generator,
    ) -> list[int]:  # fmt: skip
        """The best family met, the last one among equals."""
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = [index for index in range(len(values)) if index not in start]
        best = list(free)
        if not free or not rest or size <= len(fixed):
            return sorted([*fixed, *best])
        swaps = measure.swaps(values, [*fixed, *free])
        variances = Variance().swaps(_scaled(values), [*fixed, *free])
        leaving = rng.integers(len(free), size=self.rounds).tolist()
        entering = rng.integers(len(rest), size=self.rounds).tolist()
        score = best_score = spread = best_spread = 0.0
        for place, other, lowest in zip(leaving, entering, self._lowest_accepted(rng), strict=True):
            out, into = free[place], rest[other]
            delta = swaps.delta(out, into)
            if delta >= lowest:
                spread += variances.delta(out, into)
                swaps.swap(out, into)
                variances.swap(out, into)
                free[place], rest[other] = into, out
                score += delta
                gain = score - best_score
                if gain > _TIE or (gain > -_TIE and spread > best_spread - _TIE):
                    best, best_score, best_spread = free[:], max(score, best_score), spread
        return sorted([*fixed, *best])

    def _lowest_accepted(self, rng: Generator) -> list[float]:
        """For each round the smallest change of the score, at most 0, that is accepted.

        `luck < acceptance(-delta, temperature)` solved for delta: all logarithms together take no time.
        """
        temperatures = self.initial_temperature * self.cooling_rate ** np.arange(self.rounds)
        with np.errstate(divide="ignore"):  # luck may be 0: then everything is accepted
            lowest: list[float] = (temperatures * np.log(rng.random(self.rounds))).tolist()
        return lowest


@dataclass(frozen=True, slots=True)
class HillClimbing:
    """The best single exchange, again and again, until none helps."""

    def select(
        self, values: Sequence[float], size: int, pinned: Sequence[int], start: Sequence[int],
        measure: FamilyMeasure, rng: Generator,
    ) -> list[int]:  # fmt: skip
        """A family that no single exchange improves.

        Before the climb each member in turn makes room for a random candidate, where that loses nothing.
        """
        del size  # the start has it
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = rng.permutation([index for index in range(len(values)) if index not in start]).tolist()
        swaps = measure.swaps(values, [*fixed, *free])
        variances = Variance().swaps(_scaled(values), [*fixed, *free])

        def gain(out: int, into: int) -> tuple[float, float]:
            score, spread = (one.delta(free[out], rest[into]) for one in (swaps, variances))
            return round(score, _DIGITS), round(spread, _DIGITS)

        def exchange(out: int, into: int) -> None:
            for one in (swaps, variances):
                one.swap(free[out], rest[into])
            free[out], rest[into] = rest[into], free[out]

        if rest:
            for out, into in enumerate(rng.integers(len(rest), size=len(free)).tolist()):
                if gain(out, into) >= (0, 0):
                    exchange(out, into)
        steps = list(product(range(len(free)), range(len(rest))))
        while steps:
            best = max(steps, key=lambda step: gain(*step))
            if gain(*best) <= (0, 0):
                break
            exchange(*best)
        return sorted([*fixed, *free])


class _Ranking:
    """Candidates in a random order, so that the first of equals is any of them, and how good families of them are."""

    def __init__(self, values: Sequence[float], measure: FamilyMeasure, rng: Generator) -> None:
        self._values, self._scaled, self._measure = values, _scaled(values), measure
        self.order: list[int] = rng.permutation(len(values)).tolist()

    def __call__(self, family: Iterable[int]) -> tuple[float, float]:
        """Larger is better: the score, then the variance of the values."""
        family = tuple(family)
        score = self._measure.score([self._values[index] for index in family])
        spread = Variance().score([self._scaled[index] for index in family])
        return round(score, _DIGITS), round(spread, _DIGITS)


@dataclass(frozen=True, slots=True)
class BeamSearch:
    """Families grown one candidate at a time; only the most promising ones are grown further.

    Attributes:
        width: how many families are kept at each size.
    """

    width: int = 16

    def select(
        self, values: Sequence[float], size: int, pinned: Sequence[int], start: Sequence[int],
        measure: FamilyMeasure, rng: Generator,
    ) -> list[int]:  # fmt: skip
        """The best family found; the start, if that is better."""
        rank = _Ranking(values, measure, rng)
        beam: list[tuple[int, ...]] = [tuple(sorted(pinned))]
        for _ in range(size - len(pinned)):
            # A dict, and a sort that keeps the order of equals: no set decides.
            grown = dict.fromkeys(
                tuple(sorted((*family, index)))
                for family in beam
                for index in rank.order
                if index not in family
            )
            beam = sorted(grown, key=rank, reverse=True)[: self.width]
        return sorted(max([*beam, start], key=rank))


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

    limit: int = 200_000

    def select(
        self, values: Sequence[float], size: int, pinned: Sequence[int], start: Sequence[int],
        measure: FamilyMeasure, rng: Generator,
    ) -> list[int]:  # fmt: skip
        """A family that is as good as any."""
        del start
        rank = _Ranking(values, measure, rng)
        others = [index for index in rank.order if index not in pinned]
        wanted = size - len(pinned)
        if comb(len(others), wanted) > self.limit:
            if isinstance(measure, BinnedEntropy):
                return sorted(_filled(values, wanted, pinned, others, measure))
            raise InvalidArgument(f"{comb(len(others), wanted)} families are too many to try: use annealing")
        return sorted(max(([*pinned, *chosen] for chosen in combinations(others, wanted)), key=rank))
