"""What a family is to be: expressions over measures of families, as a family file has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import inf, isfinite
from typing import Protocol

from envgraph.code import dataclass
from envgraph.pattern import Expression, Variable, value_of
from envgraph.search.problem._diversity import Bounded, Swaps
from envgraph.search.problem._family_measures import LEAST
from envgraph.search.problem._pool import Candidate, FamilyMeasure, Pool, swaps_of
from envgraph.search.problem._problem import finite

Values = Mapping[str, float]

_ENOUGH = 1e-9
"""A condition that fails by less holds: scores are sums of floating-point terms."""


class Composed(Protocol):
    """A measure of families that is computed from others.

    Attributes:
        measures: of families, by how they are written, such as `entropy(complexity)`.
    """

    measures: Mapping[str, FamilyMeasure]

    def of(self, values: Values) -> float:
        """The score of a family of which the others have these values."""

    def score(self, members: Sequence[Candidate]) -> float:
        """The score of a family."""
        return self.of(values_of(self.measures, members))

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Exchanges, by those of the others."""
        return _ComposedSwaps(self, pool, members)


class _ComposedSwaps:
    """Invariant: `_values` are those of the family at which `_swaps` stand."""

    def __init__(self, measure: Composed, pool: Pool, members: Sequence[int]) -> None:
        self._of, self._values = measure.of, values_of(measure.measures, pool.family(members))
        self._swaps = {name: swaps_of(one, pool, members) for name, one in measure.measures.items()}
        self._score = self._of(self._values)

    def delta(self, leaving: int, entering: int) -> float:
        return self._of(self._exchanged(leaving, entering)) - self._score

    def swap(self, leaving: int, entering: int) -> None:
        self._values = self._exchanged(leaving, entering)
        self._score = self._of(self._values)
        for one in self._swaps.values():
            one.swap(leaving, entering)

    def _exchanged(self, leaving: int, entering: int) -> dict[str, float]:
        return {name: self._values[name] + one.delta(leaving, entering) for name, one in self._swaps.items()}


def values_of(measures: Mapping[str, FamilyMeasure], members: Sequence[Candidate]) -> dict[str, float]:
    """The scores of a family by some measures, which are finite numbers."""
    return {
        name: finite(one.score(members), f"measure of families `{name}`") for name, one in measures.items()
    }


@dataclass(frozen=True)
class Term(Composed):
    """The value of an expression over measures of a family, or minus that.

    Attributes:
        text: as it is written.
        expression: free of errors; its variables are the names of `measures`.
        sense: 1 where more is better, else -1.
    """

    text: str
    expression: Expression
    measures: Mapping[str, FamilyMeasure]
    sense: int = 1

    def value(self, values: Values) -> float:
        """What the expression gives; a billion below 0, or above where less is better, where it divides by 0."""
        found = value_of(self.expression, values)
        return LEAST * self.sense if found is None or not isfinite(float(found)) else float(found)

    def of(self, values: Values) -> float:
        """The value, or what is to be large instead."""
        return self.sense * self.value(values)

    def maximum(self, size: int) -> float:
        """That of a measure that is the whole expression, and to be large; else infinity."""
        one = self._alone
        return one.maximum(size) if isinstance(one, Bounded) else inf

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Exchanges, by those of the measures."""
        one = self._alone
        return _ComposedSwaps(self, pool, members) if one is None else swaps_of(one, pool, members)

    @property
    def _alone(self) -> FamilyMeasure | None:
        alone = isinstance(self.expression, Variable) and self.sense == 1
        return next(iter(self.measures.values())) if alone else None


@dataclass(frozen=True, slots=True)
class Condition:
    """A comparison of two expressions over measures of a family.

    Attributes:
        text: as it is written.
        operator: "<=", ">=" or "==".
    """

    text: str
    left: Term
    operator: str
    right: Term

    def excess(self, values: Values) -> float:
        """How far a family is from satisfying it; 0 where it does."""
        above = self.left.value(values) - self.right.value(values)
        wrong = {"<=": above, ">=": -above, "==": abs(above)}[self.operator]
        return wrong if wrong > _ENOUGH else 0.0


class Conditions(Composed):
    """How far a family is from satisfying some conditions, as a measure: 0 where all hold, else less."""

    def __init__(self, conditions: Sequence[Condition]) -> None:
        self._conditions = conditions
        sides = [side for one in conditions for side in (one.left, one.right)]
        self.measures = {name: one for side in sides for name, one in side.measures.items()}

    def of(self, values: Values) -> float:
        """Minus the sum of what is lacking."""
        return 0.0 - sum(one.excess(values) for one in self._conditions)

    def maximum(self, size: int) -> float:
        """Where all hold."""
        return 0.0


@dataclass(frozen=True)
class Objective:
    """What a family is to be.

    Attributes:
        terms: what is to be as large, or as small, as can be; the first one counts most.
        conditions: what has to hold; that counts more than all terms.
    """

    terms: tuple[Term, ...]
    conditions: tuple[Condition, ...] = ()

    @cached_property
    def measures(self) -> tuple[FamilyMeasure, ...]:
        """As measures of families, the one that counts most first."""
        first = (Conditions(self.conditions),) if self.conditions else ()
        return (*first, *self.terms)

    def values(self, members: Sequence[Candidate]) -> dict[str, float]:
        """The value of each term, by its text."""
        return {one.text: one.value(values_of(one.measures, members)) for one in self.terms}

    def lacking(self, members: Sequence[Candidate]) -> dict[str, float]:
        """Of each condition that does not hold, by its text, how far the family is from it."""
        values = values_of(Conditions(self.conditions).measures, members)
        excess = {one.text: one.excess(values) for one in self.conditions}
        return {text: one for text, one in excess.items() if one}

    def reached(self, members: Sequence[Candidate]) -> bool:
        """Whether no family of as many members is better, as far as that is known."""
        size = len(members)
        most = [one.maximum(size) for one in self.measures if isinstance(one, Bounded)]
        return all(
            bound < inf and one.score(members) >= bound - _ENOUGH
            for one, bound in zip(self.measures, most, strict=True)
        )
