"""Sharing of searches along closures: what many of them find together, or find alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from envgraph.code import dataclass
from envgraph.match.generate._sinks import Sink
from envgraph.match.plan._options import Unplannable, call_key
from envgraph.match.plan._order import Search
from envgraph.match.plan._plan import Kind, Plan, Step, ViewKey, ViewPlan
from envgraph.match.plan._planner import Planner
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    Conjunction,
    Goal,
    arguments,
    variables,
)

MOST_JOINED: Final = 24
"""Goals of a question of existence beyond which it is only answered directly: to plan it twice would take too long."""


def shared_searches(steps: Sequence[Step], sink: Sink) -> dict[int, int]:
    """The searches that need not find again what the searches before have found.

    They are from changing starts, and what is done with what they find does not depend on the start.

    Returns:
        For the number of the step that searches, that of the last step before it that matters; -1 if none does.
    """
    found: dict[int, int] = {}
    needed = set(sink.variables)
    for number in range(len(steps) - 1, 0, -1) if sink.repeatable else ():
        step = steps[number]
        needed.difference_update(step.binds)
        if step.kind is Kind.LOOP and isinstance(step.goal, ClosureAtom) and len(step.binds) == 1:
            last = next((n for n in range(number - 1, -1, -1) if needed.intersection(steps[n].binds)), -1)
            if any(each.kind is Kind.LOOP for each in steps[last + 1 : number]):
                found[number] = last
        needed.update(mentioned(step))
    return found


def mentioned(step: Step) -> Iterator[int]:
    """Every variable that a step mentions, those inside it included."""
    yield from variables(step.goal)
    if isinstance(step.goal, AggregateAtom):
        yield from arguments(step.goal.relation)
    for plan in step.inner:
        for inner in plan.steps:
            yield from mentioned(inner)


def only_search(view: ViewPlan) -> ClosureAtom | None:
    """The closure that is all that a view searches: its rows are what a given start reaches."""
    if len(view.bodies) != 1 or len(view.bodies[0].plan.steps) != 1:
        return None
    (body,) = view.bodies
    (step,) = body.plan.steps
    parameters = body.conjunction.parameters
    goal = step.goal
    if not isinstance(goal, ClosureAtom) or step.kind is not Kind.LOOP or len(step.binds) != 1:
        return None
    plain = len(parameters) == len(set(parameters)) == 2 and set(parameters) == {goal.source, goal.target}
    return goal if plain else None


@dataclass(frozen=True, slots=True)
class Join:
    """A question of existence: whether an end of a closure reaches, or is reached by, what other goals describe.

    Attributes:
        closure: the closure.
        near, far: its end with a value, and the other one.
        plan: finds all values of the far end.
    """

    closure: ClosureAtom
    near: int
    far: int
    plan: Plan


def join_of(planner: Planner, conjunction: Conjunction, plan: Plan, known: frozenset[int]) -> Join | None:
    """The plan as such a question, if it is one.

    Args:
        planner: plans what describes the far end.
        conjunction: the body.
        plan: answers the question.
        known: the variables with values, without constants.
    """
    goals = list(_goals(plan))
    if len(goals) > MOST_JOINED:
        return None
    fixed = frozenset(number for number, _ in conjunction.constants)
    for closure in goals:
        if not isinstance(closure, ClosureAtom):
            continue
        for near, far in ((closure.source, closure.target), (closure.target, closure.source)):
            others = [goal for goal in goals if goal is not closure]
            used = {v for goal in others for v in variables(goal)}
            if near in known and far not in known | fixed and near not in used and far in used:
                try:
                    found = Search(planner, conjunction, known | fixed, frozenset({far})).plan(others)
                except Unplannable:
                    continue
                return Join(closure, near, far, found)
    return None


def _goals(plan: Plan) -> Iterator[Goal]:
    for step in plan.steps:
        if step.kind is Kind.EXISTS:
            for inner in step.inner:
                yield from _goals(inner)
        else:
            yield step.goal


@dataclass(frozen=True, slots=True)
class Ends:
    """A question about a pattern: what the closure in each of its bodies may reach, and the wanted values with it.

    Attributes:
        pattern: its qualified name.
        start: the position from which the closures start; they are left out.
        given: other positions with values.
        wanted: positions whose values are wanted.
    """

    pattern: str
    start: int
    given: tuple[int, ...]
    wanted: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Alike:
    """An aggregate that has one value for all starts from which a closure reaches the same.

    Attributes:
        start: the variable of the aggregate's relation, or the position of a view.
        closure: the closure in the pattern that is called.
        forward: whether the start is its source.
        ends: what it may reach, if that can be found without the closure.
    """

    start: int
    closure: ClosureAtom
    forward: bool
    ends: Ends | None


def alike_by(planner: Planner, goal: AggregateAtom, known: frozenset[int]) -> Alike | None:
    """Return what an aggregate's value depends on only through what a closure reaches."""
    relation = goal.relation
    if not isinstance(relation, CallAtom) or planner.calls.recursive(relation.pattern):
        return None
    known = known.union(v for v in relation.arguments if v not in goal.local)
    free = [v for v in relation.arguments if v not in known]
    key = call_key(relation, known, free)
    view = planner.view(key)
    if goal.function == "count" and only_search(view):
        return None  # there is a function for that
    single = [place for place in key.bound if relation.arguments.count(relation.arguments[place]) == 1]
    found = alike_starts(planner, key, single)
    if found is None:
        return None
    ends = found.ends if len(free) == len(set(free)) else None
    return replace(found, start=relation.arguments[found.start], ends=ends)


