"""The built-in family measures, except the statistics of `_diversity.py` and the distances."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import fsum, inf, isfinite, log, log10
from typing import Final

from envgraph.code import dataclass
from envgraph.graph import IsomorphismClasses
from envgraph.search.problem._candidate_pool import Candidate
from envgraph.search.problem._statistics import BinnedEntropy

LOWEST_SCORE: Final = -1e9
"""Used in place of minus infinity, so that sums and differences of scores stay finite."""


@dataclass(frozen=True, slots=True)
class BinCoverage:
    """A statistic: the share of the usable bins that contain a member, from 0 to 1. The order does not matter.

    >>> BinCoverage(BinnedEntropy(4)).score([0.1, 0.2, 0.6])
    0.5
    """

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """Return the share of the usable bins that contain a value."""
        return sum(map(bool, self.bins.bin_counts(values))) / self.bins.usable_bins

    def maximum(self, size: int) -> float:
        """Return the share if `size` members fill as many bins as possible."""
        return min(1.0, size / self.bins.usable_bins)


@dataclass(frozen=True, slots=True)
class SmallestBinCount:
    """A statistic: the number of members in the usable bin with the fewest members. The order does not matter.

    >>> SmallestBinCount(BinnedEntropy(2)).score([0.1, 0.2, 0.6])
    1.0
    """

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """Return the number of values in the usable bin with the fewest values; 0.0 if a usable bin is empty."""
        counts = self.bins.bin_counts(values)
        return 0.0 if sum(map(bool, counts)) < self.bins.usable_bins else float(min(filter(None, counts)))

    def maximum(self, size: int) -> float:
        """Return the number of members in the smallest bin if `size` members are spread evenly."""
        return float(size // self.bins.usable_bins)


@dataclass(frozen=True, slots=True)
class LargestBinCount:
    """A statistic: the number of members in the bin with the most members. The order does not matter."""

    bins: BinnedEntropy

    def score(self, values: Sequence[float]) -> float:
        """Return the number of values in the bin with the most values."""
        return float(max(self.bins.bin_counts(values)))


@dataclass(frozen=True, slots=True)
class StepEvenness:
    """A statistic: how evenly a measure changes from each member to the next, from 0 to 1.

    Each change is divided by the sum of all absolute changes. The evenness is the entropy of these shares divided by
    its maximum (Pielou 1966, of abundances). It is 1 if all changes are equal, and 0 if at most one change is not 0. It
    depends on the order of the members, but the reversed order has the same evenness.

    >>> StepEvenness().score([0.0, 1.0, 2.0]), StepEvenness().score([0.0, 2.0, 2.0])
    (1.0, 0.0)
    """

    def score(self, values: Sequence[float]) -> float:
        """Return the evenness of the values. Two different values have evenness 1; fewer than two values have 0."""
        steps = [abs(after - before) for before, after in pairwise(values)]
        whole = fsum(steps)
        if len(steps) < 2 or not whole:
            return float(bool(whole))
        # 0.0 - ... keeps a single change from scoring -0.0; rounding may exceed 1.
        shares = [step / whole for step in steps if step]
        return min(1.0, (0.0 - fsum(share * log(share) for share in shares)) / log(len(steps)))

    def maximum(self, size: int) -> float:
        """Return 1.0, the evenness of equal changes; 0.0 if there are fewer than two members."""
        return float(size > 1)


@dataclass(frozen=True, slots=True)
class RisingShare:
    """A statistic: the share of consecutive pairs of members in which a measure does not decrease, from 0 to 1.

    It depends on the order of the members. Fewer than two members score 1.

    >>> RisingShare().score([1.0, 1.0, 3.0, 2.0, 2.5])
    0.75
    """

    def score(self, values: Sequence[float]) -> float:
        """Return the share of consecutive pairs of values that do not decrease."""
        steps = [*pairwise(values)]
        return sum(before <= after for before, after in steps) / len(steps) if steps else 1.0

    def maximum(self, size: int) -> float:
        """Return 1, the score of values that never decrease."""
        return 1.0


class DistinctMembers:
    """A family measure: the number of non-isomorphic members divided by the number of members, from 0 to 1.

    The order of the members does not matter.
    """

    def __init__(self) -> None:
        self._shapes = IsomorphismClasses()

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the share of members that remain if isomorphic members count once; 1 for no members."""
        return len({self._shape_number(member) for member in members}) / len(members) if members else 1.0

    def _shape_number(self, member: Candidate) -> int:
        return member.once(self, lambda: self._shapes.class_number(member.model.graph.store))

    def maximum(self, size: int) -> float:
        """Return 1, the score of a family without isomorphic members."""
        return 1.0


class ChainTransfer:
    """A family measure: the sum of log10 of the success probabilities along the curriculum, at most 0.

    Each member is played with the softened optimal policy of the previous member; the first member with a random
    policy. The sum is -1e9 if success cannot be reached, or if a member has more than 50,000 states. It depends on the
    order.
    """

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the sum of log10 of the success probabilities; -1e9 if a probability is 0 or a table is too large."""
        from envgraph.env import TooManyStates

        try:
            found = fsum(self._log_success(before, member) for before, member in pairwise((None, *members)) if member)
        except TooManyStates:
            return LOWEST_SCORE
        return found if isfinite(found) else LOWEST_SCORE

    @staticmethod
    def _log_success(before: Candidate | None, member: Candidate) -> float:
        """Return log10 of the success probability in `member`, cached; -inf if it is 0.

        The policy is the softened optimal policy of `before`, or a random policy if `before` is None.
        """
        from envgraph.solve import hit_probability, softened_policy

        def compute_log_success() -> float:
            policy = None
            if before is not None:
                policy = before.once("softened policy", lambda: softened_policy(before.tabular))
            hit = hit_probability(member.tabular, policy)
            return log10(hit) if hit > 0.0 else -inf

        return member.once(("transfer", before and before.state), compute_log_success)

    def maximum(self, size: int) -> float:
        """Return 0, the score if every success probability is 1."""
        return 0.0
