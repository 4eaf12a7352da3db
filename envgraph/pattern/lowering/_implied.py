"""Class tests that other goals of a conjunction imply: features have owners and targets, parameters have types."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from envgraph.metamodel import Metamodel
from envgraph.pattern._lowered import (
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    StaticType,
)
from envgraph.pattern._paths import closure_target, target_type

Types = Callable[[str], Sequence[StaticType]]
"""Types of the parameters of a pattern, generated ones included, by qualified name."""

Classes = Mapping[int, frozenset[str]]
"""Classes of which a variable has an object, by the number of the variable."""


def implied_classes(goals: Iterable[Goal], metamodel: Metamodel, types_of: Types) -> Classes:
    """Return what the relations among the goals, class tests left out, say of the classes of their variables."""
    found: dict[int, set[str]] = {}
    for goal in goals:
        for variable, type_ in _facts(goal, metamodel, types_of):
            if isinstance(type_, ObjectType):
                found.setdefault(variable, set()).add(type_.cls)
    return {variable: frozenset(classes) for variable, classes in found.items()}


def is_implied(goal: Goal, goals: Iterable[Goal], known: Classes, metamodel: Metamodel) -> bool:
    """Return whether a goal is a class test that is made anyway.

    Args:
        goal: one of `goals`.
        goals: a stronger class test among these implies it.
        known: so does what is known of its variable.
    """
    if not isinstance(goal, InstanceAtom) or goal.exact:
        return False
    return any(metamodel.is_a(cls, goal.cls) for cls in known.get(goal.variable, ())) or any(
        isinstance(other, InstanceAtom)
        and other.variable == goal.variable
        and other != goal
        and metamodel.is_a(other.cls, goal.cls)
        for other in goals
    )


def _facts(goal: Goal, metamodel: Metamodel, types_of: Types) -> Iterator[tuple[int, StaticType | None]]:
    match goal:
        case AttributeAtom():
            yield goal.object, ObjectType(goal.attribute.owner)
        case LinkAtom():
            yield goal.source, ObjectType(goal.reference.owner)
            yield goal.target, target_type(goal.reference)
        case CallAtom():
            yield from zip(goal.arguments, types_of(goal.pattern), strict=True)
        case ClosureAtom():
            source, target = types_of(goal.step)
            yield goal.source, source
            yield goal.target, closure_target(source, target, goal.closure, metamodel)
        case _:
            return
