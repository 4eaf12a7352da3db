"""Helpers about containment: the contained end of a link, and retypings that take objects out of all containers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from envgraph.metamodel import Metamodel, Reference

End = TypeVar("End", int, str)


def contained_end(reference: Reference, source: End, target: End, metamodel: Metamodel) -> End | None:
    """Return the end of a link that is contained in the other end; None if the reference is no containment."""
    found = metamodel.containment_link(reference, source, target)
    return None if found is None else found[2]


def loses_container(classes: Iterable[str], new_class: str, metamodel: Metamodel) -> bool:
    """Return True if a retyping to the class `new_class` leaves no object in a container that may contain it.

    `classes` are the exact classes before the retyping. Return False if `classes` is empty, if one of them can have no
    container, or if one of its containments also accepts `new_class`.
    """
    containments = list(_containments(metamodel))
    found = False
    for cls in classes:
        holding = [one for one in containments if metamodel.is_a(cls, one.target)]
        if not holding or any(metamodel.is_a(new_class, one.target) for one in holding):
            return False
        found = True
    return found


def _containments(metamodel: Metamodel) -> Iterator[Reference]:
    for cls in metamodel.classes.values():
        for feature in cls.features:
            if isinstance(feature, Reference) and feature.containment:
                yield feature
