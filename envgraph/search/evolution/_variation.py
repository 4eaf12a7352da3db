"""Varying a model: random mutations that leave it valid and with a value of every measure.

How many applications of rules a mutation takes is its strength. With one at a time a large model stays on a plateau,
where hundreds of changes have to come together before a measure moves: no selection sees the way. A heavy-tailed
strength (Doerr, Le, Makhmara and Nguyen 2017, "Fast genetic algorithms") has steps of every size, small ones most
often, and nothing to tune.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from envgraph.errors import RuleError
from envgraph.lang import Strength
from envgraph.search._store import Trace
from envgraph.search.problem._problem import Problem

if TYPE_CHECKING:
    from numpy.random import Generator

Step = tuple[str, tuple[int | float | bool | str, ...]]


class Variation:
    """Varies the model at which the engine of a problem stands.

    Args:
        problem: what is varied, validated and measured.
        max_attempts: mutations tried before it is given up.
        strength: of a mutation.

    Attributes:
        reasons: how many attempts were rejected, by what was wrong with them.
    """

    def __init__(self, problem: Problem, max_attempts: int, strength: Strength = "single") -> None:
        self._problem = problem
        self._max_attempts = max_attempts
        # From the first question on patterns are kept current, unless a version is held by then.
        self._begins_valid = problem.valid()
        self._most = 2 * len(problem.engine.model) if strength == "heavy_tailed" else 1
        self.reasons: Counter[str] = Counter()

    def attempts(
        self, rng: Generator, vary: Callable[[Generator], Trace | None]
    ) -> tuple[Trace, dict[str, float]] | None:
        """Vary the model until it is valid and has its measures; None, and the model as before, where that fails."""
        engine, problem = self._problem.engine, self._problem
        for _ in range(self._max_attempts):
            savepoint = engine.model.graph.history.savepoint()
            trace = vary(rng)
            judged = (
                "no rule could be applied" if trace is None else problem.judged(mutated=self._begins_valid)
            )
            if trace is not None and not isinstance(judged, str):
                engine.model.graph.history.release(savepoint)
                return trace, judged
            self.reasons[str(judged)] += 1
            engine.model.graph.history.rollback(savepoint)
        return None

    def mutation(self, rng: Generator) -> Trace | None:
        """A mutation of the strength that was asked for; None when nothing could be applied.

        A heavy-tailed one takes k applications, or fewer where nothing matches any more. The logarithm of k is drawn
        uniformly, so that k comes about as often as 1 / k says, up to twice the number of objects of the initial
        model: now and then that is all matches of a rule. All are of one rule, or, as often, each draws its own.
        """
        if self._most == 1:
            return self.once(rng)
        strength = int(self._most ** rng.random())
        return self._applied(rng, strength, alike=rng.random() < 0.5)

    def once(self, rng: Generator) -> Trace | None:
        """One application; None, and the model as before, when nothing matches or the rule cannot be applied."""
        return self._applied(rng, 1, alike=False)

    def several(self, rng: Generator, bounds: Sequence[int]) -> Trace | None:
        """A random number of applications in a row; None when not even one was possible."""
        steps: list[Step] = []
        for _ in range(int(rng.integers(bounds[0], bounds[1] + 1))):
            steps.extend(self.once(rng) or ())
        return tuple(steps) or None

    def _applied(self, rng: Generator, times: int, *, alike: bool) -> Trace | None:
        """So many applications, of one rule or of any, until nothing matches or a rule cannot be applied."""
        engine, names = self._problem.engine, self._problem.mutations
        engine.rng = rng  # for the choices inside units
        steps: list[Step] = []
        for _ in range(times):
            chosen = engine.choose(names, rng)
            if chosen is None:
                break
            if alike:
                names = chosen[:1]
            try:
                steps.extend(engine.fire(*chosen))
            except RuleError:
                break
        return tuple(steps) or None
