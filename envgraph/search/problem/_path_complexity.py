"""Measure complexity: the share of the paths from start to goal, along acyclic references, that obstacles block."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import field
from itertools import chain
from math import sqrt
from typing import Any, ClassVar, Literal

from envgraph.code import dataclass
from envgraph.errors import EvaluationError
from envgraph.metamodel import Metamodel, Reference
from envgraph.rewrite import Engine

OrderedLinks = tuple[tuple[int, tuple[int, ...]], ...]
"""Nodes with the targets of their links, in topological order."""


def count_paths(
    size: int,
    links: OrderedLinks,
    starts: Iterable[int],
    goals: Iterable[int],
    avoid: Collection[int] = frozenset(),
) -> int:
    """Return the number of paths from any start to any goal in an acyclic graph.

    Args:
        size: number of nodes; the nodes are the integers below `size`.
        links: the links of each node, in topological order.
        starts, goals: nodes, without duplicates. A node in both counts as a path of length 0.
        avoid: nodes that no path may visit.

    >>> square = ((0, (1, 2)), (1, (3,)), (2, (3,)))
    >>> count_paths(4, square, [0], [3]), count_paths(4, square, [0], [3], avoid={2})
    (2, 1)
    """
    ways = [0] * size
    for start in starts:
        ways[start] = 1
    for node, targets in links:
        so_far = ways[node]
        if so_far and node not in avoid:
            for target in targets:
                ways[target] += so_far
    return sum(ways[goal] for goal in goals if goal not in avoid)


@dataclass(frozen=True, slots=True)
class PathComplexity:
    """A measure of a model: the share of the directed paths from start to goal that is blocked.

    With P paths in total and P_E paths that avoid the objects of a class, the complexity is 1 - P_E / P ("linear", as
    the paper's text says) or 1 - sqrt(P_E / P) ("sqrt", as its published data was computed). 0 means that no path is
    blocked, 1 that all are.

    Attributes:
        start, goal: names of classes; paths lead from any object of `start` to any object of `goal`.
        along: names of the references that paths follow, `right` or `Tile.right`; their links must not form a cycle.
        avoid: name of the class whose objects block a path.
    """

    metamodel: Metamodel
    start: str
    goal: str
    along: tuple[str, ...]
    avoid: str
    transform: Literal["sqrt", "linear"] = "linear"
    range: ClassVar = (0.0, 1.0)
    _references: tuple[Reference, ...] = field(init=False, repr=False, compare=False)
    _cached_network: list[Any] = field(init=False, repr=False, compare=False, default_factory=list)

    def __post_init__(self) -> None:
        features = (self.metamodel.feature(cls.name, name) for cls in self.metamodel.class_list for name in self.along)
        found = dict.fromkeys(feature for feature in features if isinstance(feature, Reference))
        found |= dict.fromkeys(one for one in self.metamodel.references if str(one) in self.along)
        object.__setattr__(self, "_references", tuple(found))

    def evaluate(self, engine: Engine) -> float:
        """Return the complexity of the engine's current model, in [0, 1]; 1.0 if there is no path at all.

        Raises:
            EvaluationError: the links form a cycle.
        """
        model = engine.model
        # Compare whole columns of the store: mutations seldom change links, and then the cached network is still valid.
        columns = [model.graph.store.forward[one.index] for one in self._references]
        ends = tuple(model.graph.extent(self.start)), tuple(model.graph.extent(self.goal))
        known = self._cached_network[:]
        if known[:2] != [columns, ends]:
            links = [[*map(tuple, column)] for column in columns]
            self._cached_network[:] = known = [links, ends, _ordered_network(links, *ends)]
        starts, goals = ends
        network: tuple[OrderedLinks, int] | None = known[2]
        if network is None:
            message = f"path_complexity: the links along {', '.join(self.along)} form a cycle"
            raise EvaluationError(message, hint="use references without such cycles, or the measure `shortest_path`")
        steps, every = network
        free = count_paths(len(model.graph.store.classes), steps, starts, goals, set(model.graph.extent(self.avoid)))
        share = free / every if every else 0.0
        return 1.0 - (sqrt(share) if self.transform == "sqrt" else share)


def _ordered_network(
    columns: Sequence[Sequence[tuple[int, ...]]], starts: Sequence[int], goals: Sequence[int]
) -> tuple[OrderedLinks, int] | None:
    """Return the links in topological order (Kahn 1962) and the number of paths; None if the links form a cycle.

    Each column lists the targets of a reference, indexed by node.
    """
    links = [tuple(chain.from_iterable(targets)) for targets in zip(*columns, strict=True)]
    incoming = Counter(chain.from_iterable(links))
    order = [node for node in range(len(links)) if not incoming[node]]
    for node in order:
        for target in links[node]:
            incoming[target] -= 1
            if not incoming[target]:
                order.append(target)
    if len(order) < len(links):
        return None
    steps = tuple((node, links[node]) for node in order if links[node])
    return steps, count_paths(len(links), steps, starts, goals)
