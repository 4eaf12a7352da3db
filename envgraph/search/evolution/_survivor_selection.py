"""Parent selection, and survivor selection, which chooses the members that together are the most diverse family.

`Pool` compares families. Ties are broken at random, so that a population drifts if its members are equally good.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, combinations, product
from math import comb, exp, fsum
from typing import TYPE_CHECKING, Protocol

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import ComponentOptions, key
from envgraph.search.problem._candidate_pool import SCORE_DECIMALS, SCORE_TOLERANCE, Pool, StatisticMeasure
from envgraph.search.problem._statistics import BinnedEntropy, Swaps

if TYPE_CHECKING:
    from numpy.random import Generator


class ParentSelection(Protocol):
    """A strategy that chooses the members of a population that are mutated."""

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Return `count` indices into the population, with repetitions. Larger fitness is better."""


class SurvivorSelection(Protocol):
    """A strategy that chooses the next population from a pool of candidates."""

    def select(self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator) -> list[int]:
        """Return the chosen indices into the pool, ascending.

        Args:
            pool: the candidates, and the comparison of families.
            size: number of candidates to choose, at most the size of the pool.
            pinned: candidates that must be chosen.
            start: the family from which to start, `size` candidates that include the pinned ones.
            rng: source of all random choices.
        """


@dataclass(frozen=True, slots=True)
class RandomParents:
    """Parent selection that samples members uniformly with replacement, as in the paper."""

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Return `count` uniformly sampled indices."""
        return [int(index) for index in rng.integers(len(fitness), size=count)]


@dataclass(frozen=True, slots=True)
class TournamentParents:
    """Tournament selection: each parent is the fittest of `rounds` uniformly sampled members; the first wins ties.

    Attributes:
        rounds: number of members that are sampled for each parent.
    """

    rounds: int = key(2, ComponentOptions.integer, low=1, most="rounds")

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Return the winners of `count` independent tournaments."""
        draws = rng.integers(len(fitness), size=(count, self.rounds)).tolist()
        return [max(entrants, key=lambda index: fitness[index]) for entrants in draws]


@dataclass(frozen=True, slots=True)
class ElitistParents:
    """Elitist parent selection: the fittest members in turn, from the best down. The earlier member wins ties.

    Attributes:
        share: share of the members that become parents.
    """

    share: float = key(0.5, ComponentOptions.number, low=0.0, high=1.0)

    def select(self, fitness: Sequence[float], count: int, rng: Generator) -> list[int]:
        """Return the indices of the best `share` of the population, repeated in order until there are `count`."""
        del rng  # this selection is deterministic
        ranked = sorted(range(len(fitness)), key=lambda index: -fitness[index])
        elite = ranked[: max(1, round(self.share * len(ranked)))]
        return [elite[turn % len(elite)] for turn in range(count)]


def acceptance_probability(delta: float, temperature: float) -> float:
    """Return the probability of accepting a family whose score is lower by `delta`: exp(-delta / temperature).

    Metropolis rule of Kirkpatrick et al. 1983, p. 672.

    Args:
        delta: score(current) - score(candidate), >= 0, in units of the score.
        temperature: >= 0, in units of the score; at 0 no lower score is accepted.

    >>> acceptance_probability(0.1, 0.1) == exp(-1.0)
    True
    """
    return exp(-delta / temperature) if temperature > 0 else float(delta <= 0)


@dataclass(frozen=True, slots=True)
class SimulatedAnnealing:
    """Survivor selection by simulated annealing: random exchanges; worse ones are accepted with a falling probability.

    Attributes:
        rounds: number of exchanges to try.
        initial_temperature: initial temperature, in units of the family measure.
        cooling_rate: factor by which the temperature falls in each round, in (0, 1].
    """

    rounds: int = key(500, ComponentOptions.integer, low=0, most="attempts")
    initial_temperature: float = key(0.1, ComponentOptions.number, low=1e-9, high=1e9)
    cooling_rate: float = key(0.95, ComponentOptions.number, low=1e-9, high=1.0)

    def __post_init__(self) -> None:
        if self.rounds < 0 or self.initial_temperature <= 0 or not 0 < self.cooling_rate <= 1:
            raise InvalidArgument(
                f"`rounds`, `initial_temperature` and `cooling_rate` are {self.rounds}, {self.initial_temperature} and "
                f"{self.cooling_rate}, but must be at least 0, above 0, and above 0 and at most 1"
            )

    def select(self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator) -> list[int]:
        """Return the indices of the best family found, the last one among equals."""
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = [index for index in range(len(pool)) if index not in start]
        best = list(free)
        if not free or not rest or size <= len(fixed):
            return sorted([*fixed, *best])
        first, *others = pool.all_swaps([*fixed, *free])
        leaving = rng.integers(len(free), size=self.rounds).tolist()
        entering = rng.integers(len(rest), size=self.rounds).tolist()
        now, found = [0.0] * (1 + len(others)), [0.0] * (1 + len(others))
        later, between = [*enumerate(others, 1)], others[:-1]
        for place, other, lowest in zip(leaving, entering, self._lowest_accepted_changes(rng), strict=True):
            out, into = free[place], rest[other]
            delta = first.delta(out, into)
            if (_first_change(delta, between, out, into) if between else delta) >= lowest:
                now[0] += delta
                first.swap(out, into)
                for number, one in later:
                    now[number] += one.delta(out, into)
                    one.swap(out, into)
                free[place], rest[other] = into, out
                if now[0] >= found[0] - SCORE_TOLERANCE and not _is_worse(now, found):
                    best, found = free[:], [max(now[0], found[0]), *now[1:]]
        return sorted([*fixed, *best])

    def _lowest_accepted_changes(self, rng: Generator) -> list[float]:
        """Return the smallest accepted change of the score for each round, at most 0.

        It is the solution of `luck < acceptance(-delta, temperature)` for delta, where `luck` is uniform from 0 to 1.
        Computing all logarithms at once is fast.
        """
        import numpy as np

        temperatures = self.initial_temperature * self.cooling_rate ** np.arange(self.rounds)
        with np.errstate(divide="ignore"):  # luck may be 0, which accepts everything
            lowest: list[float] = (temperatures * np.log(rng.random(self.rounds))).tolist()
        return lowest


