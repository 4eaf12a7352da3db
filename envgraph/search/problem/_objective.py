"""Objectives of a family file: expressions over family measures to maximise or minimise, and conditions on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import inf, isfinite
from typing import Protocol

from envgraph.code import dataclass
from envgraph.errors import TOLERANCE
from envgraph.pattern import Expression, Variable, value_of
from envgraph.search.problem._candidate_pool import Candidate, FamilyMeasure, Pool, make_swaps
from envgraph.search.problem._family_measures import LOWEST_SCORE
from envgraph.search.problem._problem import checked_finite_number
from envgraph.search.problem._statistics import BoundedMeasure, Swaps

MeasureScores = Mapping[str, float]


class ComposedMeasure(Protocol):
    """A family measure that is computed from the scores of other family measures.

    Attributes:
        measures: the other family measures, keyed by their text, such as `entropy(complexity)`.
    """

    measures: Mapping[str, FamilyMeasure]

    def score_from(self, values: MeasureScores) -> float:
        """Return the score of a family, given the scores of the other family measures."""

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the score of a family. Raise `EvaluationError` if a score of another measure is not finite."""
        return self.score_from(scores_by_measure(self.measures, members))

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Return an object for the score changes if a member is exchanged, made from those of the other measures."""
        return _ComposedSwaps(self, pool, members)


class _ComposedSwaps:
    """Score changes of a composed measure if one member is exchanged.

    Invariant: `_values` are the scores of the family that `_swaps` currently describe.
    """

    def __init__(self, measure: ComposedMeasure, pool: Pool, members: Sequence[int]) -> None:
        self._of, self._values = measure.score_from, scores_by_measure(measure.measures, pool.family_of(members))
        self._swaps = {name: make_swaps(one, pool, members) for name, one in measure.measures.items()}
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


def scores_by_measure(measures: Mapping[str, FamilyMeasure], members: Sequence[Candidate]) -> dict[str, float]:
    """Return the scores of a family by several measures, keyed by the measures' texts.

    Raises:
        EvaluationError: a score is not a finite number.
    """
    return {
        name: checked_finite_number(one.score(members), f"measure of families `{name}`")
        for name, one in measures.items()
    }


@dataclass(frozen=True)
class ObjectiveTerm(ComposedMeasure):
    """An expression over family measures that an objective maximises or minimises.

    Attributes:
        text: the expression as written in the family file.
        expression: the expression, free of errors; its variables are the keys of `measures`.
        sense: 1 to maximise the expression, -1 to minimise it.
    """

    text: str
    expression: Expression
    measures: Mapping[str, FamilyMeasure]
    sense: int = 1

    def expression_value(self, values: MeasureScores) -> float:
        """Return the value of the expression for these scores.

        If the expression divides by 0, return the worst value: -1e9 if it is maximised, 1e9 if it is minimised.
        """
        found = value_of(self.expression, values)
        return LOWEST_SCORE * self.sense if found is None or not isfinite(float(found)) else float(found)

    def score_from(self, values: MeasureScores) -> float:
        """Return the value of the expression, negated if the expression is minimised."""
        return self.sense * self.expression_value(values)

    def maximum(self, size: int) -> float:
        """Return an upper bound on the score of a family of `size` members; infinity if no bound is known.

        A bound is known if the expression is a single bounded measure that is maximised.
        """
        one = self._single_measure
        return one.maximum(size) if isinstance(one, BoundedMeasure) else inf

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Return an object for the score changes if a member is exchanged. A single measure uses its own `swaps`."""
        one = self._single_measure
        return _ComposedSwaps(self, pool, members) if one is None else make_swaps(one, pool, members)

    @property
    def _single_measure(self) -> FamilyMeasure | None:
        alone = isinstance(self.expression, Variable) and self.sense == 1
        return next(iter(self.measures.values())) if alone else None


@dataclass(frozen=True, slots=True)
class FamilyCondition:
    """A comparison of two expressions over family measures.

    Attributes:
        text: the comparison as written in the family file.
        operator: "<=", ">=" or "==".
    """

    text: str
    left: ObjectiveTerm
    operator: str
    right: ObjectiveTerm

    def violation(self, values: MeasureScores) -> float:
        """Return by how much the comparison is violated for these scores; 0 if it holds within a tolerance."""
        above = self.left.expression_value(values) - self.right.expression_value(values)
        wrong = {"<=": above, ">=": -above, "==": abs(above)}[self.operator]
        return wrong if wrong > TOLERANCE else 0.0


class ConditionsMeasure(ComposedMeasure):
    """Several conditions as one family measure: 0 if all hold, else minus the sum of their violations."""

    def __init__(self, conditions: Sequence[FamilyCondition]) -> None:
        self._conditions = conditions
        sides = [side for one in conditions for side in (one.left, one.right)]
        self.measures = {name: one for side in sides for name, one in side.measures.items()}

    def score_from(self, values: MeasureScores) -> float:
        """Return minus the sum of the conditions' violations."""
        return 0.0 - sum(one.violation(values) for one in self._conditions)

    def maximum(self, size: int) -> float:
        """Return 0, the score of a family that satisfies all conditions."""
        return 0.0


@dataclass(frozen=True)
class Objective:
    """The objective of a family: expressions to maximise or minimise, and conditions.

    Attributes:
        terms: the expressions; earlier terms take precedence over later ones.
        conditions: conditions on the family; they take precedence over all terms.
    """

    terms: tuple[ObjectiveTerm, ...]
    conditions: tuple[FamilyCondition, ...] = ()

    @cached_property
    def measures(self) -> tuple[FamilyMeasure, ...]:
        """Return the conditions and the terms as family measures, in order of precedence."""
        first = (ConditionsMeasure(self.conditions),) if self.conditions else ()
        return (*first, *self.terms)

    def term_values(self, members: Sequence[Candidate]) -> dict[str, float]:
        """Return the value of each term for a family, keyed by the text of the term."""
        return {one.text: one.expression_value(scores_by_measure(one.measures, members)) for one in self.terms}

    def violated_conditions(self, members: Sequence[Candidate]) -> dict[str, float]:
        """Return the violated conditions: by how much each is violated, keyed by its text."""
        values = scores_by_measure(ConditionsMeasure(self.conditions).measures, members)
        excess = {one.text: one.violation(values) for one in self.conditions}
        return {text: one for text, one in excess.items() if one}

    def is_at_maximum(self, members: Sequence[Candidate]) -> bool:
        """Return True if the family attains the maximum of every measure; False if a maximum is unknown."""
        size = len(members)
        most = [one.maximum(size) for one in self.measures if isinstance(one, BoundedMeasure)]
        return all(
            bound < inf and one.score(members) >= bound - TOLERANCE
            for one, bound in zip(self.measures, most, strict=True)
        )
