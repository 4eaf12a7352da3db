"""Varying a model: random mutations that leave it valid and with a value of every measure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from numpy.random import Generator

from envgraph.errors import RuleError
from envgraph.search._problem import NoValue, Problem
from envgraph.search._store import Trace


class Variation:
    """Varies the model at which the engine of a problem stands.

    Args:
        problem: what is varied, validated and measured.
        max_attempts: mutations tried before it is given up.

    Attributes:
        reasons: how many attempts were rejected, by what was wrong with them.
    """

    def __init__(self, problem: Problem, max_attempts: int) -> None:
        self._problem = problem
        self._max_attempts = max_attempts
        self.reasons: Counter[str] = Counter()

    def attempts(
        self, rng: Generator, vary: Callable[[Generator], Trace | None]
    ) -> tuple[Trace, dict[str, float]] | None:
        """Vary the model until it is valid and has its measures; None, and the model as before, where that fails."""
        engine, problem = self._problem.engine, self._problem
        for _ in range(self._max_attempts):
            savepoint = engine.model.savepoint()
            trace = vary(rng)
            if trace is None:
                reason = "no rule could be applied"
            elif not problem.valid():
                reason = f"`{next(problem.violations())}` is violated"
            else:
                try:
                    measures = problem.measure()
                except NoValue as error:
                    reason = error.message
                else:
                    engine.model.release(savepoint)
                    return trace, measures
            self.reasons[reason] += 1
            engine.model.rollback(savepoint)
        return None

    def once(self, rng: Generator) -> Trace | None:
        """One mutation; None, and the model as before, when nothing matches or the rule cannot be applied."""
        engine = self._problem.engine
        engine.rng = rng  # for the choices inside units
        chosen = engine.choose(self._problem.mutations, rng)
        if chosen is None:
            return None
        try:
            return engine.fire(*chosen) or None
        except RuleError:
            return None

    def several(self, rng: Generator, bounds: Sequence[int]) -> Trace | None:
        """A random number of mutations in a row; None when not even one was possible."""
        steps: list[tuple[str, tuple[int | float | bool | str, ...]]] = []
        for _ in range(int(rng.integers(bounds[0], bounds[1] + 1))):
            steps.extend(self.once(rng) or ())
        return tuple(steps) or None
