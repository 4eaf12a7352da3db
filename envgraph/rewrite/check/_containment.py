"""Decisions about containment: which objects operations put into containers, and which leave their containers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from envgraph.metamodel import Metamodel, Reference
from envgraph.rewrite._rule_plan import (
    AddLink,
    BlockPlan,
    ChangeTargets,
    CreateObject,
    MoveToContainer,
    Operation,
    SetTargets,
)

End = TypeVar("End", int, str)


def contained_end(reference: Reference, source: End, target: End, metamodel: Metamodel) -> End | None:
    """Return the end of a link that is contained in the other end; None if the reference is no containment."""
    found = metamodel.containment_link(reference, source, target)
    return None if found is None else found[2]


def container_entries(
    operations: Iterable[Operation | CreateObject], metamodel: Metamodel
) -> Iterator[tuple[int, int]]:
    """Yield the slots of an object and its new container, for each object that operations put into a container."""
    for operation in operations:
        match operation:
            case MoveToContainer(node, container, reference):
                links = [(container, node)]
            case AddLink(source, reference, target):
                links = [(source, target)]
            case SetTargets(node, reference, values) | ChangeTargets(node, reference, "+=", values):
                links = [(node, value) for value in values]
            case _:
                continue
        for held in (metamodel.containment_link(reference, *ends) for ends in links):
            if held is not None:
                yield held[2], held[1]


def leaving_changes(plan: BlockPlan, metamodel: Metamodel, *, alone: bool) -> list[SetTargets | ChangeTargets]:
    """Return the assignments of a block whose objects have to leave their containers before any object enters one.

    There are none if the block is the `alone` of its rule and moves at most one object.
    """
    setting = [change for change in plan.sets if isinstance(change, SetTargets | ChangeTargets)]
    housing = [change for change in setting if contained_end(change.reference, 0, 1, metamodel) is not None]
    others = len([*container_entries((*plan.moves, *plan.links), metamodel)])
    return [] if alone and len(housing) + others <= 1 else housing


def containments_of(cls: str, metamodel: Metamodel) -> list[Reference]:
    """Return the references by which objects of a class may be contained."""
    return [one for one in metamodel.references if one.containment and metamodel.may_overlap(cls, one.target)]


def loses_container(classes: Iterable[str], new_class: str, metamodel: Metamodel) -> bool:
    """Return True if a retyping to the class `new_class` leaves no object in a container that may contain it.

    `classes` are the exact classes before the retyping. Return False if `classes` is empty, if one of them can have no
    container, or if one of its containments also accepts `new_class`.
    """
    containments = [one for one in metamodel.references if one.containment]
    found = False
    for cls in classes:
        holding = [one for one in containments if metamodel.is_a(cls, one.target)]
        if not holding or any(metamodel.is_a(new_class, one.target) for one in holding):
            return False
        found = True
    return found
