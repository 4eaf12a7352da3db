"""The measures of families that come with envgraph, beside the statistics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import fsum, inf, isfinite, log, log10
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import TooManyStates
from envgraph.graph import Shapes
from envgraph.search._diversity import BinnedEntropy, Swaps
from envgraph.search._families import Candidate, Pool
from envgraph.search._object_facts import Describer, differing
from envgraph.solve import hit_probability, softened_policy

LEAST: Final = -1e9
"""Stands for minus infinity: sums and differences of scores stay numbers."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Share of the bins that a value can fall into that have a member, from 0 to 1; whatever the order.

    >>> Coverage(BinnedEntropy(4)).score([0.1, 0.2, 0.6])
    0.5
    """

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """The share."""
        return sum(map(bool, self.bins.counts(values))) / self.bins.usable

    def maximum(self, size: int) -> float:
        """The share of a family with as many bins as it can have."""
        return min(1.0, size / self.bins.usable)


@dataclass(frozen=True, slots=True)
class Fewest:
    """Members in the bin that has the fewest, of the bins that a value can fall into; whatever the order.

    >>> Fewest(BinnedEntropy(2)).score([0.1, 0.2, 0.6])
    1.0
    """

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """The number of members."""
        counts = self.bins.counts(values)
        return 0.0 if sum(map(bool, counts)) < self.bins.usable else float(min(filter(None, counts)))

    def maximum(self, size: int) -> float:
        """The number where all bins have as many."""
        return float(size // self.bins.usable)


@dataclass(frozen=True, slots=True)
class Most:
    """Members in the bin that has the most; whatever the order."""

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """The number of members."""
        return float(max(self.bins.counts(values)))


@dataclass(frozen=True, slots=True)
class Evenness:
    """How even the steps of a measure are from each member to the next, from 0 to 1.

    The entropy of the shares that the steps have in the whole way, over its maximum (Pielou 1966, of abundances): 1
    where all steps are equal, 0 where one step is the whole way, or nothing changes. Depends on the order, and is the
    same for the order reversed.

    >>> Evenness().score([0.0, 1.0, 2.0]), Evenness().score([0.0, 2.0, 2.0])
    (1.0, 0.0)
    """

    def score(self, values: Sequence[float]) -> float:
        """The evenness; 1 for two members that differ."""
        steps = [abs(after - before) for before, after in pairwise(values)]
        whole = fsum(steps)
        if len(steps) < 2 or not whole:
            return float(bool(whole))
        # 0.0 - ... keeps a single step from scoring -0.0; rounding may lead above 1.
        shares = [step / whole for step in steps if step]
        return min(1.0, (0.0 - fsum(share * log(share) for share in shares)) / log(len(steps)))

    def maximum(self, size: int) -> float:
        """Of equal steps."""
        return float(size > 1)


@dataclass(frozen=True, slots=True)
class Rising:
    """Share of the steps from each member to the next in which a measure does not fall, from 0 to 1; 1 without steps.

    Depends on the order.

    >>> Rising().score([1.0, 1.0, 3.0, 2.0, 2.5])
    0.75
    """

    def score(self, values: Sequence[float]) -> float:
        """The share."""
        steps = [*pairwise(values)]
        return sum(before <= after for before, after in steps) / len(steps) if steps else 1.0

    def maximum(self, size: int) -> float:
        """Where it never falls."""
        return 1.0


class Distance:
    """How far the members are from each other: in how many objects two of them differ, see `Family.distances`.

    Whatever the order; 0 for fewer than two members. Either the mean over all pairs, or the distance of the nearest.

    Args:
        least: whether that of the nearest counts, and not the mean.
    """

    def __init__(self, least: bool) -> None:
        self._least, self._describe = least, Describer()

    def score(self, members: Sequence[Candidate]) -> float:
        """The mean or least distance."""
        return self._of(self._between(members), np.arange(len(members)))

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Swaps by the distances between all candidates, which are computed once."""
        between = self._between(pool.candidates)
        return _LeastSwaps(self._of, between, members) if self._least else _MeanSwaps(between, members)

    def _between(self, members: Sequence[Candidate]) -> NDArray[np.int64]:
        """The distances [members, members]."""
        rows = [self._row(member) for member in members]
        objects = np.zeros((len(rows), max(map(len, rows), default=0)), np.int32)
        for place, row in enumerate(rows):
            objects[place, : len(row)] = row
        return differing(objects, objects)

    def _row(self, member: Candidate) -> NDArray[np.int32]:
        return member.once(self, lambda: self._describe(member.model))

    def _of(self, between: NDArray[np.int64], members: NDArray[np.int64]) -> float:
        pairs = between[members[:, None], members][np.triu_indices(len(members), 1)]
        if not len(pairs):
            return 0.0
        return float(pairs.min() if self._least else pairs.sum() / len(pairs))


