"""What families are worth: measures that see the members in their order, and pools that families are chosen from.

There is one protocol. What reads one number of each member, such as the entropy, is a `Statistic`, and `Over` makes a
measure of families of it. Survivor selection asks for little but exchanges of one member; a measure that knows better
than to compute its score anew says so by `change`, or, where that needs memory, by `swaps`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf
from typing import TYPE_CHECKING, Final, Protocol, TypeVar, runtime_checkable

from envgraph.code import dataclass
from envgraph.graph import Model
from envgraph.search.problem._diversity import Bounded, Statistic, Swaps, Variance

if TYPE_CHECKING:
    from envgraph.env import Tabular

T = TypeVar("T")

DIGITS: Final = 12
"""Scores that agree in so many decimals are the same: sums of swap deltas carry rounding errors."""

TIE: Final = 10**-DIGITS


class Candidate(Protocol):
    """A member as measures of families see it."""

    @property
    def measures(self) -> Mapping[str, float]:
        """Value of every measure of the family file, by name."""

    @property
    def state(self) -> int:
        """Hash of its model."""

    @property
    def model(self) -> Model:
        """Its model, to be read before that of another candidate is asked for, and not to be changed."""

    @property
    def tabular(self) -> Tabular:
        """The table of its reachable states.

        Raises:
            EvaluationError, RuleError: as `explore`; `TooManyStates` if there are more than 50,000.
        """

    def once(self, key: object, make: Callable[[], T]) -> T:
        """What `make` gives, made once for each candidate and key, and then kept."""


class FamilyMeasure(Protocol):
    """A measure of a whole family; larger is better.

    It may also have these methods, which save time and nothing else:

    - `change(members, leaving, entering) -> float`: the score after the candidate `entering` came for
      `members[leaving]`, and went to its own place in the order, minus the score before;
    - `swaps(pool, members) -> Swaps`: the same for many exchanges, from the family of `members`, indices into `pool`;
    - `maximum(size) -> float`: the largest score of a family of so many members; a search ends there.
    """

    def score(self, members: Sequence[Candidate]) -> float:
        """The measure of a family, its members in the order of the curriculum."""


@runtime_checkable
class Changing(Protocol):
    """A measure of families that knows what an exchange changes."""

    def change(self, members: Sequence[Candidate], leaving: int, entering: Candidate) -> float:
        """See `FamilyMeasure`."""


@runtime_checkable
class Swapping(Protocol):
    """A measure of families that remembers something from one exchange to the next."""

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """See `FamilyMeasure`."""


@dataclass(frozen=True, slots=True)
class Over:
    """A statistic of one measure of the members, in their order.

    Attributes:
        statistic: of the values.
        of: name of the measure.
    """

    statistic: Statistic
    of: str

    def score(self, members: Sequence[Candidate]) -> float:
        """The statistic of the members' values."""
        return self.statistic.score([member.measures[self.of] for member in members])

    def maximum(self, size: int) -> float:
        """What the statistic knows; else infinity."""
        return self.statistic.maximum(size) if isinstance(self.statistic, Bounded) else inf

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Those of the statistic, if it has some."""
        make = getattr(self.statistic, "swaps", None)
        if make is None:
            return Recomputed(self, pool, members)
        found: Swaps = make(pool.values(self.of), members)
        return found


class Recomputed:
    """Swaps for any measure of families, by its `change`, or by computing the score anew.

    Invariant: `_score` is that of the family of `_members`.
    """

    def __init__(self, measure: FamilyMeasure, pool: Pool, members: Sequence[int]) -> None:
        self._measure, self._pool, self._members = measure, pool, pool.ordered(members)
        self._score = 0.0 if isinstance(measure, Changing) else measure.score(pool.family(members))

    def delta(self, leaving: int, entering: int) -> float:
        """Score after the exchange minus score before it."""
        pool, place = self._pool, self._members.index(leaving)
        if isinstance(self._measure, Changing):
            family = [pool.candidates[one] for one in self._members]
            return self._measure.change(family, place, pool.candidates[entering])
        exchanged = [entering if one == leaving else one for one in self._members]
        return self._measure.score(pool.family(exchanged)) - self._score

    def swap(self, leaving: int, entering: int) -> None:
        """Exchange the two."""
        members = [entering if one == leaving else one for one in self._members]
        self._members = self._pool.ordered(members)
        if not isinstance(self._measure, Changing):
            self._score = self._measure.score(self._pool.family(members))


class _Spread:
    """The variance of values on [0, 1], so that `TIE` is small beside differences."""

    def __init__(self, values: Sequence[float]) -> None:
        low, high = min(values), max(values)
        width = high - low
        self._scaled = [(value - low) / width if width > 0 else 0.0 for value in values]

    def of(self, members: Iterable[int]) -> float:
        return Variance().score([self._scaled[one] for one in members])

    def swaps(self, members: Sequence[int]) -> Swaps:
        return Variance().swaps(self._scaled, members)


class Pool:
    """Candidates that a family is chosen from, and what families of them are worth.

    Families are compared by the first measure; of those that are equal in it by the second, and so on; of those that
    are equal in all, the one whose values vary most is better. With all members in one bin no exchange changes the
    entropy, and chance alone may take thousands of generations to come to another bin.

    Args:
        candidates: at least one.
        measures: of families, the one that counts most first; at least one.
        of: name of the measure of which values vary.
        key: orders the members of a family; candidates of equal keys keep their order.
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
        self._spread = _Spread(self.values(of))
        self._place: list[int] | None = None
        if key is not None:
            ranked = sorted(range(len(candidates)), key=lambda one: key(candidates[one]))
            places = dict(zip(ranked, range(len(ranked)), strict=True))
            self._place = [places[one] for one in range(len(ranked))]

    def __len__(self) -> int:
        return len(self.candidates)

    def values(self, of: str) -> list[float]:
        """A measure of all candidates."""
        if of not in self._values:
            self._values[of] = [one.measures[of] for one in self.candidates]
        return self._values[of]

    def ordered(self, members: Iterable[int]) -> list[int]:
        """Members of a family in their order."""
        return sorted(members, key=None if self._place is None else self._place.__getitem__)

    def family(self, members: Iterable[int]) -> list[Candidate]:
        """The candidates themselves, in their order."""
        return [self.candidates[one] for one in self.ordered(members)]

    def rank(self, members: Iterable[int]) -> tuple[float, ...]:
        """What a family is worth, for comparisons: the scores, then how the values vary; larger is better."""
        members = [*members]
        family = self.family(members)
        scores = [measure.score(family) for measure in self.measures]
        return tuple(round(score, DIGITS) for score in (*scores, self._spread.of(members)))

    def swaps(self, members: Sequence[int]) -> list[Swaps]:
        """Exchanges from a family, for each measure, and at the end for how the values vary."""
        return [*(swaps_of(one, self, members) for one in self.measures), self._spread.swaps(members)]


def swaps_of(measure: FamilyMeasure, pool: Pool, members: Sequence[int]) -> Swaps:
    """Exchanges from a family, as fast as the measure has them."""
    return (
        measure.swaps(pool, members) if isinstance(measure, Swapping) else Recomputed(measure, pool, members)
    )
