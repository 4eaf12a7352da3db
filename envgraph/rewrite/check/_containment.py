"""Questions about containment: the contained end of a link, and classes without a common container."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from envgraph.metamodel import Metamodel, Reference

End = TypeVar("End", int, str)


def content_of(reference: Reference, source: End, target: End, metamodel: Metamodel) -> End | None:
    """Return the end of a link that is contained in the other end; None if the reference is no containment."""
    found = metamodel.containment(reference, source, target)
    return None if found is None else found[2]


def homeless(classes: Iterable[str], after: str, metamodel: Metamodel) -> bool:
    """Return True if a retyping to `after` leaves every object without a container that may contain it.

    Objects of each of `classes` (exact classes before the retyping) must be containable, and none of their containments
    may accept an object of `after`.
    """
    containments = list(_containments(metamodel))
    found = False
    for cls in classes:
        holding = [one for one in containments if metamodel.is_a(cls, one.target)]
        if not holding or any(metamodel.is_a(after, one.target) for one in holding):
            return False
        found = True
    return found


def _containments(metamodel: Metamodel) -> Iterator[Reference]:
    for cls in metamodel.classes.values():
        for feature in cls.features:
            if isinstance(feature, Reference) and feature.containment:
                yield feature