def _first_change(delta: float, other_swaps: Sequence[Swaps], leaving: int, entering: int) -> float:
    """Return `delta` if it is not about 0, else the first change by `other_swaps` that is not; 0.0 if all are about
    0.
    """
    later = (one.delta(leaving, entering) for one in other_swaps)
    return next((one for one in chain((delta,), later) if abs(one) > SCORE_TOLERANCE), 0.0)


def _is_worse(scores: Sequence[float], other_scores: Sequence[float]) -> bool:
    """Return True if `scores` is smaller than `other_scores` at the first place where they differ beyond the
    tolerance.
    """
    for one, other in zip(scores, other_scores, strict=True):
        if one > other + SCORE_TOLERANCE:
            return False
        if one < other - SCORE_TOLERANCE:
            return True
    return False


@dataclass(frozen=True, slots=True)
class HillClimbing:
    """Survivor selection by hill climbing: make the best single exchange until no exchange improves the family."""

    def select(self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator) -> list[int]:
        """Return the indices of a family that no single exchange improves.

        Before the climb each member in turn is exchanged for a random candidate if the score does not fall.
        """
        del size  # the start has this size
        fixed = list(pinned)
        free = [index for index in start if index not in fixed]
        rest = rng.permutation([index for index in range(len(pool)) if index not in start]).tolist()
        swaps = pool.all_swaps([*fixed, *free])

        def gain(out: int, into: int) -> tuple[float, ...]:
            return tuple([round(one.delta(free[out], rest[into]), SCORE_DECIMALS) for one in swaps])

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
    """Survivor selection by beam search: families grow by one candidate at a time, and only the best ones are extended.

    Attributes:
        width: number of families that are extended at each size.
    """

    width: int = key(16, ComponentOptions.integer, low=1, most="width")

    def select(self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator) -> list[int]:
        """Return the indices of the best family found, or of `start` if that is better."""
        order = rng.permutation(len(pool)).tolist()  # ties are broken at random by this order
        beam: list[tuple[int, ...]] = [tuple(sorted(pinned))]
        for _ in range(size - len(pinned)):
            # A dict and a stable sort: the order of sets must not affect the result.
            grown = dict.fromkeys(
                tuple(sorted((*family, index))) for family in beam for index in order if index not in family
            )
            beam = sorted(grown, key=pool.ranking_key, reverse=True)[: self.width]
        return sorted(max([*beam, start], key=pool.ranking_key))


def _fill_bins(
    values: Sequence[float], wanted: int, pinned: Sequence[int], others: Sequence[int], measure: BinnedEntropy
) -> list[int]:
    """Return the pinned candidates and `wanted` of the others, added one by one from a bin with the fewest members.

    The entropy is largest, because the entropy gain of a bin falls with its number of members. Ties between bins, and
    within a bin, are broken by the largest distance from the mean.
    """
    mean = fsum(values) / len(values)
    counts, waiting = measure.bin_counts([values[index] for index in pinned]), dict[int, list[int]]()
    for index in sorted(others, key=lambda index: abs(values[index] - mean)):
        waiting.setdefault(measure.bin_of(values[index]), []).append(index)
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
    """Survivor selection by exhaustive search over all families, for small pools and to test other selections.

    If there are too many families, bins are filled instead. The result then has the largest entropy and a large
    variance, but maybe not the largest variance.

    Attributes:
        limit: largest number of families to try. If the measure has no bins, more families are refused.
    """

    limit: int = key(200_000, ComponentOptions.integer, low=1, most="steps")

    def select(self, pool: Pool, size: int, pinned: Sequence[int], start: Sequence[int], rng: Generator) -> list[int]:
        """Return the indices of a best family. If there are too many families to try, bins are filled.

        Raises:
            InvalidArgument: there are more than `limit` families, and the measure has no bins.
        """
        del start
        order = rng.permutation(len(pool)).tolist()  # ties are broken at random by this order
        others = [index for index in order if index not in pinned]
        wanted = size - len(pinned)
        if comb(len(others), wanted) > self.limit:
            match pool.measures:
                case (StatisticMeasure(statistic=BinnedEntropy() as bins, of=of),):
                    return sorted(_fill_bins(pool.measure_values(of), wanted, pinned, others, bins))
            raise InvalidArgument(f"{comb(len(others), wanted)} families are too many to try: use `SimulatedAnnealing`")
        return sorted(max(([*pinned, *chosen] for chosen in combinations(others, wanted)), key=pool.ranking_key))
