"""Statistics of a family: one number computed from the values of its members.

A statistic may offer *swaps*: the change of its score if one member is exchanged for a candidate. Survivor selection
asks for little else. For binned entropy a swap takes constant time instead of a pass over the family.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, floor, fsum, log2
from typing import Protocol, runtime_checkable

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument


class Swaps(Protocol):
    """Score changes if one member of a family is exchanged for a candidate. Candidates are given by pool index."""

    def delta(self, leaving: int, entering: int) -> float:
        """Return the score after exchanging `leaving` for `entering` minus the current score. Change nothing."""

    def swap(self, leaving: int, entering: int) -> None:
        """Exchange the member `leaving` for the candidate `entering`. The result is the new current family."""


class Statistic(Protocol):
    """A number computed from the values of a family, independent of their order; a larger number means more diverse.

    A statistic may also have a method `swaps(values, members) -> Swaps`, where `members` are indices into `values`.
    Without it the statistic is recomputed for each swap.
    """

    def score(self, values: Sequence[float]) -> float:
        """Return the statistic of a family whose members have these values."""


@runtime_checkable
class BoundedMeasure(Protocol):
    """A statistic or family measure with a known upper bound. A search stops when a family reaches the bound."""

    def maximum(self, size: int) -> float:
        """Return the upper bound on the score of a family of `size` members."""


@dataclass(frozen=True, slots=True)
class BinnedEntropy:
    """Shannon entropy, in bits, of the distribution of the values over bins of equal width.

    H = -sum p_i log2 p_i with p_i the share of members in bin i (Shannon 1948, section 6). The entropy is largest if
    the members are spread over the bins as evenly as their number allows.

    Attributes:
        bins: number of bins, at least 1.
        low, high: the range that is divided. Values outside count in the first or last bin; `high` belongs to the last
            bin.
        whole: True if all values are integers. A bin that contains no integer then stays empty.

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
            raise InvalidArgument(
                f"`bins` is {self.bins} on [{self.low}, {self.high}], but must be at least 1, and the range not empty"
            )

    def bin_of(self, value: float) -> int:
        """Return the index of the bin of a value, from 0. Values outside of the range are in the first or last bin."""
        if value <= self.low:  # values far outside would overflow below
            return 0
        if value >= self.high:
            return self.bins - 1
        return min(int((value - self.low) / (self.high - self.low) * self.bins), self.bins - 1)

    def bin_counts(self, values: Sequence[float]) -> list[int]:
        """Return the number of values in each bin."""
        counts = [0] * self.bins
        for value in values:
            counts[self.bin_of(value)] += 1
        return counts

    def score(self, values: Sequence[float]) -> float:
        """Return the entropy of the values in bits; 0.0 if there are no values."""
        size = len(values)
        # 0.0 - ... keeps a family in one bin from scoring -0.0.
        return 0.0 - fsum(count / size * log2(count / size) for count in self.bin_counts(values) if count)

    def maximum(self, size: int) -> float:
        """Return the entropy of `size` members that are spread over the bins as evenly as possible."""
        each, rest = divmod(size, self.usable_bins)
        counts = [(each + 1, rest), (each, self.usable_bins - rest)]
        return 0.0 - fsum(bins * count / size * log2(count / size) for count, bins in counts if count)

    @property
    def usable_bins(self) -> int:
        """Return the number of bins that can contain a value."""
        if not self.whole or self.high - self.low >= self.bins:
            return self.bins
        # The range is extended by one integer at each end: values outside count in the first or last bin.
        return len({self.bin_of(value) for value in range(floor(self.low), ceil(self.high) + 1)})

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Swaps:
        """Return an object for the entropy changes if a member is exchanged, each computed in constant time."""
        return _EntropySwaps(self, values, members)


class _EntropySwaps:
    """Changes of binned entropy if one member is exchanged for a candidate.

    Invariant: `_counts[b]` members of the current family are in bin b.
    """

    def __init__(self, measure: BinnedEntropy, values: Sequence[float], members: Sequence[int]) -> None:
        self._bin = [measure.bin_of(value) for value in values]
        self._counts = measure.bin_counts([values[index] for index in members])
        size = len(members)
        # The contribution of a bin with c members to the entropy, for c from 0 to `size`.
        term = [0.0] + [-(count / size) * log2(count / size) for count in range(1, size + 1)]
        # How the contribution changes if one of c members leaves, or if one joins. No member leaves an empty bin.
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
    """Gini coefficient of the values: their mean absolute difference divided by twice their mean (Gini 1912).

    It is 0 if all values are equal. No value may be negative.

    >>> Gini().score([0.0, 0.0, 0.0, 1.0])
    0.75
    """

    def score(self, values: Sequence[float]) -> float:
        """Return the coefficient, in [0, 1); 0 for no values. Raises `InvalidArgument` if a value is negative."""
        ordered = sorted(values)
        total = fsum(ordered)
        if not ordered or total == 0:
            return 0.0
        if ordered[0] < 0:
            raise InvalidArgument(f"the Gini coefficient needs values of at least 0, but one value is {ordered[0]:g}")
        size = len(ordered)
        weighted = fsum((2 * rank - size - 1) * value for rank, value in enumerate(ordered, start=1))
        return weighted / (size * total)

    def maximum(self, size: int) -> float:
        """Return the coefficient of `size` values of which only one is not 0."""
        return 1 - 1 / size if size else 0.0


@dataclass(frozen=True, slots=True)
class Variance:
    """Population variance of the values.

    >>> Variance().score([0.0, 1.0])
    0.25
    """

    def score(self, values: Sequence[float]) -> float:
        """Return the population variance of the values; 0.0 if there are no values."""
        if not values:
            return 0.0
        mean = fsum(values) / len(values)
        return fsum((value - mean) ** 2 for value in values) / len(values)

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Swaps:
        """Return an object for the variance changes if a member is exchanged, each computed in constant time."""
        return _VarianceSwaps(values, members)


class _VarianceSwaps:
    """Changes of the variance if one member is exchanged for a candidate.

    Invariant: `_total` is the sum of the members' values minus the mean of all candidates' values.
    """

    def __init__(self, values: Sequence[float], members: Sequence[int]) -> None:
        mean = fsum(values) / max(1, len(values))  # centred on 0, so that sums lose the fewest digits
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
