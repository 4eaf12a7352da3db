"""Reachability of many starts at once, by strongly connected components."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any

from envgraph.metamodel import components


class Tree(dict[Any, Any]):
    """What a start reaches, each with the node from which it was reached, or None where that is not known.

    The root is the start: with `reflexive` it is a key itself, with None.
    """

    __slots__ = ()


Reached = dict[Any, Any]
"""What a start reaches: a `Tree` of its own, or a dict with nothing but None, which several starts may share."""


def reachable_sets(
    starts: Sequence[Any], following: Callable[[Any], Iterable[Any]], reflexive: bool
) -> dict[Any, Reached]:
    """Return what each start reaches by one or more steps; with `reflexive`, itself too.

    Nodes of one component share one dict, so a connected graph costs no more than its nodes; a node that no
    circle leads back to has a tree. Components are found by Tarjan's algorithm (1972), each after all that it leads to.

    >>> edges = {1: [2], 2: [1, 3], 3: [4], 4: []}
    >>> [dict(each) for each in reachable_sets([1, 2, 3], edges.__getitem__, False).values()]
    [{2: None, 1: None, 3: None, 4: None}, {2: None, 1: None, 3: None, 4: None}, {4: 3}]
    """
    reached: dict[Hashable, Reached] = {}
    for component, exits in components(starts, following):
        circle = len(component) > 1 or component[0] in exits
        found = _shared(component, exits, reached) if circle else _tree(component[0], exits, reached)
        for node in component:
            reached[node] = found
    if not reflexive:
        return {start: reached[start] for start in starts}
    return {s: reached[s] if s in reached[s] else Tree({s: None, **reached[s]}) for s in starts}


def _shared(component: list[Any], exits: Iterable[Any], reached: Mapping[Any, Reached]) -> Reached:
    found: Reached = dict.fromkeys(component)
    for node in exits:
        if node not in found:
            found[node] = None
            found.update(dict.fromkeys(reached[node]))
    return found


def _tree(start: Any, exits: Iterable[Any], reached: Mapping[Any, Reached]) -> Tree:
    """Merge the trees of what follows; where two know a node, the path to it is whole in either."""
    found = Tree()
    for node in exits:
        if node not in found:
            other = reached[node]
            if len(found) <= len(other):
                found = Tree({**other, **found})
            else:
                for each, by in other.items():
                    found.setdefault(each, by)
            found[node] = start
    return found
