"""Reachability from many start nodes at once, by strongly connected components."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any

from envgraph.metamodel import strong_components


class ReachTree(dict[Any, Any]):
    """A search tree of the nodes that one start node reaches. Maps each node to its parent in the tree.

    The parent is None if it is unknown. The start node is a key, with parent None, only if it counts as reached.
    """

    __slots__ = ()


ReachedNodes = dict[Any, Any]
"""The nodes that a start node reaches: a `Tree` of its own, or a dict with only None values, which starts may share."""


def reachable_sets(
    starts: Sequence[Any], following: Callable[[Any], Iterable[Any]], reflexive: bool
) -> dict[Any, ReachedNodes]:
    """Return a dict from each start node to the nodes that it reaches by one or more edges.

    The nodes of a strongly connected component share one dict, so such a component needs memory only once per node.
    A node that is on no cycle has a `ReachTree` of its own. Components are found by Tarjan's algorithm (1972).

    >>> edges = {1: [2], 2: [1, 3], 3: [4], 4: []}
    >>> [dict(each) for each in reachable_sets([1, 2, 3], edges.__getitem__, False).values()]
    [{2: None, 1: None, 3: None, 4: None}, {2: None, 1: None, 3: None, 4: None}, {4: 3}]

    Args:
        starts: the start nodes.
        following: returns the successors of a node.
        reflexive: if True, each start node also counts as reached by itself, without an edge.
    """
    reached: dict[Hashable, ReachedNodes] = {}
    for component, exits in strong_components(starts, following):
        circle = len(component) > 1 or component[0] in exits
        found = (
            _reached_by_component(component, exits, reached)
            if circle
            else _reached_by_node(component[0], exits, reached)
        )
        for node in component:
            reached[node] = found
    if not reflexive:
        return {start: reached[start] for start in starts}
    return {s: reached[s] if s in reached[s] else ReachTree({s: None, **reached[s]}) for s in starts}


def _reached_by_component(
    component: list[Any], exits: Iterable[Any], reached: Mapping[Any, ReachedNodes]
) -> ReachedNodes:
    """Return the dict that all nodes of a cyclic component share, with every node that they reach as a key."""
    found: ReachedNodes = dict.fromkeys(component)
    for node in exits:
        if node not in found:
            found[node] = None
            found.update(dict.fromkeys(reached[node]))
    return found


def _reached_by_node(start: Any, exits: Iterable[Any], reached: Mapping[Any, ReachedNodes]) -> ReachTree:
    """Return the search tree of a node that is on no cycle, merged from the trees of `exits`, its successors.

    If two successors reach the same node, its parent may come from either tree, because both hold complete paths.
    """
    found = ReachTree()
    for node in exits:
        if node not in found:
            other = reached[node]
            if len(found) <= len(other):
                found = ReachTree({**other, **found})
            else:
                for each, by in other.items():
                    found.setdefault(each, by)
            found[node] = start
    return found
