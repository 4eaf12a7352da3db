"""Intersections of large sets of link ends, for loops with link tests."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph.graph import IndexedSet


def intersect_ends(ends: IndexedSet[int], fewest: Sequence[int], *others: Sequence[int]) -> list[int]:
    """Return the nodes of a large set of link ends that are also in the smallest other set, in the order of `ends`.

    The number of steps is the size of the smaller set. So a search for triangles does not scan a hub for each of its
    neighbours (worst-case optimal joins rest on this: Ngo, Porat, Ré and Rudra 2012).

    >>> intersect_ends(IndexedSet((4, 3, 2, 1)), (1, 7, 4))
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
