"""Joins by attribute value: where a search would test many objects for a value, the body calls a view of all values."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.graph import Store
from envgraph.match._match_costs import VIEWS
from envgraph.match.plan._search_plan import SearchPlan, StepKind, attribute_and_variables
from envgraph.match.plan._step_candidates import Unplannable
from envgraph.match.views.delta._occurrences import TupleEffect, occurrences
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.metamodel import Attribute, Metamodel, Value, Values
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ConditionAtom,
    Conjunction,
    Goal,
    LinkAtom,
    ObjectType,
    UnequalAtom,
    renumber_relation,
    visible_variables,
)


def value_join_attributes(store: Store, planner: ViewPlanner, body: Conjunction) -> frozenset[int]:
    """Return the indices of the attributes by which the search of a body would test many objects for a known value.

    Args:
        store: the store, whose values are sampled.
        planner: orders goals.
        body: goals over relations of the network.
    """
    possible = {
        held[0].index
        for goal in body.goals
        if (held := attribute_and_variables(goal))
        and _is_bound_elsewhere(body, goal)
        and planner.sizes.extent_size(held[0].owner) > VIEWS.many
        and _is_selective(store, planner.library.metamodel, held[0])
    }
    if not possible:
        return frozenset()
    fixed = {number for number, _ in body.constants}
    found: set[int] = set()  # used only for membership tests
    for known, others in _searches(body):
        try:
            plan = planner.plan(body, [body.goals[number] for number in others], frozenset(known))
        except Unplannable:
            continue
        found.update(_tested_attributes(plan, known | fixed))
    return frozenset(found & possible)


def call_value_views(body: Conjunction, attributes: frozenset[int]) -> Conjunction:
    """Return the body in which goals of these attributes (given by index) call the views of objects and values."""
    goals = tuple(
        CallAtom(values_of(held[0]), held[1:])
        if (held := attribute_and_variables(goal)) and held[0].index in attributes
        else goal
        for goal in body.goals
    )
    return Conjunction(body.types, body.constants, body.parameters, goals)


def values_of(attribute: Attribute) -> str:
    """Return the name of the view of an attribute's values."""
    return f"{attribute}/values"


def value_view_body(goal: Goal) -> Conjunction:
    """Return the body of the view of a goal's attribute, which contains each object with its value."""
    held = attribute_and_variables(goal)
    assert isinstance(goal, AttributeAtom | LinkAtom) and held
    types = (ObjectType(held[0].owner), held[0].type)
    return Conjunction(types, (), (0, 1), (renumber_relation(goal, {held[1]: 0, held[2]: 1}),))


def _is_bound_elsewhere(body: Conjunction, goal: Goal) -> bool:
    """Return True if the value of an attribute goal occurs in another goal that may bind it, not only compare it."""
    held = attribute_and_variables(goal)
    return held is not None and any(
        held[2] in visible_variables(other)
        for other in body.goals
        if other is not goal and not isinstance(other, UnequalAtom | ConditionAtom)
    )


def _is_selective(store: Store, metamodel: Metamodel, attribute: Attribute) -> bool:
    """Return True if the sampled objects have at least `DIFFERENT` different values of an attribute."""
    column = store.values[attribute.index]
    different: set[Value | Values] = set()  # only its size is used
    for cls, extent in zip(metamodel.class_list, store.extents, strict=True):
        if metamodel.is_a(cls.name, attribute.owner):
            values = (value for node in extent[: VIEWS.sample] if (value := column[node]) is not None)
            different.update(tuple(value) if isinstance(value, list) else value for value in values)
    return len(different) >= VIEWS.different


def _searches(body: Conjunction) -> Iterator[tuple[set[int], list[int]]]:
    """Yield the bound variables and the goal numbers to solve, for the search of all matches and for each delta."""
    everything = list(range(len(body.goals)))
    yield set(), everything
    for place in occurrences(body):
        known = {v for v in place.columns if v is not None}
        goal = body.goals[place.goal]
        if place.role is TupleEffect.COUNT and isinstance(goal, AggregateAtom):
            known.add(goal.result)
        yield known, [number for number in everything if number != place.goal]


def _tested_attributes(plan: SearchPlan, known: set[int]) -> Iterator[int]:
    """Yield the indices of attributes by which objects of a long loop are tested for a value known before the loop."""
    rows, before = 1.0, set(known)
    looped: dict[int, set[int]] = {}
    for step in plan.steps:
        if step.kind is StepKind.LOOP and step.rows > VIEWS.many * rows:
            looped.update((variable, before.copy()) for variable in step.binds)
        held = attribute_and_variables(step.goal)
        if held and step.kind is StepKind.TEST and held[2] in looped.get(held[1], ()):
            yield held[0].index
        rows = max(step.rows, 1e-9)
        before.update(step.binds)
