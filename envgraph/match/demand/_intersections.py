"""Intersections of several crowded ends of links, for loops that look for them."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph.graph import IndexedSet


def common(ends: IndexedSet[int], fewest: Sequence[int], *others: Sequence[int]) -> list[int]:
    """Those of crowded ends that are among the fewest others, in their order.

    It takes as many steps as there are in the smaller one: so a search for triangles does not go through a hub for each
    of its neighbours (the joins of Ngo, Porat, Ré and Rudra 2012 rest on that).

    >>> common(IndexedSet((4, 3, 2, 1)), (1, 7, 4))
    [4, 1]
    """
    if others:
        fewest = min(fewest, *others, key=len)
    if len(fewest) >= len(ends):
        inside = fewest.position if isinstance(fewest, IndexedSet) else fewest
        return [node for node in ends if node in inside]
    position = ends.position
    found = [node for node in fewest if node in position]
    if len(found) > 1:
        found.sort(key=position.__getitem__)
    return found