class _MeanSwaps:
    """Invariant: `_sums[c]` is the sum of the distances between candidate c and the members."""

    def __init__(self, between: NDArray[np.int64], members: Sequence[int]) -> None:
        self._between, self._pairs = between, max(1, len(members) * (len(members) - 1) // 2)
        self._sums = between[:, [*members]].sum(axis=1)

    def delta(self, leaving: int, entering: int) -> float:
        gained = self._sums[entering] - self._between[entering, leaving] - self._sums[leaving]
        return float(gained) / self._pairs

    def swap(self, leaving: int, entering: int) -> None:
        self._sums += self._between[entering] - self._between[leaving]


class _LeastSwaps:
    """Invariant: `_least` is the distance of the nearest of `_members`."""

    def __init__(
        self,
        of: Callable[[NDArray[np.int64], NDArray[np.int64]], float],
        between: NDArray[np.int64],
        members: Sequence[int],
    ) -> None:
        self._of, self._between, self._members = of, between, np.array([*members])
        self._least = of(between, self._members)

    def delta(self, leaving: int, entering: int) -> float:
        return self._of(self._between, self._exchanged(leaving, entering)) - self._least

    def swap(self, leaving: int, entering: int) -> None:
        self._members = self._exchanged(leaving, entering)
        self._least = self._of(self._between, self._members)

    def _exchanged(self, leaving: int, entering: int) -> NDArray[np.int64]:
        return np.where(self._members == leaving, entering, self._members)


class Distinct:
    """Share of the members that is left where of isomorphic ones one counts, from 0 to 1; whatever the order."""

    def __init__(self) -> None:
        self._shapes = Shapes()

    def score(self, members: Sequence[Candidate]) -> float:
        """The share; 1 for no members."""
        return len({self._shape(member) for member in members}) / len(members) if members else 1.0

    def _shape(self, member: Candidate) -> int:
        return member.once(self, lambda: self._shapes.number(member.model.graph.store))

    def maximum(self, size: int) -> float:
        """Where no two are isomorphic."""
        return 1.0


class ChainTransfer:
    """`chain_transfer` of the tables of the members: the sum of log10 of chances, at most 0. Depends on the order.

    A billion below 0 where success cannot be reached, or a member has more than 50,000 states.
    """

    def score(self, members: Sequence[Candidate]) -> float:
        """The sum."""
        try:
            found = fsum(
                self._transfer(before, member) for before, member in pairwise((None, *members)) if member
            )
        except TooManyStates:
            return LEAST
        return found if isfinite(found) else LEAST

    @staticmethod
    def _transfer(before: Candidate | None, member: Candidate) -> float:
        """Log10 of the chance of success in a member with what is best in the one before it."""

        def found() -> float:
            policy = None
            if before is not None:
                policy = before.once("softened policy", lambda: softened_policy(before.tabular))
            hit = hit_probability(member.tabular, policy)
            return log10(hit) if hit > 0.0 else -inf

        return member.once(("transfer", before and before.state), found)

    def maximum(self, size: int) -> float:
        """Where every chance is 1."""
        return 0.0
