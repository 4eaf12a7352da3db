"""Optimisation from the model of an engine, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import inf
from time import monotonic

import numpy as np

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph import Version
from envgraph.rewrite import Engine, Trace
from envgraph.search.optimising._appraisal import Appraisal, watchable
from envgraph.search.optimising._archive import Archive, Found, steps_of
from envgraph.search.optimising._climbing import Annealing
from envgraph.search.optimising._goals import Goal, Sense
from envgraph.search.optimising._walk import Progress, Strategy, Walk
from envgraph.search.problem._problem import Constraint, CountWithin, Forbid, Require

_LARGE = 256
"""Objects from which on patterns are watched: the domain of `benchmarks/bench_assignment.py` is faster then."""

Objectives = str | Goal | Iterable[str | Goal]


@dataclass(frozen=True, slots=True)
class Solution:
    """A model that was found.

    Attributes:
        values: of the objectives, by name; infinite where there is none.
        violation: 0 if all constraints hold; else how many matches are too many or missing.
        trace: what leads to it from the model at which the search began: `engine.replay` does it again.
        version: the model, for `engine.checkout`.
    """

    values: Mapping[str, float]
    violation: float
    trace: Trace
    version: Version


@dataclass(frozen=True, slots=True)
class Optimum:
    """What came of an optimisation.

    Attributes:
        front: the best that was found: with one objective a single model; with several those that no other one
            betters in one objective without being worse in another, the best in the first objective first.
        initial: values of the objectives at the start.
        steps: moves that were tried.
        goals: the objectives.
    """

    front: tuple[Solution, ...]
    initial: Mapping[str, float]
    steps: int
    goals: tuple[Goal, ...]

    @property
    def best(self) -> Solution:
        """The first of the front."""
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
    """Search for the model that is best by some objectives, from that of an engine, by applying rules.

    Patterns that objectives and constraints ask about are watched meanwhile, so that a step costs what it changes; in
    models of less than 256 objects, where looking is faster, only those that are `incremental`. The engine stands at
    the best model afterwards.

    Args:
        engine: outside of a transaction.
        moves: names of rules, units and derived groups.
        maximise, minimise: names of patterns: the number that each computes, or, if it has no parameter for one, the
            number of its matches; or a `Goal`, of any measure. At least one in all.
        require, forbid, count: patterns with a match, without one, and with so many matches. The model at the start may
            violate them; fewer violations are better, whatever the objectives.
        strategy: `Annealing()` if None; or `HillClimb`, `Beam`, `TreeSearch`, or your own.
        steps: how many moves are tried.
        seconds: for how long at most; with this limit the result may differ from run to run.
        target: a value that is good enough, for each objective one: the search ends there.
        seed: the one source of randomness.
        progress: is called now and then with how many moves have been tried, and what is best so far.

    Raises:
        InvalidArgument: an unknown name, no objective, or limits that make no sense.
        EvaluationError: an objective has a value that is no number, or a rule computes one that has no value. The model
            is as before then, and after an interruption.
        TransactionError: inside a transaction.

    >>> from envgraph import open
    >>> engine = open("assignment")
    >>> found = optimise(engine, ["introduce", "move"], maximise="craIndex", forbid=["unassigned"], steps=300)
    >>> engine.exists("unassigned"), found.best.violation
    (False, 0.0)
    """
    goals = (*_goals(engine, maximise, "maximise"), *_goals(engine, minimise, "minimise"))
    constraints: list[Constraint] = [Require(name) for name in _names(require)]
    constraints += [Forbid(name) for name in _names(forbid)]
    constraints += [CountWithin(name, *bounds) for name, bounds in (count or {}).items()]
    aims = [target] if isinstance(target, int | float) else None if target is None else list(target)
    return pursue(
        engine, _names(moves), goals, constraints, strategy or Annealing(),
        steps=steps, seconds=seconds, target=aims, seed=seed, progress=progress,
    )  # fmt: skip


def pursue(
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
    """Search as `optimise` does, with prepared goals and constraints; `clock` returns seconds."""
    _check(engine, moves, goals, constraints, steps, target)
    costs = None
    if target is not None:
        costs = tuple(-a if goal.sense == "maximise" else a for goal, a in zip(goals, target, strict=True))

    def tell(done: int, archive: Archive) -> None:
        if progress is not None:
            best = next(iter(archive)).standing
            values = (
                f"{goal.name} {goal.value(cost):.6g}" for goal, cost in zip(goals, best.costs, strict=True)
            )
            violated = [f"{best.violation:g} violations"] if best.violation else []
            progress(done, ", ".join([*violated, *values]))

    rng, before = np.random.default_rng(seed), engine.rng
    with _watching(engine, watchable(goals, constraints)):
        start = engine.model.state_hash()
        engine.rng = rng  # for choices inside of units
        try:
            appraise = Appraisal(engine, goals, constraints)
            walk = Walk(engine, moves, appraise, rng, steps, seconds, target=costs, tell=tell, clock=clock)
            try:
                strategy.search(walk)
                front = tuple(_solution(engine, walk, found, goals, start) for found in walk.archive)
                engine.checkout(front[0].version, discard=True)
            except BaseException:
                walk.abandon()
                raise
        finally:
            engine.rng = before
    return Optimum(front, _values(goals, walk.start), walk.spent, tuple(goals))


def _solution(engine: Engine, walk: Walk, found: Found, goals: Sequence[Goal], start: int) -> Solution:
    walk.go(found)
    trace = Trace(steps_of(found.path), start=start)
    trace.states[len(trace)] = engine.model.state_hash()
    return Solution(_values(goals, found), found.standing.violation, trace, found.version)


def _values(goals: Sequence[Goal], found: Found) -> Mapping[str, float]:
    return {goal.name: goal.value(cost) for goal, cost in zip(goals, found.standing.costs, strict=True)}


def _names(names: str | Iterable[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _goals(engine: Engine, given: Objectives, sense: Sense) -> Iterator[Goal]:
    for one in [given] if isinstance(given, str | Goal) else given:
        yield one if isinstance(one, Goal) else Goal.of(engine, one, sense)


def _check(
    engine: Engine,
    moves: Sequence[str],
    goals: Sequence[Goal],
    constraints: Sequence[Constraint],
    steps: int,
    target: Sequence[float] | None,
) -> None:
    """Refuse what makes no sense before anything is changed."""
    names = [goal.name for goal in goals]
    if not goals or len(set(names)) < len(names):
        raise InvalidArgument("there is one objective or more, each with a name of its own")
    if not moves:
        raise InvalidArgument("no rule changes the model", 'name some: `["move", "join"]`')
    for name in moves:
        engine.catalog.group(name)
    for pattern in watchable((), constraints):
        engine.catalog.asked(pattern)
    if type(steps) is not int or steps < 1:
        raise InvalidArgument(f"`steps` is a number from 1, not {steps!r}")
    if target is not None and (len(target) != len(goals) or not all(-inf < one < inf for one in target)):
        raise InvalidArgument(f"`target` has a number for each of the {len(goals)} objectives")
    if engine.events.active:
        message = "event rules would change models that are only tried"
        raise InvalidArgument(message, "search on `engine.copy()`, which has none")
    if engine.model.graph.history.depth:
        raise TransactionError("an optimisation goes back and forth: it cannot be inside a transaction")


@contextmanager
def _watching(engine: Engine, patterns: Sequence[str]) -> Iterator[None]:
    """Patterns are watched inside, unless looking for their matches is as fast, or somebody holds a version."""
    known, large = set(engine.watched), len(engine.model) >= _LARGE
    new = []
    for name in patterns:
        found = engine.library.get(engine.catalog.asked(name)[1])
        wanted = large if found.strategy is None else found.strategy == "incremental"
        if wanted and found.qualified_name not in known and not engine.library.inputs(found.qualified_name):
            new.append(found.qualified_name)
    try:
        engine.watch(*new)
    except (InvalidArgument, TransactionError):
        new = []  # the naive matcher, another engine that watches this model, or a version that is held
    try:
        yield
    finally:
        engine.unwatch(*new)
