"""Search graphs whose edges are given by a function from a node to its successors."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

Vertex = TypeVar("Vertex", bound=Hashable)


def reachable_nodes(starts: Iterable[Vertex], following: Callable[[Vertex], Iterable[Vertex]]) -> list[Vertex]:
    """Return all nodes reachable from the starts, the starts included: each once, nearest first.

    >>> reachable_nodes([1], {1: [2], 2: [1, 3], 3: []}.__getitem__)
    [1, 2, 3]
    """
    known = dict.fromkeys(starts)
    found = list(known)
    for node in found:  # the list grows
        for other in following(node):
            if other not in known:
                known[other] = None
                found.append(other)
    return found


def shortest_path(start: Vertex, goal: Vertex, following: Callable[[Vertex], Iterable[Vertex]]) -> list[Vertex] | None:
    """Return the nodes of a shortest path of at least one step, without the start; None if there is no path.

    >>> edges = {1: [2], 2: [3], 3: [1]}.__getitem__
    >>> shortest_path(1, 3, edges), shortest_path(1, 1, edges)
    ([2, 3], [2, 3, 1])
    """
    before: dict[Vertex, Vertex] = {}
    queue = [start]
    for node in queue:
        for other in following(node):
            if other not in before:
                before[other] = node
                queue.append(other)
                if other == goal:
                    way = [goal]
                    while (node := before[way[-1]]) != start:
                        way.append(node)
                    return way[::-1]
    return None


def strong_components(
    starts: Sequence[Any], following: Callable[[Any], Iterable[Any]]
) -> Iterator[tuple[list[Any], dict[Any, None]]]:
    """Yield the strongly connected components that the starts reach, successors first.

    Yields:
        The nodes of a component, and all direct successors of these nodes.
    """
    order: dict[Any, int] = {}
    lowest: dict[Any, int] = {}
    waiting: dict[Any, None] = {}
    leads: dict[Any, list[Any]] = {}
    """Successors of the nodes whose component is not complete; `following` may be slow, so it is called once."""

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
