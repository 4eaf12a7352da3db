"""The measures of families that come with envgraph, beside the statistics."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import fsum, inf, isfinite, log, log10
from typing import Final

from envgraph.code import dataclass
from envgraph.graph import Shapes
from envgraph.search.problem._diversity import BinnedEntropy
from envgraph.search.problem._pool import Candidate

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
        from envgraph.env import TooManyStates

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
        from envgraph.solve import hit_probability, softened_policy

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
