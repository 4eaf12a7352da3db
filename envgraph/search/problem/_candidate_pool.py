"""Family measures, which see all members in their order, and pools of candidates from which families are chosen.

Every measure of families follows the protocol `FamilyMeasure`. A `Statistic` of one measure of the members, such as an
entropy, becomes a family measure by `StatisticMeasure`. Survivor selection mostly exchanges single members. A measure
that can compute the change of its score faster than the score has a method `change`, or `swaps` if it needs a cache for
that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf
from typing import TYPE_CHECKING, Final, Protocol, TypeVar, runtime_checkable

from envgraph.code import dataclass
from envgraph.graph import Model
from envgraph.search.problem._statistics import BoundedMeasure, Statistic, Swaps, Variance

if TYPE_CHECKING:
    from envgraph.env import Tabular

T = TypeVar("T")

SCORE_DECIMALS: Final = 12
"""Decimals to which scores are rounded before comparison: sums of swap deltas have rounding errors."""

SCORE_TOLERANCE: Final = 10**-SCORE_DECIMALS


class Candidate(Protocol):
    """A member of a family as family measures see it."""

    @property
    def measures(self) -> Mapping[str, float]:
        """Return the value of every measure of the family file, by name."""

    @property
    def state(self) -> int:
        """Return the hash of the member's model."""

    @property
    def model(self) -> Model:
        """Return the member's model. Do not change it, and read it before asking another candidate for its model."""

    @property
    def tabular(self) -> Tabular:
        """Return the transition table of the member's environment.

        Raises:
            EvaluationError, RuleError: a state causes an error.
            TooManyStates: there are more than 50,000 states.
        """

    def once(self, key: object, make: Callable[[], T]) -> T:
        """Return the result of `make()`, which is called once for each candidate and key. Later calls use the cache."""


class FamilyMeasure(Protocol):
    """A measure of a whole family; a larger score is better.

    A class may also have these optional methods, which only save time:

    - `change(members, leaving, entering) -> float`: the change of the score if the candidate `entering` replaces
      `members[leaving]`, and is inserted at its own place in the order;
    - `swaps(pool, members) -> Swaps`: the changes of the score for many exchanges; `members` are indices into `pool`;
    - `maximum(size) -> float`: the largest score of a family of `size` members; a search ends when it is reached.
    """

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the score of a family. The members are in the order of the curriculum."""


@runtime_checkable
class ChangeMeasure(Protocol):
    """A family measure that computes directly how an exchange changes its score."""

    def change(self, members: Sequence[Candidate], leaving: int, entering: Candidate) -> float:
        """Return the change of the score if the candidate `entering` replaces `members[leaving]`."""


@runtime_checkable
class SwapMeasure(Protocol):
    """A family measure that caches data between exchanges to compute their score changes."""

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Return an object for the score changes if one of `members`, which are indices into `pool`, is exchanged."""


