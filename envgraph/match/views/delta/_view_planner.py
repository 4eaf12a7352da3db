"""Plan the searches of views. Sizes are measured in the model, and calls read the stored rows of other views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Protocol

from envgraph.match._match_costs import PLAN, VIEWS
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._goal_order import GoalOrderSearch, PlanDraft
from envgraph.match.plan._measured_sizes import LiveSizes
from envgraph.match.plan._planner import are_disjoint, determined_variables
from envgraph.match.plan._search_plan import (
    PatternPlan,
    PatternQuery,
    SearchPlan,
    StepKind,
    attribute_and_variables,
)
from envgraph.match.plan._size_estimates import SizeEstimates
from envgraph.match.plan._step_candidates import Bound, PlanInside, StepCandidate, StepCandidates, Unplannable
from envgraph.match.views.delta._view_bodies import existential_variables
from envgraph.metamodel import Reference
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    Binary,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    visible_variables,
)


class ViewSizes(Protocol):
    """The interface to the present sizes of views and closures, for cost estimates."""

    def row_count(self, view: str) -> float:
        """Return the number of matches of a view."""

    def rows_per_key(self, view: str, positions: tuple[int, ...]) -> float:
        """Return how many matches of a view share their values at some positions, on average."""

    def closure_sizes(self, closure: str) -> tuple[bool, float, float]:
        """Return for a closure: True if starts are sources, the number of starts, and the nodes reached per start."""


class ViewPlanner:
    """A planner for conjunctions over the relations of views.

    Attributes:
        plans: the cached plans of delta functions, by view, body and goal.
    """

    def __init__(self, library: Library, calls: CallGraph, sizes: LiveSizes, held: ViewSizes) -> None:
        self.library = library
        self.calls = calls
        self.sizes: SizeEstimates = sizes
        self.live = sizes
        self.view_sizes = held
        self.plans: dict[tuple[str, int, int], SearchPlan] = {}

    def plan_pattern(self, key: PatternQuery) -> PatternPlan:
        """Raise an `AssertionError`, because calls of views read stored rows and need no plan."""
        raise AssertionError(key)

    def plan(self, conjunction: Conjunction, goals: Sequence[Goal], bound: frozenset[int]) -> SearchPlan:
        """Return a plan for goals, given the `bound` variables; it binds all others but those that only need to exist.

        Raises:
            Unplannable: a variable cannot be enumerated.
        """
        fixed = frozenset(number for number, _ in conjunction.constants)
        loose = existential_variables(conjunction)
        wanted = {v for goal in goals for v in visible_variables(goal)} - loose - bound - fixed
        wanted.update(v for v in conjunction.parameters if v not in bound and v not in fixed)
        return ViewGoalOrderSearch(self, conjunction, bound | fixed, frozenset(wanted)).plan(goals)

    def may_repeat(self, bodies: Sequence[Conjunction]) -> bool:
        """Return True if a row of a view with these bodies may have several derivations."""
        for body in bodies:
            known = {*body.parameters, *(number for number, _ in body.constants)}
            counted = {v for goal in body.goals for v in visible_variables(goal)} - existential_variables(body)
            if not counted <= determined_variables(body.goals, known, self.sizes):
                return True
        positions = range(len(bodies[0].parameters)) if bodies else ()
        return not are_disjoint(self.library.metamodel, positions, bodies)

    def is_large_ordering(self, bodies: Sequence[Conjunction]) -> bool:
        """Return True if a pattern is estimated to have very many rows, and compares values as in `x < y`.

        Such comparisons relate nearly all pairs of objects. An ordered index finds the existence or number of rows
        without listing them. So patterns with negations or counts of such a pattern are recomputed after every change.
        """
        for body in bodies:
            if any(map(_is_ordering, body.goals)):
                with suppress(Unplannable):
                    if self.plan(body, body.goals, frozenset()).rows > VIEWS.most_ordered:
                        return True
        return False


def _is_ordering(goal: Goal) -> bool:
    """Return True if a goal compares values of two or more variables by `<`, `<=`, `>` or `>=`."""
    expression = goal.expression if isinstance(goal, ConditionAtom) and len(goal.reads) > 1 else None
    return isinstance(expression, Binary) and expression.operator in ("<", "<=", ">", ">=")


class ViewStepCandidates(StepCandidates):
    """The candidates for the next step of a plan in views, where calls and closures are lookups."""

    def __init__(self, views: ViewPlanner, conjunction: Conjunction, plan_inside: PlanInside) -> None:
        super().__init__(views, conjunction, plan_inside)
        self._held = views.view_sizes
        self._live = views.live
        self._loose = existential_variables(conjunction)

    def filter_candidate(self, goal: Goal, bound: Bound, uses: Counter[int]) -> StepCandidate | None:
        if _needs_value_index(goal, bound):
            return None
        if isinstance(goal, AttributeAtom) and goal.object in bound and goal.value in bound:
            return StepCandidate(
                StepKind.TEST, goal, (), PLAN.access, self._live.value_probability(goal.attribute.index)
            )
        return super().filter_candidate(goal, bound, uses)

    def _computed_candidate(self, goal: Goal, bound: Bound) -> StepCandidate:
        match goal:
            case AggregateAtom():
                return self._value(goal, goal.result, bound, PLAN.expression)
            case AbsenceAtom():
                return StepCandidate(StepKind.TEST, goal, (), PLAN.access, 0.5)
            case _:
                return super()._computed_candidate(goal, bound)

    def _has_fixed_estimate(self, pattern: str) -> bool:
        return False

    def _needed_variables(self, goal: CallAtom, free: Sequence[int], uses: Counter[int]) -> tuple[int, ...]:
        return tuple(free)

    def _estimate(self, goal: CallAtom, bound: Bound, needed: Sequence[int]) -> tuple[float, float]:
        positions = tuple(p for p, v in enumerate(goal.arguments) if v in bound)
        if not positions:
            rows = self._held.row_count(goal.pattern)
        elif len(positions) == len(goal.arguments):
            return min(0.5, self._held.row_count(goal.pattern)), 2 * PLAN.access
        else:
            rows = self._held.rows_per_key(goal.pattern, positions)
        return rows, rows + PLAN.access

    def _closure_cost(self, goal: ClosureAtom, bound: Bound) -> float:
        forward, starts, each = self._held.closure_sizes(goal.step)
        start, other = (goal.source, goal.target) if forward else (goal.target, goal.source)
        if start in bound:
            return 2 * PLAN.access if other in bound else each
        return starts if other in bound else starts * each

    def _relations(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[StepCandidate]:
        for option in super()._relations([goal for goal in goals if not _needs_value_index(goal, bound)], bound, uses):
            if isinstance(option.goal, ClosureAtom):
                _, starts, each = self._held.closure_sizes(option.goal.step)
                rows = min(starts * each, option.cost)
                yield StepCandidate(StepKind.LOOP, option.goal, option.binds, option.cost, rows)
            elif self._loose.isdisjoint(option.binds):
                yield option

    def _extents(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[StepCandidate]:
        """Yield, for each unbound object variable of a fact, a loop over the smallest class that the fact requires.

        Variables that occur only in calls of views get no loop, because the rows of views may contain deleted objects.
        """
        classes: dict[int, list[InstanceAtom]] = {}
        for goal in goals:
            for atom in _implied_class_tests(goal):
                if atom.variable not in bound and atom.variable not in self._loose:
                    classes.setdefault(atom.variable, []).append(atom)
        for variable, atoms in classes.items():
            atom = min(atoms, key=lambda a: (self._extent(a), not any(a is goal for goal in goals)))
            size = self._extent(atom)
            yield StepCandidate(StepKind.LOOP, atom, (variable,), size, size)


def _needs_value_index(goal: Goal, bound: Bound) -> bool:
    """Return True if a goal would need a lookup of objects by attribute value, which views do not have."""
    held = attribute_and_variables(goal)
    return held is not None and held[1] not in bound


def _implied_class_tests(goal: Goal) -> Sequence[InstanceAtom]:
    """Return the class tests that a fact implies for its objects by its attribute or reference; () for other goals."""
    match goal:
        case InstanceAtom():
            return [goal]
        case AttributeAtom(attribute, owner, _):
            return [InstanceAtom(attribute.owner, owner)]
        case LinkAtom(Reference() as reference, source, target):
            return [InstanceAtom(reference.owner, source), InstanceAtom(reference.target, target)]
        case LinkAtom(attribute, owner, _):
            return [InstanceAtom(attribute.owner, owner)]
        case _:
            return []


class ViewGoalOrderSearch(GoalOrderSearch):
    """The plan search for conjunctions over facts of the model and stored relations of the view network."""

    options: type[StepCandidates] = ViewStepCandidates
    most_plans = 24
    counts_abandoned = True  # each occurrence has a plan of its own: none may take long

    def _append_loop(self, draft: PlanDraft, loop: StepCandidate) -> None:
        """Append a loop to a draft plan, and remove its goal. Other class tests of its object remain to be tested."""
        draft.append_step(loop)
        self._remove_goals(draft, [loop.goal], loop.binds)
