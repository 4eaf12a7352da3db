"""Statistics of a family: one number for the values of its members.

A statistic may offer *swaps*, the score after exchanging one member, because survivor selection asks for little else:
for binned entropy that is a constant amount of work instead of a pass over the family.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, floor, fsum, log2
from typing import Protocol, runtime_checkable

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument


class Swaps(Protocol):
    """Scores of families that differ from the current one in one member. Candidates are named by pool index."""

    def delta(self, leaving: int, entering: int) -> float:
        """Score after the exchange minus score before it; nothing is changed."""

    def swap(self, leaving: int, entering: int) -> None:
        """Exchange the two."""


class Statistic(Protocol):
    """One number of the values of a family, whatever their order; larger is more diverse.

    It may also have `swaps(values, members) -> Swaps`, exchanges from the family of `members`, which are indices into
    `values`: without it the statistic is computed anew for each.
    """

    def score(self, values: Sequence[float]) -> float:
        """The statistic of a family with these values."""


@runtime_checkable
class Bounded(Protocol):
    """A statistic, or a measure of families, that knows how large it can be at most; a search stops there."""

    def maximum(self, size: int) -> float:
        """The largest score of a family of so many members."""


@dataclass(frozen=True, slots=True)
class BinnedEntropy:
    """Shannon entropy, in bits, of the distribution of the values over equal bins.

    H = -sum p_i log2 p_i with p_i the share of members in bin i (Shannon 1948, section 6). It is largest where the
    members are spread over the bins as evenly as their number allows.

    Attributes:
        bins: number of equal bins, at least 1.
        low, high: the range that is divided; values outside count in the first or last bin, and the upper end
            belongs to the last bin.
        whole: whether the values are whole numbers, so that a bin between two of them stays empty.

    >>> BinnedEntropy(4).score([0.1, 0.3, 0.6, 0.9])
    2.0
    >>> BinnedEntropy(4).maximum(8), BinnedEntropy(4, 0, 1, whole=True).maximum(8)
    (2.0, 1.0)
    """

    bins: int
    low: float = 0.0
    high: float = 1.0
    whole: bool = False

    def __post_init__(self) -> None:
        if self.bins < 1 or not self.low < self.high:
            raise InvalidArgument(f"cannot make {self.bins} bins on [{self.low}, {self.high}]")

    def bin(self, value: float) -> int:
        """Number of the bin of a value, from 0."""
        if value <= self.low:  # values far outside would overflow below
            return 0
        if value >= self.high:
            return self.bins - 1
        return min(int((value - self.low) / (self.high - self.low) * self.bins), self.bins - 1)

    def counts(self, values: Sequence[float]) -> list[int]:
        """How many values each bin holds."""
        counts = [0] * self.bins
        for value in values:
            counts[self.bin(value)] += 1
        return counts

    def score(self, values: Sequence[float]) -> float:
        """The entropy; 0.0 for no values."""
        size = len(values)
        # 0.0 - ... keeps a family in one bin from scoring -0.0.
        return 0.0 - fsum(count / size * log2(count / size) for count in self.counts(values) if count)

    def maximum(self, size: int) -> float:
        """The entropy of a family whose members are spread as evenly as possible."""
        each, rest = divmod(size, self.usable)
        counts = [(each + 1, rest), (each, self.usable - rest)]
        return 0.0 - fsum(bins * count / size * log2(count / size) for count, bins in counts if count)

    @property
    def usable(self) -> int:
        """How many bins a value can fall into."""
        if not self.whole or self.high - self.low >= self.bins:
            return self.bins
        # One whole number beyond each end: it counts in the bin there.
        return len({self.bin(value) for value in range(floor(self.low), ceil(self.high) + 1)})

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Swaps:
        """Swaps in constant time."""
        return _EntropySwaps(self, values, members)


class _EntropySwaps:
    """Invariant: `_counts[b]` members of the current family are in bin b."""

    def __init__(self, measure: BinnedEntropy, values: Sequence[float], members: Sequence[int]) -> None:
        self._bin = [measure.bin(value) for value in values]
        self._counts = measure.counts([values[index] for index in members])
        size = len(members)
        # The contribution of a bin with c members to the entropy; there are only size + 1 different ones.
        term = [0.0] + [-(count / size) * log2(count / size) for count in range(1, size + 1)]
        # How that changes when one of c members leaves, or joins them. Nobody leaves a bin without members.
        self._leaving = [0.0] + [less - more for less, more in pairwise(term)]
        self._joining = [more - less for less, more in pairwise(term)]

    def delta(self, leaving: int, entering: int) -> float:
        out, into = self._bin[leaving], self._bin[entering]
        if out == into:
            return 0.0
        return self._leaving[self._counts[out]] + self._joining[self._counts[into]]

    def swap(self, leaving: int, entering: int) -> None:
        self._counts[self._bin[leaving]] -= 1
        self._counts[self._bin[entering]] += 1


@dataclass(frozen=True, slots=True)
class Gini:
    """Gini coefficient of the values: mean absolute difference over twice the mean (Gini 1912).

    0 when all values are equal, or all are 0; values must not be negative.

    >>> Gini().score([0.0, 0.0, 0.0, 1.0])
    0.75
    """

    def score(self, values: Sequence[float]) -> float:
        """The coefficient, in [0, 1)."""
        ordered = sorted(values)
        total = fsum(ordered)
        if not ordered or total == 0:
            return 0.0
        if ordered[0] < 0:
            raise InvalidArgument("the Gini coefficient is defined for values that are not negative")
        size = len(ordered)
        weighted = fsum((2 * rank - size - 1) * value for rank, value in enumerate(ordered, start=1))
        return weighted / (size * total)

    def maximum(self, size: int) -> float:
        """The coefficient where one member has all."""
        return 1 - 1 / size if size else 0.0


@dataclass(frozen=True, slots=True)
class Variance:
    """Population variance of the values.

    >>> Variance().score([0.0, 1.0])
    0.25
    """

    def score(self, values: Sequence[float]) -> float:
        """The variance; 0.0 for no values."""
        if not values:
            return 0.0
        mean = fsum(values) / len(values)
        return fsum((value - mean) ** 2 for value in values) / len(values)

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Swaps:
        """Swaps in constant time."""
        return _VarianceSwaps(values, members)


class _VarianceSwaps:
    """Invariant: `_total` is the sum of the members' values, as distances from the mean of all values."""

    def __init__(self, values: Sequence[float], members: Sequence[int]) -> None:
        mean = fsum(values) / max(1, len(values))  # near 0, sums lose the fewest digits
        self._values = [value - mean for value in values]
        self._size = len(members)
        self._total = fsum(self._values[index] for index in members)

    def delta(self, leaving: int, entering: int) -> float:
        # Var = (n sum x^2 - (sum x)^2) / n^2, and x becomes x + change.
        out, into = self._values[leaving], self._values[entering]
        change = into - out
        return change * (self._size * (into + out) - 2 * self._total - change) / self._size**2

    def swap(self, leaving: int, entering: int) -> None:
        self._total += self._values[entering] - self._values[leaving]
