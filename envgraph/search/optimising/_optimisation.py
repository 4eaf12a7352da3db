"""The function `optimise`, which searches for the best model from the current model of an engine, and its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from time import monotonic

import numpy as np

from envgraph.code import dataclass
from envgraph.draw import html_table
from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph import Version
from envgraph.rewrite import Engine, Trace
from envgraph.search.optimising._annealing import Annealing
from envgraph.search.optimising._goals import Goal, Sense
from envgraph.search.optimising._model_evaluator import ModelEvaluator, queried_patterns
from envgraph.search.optimising._pareto_archive import FoundState, ParetoArchive, applications_of
from envgraph.search.optimising._search_walk import Progress, Strategy, Walk
from envgraph.search.problem._problem import Constraint, Forbid, MatchCountWithin, Require

_WATCHED_SIZE = 256
"""Least number of objects at which patterns are watched: above it `benchmarks/bench_assignment.py` is faster."""

Objectives = str | Goal | Iterable[str | Goal]


@dataclass(frozen=True, slots=True)
class Solution:
    """A model found by an optimisation.

    Attributes:
        values: values of the objectives, by name; infinite if an objective has no value.
        violation: 0 if all constraints hold, else the number of surplus and missing matches.
        trace: the rule applications from the initial model to this one; `engine.replay` applies them again.
        version: the version of the model, for `engine.checkout`.
    """

    values: Mapping[str, float]
    violation: float
    trace: Trace
    version: Version


@dataclass(frozen=True, slots=True)
class Optimum:
    """The result of an optimisation.

    Attributes:
        front: the non-dominated models, the best in the first objective first; a single model if there is one
            objective.
        initial: values of the objectives in the initial model.
        steps: number of moves that were tried.
        goals: the objectives.
    """

    front: tuple[Solution, ...]
    initial: Mapping[str, float]
    steps: int
    goals: tuple[Goal, ...]

    def _repr_html_(self) -> str:
        names = [goal.name for goal in self.goals]
        rows: list[Sequence[object]] = [("start", *(self.initial[name] for name in names), None, None)]
        rows += [("found", *(one.values[name] for name in names), one.violation, len(one.trace)) for one in self.front]
        return html_table(rows, ["model", *names, "violation", "applications"], f"{self.steps:,} moves were tried")

    @property
    def best(self) -> Solution:
        """Return the first model of the front."""
        return self.front[0]


def optimise(
    engine: Engine,
    moves: str | Iterable[str],
    *,
    maximise: Objectives = (),
    minimise: Objectives = (),
    require: Iterable[str] = (),
    forbid: Iterable[str] = (),
    count: Mapping[str, tuple[int, int | None]] | None = None,
    strategy: Strategy | None = None,
    steps: int = 10_000,
    seconds: float | None = None,
    target: float | Sequence[float] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Optimum:
    """Search for the model that is best by some objectives, by applying rules to the model of an engine.

    Patterns of objectives and constraints are watched during the search, so that a step takes time in proportion to its
    changes. In models of fewer than 256 objects only `incremental` patterns are watched, because matching is faster
    there. Afterwards the engine is at the best model.

    Args:
        engine: the engine, outside of a transaction.
        moves: names of rules, units and derived groups.
        maximise, minimise: names of patterns or `Goal` objects, at least one in total. The value of a pattern is its
            numeric parameter, or its number of matches if it has none.
        require, forbid, count: patterns that must have a match, must have none, or must have a number of matches within
            bounds. The initial model may violate them. Fewer violations are better, whatever the objectives.
        strategy: None for `Annealing()`; or `HillClimb`, `Beam`, `TreeSearch`, or your own.
        steps: number of moves to try.
        seconds: time limit, or None. With a limit the result may differ from run to run.
        target: a value for each objective that is good enough; the search ends when all are reached.
        seed: the only source of randomness.
        progress: callback that is called regularly with the number of tried moves and a text about the best model.

    Raises:
        InvalidArgument: a name is unknown, there is no objective, or a limit is invalid.
        EvaluationError: an objective or a value computed by a rule is not a number. The model is restored then, as
            after an interruption.
        TransactionError: the engine is inside a transaction.

    >>> from envgraph import open
    >>> engine = open("assignment")
    >>> found = optimise(engine, ["introduce", "move"], maximise="craIndex", forbid=["unassigned"], steps=300)
    >>> engine.exists("unassigned"), found.best.violation
    (False, 0.0)
    """
    goals = (*_make_goals(engine, maximise, "maximise"), *_make_goals(engine, minimise, "minimise"))
    constraints: list[Constraint] = [Require(name) for name in _name_list(require)]
    constraints += [Forbid(name) for name in _name_list(forbid)]
    constraints += [MatchCountWithin(name, *bounds) for name, bounds in (count or {}).items()]
    aims = [target] if isinstance(target, int | float) else None if target is None else list(target)
    return search_goals(
        engine, _name_list(moves), goals, constraints, strategy or Annealing(),
        steps=steps, seconds=seconds, target=aims, seed=seed, progress=progress,
    )  # fmt: skip


def search_goals(
    engine: Engine,
    moves: Sequence[str],
    goals: Sequence[Goal],
    constraints: Sequence[Constraint],
    strategy: Strategy,
    *,
    steps: int,
    seconds: float | None = None,
    target: Sequence[float] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    clock: Callable[[], float] = monotonic,
) -> Optimum:
    """Search as `optimise` does, with prepared goals and constraints. `clock` returns the time in seconds."""
    _check_arguments(engine, moves, goals, constraints, steps, target)
    costs = None
    if target is not None:
        costs = tuple(-a if goal.sense == "maximise" else a for goal, a in zip(goals, target, strict=True))

    def report_best(done: int, archive: ParetoArchive) -> None:
        if progress is not None:
            best = next(iter(archive)).costs
            values = (
                f"{goal.name} {goal.cost_to_value(cost):.6g}" for goal, cost in zip(goals, best.costs, strict=True)
            )
            violated = [f"{best.violation:g} violations"] if best.violation else []
            progress(done, ", ".join([*violated, *values]))

    rng, before = np.random.default_rng(seed), engine.rng
    with _watched_patterns(engine, queried_patterns(goals, constraints)):
        start = engine.model.state_hash()
        engine.rng = rng  # for random choices inside units
        try:
            appraise = ModelEvaluator(engine, goals, constraints)
            walk = Walk(engine, moves, appraise, rng, steps, seconds, target=costs, tell=report_best, clock=clock)
            try:
                strategy.search(walk)
                front = tuple(_make_solution(engine, walk, found, goals, start) for found in walk.archive)
                engine.checkout(front[0].version, discard=True)
            except BaseException:
                walk.restore_initial_state()
                raise
        finally:
            engine.rng = before
    return Optimum(front, _goal_values(goals, walk.initial_state), walk.moves_tried, tuple(goals))


def _make_solution(engine: Engine, walk: Walk, found: FoundState, goals: Sequence[Goal], start: int) -> Solution:
    walk.check_out(found)
    trace = Trace(applications_of(found.path), start=start)
    trace.states[len(trace)] = engine.model.state_hash()
    return Solution(_goal_values(goals, found), found.costs.violation, trace, found.version)


def _goal_values(goals: Sequence[Goal], found: FoundState) -> Mapping[str, float]:
    return {goal.name: goal.cost_to_value(cost) for goal, cost in zip(goals, found.costs.costs, strict=True)}


def _name_list(names: str | Iterable[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _make_goals(engine: Engine, given: Objectives, sense: Sense) -> Iterator[Goal]:
    for one in [given] if isinstance(given, str | Goal) else given:
        yield one if isinstance(one, Goal) else Goal.from_pattern(engine, one, sense)


def _check_arguments(
    engine: Engine,
    moves: Sequence[str],
    goals: Sequence[Goal],
    constraints: Sequence[Constraint],
    steps: int,
    target: Sequence[float] | None,
) -> None:
    """Raise `InvalidArgument` or `TransactionError` if an argument is invalid, before anything is changed."""
    names = [goal.name for goal in goals]
    if not goals:
        raise InvalidArgument('give at least one objective, such as `maximise="pattern"`')
    if len(set(names)) < len(names):
        raise InvalidArgument("two objectives have the same name: give `Goal` objects with different names")
    if not moves:
        raise InvalidArgument("`moves` is empty", 'name rules or units, such as `["move", "join"]`')
    for name in moves:
        engine.catalog.group(name)
    for pattern in queried_patterns((), constraints):
        engine.catalog.query_target(pattern)
    if type(steps) is not int or steps < 1:
        raise InvalidArgument(f"`steps` is {steps!r}, but must be an integer of at least 1")
    if target is not None and (len(target) != len(goals) or not all(-inf < one < inf for one in target)):
        raise InvalidArgument(f"`target` must have a finite number for each of the {len(goals)} objectives")
    if engine.events.has_event_rules:
        message = "the engine has active event rules, which would change models during the search"
        raise InvalidArgument(message, "search on `engine.copy()`, which has no event rules")
    if engine.model.graph.history.savepoint_depth:
        raise TransactionError("`optimise` cannot run inside a transaction: call it outside")


@contextmanager
def _watched_patterns(engine: Engine, patterns: Sequence[str]) -> Iterator[None]:
    """Watch the patterns inside the context, and stop watching them afterwards. Watch none if that is impossible.

    Patterns that are watched already, that match faster unwatched or that have input parameters are left out.
    """
    known, large = set(engine.watched), len(engine.model) >= _WATCHED_SIZE
    new = []
    for name in patterns:
        found = engine.library.get(engine.catalog.query_target(name)[1])
        wanted = large if found.strategy is None else found.strategy == "incremental"
        if wanted and found.qualified_name not in known and not engine.library.inputs(found.qualified_name):
            new.append(found.qualified_name)
    try:
        engine.watch(*new)
    except (InvalidArgument, TransactionError):
        new = []  # impossible with the naive matcher, a second watching engine, or an existing version
    try:
        yield
    finally:
        engine.unwatch(*new)
