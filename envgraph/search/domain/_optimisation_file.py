"""Run the optimisation that a family file with `[optimise]` describes."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import Diagnostic, LoadError, Source
from envgraph.graph import check_conformance
from envgraph.lang import LocatedName
from envgraph.rewrite import Engine
from envgraph.search.domain._domain import Domain
from envgraph.search.optimising import Goal, Optimum, Sense, search_goals
from envgraph.search.optimising._search_walk import Progress
from envgraph.search.problem._problem import Forbid, Problem


def optimise_domain(domain: Domain, *, progress: Progress | None = None) -> tuple[Engine, Optimum]:
    """Run the optimisation of a family file; return the engine, which is at the best model, and the result.

    Raises:
        LoadError: the file has no `[optimise]`, or options are invalid.
    """
    spec = domain.spec.optimise
    if spec is None:
        source = domain.spec.source or Source(domain.spec.path, "")
        hint = 'write `[optimise]` with `maximise = ["..."]`: names of measures'
        message = "the family file has no `[optimise]`"
        raise LoadError([Diagnostic("missing-key", message, source.span_between(0, 0), hint)])
    engine = domain.engine()
    problem, strategy = optimisation_problem(domain, engine), domain.strategy()
    senses: list[tuple[LocatedName, Sense]] = [(one, "maximise") for one in spec.maximise]
    senses += [(one, "minimise") for one in spec.minimise]
    found = search_goals(
        engine,
        problem.mutations,
        [
            Goal(str(name), problem.measures[str(name)], sense, problem.otherwise.get(str(name)))
            for name, sense in senses
        ],
        problem.constraints,
        strategy,
        steps=spec.steps,
        seconds=spec.time_limit,
        target=None if spec.target is None else [spec.target],
        seed=domain.spec.seed,
        progress=progress,
    )
    return engine, found


def optimisation_problem(domain: Domain, engine: Engine) -> Problem:
    """Return the search problem of a domain, in which features without a value in the initial model need none."""
    missing = {
        Forbid(f"conformance.{one.feature.owner}.{one.feature.name}")
        for one in check_conformance(domain.initial())
        if one.kind == "missing-value"
    }
    problem = domain.problem(engine)
    return replace(problem, constraints=[one for one in problem.constraints if one not in missing])
