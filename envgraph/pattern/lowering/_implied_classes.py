"""Find class tests that other goals of a conjunction imply, such as the class that owns a feature."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from envgraph.metamodel import Metamodel
from envgraph.pattern._feature_paths import closure_target_type, target_type
from envgraph.pattern._goals import (
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    StaticType,
)

ParameterTypes = Callable[[str], Sequence[StaticType]]
"""Returns the types of the parameters of a pattern, by its qualified name; generated patterns included."""

KnownClasses = Mapping[int, frozenset[str]]
"""For the number of a variable the classes that its objects are known to have."""


def implied_classes(goals: Iterable[Goal], metamodel: Metamodel, types_of: ParameterTypes) -> KnownClasses:
    """Return for each variable the classes that relations imply, not class tests: for example a feature's owner."""
    found: dict[int, set[str]] = {}
    for goal in goals:
        for variable, type_ in _implied_types(goal, metamodel, types_of):
            if isinstance(type_, ObjectType):
                found.setdefault(variable, set()).add(type_.cls)
    return {variable: frozenset(classes) for variable, classes in found.items()}


def is_implied(goal: Goal, goals: Iterable[Goal], known: KnownClasses, metamodel: Metamodel) -> bool:
    """Return True if a goal is a class test that other goals or known classes imply. Exact tests are not implied.

    Args:
        goal: one of `goals`.
        goals: all goals; a stronger class test among them implies `goal`.
        known: the classes that each variable is known to have.
        metamodel: the metamodel.
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


def _implied_types(
    goal: Goal, metamodel: Metamodel, types_of: ParameterTypes
) -> Iterator[tuple[int, StaticType | None]]:
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
            yield goal.target, closure_target_type(source, target, goal.closure, metamodel)
        case _:
            return
