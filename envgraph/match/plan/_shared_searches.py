"""Find closure searches in plans that may skip nodes found from other starts, as later steps use the found nodes
alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from envgraph.code import dataclass
from envgraph.match._match_costs import PLAN
from envgraph.match.generate._sinks import SolutionSink
from envgraph.match.plan._goal_order import GoalOrderSearch
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import PatternPlan, PatternQuery, PlanStep, SearchPlan, StepKind
from envgraph.match.plan._step_candidates import Unplannable, query_of_call
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    Conjunction,
    Goal,
    relation_variables,
    visible_variables,
)


def shared_searches(steps: Sequence[PlanStep], sink: SolutionSink) -> dict[int, int]:
    """Return the closure loops of a plan that may skip nodes which they have already found from other starts.

    A loop may do so if later steps and the sink use only the found node, not its start, and results may repeat.

    Returns:
        for the number of each such step, the number of the last earlier step whose variables are used later, or -1. The
        found nodes must be forgotten whenever this earlier step binds new values.
    """
    found: dict[int, int] = {}
    needed = set(sink.variables)
    for number in range(len(steps) - 1, 0, -1) if sink.repeatable else ():
        step = steps[number]
        needed.difference_update(step.binds)
        if step.kind is StepKind.LOOP and isinstance(step.goal, ClosureAtom) and len(step.binds) == 1:
            last = next((n for n in range(number - 1, -1, -1) if needed.intersection(steps[n].binds)), -1)
            if any(each.kind is StepKind.LOOP for each in steps[last + 1 : number]):
                found[number] = last
        needed.update(variables_used_by(step))
    return found


def variables_used_by(step: PlanStep) -> Iterator[int]:
    """Yield every variable that a step uses, also in negations and aggregates. Variables may be repeated."""
    yield from visible_variables(step.goal)
    if isinstance(step.goal, AggregateAtom):
        yield from relation_variables(step.goal.relation)
    for plan in step.inner:
        for inner in plan.steps:
            yield from variables_used_by(inner)


def closure_of_plan(view: PatternPlan) -> ClosureAtom | None:
    """Return the closure if it is a pattern's only goal, from its bound to its other parameter; else None."""
    if len(view.bodies) != 1 or len(view.bodies[0].plan.steps) != 1:
        return None
    (body,) = view.bodies
    (step,) = body.plan.steps
    parameters = body.conjunction.parameters
    goal = step.goal
    if not isinstance(goal, ClosureAtom) or step.kind is not StepKind.LOOP or len(step.binds) != 1:
        return None
    is_direct = len(parameters) == len(set(parameters)) == 2 and set(parameters) == {goal.source, goal.target}
    return goal if is_direct else None


@dataclass(frozen=True, slots=True)
class ClosureMeeting:
    """An existence test that succeeds if a closure search from the near end finds a value of the far end.

    Attributes:
        closure: the closure.
        bound_end: the variable of its end with a value.
        free_end: the variable of its other end.
        plan: finds all values of `free_end` that satisfy the other goals.
    """

    closure: ClosureAtom
    bound_end: int
    free_end: int
    plan: SearchPlan


def join_of(
    planner: Planner, conjunction: Conjunction, plan: SearchPlan, known: frozenset[int]
) -> ClosureMeeting | None:
    """Return the plan of an existence test as a `ClosureMeeting`; None if the test has no such form.

    It needs a closure with a known end that no other goal uses, and another end that only the other goals bind.

    Args:
        planner: gives the plans of called patterns and the size estimates.
        conjunction: the body.
        plan: the plan of the test.
        known: the variables with values, without constants.
    """
    goals = list(_goals(plan))
    if len(goals) > PLAN.most_joined:
        return None
    fixed = frozenset(number for number, _ in conjunction.constants)
    for closure in goals:
        if not isinstance(closure, ClosureAtom):
            continue
        for near, far in ((closure.source, closure.target), (closure.target, closure.source)):
            others = [goal for goal in goals if goal is not closure]
            used = {v for goal in others for v in visible_variables(goal)}
            if near in known and far not in known | fixed and near not in used and far in used:
                try:
                    found = GoalOrderSearch(planner, conjunction, known | fixed, frozenset({far})).plan(others)
                except Unplannable:
                    continue
                return ClosureMeeting(closure, near, far, found)
    return None


def _goals(plan: SearchPlan) -> Iterator[Goal]:
    """Yield the goals of a plan. An existence test is replaced by the goals inside it."""
    for step in plan.steps:
        if step.kind is StepKind.EXISTS:
            for inner in step.inner:
                yield from _goals(inner)
        else:
            yield step.goal


