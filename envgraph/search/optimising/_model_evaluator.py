"""Evaluation of models during an optimisation: the constraint violation and the costs of the engine's current model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph.match import RepeatedQueries, Row
from envgraph.rewrite import Engine
from envgraph.search.optimising._goals import ConstrainedCosts, Goal
from envgraph.search.problem._individual_measures import MatchCount, PatternValue
from envgraph.search.problem._problem import Constraint, Forbid, MatchCountWithin, Require

_FIRST_PLANNING = 64
"""Number of evaluated models after which queries are planned for the current model. They are planned again after four
times as many, and so on, because models may grow at first (`benchmarks/bench_assignment.py` begins without a class)."""


class ModelEvaluator:
    """A function that evaluates the engine's current model. It is called after every move.

    Args:
        engine: the engine whose current model is evaluated.
        goals: the objectives.
        constraints: the constraints.
    """

    def __init__(self, engine: Engine, goals: Sequence[Goal], constraints: Sequence[Constraint]) -> None:
        self._engine, self._watched = engine, frozenset(engine.watched)
        self._questions: RepeatedQueries | None = None
        self._states, self._next = 0, _FIRST_PLANNING
        self._excesses = [self._violation_function(constraint) for constraint in constraints]
        self._costs = [self._cost_function(goal) for goal in goals]

    def __call__(self) -> ConstrainedCosts:
        """Return the constraint violation and the costs of the current model.

        Queries are planned again for it after 64 calls, after four times as many, and so on.
        """
        self._states += 1
        if self._states == self._next:
            self._next *= 4
            self._questions = RepeatedQueries(self._engine.model, self._engine.library)
        violation = 0.0
        for excess in self._excesses:
            violation += excess()
        return ConstrainedCosts(violation, tuple([cost() for cost in self._costs]))

    def _cost_function(self, goal: Goal) -> Callable[[], float]:
        measure, engine = goal.measure, self._engine
        if not isinstance(measure, MatchCount | PatternValue):
            return lambda: goal.value_to_cost(measure.evaluate(engine))
        rows, count = self._match_queries(measure.pattern)
        if isinstance(measure, MatchCount):
            return lambda: goal.value_to_cost(float(count()))
        return lambda: goal.value_to_cost(measure.value_in(rows()))

    def _violation_function(self, constraint: Constraint) -> Callable[[], float]:
        """Return a function that computes the violation of a constraint: the number of surplus or missing matches.

        For constraints that are not about numbers of matches it is 1 if the constraint is violated, else 0.
        """
        if not isinstance(constraint, Forbid | MatchCountWithin):
            return lambda: 0.0 if constraint.holds(self._engine) else 1.0
        low, high = (0, 0) if isinstance(constraint, Forbid) else (constraint.low, constraint.high)
        _, count = self._match_queries(constraint.pattern)

        def outside() -> float:
            found = count()
            return float(max(low - found, 0 if high is None else found - high, 0))

        return outside

    def _match_queries(self, name: str) -> tuple[Callable[[], Sequence[Row]], Callable[[], int]]:
        """Return two functions: the first returns the matches of a pattern, the second their number."""
        matcher, (_, pattern, arguments) = self._engine.matcher, self._engine.queries.resolve_query(name)
        watched = pattern in self._watched

        def rows() -> Sequence[Row]:
            if watched or self._questions is None:
                return matcher.rows(pattern, arguments)
            return self._questions.rows(pattern)

        def count() -> int:
            if watched or self._questions is None:
                return matcher.count(pattern, arguments)
            return self._questions.count(pattern)

        return rows, count


def queried_patterns(goals: Sequence[Goal], constraints: Sequence[Constraint]) -> list[str]:
    """Return the names of the patterns that goals and constraints query after every move, without duplicates."""
    asked: list[str] = []
    for goal in goals:
        if isinstance(goal.measure, MatchCount | PatternValue):
            asked.append(goal.measure.pattern)
    for constraint in constraints:
        if isinstance(constraint, Require | Forbid | MatchCountWithin):
            asked.append(constraint.pattern)
    return list(dict.fromkeys(asked))
