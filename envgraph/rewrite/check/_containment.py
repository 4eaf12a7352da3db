"""Objects that can be in no container any more after they have changed their class."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from envgraph.metamodel import Metamodel, Reference


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
