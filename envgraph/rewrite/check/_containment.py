"""Containers: which end of a link is inside the other, and objects that can be in none after a change of class."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from envgraph.metamodel import Metamodel, Reference

End = TypeVar("End", int, str)


def content_of(reference: Reference, source: End, target: End, metamodel: Metamodel) -> End | None:
    """Return which end of a link is contained in the other; None if neither is."""
    found = metamodel.containment(reference, source, target)
    return None if found is None else found[2]


def homeless(classes: Iterable[str], after: str, metamodel: Metamodel) -> bool:
    """Return whether objects of exactly these classes have containers that hold none of them as one of `after`."""
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
