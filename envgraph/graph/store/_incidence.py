"""The links of an object, and which of them its deletion would leave without an end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph.graph.store._layout import Layout
from envgraph.graph.store._relation import Relation
from envgraph.graph.store._store import Store

Link = tuple[Relation, int, int]
"""A link: its relation, source and target."""


def links_of(store: Store, layout: Layout, node: int) -> Iterator[Link]:
    """All links of an object, each once."""
    return links_at(node, layout.incident[store.classes[node]])


def links_at(node: int, ends: Iterable[tuple[Relation, bool]]) -> Iterator[Link]:
    """The links of an object in some relations, where it is the source (True) or the target (False)."""
    loops = set()
    for relation, outgoing in ends:
        for other in (relation.forward if outgoing else relation.backward)[node]:
            if other == node:  # listed from both its ends
                if relation.fact.index in loops:
                    continue
                loops.add(relation.fact.index)
            yield (relation, node, other) if outgoing else (relation, other, node)


def contained_tree(store: Store, layout: Layout, root: int) -> list[int]:
    """An object and all that it contains, containers first."""
    tree = [root]
    for node in tree:
        for relation in layout.containments[store.classes[node]]:
            tree.extend(relation.forward[node])
    return tree


def dangling_links(store: Store, layout: Layout, tree: Sequence[int]) -> Iterator[Link]:
    """Links between the objects of a containment tree and others, but for its container; and loops of its root."""
    inside = set(tree)
    root = tree[0]
    for node in tree:
        for relation, source, target in links_of(store, layout, node):
            if source in inside and target in inside and not source == target == root:
                continue
            from_container = relation.contained if source == root else relation.containment
            if node != root or not from_container:
                yield relation, source, target
