"""Compute measures of the next models in worker processes, before the search itself needs them.

The search makes each of its models itself, with and without workers, so that its result is the same. The workers make
the same models before, from the same parents and random numbers; so the search finds their measures, and the reasons
for rejection, in the cache of its problem. That saves time if measures take long, such as those that visit all states.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from numpy.random import Generator

from envgraph.code import dataclass
from envgraph.errors import EnvgraphError
from envgraph.files import run_in_workers
from envgraph.search.domain._domain import Domain
from envgraph.search.evolution._evolution_settings import EvolutionSettings
from envgraph.search.evolution._mutation import Variation, Vary
from envgraph.search.problem._problem import Problem

if TYPE_CHECKING:
    from envgraph.graph import Version
    from envgraph.lang import Bundle
    from envgraph.search._run_store import Trace
    from envgraph.search.domain._components import Components


@dataclass(frozen=True, slots=True, eq=False)
class MeasureWorkers:
    """Workers that compute measures of models; a `PrepareMeasures`.

    Attributes:
        domain: the domain of the search.
        workers: number of processes, at least 2.
    """

    domain: Domain
    workers: int

    def __call__(self, problem: Problem, vary: Vary, starts: Sequence[tuple[Trace, Generator]]) -> None:
        """Compute the measures of all models that `vary` makes, and add them to the cache of a problem.

        Args:
            problem: the problem of the search.
            vary: makes the models.
            starts: for each call of `vary` the rule applications that lead from the initial model to its parent, and
                its random generator, which is not changed.
        """
        size = -(-len(starts) // self.workers)
        source = self.domain.workspace.bundle(), self.domain.components, self.domain.overrides
        chunks = [(source, vary, starts[first : first + size]) for first in range(0, len(starts), size)]
        for found in run_in_workers(_measures_by_state, chunks, self.workers):
            problem.add_results(found)


_searches: dict[object, tuple[Problem, Version, Variation, EvolutionSettings]] = {}
"""The search of this worker process: a single entry, by the texts and overrides of its domain."""


def _measures_by_state(
    source: tuple[Bundle, Components, Sequence[str]], vary: Vary, tasks: Sequence[tuple[Trace, Generator]]
) -> dict[int, dict[str, float] | str]:
    """Return the measures of the models that `vary` makes in a worker, or the reason for rejection, by state hash."""
    bundle, components, overrides = source
    key = (*bundle.texts.items(), *overrides)
    if key not in _searches:
        domain = Domain.from_bundle(bundle, components, overrides)
        problem, settings = domain.problem(domain.engine()), domain.settings()
        variation = Variation(problem, settings.max_attempts, settings.strength)
        _searches.clear()
        _searches[key] = problem, problem.engine.commit(), variation, settings
    problem, origin, variation, settings = _searches[key]
    engine = problem.engine
    for trace, rng in tasks:
        try:
            engine.replay(trace)
            vary(variation, settings, rng)
        except EnvgraphError:
            pass  # the search itself meets the same error, at its own time
        engine.checkout(origin, discard=True)
    return problem.take_results()
