"""Reachability of many starts at once, by strongly connected components."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Any


def reachable_sets(
    starts: Sequence[Any], following: Callable[[Any], Iterable[Any]], reflexive: bool
) -> dict[Any, dict[Any, None]]:
    """What each start reaches by one or more steps; with `reflexive`, itself too.

    Nodes of one component share one dict, so a graph that hangs together costs no more than its nodes. Components
    are found by Tarjan's algorithm (1972), each after all that it leads to.

    >>> edges = {1: [2], 2: [1, 3], 3: []}
    >>> [list(each) for each in reachable_sets([1, 2, 3], edges.__getitem__, False).values()]
    [[2, 1, 3], [2, 1, 3], []]
    """
    reached: dict[Hashable, dict[Any, None]] = {}
    for component, exits in components(starts, following):
        found: dict[Any, None] = {}
        if len(component) > 1 or component[0] in exits:
            found.update(dict.fromkeys(component))
        for node in exits:
            if node not in found:
                found[node] = None
                found.update(reached[node])
        for node in component:
            reached[node] = found
    if not reflexive:
        return {start: reached[start] for start in starts}
    return {s: reached[s] if s in reached[s] else {s: None, **reached[s]} for s in starts}


def components(
    starts: Sequence[Any], following: Callable[[Any], Iterable[Any]]
) -> Iterator[tuple[list[Any], dict[Any, None]]]:
    """Strongly connected components that the starts reach, those that one leads to before it.

    Yields:
        The nodes of a component, and all nodes that one step leads to from them.
    """
    order: dict[Any, int] = {}
    lowest: dict[Any, int] = {}
    waiting: dict[Any, None] = {}
    leads: dict[Any, list[Any]] = {}
    """Where the nodes lead whose component is not known yet: `following` may be a search, and is asked once."""

    def begun(node: Any) -> Iterator[Any]:
        order[node] = lowest[node] = len(order)
        waiting[node] = None
        leads[node] = list(following(node))
        return iter(leads[node])

    for root in starts:
        if root in order:
            continue
        path = [(root, begun(root))]
        while path:
            node, rest = path[-1]
            for other in rest:
                if other not in order:
                    path.append((other, begun(other)))
                    break
                if other in waiting:
                    lowest[node] = min(lowest[node], order[other])
            else:
                path.pop()
                if path:
                    above = path[-1][0]
                    lowest[above] = min(lowest[above], lowest[node])
                if lowest[node] == order[node]:
                    component = []
                    while True:
                        member, _ = waiting.popitem()
                        component.append(member)
                        if member == node:
                            break
                    yield component, dict.fromkeys(o for member in component for o in leads.pop(member))
