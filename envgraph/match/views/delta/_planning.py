"""Plan the searches of views. Sizes are measured in the model, and calls read the stored rows of other views."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Protocol

from envgraph.match._costs import PLAN, VIEWS
from envgraph.match.passes._calls import CallGraph
from envgraph.match.plan._estimate import Sizes
from envgraph.match.plan._live import LiveSizes
from envgraph.match.plan._options import Bound, Option, Options, PlanInside, Unplannable
from envgraph.match.plan._order import Draft, Search
from envgraph.match.plan._plan import Kind, Plan, ViewKey, ViewPlan, held_value
from envgraph.match.plan._planner import determined, disjoint
from envgraph.match.views.delta._bodies import existential
from envgraph.metamodel import Reference
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    Binary,
    CallAtom,
    ClosureAtom,
    Condition,
    Conjunction,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    variables,
)


class Held(Protocol):
    """The interface to the present sizes of views and closures, for cost estimates."""

    def rows(self, view: str) -> float:
        """Return the number of matches of a view."""

    def matching(self, view: str, positions: tuple[int, ...]) -> float:
        """Return how many matches of a view share their values at some positions, on average."""

    def reached(self, closure: str) -> tuple[bool, float, float]:
        """Return for a closure: True if starts are sources, the number of starts, and the nodes reached per start."""


class ViewPlanner:
    """A planner for conjunctions over the relations of views.

    Attributes:
        plans: the cached plans of delta functions, by view, body and goal.
    """

    def __init__(self, library: Library, calls: CallGraph, sizes: LiveSizes, held: Held) -> None:
        self.library = library
        self.calls = calls
        self.sizes: Sizes = sizes
        self.live = sizes
        self.held = held
        self.plans: dict[tuple[str, int, int], Plan] = {}

    def view(self, key: ViewKey) -> ViewPlan:
        """Raise an `AssertionError`, because calls of views read stored rows and need no plan."""
        raise AssertionError(key)

    def plan(self, conjunction: Conjunction, goals: Sequence[Goal], bound: frozenset[int]) -> Plan:
        """Return a plan for goals, given the `bound` variables; it binds all others but those that only need to exist.

        Raises:
            Unplannable: a variable cannot be enumerated.
        """
        fixed = frozenset(number for number, _ in conjunction.constants)
        loose = existential(conjunction)
        wanted = {v for goal in goals for v in variables(goal)} - loose - bound - fixed
        wanted.update(v for v in conjunction.parameters if v not in bound and v not in fixed)
        return ViewSearch(self, conjunction, bound | fixed, frozenset(wanted)).plan(goals)

    def repeats(self, bodies: Sequence[Conjunction]) -> bool:
        """Return True if a row of a view with these bodies may have several derivations."""
        for body in bodies:
            known = {*body.parameters, *(number for number, _ in body.constants)}
            counted = {v for goal in body.goals for v in variables(goal)} - existential(body)
            if not counted <= determined(body.goals, known, self.sizes):
                return True
        positions = range(len(bodies[0].parameters)) if bodies else ()
        return not disjoint(self.library.metamodel, positions, bodies)

    def orders(self, bodies: Sequence[Conjunction]) -> bool:
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
    expression = goal.expression if isinstance(goal, Condition) and len(goal.reads) > 1 else None
    return isinstance(expression, Binary) and expression.operator in ("<", "<=", ">", ">=")


class ViewOptions(Options):
    """The candidates for the next step of a plan in views, where calls and closures are lookups."""

    def __init__(self, views: ViewPlanner, conjunction: Conjunction, plan_inside: PlanInside) -> None:
        super().__init__(views, conjunction, plan_inside)
        self._held = views.held
        self._live = views.live
        self._loose = existential(conjunction)

    def filter(self, goal: Goal, bound: Bound, uses: Counter[int]) -> Option | None:
        if _from_value(goal, bound):
            return None
        if isinstance(goal, AttributeAtom) and goal.object in bound and goal.value in bound:
            return Option(Kind.TEST, goal, (), PLAN.access, self._live.selectivity(goal.attribute.index))
        return super().filter(goal, bound, uses)

    def _derived(self, goal: Goal, bound: Bound) -> Option:
        match goal:
            case AggregateAtom():
                return self._value(goal, goal.result, bound, PLAN.expression)
            case Absence():
                return Option(Kind.TEST, goal, (), PLAN.access, 0.5)
            case _:
                return super()._derived(goal, bound)

    def _opaque(self, pattern: str) -> bool:
        return False

    def _needed(self, goal: CallAtom, free: Sequence[int], uses: Counter[int]) -> tuple[int, ...]:
        return tuple(free)

    def _estimate(self, goal: CallAtom, bound: Bound, needed: Sequence[int]) -> tuple[float, float]:
        positions = tuple(p for p, v in enumerate(goal.arguments) if v in bound)
        if not positions:
            rows = self._held.rows(goal.pattern)
        elif len(positions) == len(goal.arguments):
            return min(0.5, self._held.rows(goal.pattern)), 2 * PLAN.access
        else:
            rows = self._held.matching(goal.pattern, positions)
        return rows, rows + PLAN.access

    def _closure_cost(self, goal: ClosureAtom, bound: Bound) -> float:
        forward, starts, each = self._held.reached(goal.step)
        start, other = (goal.source, goal.target) if forward else (goal.target, goal.source)
        if start in bound:
            return 2 * PLAN.access if other in bound else each
        return starts if other in bound else starts * each

    def _relations(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[Option]:
        for option in super()._relations(
            [goal for goal in goals if not _from_value(goal, bound)], bound, uses
        ):
            if isinstance(option.goal, ClosureAtom):
                _, starts, each = self._held.reached(option.goal.step)
                rows = min(starts * each, option.cost)
                yield Option(Kind.LOOP, option.goal, option.binds, option.cost, rows)
            elif self._loose.isdisjoint(option.binds):
                yield option

    def _extents(self, goals: Sequence[Goal], bound: Bound, uses: Counter[int]) -> Iterator[Option]:
        """Yield, for each unbound object variable of a fact, a loop over the smallest class that the fact requires.

        Variables that occur only in calls of views get no loop, because the rows of views may contain deleted objects.
        """
        classes: dict[int, list[InstanceAtom]] = {}
        for goal in goals:
            for atom in _classes(goal):
                if atom.variable not in bound and atom.variable not in self._loose:
                    classes.setdefault(atom.variable, []).append(atom)
        for variable, atoms in classes.items():
            atom = min(atoms, key=lambda a: (self._extent(a), not any(a is goal for goal in goals)))
            size = self._extent(atom)
            yield Option(Kind.LOOP, atom, (variable,), size, size)


def _from_value(goal: Goal, bound: Bound) -> bool:
    """Return True if a goal would need a lookup of objects by attribute value, which views do not have."""
    held = held_value(goal)
    return held is not None and held[1] not in bound


def _classes(goal: Goal) -> Sequence[InstanceAtom]:
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


class ViewSearch(Search):
    """The plan search for conjunctions over facts of the model and stored relations of the view network."""

    options: type[Options] = ViewOptions
    most_plans = 24
    counts_abandoned = True  # each occurrence has a plan of its own: none may take long

    def _enter(self, draft: Draft, loop: Option) -> None:
        """Append a loop to a draft plan, and remove its goal. Other class tests of its object remain to be tested."""
        draft.add(loop)
        self._drop(draft, [loop.goal], loop.binds)
