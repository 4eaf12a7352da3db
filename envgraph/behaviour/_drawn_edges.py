"""Find the end points of objects that are drawn as edges."""

from __future__ import annotations

from envgraph.metamodel import Metamodel, Reference


def edge_ends(metamodel: Metamodel, cls: str, end: str) -> tuple[Reference, ...]:
    """Return the first two references of a class, drawn as edges, that have a single target of the node class `end`.

    Return an empty tuple if the class has only one such reference or none.
    """
    found = tuple(
        feature
        for feature in metamodel.features(cls).values()
        if isinstance(feature, Reference) and not feature.many and metamodel.is_a(feature.target, end)
    )
    return found[:2] if len(found) > 1 else ()
