"""The planner: orders the goals of all bodies of a pattern, filters first, then the loop with the lowest estimate."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from math import fsum

from envgraph.match.passes import ON_DEMAND, RewrittenBodies, expanded_bodies
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._goal_order import GoalOrderSearch
from envgraph.match.plan._search_plan import BodyPlan, PatternPlan, PatternQuery, SearchPlan, StepKind
from envgraph.match.plan._size_estimates import SizeEstimates
from envgraph.match.plan._step_candidates import Unplannable
from envgraph.metamodel import Metamodel
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    Conjunction,
    Goal,
    Library,
    LinkAtom,
    ObjectType,
    ValuationAtom,
    required_variables,
    visible_variables,
)


class Planner:
    """A planner for the patterns of a library. A plan depends only on the pattern query and the size estimates.

    Args:
        library: the patterns.
        calls: their call graph.
        sizes: the size estimates; None for estimates from the metamodel.
        not_inlined: names of patterns that are never inlined.
    """

    def __init__(
        self,
        library: Library,
        calls: CallGraph,
        sizes: SizeEstimates | None = None,
        not_inlined: Container[str] = (),
    ) -> None:
        self.library = library
        self.calls = calls
        self.sizes = sizes or SizeEstimates(library.metamodel)
        self._bodies = RewrittenBodies(library, calls, ON_DEMAND, not_inlined)
        self._views: dict[PatternQuery, PatternPlan | Unplannable] = {}

    def plan_pattern(self, key: PatternQuery) -> PatternPlan:
        """Return the plan of a pattern query. Plans and failures are cached.

        Raises:
            Unplannable: a parameter without a value cannot be enumerated.
        """
        if key not in self._views:
            try:
                self._views[key] = self._plan_view(key, self._bodies.bodies_of(key.pattern))
            except Unplannable as reason:
                self._views[key] = reason
        found = self._views[key]
        if isinstance(found, Unplannable):
            raise found
        return found

    def plan_expanded(self, key: PatternQuery) -> PatternPlan:
        """Return the plan of a pattern query, with one body for each combination of inlined bodies if these are few.

        Raises:
            Unplannable: a parameter without a value cannot be enumerated.
        """
        return self._plan_view(key, expanded_bodies(self._bodies, key.pattern))

    def plan_all_variables(self, conjunction: Conjunction, bound: tuple[int, ...]) -> SearchPlan:
        """Return a plan that binds every variable of a conjunction, if parameters at `bound` positions have values.

        Raises:
            Unplannable: a variable cannot be enumerated.
        """
        fixed = frozenset(number for number, _ in conjunction.constants)
        known = fixed | {conjunction.parameters[position] for position in bound}
        wanted = {v for goal in conjunction.goals for v in visible_variables(goal)} | {*conjunction.parameters}
        return GoalOrderSearch(self, conjunction, known, frozenset(wanted) - known).plan(conjunction.goals)

    def _plan_view(self, key: PatternQuery, conjunctions: tuple[Conjunction, ...]) -> PatternPlan:
        """Return the plan of a pattern query whose pattern has these bodies."""
        bodies = tuple(self._plan_body(key, conjunction) for conjunction in conjunctions)
        distinct = not any(body.may_repeat for body in bodies) and are_disjoint(
            self.library.metamodel, (*key.outputs, *key.bound), conjunctions
        )
        rows = fsum(body.plan.rows for body in bodies)
        return PatternPlan(key, bodies, distinct, rows, fsum(body.plan.cost for body in bodies))

    def _plan_body(self, key: PatternQuery, conjunction: Conjunction) -> BodyPlan:
        """Return the plan of one body for a pattern query, or raise `Unplannable`."""
        fixed = frozenset(number for number, _ in conjunction.constants)
        bound = fixed | {conjunction.parameters[position] for position in key.bound}
        wanted = frozenset(conjunction.parameters[position] for position in key.outputs) - bound
        plan = GoalOrderSearch(self, conjunction, bound, wanted).plan(conjunction.goals)
        missing = wanted - bound - {number for step in plan.steps for number in step.binds}
        if missing:
            raise Unplannable(missing)
        looped = {number for step in plan.steps if step.kind is StepKind.LOOP for number in step.binds}
        repeats = not looped <= determined_variables(conjunction.goals, bound | wanted, self.sizes)
        return BodyPlan(conjunction, plan, repeats)


def determined_variables(goals: Sequence[Goal], known: Iterable[int], sizes: SizeEstimates) -> set[int]:
    """Return the `known` variables and those to which the goals give at most one value if `known` have values."""
    found = set(known)
    size = -1
    while size != len(found):
        size = len(found)
        for goal in goals:
            match goal:
                case LinkAtom(reference, source, target):
                    if source in found and not reference.many:
                        found.add(target)
                    if target in found and sizes.single_source(reference):
                        found.add(source)
                case AttributeAtom(_, owner, value):
                    if owner in found:
                        found.add(value)
                case ValuationAtom() | AggregateAtom():
                    if found.issuperset(required_variables(goal)):
                        found.add(goal.result)
                case _:
                    pass
    return found


def are_disjoint(metamodel: Metamodel, positions: Sequence[int], bodies: Sequence[Conjunction]) -> bool:
    """Return True if every two bodies have different constants or disjoint classes at one of these positions."""
    return all(
        any(_differ(metamodel, position, body, other) for position in positions)
        for number, body in enumerate(bodies)
        for other in bodies[:number]
    )


def _differ(metamodel: Metamodel, position: int, *bodies: Conjunction) -> bool:
    """Return True if the parameter at a position has different constants or disjoint classes in two bodies."""
    one, other = (body.types[body.parameters[position]] for body in bodies)
    if isinstance(one, ObjectType) and isinstance(other, ObjectType):
        return not metamodel.may_overlap(one.cls, other.cls)
    fixed = [dict(body.constants).get(body.parameters[position]) for body in bodies]
    return None not in fixed and fixed[0] != fixed[1]
