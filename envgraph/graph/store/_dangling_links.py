"""The links of an object, its containment tree, and the links that its deletion would leave dangling."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph.graph.store._metamodel_tables import MetamodelTables
from envgraph.graph.store._relation import ReferenceStorage
from envgraph.graph.store._store import Store

Link = tuple[ReferenceStorage, int, int]
"""A link: its relation, source and target."""


def links_of(store: Store, layout: MetamodelTables, node: int) -> Iterator[Link]:
    """Yield all links of an object, each once."""
    return links_in(node, layout.incident_relations[store.classes[node]])


def links_in(node: int, directions: Iterable[tuple[ReferenceStorage, bool]]) -> Iterator[Link]:
    """Yield the links of an object in the given relations, each once.

    Args:
        node: the object.
        directions: pairs of a relation and a bool: True for links with the object as source, False for links with it as
            target.
    """
    loops = set()
    for relation, outgoing in directions:
        for other in (relation.forward if outgoing else relation.backward)[node]:
            if other == node:  # a link to itself is listed at both of its ends
                if relation.fact.index in loops:
                    continue
                loops.add(relation.fact.index)
            yield (relation, node, other) if outgoing else (relation, other, node)


def contained_tree(store: Store, layout: MetamodelTables, root: int) -> list[int]:
    """Return an object and all objects that it contains, directly or indirectly, containers before their contents."""
    tree = [root]
    for node in tree:
        for relation in layout.containment_relations[store.classes[node]]:
            tree.extend(relation.forward[node])
    return tree


def dangling_links(store: Store, layout: MetamodelTables, tree: Sequence[int]) -> Iterator[Link]:
    """Yield the links that deleting a containment tree would leave dangling.

    These are the links between an object of the tree and an object outside, except the link from the container of the
    root. Links from the root to itself are included.

    Args:
        store: the store.
        layout: the tables of the metamodel.
        tree: the objects of the tree, the root first.
    """
    inside = set(tree)
    root = tree[0]
    for node in tree:
        for relation, source, target in links_of(store, layout, node):
            if source in inside and target in inside and not source == target == root:
                continue
            from_container = relation.is_contained if source == root else relation.containment
            if node != root or not from_container:
                yield relation, source, target
