"""Mutation of a model: random rule applications that leave the model valid and with a value of every measure.

The strength of a mutation is its number of rule applications. With one application at a time a large model stays on a
plateau if hundreds of changes are needed before a measure changes. A heavy-tailed strength (Doerr, Le, Makhmara and
Nguyen 2017, "Fast genetic algorithms") has steps of every size, small ones most often, and no parameter to tune.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from envgraph.errors import RuleError
from envgraph.lang import Strength
from envgraph.search._run_store import Trace
from envgraph.search.evolution._evolution_settings import EvolutionSettings
from envgraph.search.problem._problem import Problem

if TYPE_CHECKING:
    from numpy.random import Generator

Varied = tuple[Trace, dict[str, float]]
"""A valid model: the rule applications that made it, and its measures."""

Vary = Callable[["Variation", EvolutionSettings, "Generator"], Varied | None]
"""Makes models from the engine's current one; a function of a module, so that worker processes can load it."""

PrepareMeasures = Callable[[Problem, Vary, Sequence[tuple[Trace, "Generator"]]], None]
"""Computes the measures of models in parallel before the search needs them, and adds them to the cache of its problem.

The second argument makes the models. The third has an entry for each call of it: the rule applications that lead from
the initial model to the one to vary, and the random generator, which is not changed.
"""

RuleApplication = tuple[str, tuple[int | float | bool | str, ...]]


class Variation:
    """An operator that mutates the current model of a problem's engine.

    Args:
        problem: the search problem with mutations, constraints and measures.
        max_attempts: number of mutations to try.
        strength: strength of a mutation, "single" or "heavy_tailed".

    Attributes:
        rejection_counts: number of rejected attempts, by the reason.
    """

    def __init__(self, problem: Problem, max_attempts: int, strength: Strength = "single") -> None:
        self._problem = problem
        self._max_attempts = max_attempts
        # Start incremental matching now: after a version is committed it can no longer start.
        self._is_initial_valid = problem.is_valid()
        self._most_applications = 2 * len(problem.engine.model) if strength == "heavy_tailed" else 1
        self.rejection_counts: Counter[str] = Counter()

    def vary_until_valid(self, rng: Generator, vary: Callable[[Generator], Trace | None]) -> Varied | None:
        """Call `vary` until the model is valid; return the rule applications and the measures.

        Each attempt that fails is rolled back and its reason is counted. If all attempts fail, return None.
        """
        engine, problem = self._problem.engine, self._problem
        for _ in range(self._max_attempts):
            savepoint = engine.model.graph.history.savepoint()
            trace = vary(rng)
            judged = (
                "no rule could be applied"
                if trace is None
                else problem.measures_or_rejection(is_mutated=self._is_initial_valid)
            )
            if trace is not None and not isinstance(judged, str):
                engine.model.graph.history.release(savepoint)
                return trace, judged
            self.rejection_counts[str(judged)] += 1
            engine.model.graph.history.rollback(savepoint)
        return None

    def mutate(self, rng: Generator) -> Trace | None:
        """Mutate the model, and return the rule applications; None if no rule could be applied.

        A heavy-tailed mutation makes k applications, or fewer if nothing matches any more. The logarithm of k is
        uniform up to twice the number of objects of the initial model, so that the probability of k is about
        proportional to 1 / k. With probability 1/2 all applications are of one rule; otherwise each samples its own
        rule.
        """
        if self._most_applications == 1:
            return self.apply_once(rng)
        strength = int(self._most_applications ** rng.random())
        return self._apply_rules(rng, strength, is_one_rule=rng.random() < 0.5)

    def apply_once(self, rng: Generator) -> Trace | None:
        """Apply one random rule and return the application; None, without a change, if nothing matches or it fails."""
        return self._apply_rules(rng, 1, is_one_rule=False)

    def apply_several(self, rng: Generator, bounds: Sequence[int]) -> Trace | None:
        """Apply a random number of rules within `bounds`, and return the applications; None if none succeeded."""
        steps: list[RuleApplication] = []
        for _ in range(int(rng.integers(bounds[0], bounds[1] + 1))):
            steps.extend(self.apply_once(rng) or ())
        return tuple(steps) or None

    def _apply_rules(self, rng: Generator, times: int, *, is_one_rule: bool) -> Trace | None:
        """Apply up to `times` random rules, until nothing matches or a rule fails; return the applications or None.

        If `is_one_rule`, all applications are of the rule that is sampled first.
        """
        engine, names = self._problem.engine, self._problem.mutations
        engine.rng = rng  # for random choices inside units
        steps: list[RuleApplication] = []
        for _ in range(times):
            chosen = engine.choose(names, rng)
            if chosen is None:
                break
            if is_one_rule:
                names = chosen[:1]
            try:
                steps.extend(engine.fire(*chosen))
            except RuleError:
                break
        return tuple(steps) or None