def alike_starts(planner: Planner, key: ViewKey, positions: Sequence[int]) -> Alike | None:
    """A position, of some, on whose value the rows of a view depend only through what a closure reaches."""
    for position in positions:
        found = {_search_from(body.conjunction, position) for body in planner.view(key).bodies}
        if len(found) == 1 and (one := found.pop()) is not None:
            step, closure, forward = one
            others = tuple(place for place in key.bound if place != position)
            ends = Ends(key.pattern, position, others, key.outputs)
            plain = plans_of_ends(planner, ends) is not None
            return Alike(position, ClosureAtom(step, closure, 0, 1), forward, ends if plain else None)
    return None


def plans_of_ends(planner: Planner, ends: Ends) -> list[tuple[Conjunction, int, Plan]] | None:
    """Of each body the end of its closure and a plan that finds all values of it; None if there is no such plan."""
    found = []
    for body in planner.view(
        ViewKey(ends.pattern, tuple(sorted((*ends.given, ends.start))), ends.wanted)
    ).bodies:
        conjunction = body.conjunction
        parameters = conjunction.parameters
        start = parameters[ends.start]
        closure = next(g for g in conjunction.goals if isinstance(g, ClosureAtom) and start in variables(g))
        end = closure.target if closure.source == start else closure.source
        known = frozenset(n for n, _ in conjunction.constants) | {parameters[p] for p in ends.given}
        wanted = frozenset({end, *(parameters[place] for place in ends.wanted)}) - known
        others = [goal for goal in conjunction.goals if goal is not closure]
        if end in known or len(others) > MOST_JOINED:
            return None
        try:
            found.append((conjunction, end, Search(planner, conjunction, known, wanted).plan(others)))
        except Unplannable:
            return None
    return found


def _search_from(conjunction: Conjunction, position: int) -> tuple[str, Closure, bool] | None:
    """The closure that starts from a parameter which stands nowhere else."""
    variable = conjunction.parameters[position]
    if conjunction.parameters.count(variable) > 1 or any(n == variable for n, _ in conjunction.constants):
        return None
    using = [goal for goal in conjunction.goals if variable in _all_variables(goal)]
    goal = using[0] if len(using) == 1 else None
    if not isinstance(goal, ClosureAtom) or goal.source == goal.target:
        return None
    return goal.step, goal.closure, goal.source == variable


def _all_variables(goal: Goal) -> set[int]:
    found = set(variables(goal))
    if isinstance(goal, AggregateAtom):
        found.update(arguments(goal.relation))
    if isinstance(goal, Absence):
        found.update(
            v for alternative in goal.alternatives for each in alternative for v in _all_variables(each)
        )
    return found
