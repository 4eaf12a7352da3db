"""The candidates for the next step of a plan: estimated cost and fanout of each goal that can be solved next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import fsum, inf
from typing import Protocol

from envgraph.code import dataclass
from envgraph.match._match_costs import PLAN
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._search_plan import PatternPlan, PatternQuery, SearchPlan, StepKind
from envgraph.match.plan._size_estimates import SizeEstimates
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    ObjectType,
    UnequalAtom,
    ValuationAtom,
    relation_variables,
    required_variables,
    visible_variables,
)


class Unplannable(Exception):
    """The error raised if no goal can enumerate some variables. The pattern then needs values for them."""

    def __init__(self, numbers: frozenset[int]) -> None:
        self.numbers = numbers
        super().__init__(f"variables {sorted(numbers)} cannot be enumerated")


class PatternPlans(Protocol):
    """The interface through which the plan search gets the plans of called patterns."""

    library: Library
    calls: CallGraph
    sizes: SizeEstimates

    def plan_pattern(self, key: PatternQuery) -> PatternPlan:
        """Return the plan of a pattern query. Raise `Unplannable` if a parameter cannot be enumerated."""


@dataclass(frozen=True, slots=True)
class StepCandidate:
    """A candidate for the next step: a goal, the cost of one execution, and the fanout (rows for each row before).

    Attributes:
        total_estimate: cost and rows of all executions together, if the rows do not depend on earlier steps; else None.
    """

    kind: StepKind
    goal: Goal
    binds: tuple[int, ...]
    cost: float
    fanout: float
    inner: tuple[SearchPlan, ...] = ()
    total_estimate: tuple[float, float] | None = None

    @property
    def rank(self) -> float:
        """Return the sort key of a filter: ascending ranks minimise the work of filters (Hellerstein 1993, 2)."""
        return (self.fanout - 1.0) / self.cost

    @property
    def effort(self) -> float:
        """Return the sort key of a loop: its rows, plus a quarter of its cost."""
        return self.fanout + self.cost / 4


Bound = set[int] | frozenset[int]
PlanInside = Callable[[Sequence[Goal], frozenset[int], frozenset[int]], SearchPlan]
"""Plans goals of a negation or aggregate. Arguments: the goals, the variables with values, and the wanted variables."""


class StepCandidates:
    """The candidates for the next step of a plan of one conjunction.

    Args:
        views: plans of called patterns.
        conjunction: the body.
        plan_inside: plans the goals of negations and aggregates.
    """

    def __init__(self, views: PatternPlans, conjunction: Conjunction, plan_inside: PlanInside) -> None:
        self._views = views
        self._sizes = views.sizes
        self._conjunction = conjunction
        self._constants = frozenset(number for number, _ in conjunction.constants)
        self._plan_inside = plan_inside
        self._inner: dict[int, tuple[SearchPlan, ...]] = {}
        self._closure_ends: dict[int, tuple[float, float]] = {}

    def filter_candidate(self, goal: Goal, bound: Bound, uses: Counter[int]) -> StepCandidate | None:
        """Return a goal as a candidate with at most one row for each row before; None if more variables need values."""
        match goal:
            case InstanceAtom():
                has_value = goal.variable in bound or uses[goal.variable] == 1  # or it is used nowhere else
                return StepCandidate(StepKind.TEST, goal, (), PLAN.access, 0.3) if has_value else None
            case AttributeAtom(_, owner, value):
                if owner not in bound:
                    return None
                if value in bound:
                    return StepCandidate(StepKind.TEST, goal, (), PLAN.access, 0.2)
                return StepCandidate(StepKind.BIND, goal, (value,), PLAN.access, 0.99)
            case LinkAtom():
                return self._link(goal, bound, uses)
            case CallAtom():
                free = _unbound_variables(goal, bound)
                return None if self._needed_variables(goal, free, uses) else self._test_of_call(goal, bound)
            case ClosureAtom():
                return self._test_of_closure(goal, bound, uses)
            case _:
                return self._computed_candidate(goal, bound) if bound.issuperset(required_variables(goal)) else None

    def _computed_candidate(self, goal: Goal, bound: Bound) -> StepCandidate:
        """Return the candidate for an inequality, expression, aggregate or negation whose inputs all have values."""
        match goal:
            case UnequalAtom():
                return StepCandidate(StepKind.TEST, goal, (), PLAN.access, 0.9)
            case ConditionAtom():
                return StepCandidate(StepKind.TEST, goal, (), PLAN.expression, 0.5)
            case ValuationAtom(_, _, result):
                return self._value(goal, result, bound, PLAN.expression)
            case AggregateAtom():
                inner = self._plans_inside(goal)
                return self._value(goal, goal.result, bound, PLAN.call + inner[0].cost, inner)
            case AbsenceAtom():
                inner = self._plans_inside(goal)
                return StepCandidate(
                    StepKind.ABSENT, goal, (), PLAN.access + fsum(plan.cost for plan in inner) / 2, 0.5, inner
                )
        raise AssertionError(goal)

    def _value(
        self, goal: Goal, result: int, bound: Bound, cost: float, inner: tuple[SearchPlan, ...] = ()
    ) -> StepCandidate:
        """Return the candidate for a computed value: a test if `result` has a value, else a binding of `result`."""
        if result in bound:
            return StepCandidate(StepKind.TEST, goal, (), cost, 0.2, inner)
        return StepCandidate(StepKind.BIND, goal, (result,), cost, 0.99, inner)

    def _plans_inside(self, goal: AbsenceAtom | AggregateAtom) -> tuple[SearchPlan, ...]:
        """Return the plans of a negation's alternatives or an aggregate's relation; its inputs must have values."""
        if id(goal) not in self._inner:
            known = self._constants.union(required_variables(goal))
            alternatives: Sequence[tuple[Goal, ...]]
            if isinstance(goal, AbsenceAtom):
                alternatives, wanted = goal.alternatives, frozenset[int]()
            else:
                alternatives, wanted = (
                    [(goal.relation,)],
                    frozenset(relation_variables(goal.relation)) - known,
                )
            self._inner[id(goal)] = tuple(self._plan_inside(goals, known, wanted) for goals in alternatives)
        return self._inner[id(goal)]

    def _link(self, goal: LinkAtom, bound: Bound, uses: Counter[int]) -> StepCandidate | None:
        """Return a link as a test, or as a binding if its other end is at most one object; None if it needs a loop."""
        reference, source, target = goal.reference, goal.source, goal.target
        if source in bound and target in bound:
            return StepCandidate(StepKind.TEST, goal, (), PLAN.access, self._sizes.link_probability(reference))
        if source in bound:
            single, end, size = not reference.many, target, self._sizes.targets_per_source(reference)
        elif target in bound:
            single, end, size = (
                self._sizes.single_source(reference),
                source,
                self._sizes.sources_per_target(reference),
            )
        else:
            return None
        if uses[end] == 1:
            return StepCandidate(StepKind.TEST, goal, (), PLAN.access, min(0.9, size))
        return StepCandidate(StepKind.BIND, goal, (end,), PLAN.access, min(0.99, size)) if single else None

    def _test_of_call(self, goal: CallAtom, bound: Bound) -> StepCandidate | None:
        """Return a call as a test that a match exists; None if the pattern has no plan for these bound variables."""
        try:
            _, cost = self._estimate(goal, bound, ())
        except Unplannable:
            return None
        return StepCandidate(StepKind.TEST, goal, (), cost / 2, 0.5)

    def _test_of_closure(self, goal: ClosureAtom, bound: Bound, uses: Counter[int]) -> StepCandidate | None:
        """Return a closure as a test; None if it has no plan, or if an end without a value is used elsewhere."""
        step = CallAtom(goal.step, (goal.source, goal.target))
        free = _unbound_variables(step, bound)
        try:
            if not free:
                return StepCandidate(StepKind.TEST, goal, (), self._closure_cost(goal, bound) / 2, 0.5)
            # A closure reaches any node exactly if a first step exists.
            if (
                goal.closure is Closure.PLUS
                and goal.source != goal.target
                and not self._needed_variables(step, free, uses)
            ):
                return StepCandidate(StepKind.TEST, goal, (), self._estimate(step, bound, ())[1] / 2, 0.9)
        except Unplannable:
            pass
        return None

    def _has_fixed_estimate(self, pattern: str) -> bool:
        """Return True if a pattern gets fixed estimates: it is recursive, or its chains of calls are too long."""
        return self._views.calls.is_recursive(pattern) or self._views.calls.summary_of(pattern).height > PLAN.deepest

    def _closure_cost(self, goal: ClosureAtom, bound: Bound) -> float:
        """Return the cost of a search from the bound end or all sources; for two bound ends, the cost of two tests."""
        from_source, from_target = goal.source in bound, goal.target in bound
        if self._has_fixed_estimate(goal.step):
            cost = PLAN.opaque_cost
        else:
            keys = [PatternQuery(goal.step, (0,), (1,))] if from_source or not from_target else []
            if from_target:
                keys.append(PatternQuery(goal.step, (1,), (0,)))
            cost = min(self._views.plan_pattern(key).cost for key in keys)
        if from_source and from_target:
            return PLAN.reached * (cost + PLAN.call) / PLAN.meeting_share
        ends = self._end_counts(goal)
        starts = 1.0 if from_source or from_target else ends[0]
        reached = max(PLAN.reached, ends[from_source or not from_target] / PLAN.reached_share)
        return starts * reached * (cost + PLAN.call)

    def _closure_loop(self, goal: ClosureAtom, free: tuple[int, ...], cost: float, forward: bool) -> StepCandidate:
        """Return the loop over the unbound ends of a closure. `forward` is True if its targets are enumerated."""
        ends = self._end_counts(goal)
        rows = max(PLAN.reached, ends[forward] / PLAN.reached_share)
        if len(free) > 1:
            return StepCandidate(StepKind.LOOP, goal, free, cost, rows * ends[0])
        all_ = ends[forward]
        return StepCandidate(StepKind.LOOP, goal, free, cost, rows, total_estimate=(max(1.0, all_ / rows) * cost, all_))

    def value_count(self, variable: int) -> float:
        """Return the estimated number of objects that a variable may denote; infinity for a data value."""
        type_ = self._conjunction.types[variable]
        return self._sizes.extent_size(type_.cls) if isinstance(type_, ObjectType) else inf

    def _end_counts(self, goal: ClosureAtom) -> tuple[float, float]:
        """Return the estimated numbers of objects that may be sources and targets of a closure."""
        found = self._closure_ends.get(id(goal))
        if found is None:
            types = (self._conjunction.types[end] for end in (goal.source, goal.target))
            source, target = (
                self._sizes.extent_size(t.cls) if isinstance(t, ObjectType) else PLAN.reached for t in types
            )
            found = self._closure_ends[id(goal)] = source, target
        return found

    def _needed_variables(self, goal: CallAtom, free: Sequence[int], uses: Counter[int]) -> tuple[int, ...]:
        """Return the variables in `free` that are used elsewhere; all of `free` if a recursive pattern needs one."""
        if self._views.calls.is_recursive(goal.pattern) and any(uses[v] > 1 for v in free):
            return tuple(free)
        return tuple(v for v in free if uses[v] > 1)

    def _estimate(self, goal: CallAtom, bound: Bound, needed: Sequence[int]) -> tuple[float, float]:
        """Return the rows and cost of a call that gives the `needed` variables, or raise `Unplannable`."""
        unbound = {goal.arguments[position] for position in self._views.library.inputs(goal.pattern)} - bound
        if unbound:
            raise Unplannable(frozenset(unbound))
        if self._has_fixed_estimate(goal.pattern):
            times = 1.0 if not bound.isdisjoint(goal.arguments) else PLAN.opaque_whole
            return times * PLAN.opaque_rows ** len(needed), times * PLAN.opaque_cost
        view = self._views.plan_pattern(query_of_call(goal, bound, needed))
        return view.rows, view.cost + PLAN.call

    def loop_candidates(
        self, goals: Iterable[Goal], bound: Bound, uses: Counter[int], known: dict[int, list[StepCandidate]]
    ) -> list[StepCandidate]:
        """Return the candidates for the next loop, in ascending order of effort.

        Args:
            goals: the remaining goals.
            bound: the variables with values.
            uses: how often each variable is still used.
            known: cached loops over relations, by identity of the goal; missing entries are added.
        """
        goals, found = list(goals), []
        for goal in goals:
            options = known.get(id(goal))
            if options is None:
                options = known[id(goal)] = list(self._relations([goal], bound, uses))
            found += options
        found += self._extents(goals, bound, uses)
        return sorted(found, key=lambda option: option.effort)

    def _relations(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[StepCandidate]:
        """Yield loops over links with one bound end, calls and closures. Goals that have no plan are skipped."""
        for goal in goals:
            match goal:
                case LinkAtom(reference, source, target) if source in bound:
                    size = self._sizes.targets_per_source(reference)
                    yield StepCandidate(StepKind.LOOP, goal, (target,), size, size)
                case LinkAtom(reference, source, target) if target in bound:
                    size = self._sizes.sources_per_target(reference)
                    yield StepCandidate(StepKind.LOOP, goal, (source,), size, size)
                case CallAtom():
                    needed = self._needed_variables(goal, _unbound_variables(goal, bound), uses)
                    try:
                        rows, cost = self._estimate(goal, bound, needed)
                    except Unplannable:
                        continue
                    yield StepCandidate(StepKind.LOOP, goal, needed, cost, rows)
                case ClosureAtom(_, _, source, target):
                    try:
                        cost = self._closure_cost(goal, bound)
                    except Unplannable:
                        continue
                    free = tuple(dict.fromkeys(v for v in (source, target) if v not in bound))
                    yield self._closure_loop(goal, free, cost, target not in bound)
                case _:
                    pass

    def _extents(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[StepCandidate]:
        """Yield for each object variable without a value a loop over the smallest class that may contain its values."""
        classes: dict[int, list[InstanceAtom]] = {}
        for goal in goals:
            for variable in visible_variables(goal):
                if variable not in bound and variable not in classes:
                    type_ = self._conjunction.types[variable]
                    if isinstance(type_, ObjectType):
                        classes[variable] = [InstanceAtom(type_.cls, variable)]
            if isinstance(goal, InstanceAtom):
                classes[goal.variable].append(goal)
        for variable, atoms in classes.items():
            atom = atoms[0]
            if len(atoms) > 1:
                atom = min(atoms, key=lambda a: (self._extent(a), not a.exact))
            size = self._extent(atom)
            # An object that only one goal uses is better found through this goal.
            weight = 1.0 if uses[variable] > 1 else 1.5
            yield StepCandidate(StepKind.LOOP, atom, (variable,), size * weight, size)

    def _extent(self, atom: InstanceAtom) -> float:
        """Return the estimated number of objects that pass a class test."""
        return self._sizes.direct_extent_size(atom.cls) if atom.exact else self._sizes.extent_size(atom.cls)


def _unbound_variables(goal: CallAtom, bound: Bound) -> tuple[int, ...]:
    """Return the variables of a call that have no value, each once."""
    return tuple(dict.fromkeys(v for v in goal.arguments if v not in bound))


def query_of_call(goal: CallAtom, bound: Bound, needed: Sequence[int]) -> PatternQuery:
    """Return the pattern query of a call: `bound` variables give its bound positions, `needed` ones its outputs."""
    given = tuple(position for position, v in enumerate(goal.arguments) if v in bound)
    wanted = tuple(position for position, v in enumerate(goal.arguments) if v in needed)
    return PatternQuery(goal.pattern, given, wanted)
