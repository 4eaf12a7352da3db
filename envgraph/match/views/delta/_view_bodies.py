"""Analyse the bodies of views.

A body of a view is a conjunction over facts of the model and relations of other operators. Each negation contains a
single relation, each aggregate reads one relation, and variables of which only the existence matters are not counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from envgraph.match.passes import RewrittenBodies
from envgraph.metamodel import Reference
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Conjunction,
    Goal,
    LinkAtom,
    RelationAtom,
    relation_variables,
    required_variables,
    visible_variables,
)


def negated(goal: AbsenceAtom) -> RelationAtom:
    """Return the only relation inside a negation."""
    ((relation,),) = goal.alternatives
    assert isinstance(relation, RelationAtom)
    return relation


def local_variables(goal: AbsenceAtom | AggregateAtom) -> tuple[int, ...]:
    """Return the variables of a negation or aggregate that do not get their values outside."""
    outer = set(required_variables(goal))
    relation = negated(goal) if isinstance(goal, AbsenceAtom) else goal.relation
    return tuple(v for v in relation_variables(relation) if v not in outer)


def existential_variables(conjunction: Conjunction) -> frozenset[int]:
    """Return the variables for which a match needs only some value: an end of a link, or an attribute's value.

    Such a variable occurs nowhere else, but the other end or the owner does. The number of such links does not matter.
    """
    uses = Counter(v for goal in conjunction.goals for v in set(visible_variables(goal)))
    known = {*conjunction.parameters, *(number for number, _ in conjunction.constants)}

    def alone(variable: int) -> bool:
        return uses[variable] == 1 and variable not in known

    found: set[int] = set()
    for goal in conjunction.goals:
        match goal:
            case LinkAtom(Reference(), source, target) if source != target and alone(source) != alone(target):
                found.add(source if alone(source) else target)
            case LinkAtom(_, owner, value) | AttributeAtom(_, owner, value) if alone(value) and not alone(owner):
                found.add(value)
            case _:
                pass
    return frozenset(found)


def connected_goals(goals: Sequence[Goal], starts: Iterable[int], fixed: frozenset[int]) -> list[Goal]:
    """Return the goals that mention some variables, and goals connected with these by variables that are not fixed."""
    reached = set(starts)
    chosen: dict[int, Goal] = {}
    size = -1
    while size != len(chosen):
        size = len(chosen)
        for goal in goals:
            own = set(visible_variables(goal)) - fixed
            if id(goal) not in chosen and own & reached:
                chosen[id(goal)] = goal
                reached |= own
    return [goal for goal in goals if id(goal) in chosen]


def single_link_of(step: Sequence[Conjunction]) -> tuple[int, bool] | None:
    """Return the reference index of a step pattern that is one link, and True if its ends are swapped; else None."""
    goal = _only_goal(step)
    if not (isinstance(goal, LinkAtom) and isinstance(goal.reference, Reference)):
        return None
    ends = (goal.source, goal.target)
    if step[0].parameters == ends:
        return goal.reference.index, False
    return (goal.reference.index, True) if step[0].parameters == ends[::-1] else None


def single_closure_of(relation: RelationAtom, bodies: RewrittenBodies) -> ClosureAtom | None:
    """Return the closure, with the caller's variables, if a relation calls a pattern of only a closure; else None."""
    called = bodies.inlinable_bodies(relation.pattern) if isinstance(relation, CallAtom) else None
    goal = _only_goal(called) if called else None
    if not (isinstance(relation, CallAtom) and called and isinstance(goal, ClosureAtom)):
        return None
    heads = called[0].parameters
    if len(set(heads)) < len(heads) or {goal.source, goal.target} != set(heads):
        return None
    numbers = dict(zip(heads, relation.arguments, strict=True))
    return replace(goal, source=numbers[goal.source], target=numbers[goal.target])


def _only_goal(bodies: Sequence[Conjunction]) -> Goal | None:
    """Return the goal if there is only one body, with only one goal and no constants; else None."""
    if len(bodies) != 1 or len(bodies[0].goals) != 1 or bodies[0].constants:
        return None
    return bodies[0].goals[0]
