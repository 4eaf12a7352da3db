"""Objects that are drawn as edges."""

from __future__ import annotations

from envgraph.metamodel import Metamodel, Reference


def edge_ends(metamodel: Metamodel, cls: str, end: str) -> tuple[Reference, ...]:
    """The first two single references to nodes, of a class whose objects are drawn as edges; else ()."""
    found = tuple(
        feature
        for feature in metamodel.features(cls).values()
        if isinstance(feature, Reference) and not feature.many and metamodel.is_a(feature.target, end)
    )
    return found[:2] if len(found) > 1 else ()