@dataclass(frozen=True, slots=True)
class StatisticMeasure:
    """A family measure that is a statistic of one measure of the members, in their order.

    Attributes:
        statistic: the statistic of the values.
        of: name of the measure.
    """

    statistic: Statistic
    of: str

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the statistic of the members' values."""
        return self.statistic.score([member.measures[self.of] for member in members])

    def maximum(self, size: int) -> float:
        """Return the statistic's upper bound for a family of `size` members; infinity if the statistic has none."""
        return self.statistic.maximum(size) if isinstance(self.statistic, BoundedMeasure) else inf

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Return an object for the score changes if a member is exchanged: the statistic's own, or
        `RecomputedSwaps`.
        """
        make = getattr(self.statistic, "swaps", None)
        if make is None:
            return RecomputedSwaps(self, pool, members)
        found: Swaps = make(pool.measure_values(self.of), members)
        return found


class RecomputedSwaps:
    """Score changes of any family measure if one member is exchanged, by its `change` or by recomputing its score.

    Invariant: `_score` is the score of the family of `_members`.
    """

    def __init__(self, measure: FamilyMeasure, pool: Pool, members: Sequence[int]) -> None:
        self._measure, self._pool, self._members = measure, pool, pool.order_members(members)
        self._score = 0.0 if isinstance(measure, ChangeMeasure) else measure.score(pool.family_of(members))

    def delta(self, leaving: int, entering: int) -> float:
        """Return the score after exchanging `leaving` for `entering` minus the current score."""
        pool, place = self._pool, self._members.index(leaving)
        if isinstance(self._measure, ChangeMeasure):
            family = [pool.candidates[one] for one in self._members]
            return self._measure.change(family, place, pool.candidates[entering])
        exchanged = [entering if one == leaving else one for one in self._members]
        return self._measure.score(pool.family_of(exchanged)) - self._score

    def swap(self, leaving: int, entering: int) -> None:
        """Exchange the member `leaving` for the candidate `entering`."""
        members = [entering if one == leaving else one for one in self._members]
        self._members = self._pool.order_members(members)
        if not isinstance(self._measure, ChangeMeasure):
            self._score = self._measure.score(self._pool.family_of(members))


class _ValueVariance:
    """The variance of values that are scaled to [0, 1], so that differences are large compared to `SCORE_TOLERANCE`."""

    def __init__(self, values: Sequence[float]) -> None:
        low, high = min(values), max(values)
        width = high - low
        self._scaled = [(value - low) / width if width > 0 else 0.0 for value in values]

    def variance_of(self, members: Iterable[int]) -> float:
        return Variance().score([self._scaled[one] for one in members])

    def swaps(self, members: Sequence[int]) -> Swaps:
        return Variance().swaps(self._scaled, members)


class Pool:
    """Candidates from which a family is chosen, and comparisons of the families.

    Families are compared by the first measure, then by the second, and so on. Families that are equal in all measures
    are compared by the variance of their values, and the larger variance is better. Without the variance, if all
    members are in one bin, no exchange changes the entropy. Chance alone may then take thousands of generations to
    reach another bin.

    Args:
        candidates: the candidates, at least one.
        measures: the family measures in order of precedence, at least one.
        of: name of the measure whose values' variance is compared.
        key: sort key of the members of a family. Candidates with equal keys keep their order. None: pool order.
    """

    def __init__(
        self,
        candidates: Sequence[Candidate],
        measures: Sequence[FamilyMeasure],
        of: str,
        key: Callable[[Candidate], tuple[float, ...]] | None = None,
    ) -> None:
        self.candidates, self.measures = candidates, measures
        self._values: dict[str, list[float]] = {}
        self._spread = _ValueVariance(self.measure_values(of))
        self._ranks: list[int] | None = None
        if key is not None:
            ranked = sorted(range(len(candidates)), key=lambda one: key(candidates[one]))
            places = dict(zip(ranked, range(len(ranked)), strict=True))
            self._ranks = [places[one] for one in range(len(ranked))]

    def __len__(self) -> int:
        return len(self.candidates)

    def measure_values(self, measure: str) -> list[float]:
        """Return the values of a measure for all candidates, in pool order."""
        if measure not in self._values:
            self._values[measure] = [one.measures[measure] for one in self.candidates]
        return self._values[measure]

    def order_members(self, members: Iterable[int]) -> list[int]:
        """Sort members, given as pool indices, in the order of the family."""
        return sorted(members, key=None if self._ranks is None else self._ranks.__getitem__)

    def family_of(self, members: Iterable[int]) -> list[Candidate]:
        """Return the candidates with these pool indices, in the order of the family."""
        return [self.candidates[one] for one in self.order_members(members)]

    def ranking_key(self, members: Iterable[int]) -> tuple[float, ...]:
        """Return a key for comparing families: rounded scores, then the variance of the values. Larger is better."""
        members = [*members]
        family = self.family_of(members)
        scores = [measure.score(family) for measure in self.measures]
        return tuple(round(score, SCORE_DECIMALS) for score in (*scores, self._spread.variance_of(members)))

    def all_swaps(self, members: Sequence[int]) -> list[Swaps]:
        """Return objects for the score changes if a member is exchanged: one per measure, then one for the variance."""
        return [*(make_swaps(one, self, members) for one in self.measures), self._spread.swaps(members)]


def make_swaps(measure: FamilyMeasure, pool: Pool, members: Sequence[int]) -> Swaps:
    """Return an object for the score changes if a member is exchanged: the measure's own, or one that recomputes it."""
    return measure.swaps(pool, members) if isinstance(measure, SwapMeasure) else RecomputedSwaps(measure, pool, members)