@dataclass(frozen=True, slots=True)
class ClosureEndsQuery:
    """A query for the nodes where the closures in a pattern's bodies may end, with the wanted values of each.

    Attributes:
        pattern: qualified name.
        start: the position at which the closures start. The query leaves out the closures themselves.
        given: the other bound positions.
        wanted: the positions whose values are wanted.
    """

    pattern: str
    start: int
    given: tuple[int, ...]
    wanted: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ReachAggregate:
    """An aggregate whose value depends on a closure's start only through the set of nodes that the start reaches.

    Attributes:
        start: the start: a variable of the aggregate's relation, or a position of a pattern query.
        closure: the closure in the called pattern.
        forward: True if the start is the source of the closure.
        ends: a query for the possible ends of the closure; None if they cannot be found without the closure.
    """

    start: int
    closure: ClosureAtom
    forward: bool
    ends: ClosureEndsQuery | None


def reach_aggregate_of(planner: Planner, goal: AggregateAtom, known: frozenset[int]) -> ReachAggregate | None:
    """Return the closure whose reached nodes alone fix the value of an aggregate; None if there is none.

    Return None also if the aggregate counts just these nodes. `known` are the variables with values.
    """
    relation = goal.relation
    if not isinstance(relation, CallAtom) or planner.calls.is_recursive(relation.pattern):
        return None
    known = known.union(v for v in relation.arguments if v not in goal.local)
    free = [v for v in relation.arguments if v not in known]
    key = query_of_call(relation, known, free)
    view = planner.plan_pattern(key)
    if goal.function == "count" and closure_of_plan(view):
        return None  # counted by `ClosureQuestion.SIZE`
    single = [place for place in key.bound if relation.arguments.count(relation.arguments[place]) == 1]
    found = reach_aggregate_at(planner, key, single)
    if found is None:
        return None
    ends = found.ends if len(free) == len(set(free)) else None
    return replace(found, start=relation.arguments[found.start], ends=ends)


def reach_aggregate_at(planner: Planner, key: PatternQuery, positions: Sequence[int]) -> ReachAggregate | None:
    """Return the first position whose value influences a query's rows only as the start of a closure, as an
    `ReachAggregate`.

    Return None if there is no such position. All bodies must use the same closure.
    """
    for position in positions:
        found = {_closure_from(body.conjunction, position) for body in planner.plan_pattern(key).bodies}
        if len(found) == 1 and (one := found.pop()) is not None:
            step, closure, forward = one
            others = tuple(place for place in key.bound if place != position)
            ends = ClosureEndsQuery(key.pattern, position, others, key.outputs)
            is_direct = plans_of_ends(planner, ends) is not None
            return ReachAggregate(position, ClosureAtom(step, closure, 0, 1), forward, ends if is_direct else None)
    return None


def plans_of_ends(planner: Planner, ends: ClosureEndsQuery) -> list[tuple[Conjunction, int, SearchPlan]] | None:
    """Return for each body its conjunction, the end of its closure, and a plan that finds all values of the end.

    Return None if in a body the end has a value already, or the other goals are too many or cannot be planned.
    """
    found = []
    for body in planner.plan_pattern(
        PatternQuery(ends.pattern, tuple(sorted((*ends.given, ends.start))), ends.wanted)
    ).bodies:
        conjunction = body.conjunction
        parameters = conjunction.parameters
        start = parameters[ends.start]
        closure = next(g for g in conjunction.goals if isinstance(g, ClosureAtom) and start in visible_variables(g))
        end = closure.target if closure.source == start else closure.source
        known = frozenset(n for n, _ in conjunction.constants) | {parameters[p] for p in ends.given}
        wanted = frozenset({end, *(parameters[place] for place in ends.wanted)}) - known
        others = [goal for goal in conjunction.goals if goal is not closure]
        if end in known or len(others) > PLAN.most_joined:
            return None
        try:
            found.append((conjunction, end, GoalOrderSearch(planner, conjunction, known, wanted).plan(others)))
        except Unplannable:
            return None
    return found


def _closure_from(conjunction: Conjunction, position: int) -> tuple[str, Closure, bool] | None:
    """Return step, kind and direction (True: forward) of the closure that alone uses a parameter, or None."""
    variable = conjunction.parameters[position]
    if conjunction.parameters.count(variable) > 1 or any(n == variable for n, _ in conjunction.constants):
        return None
    using = [goal for goal in conjunction.goals if variable in _all_variables(goal)]
    goal = using[0] if len(using) == 1 else None
    if not isinstance(goal, ClosureAtom) or goal.source == goal.target:
        return None
    return goal.step, goal.closure, goal.source == variable


def _all_variables(goal: Goal) -> set[int]:
    """Return all variables of a goal, variables inside negations and aggregates included."""
    found = set(visible_variables(goal))
    if isinstance(goal, AggregateAtom):
        found.update(relation_variables(goal.relation))
    if isinstance(goal, AbsenceAtom):
        found.update(v for alternative in goal.alternatives for each in alternative for v in _all_variables(each))
    return found
