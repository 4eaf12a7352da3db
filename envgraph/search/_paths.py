"""How many directed paths a model leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

from envgraph.errors import EvaluationError
from envgraph.metamodel import Metamodel, Reference
from envgraph.rewrite import Engine


def count_paths(
    order: Sequence[int], links: dict[int, tuple[int, ...]], starts: set[int], goals: set[int]
) -> int:
    """Number of paths from any start to any goal along `links`.

    Args:
        order: the nodes that may be visited, sources of links before their targets.
        links: targets of each node; targets outside `order` are ignored.
        starts, goals: subsets of the nodes; a node that is both is a path of its own.
    """
    reached = dict.fromkeys(order, 0)
    total = 0
    for node in order:
        ways = reached[node] + (node in starts)
        if not ways:
            continue
        if node in goals:
            total += ways
        for target in links[node]:
            if target in reached:
                reached[target] += ways
    return total


@dataclass(frozen=True, slots=True)
class PathComplexity:
    """Share of the directed paths from start to goal that is blocked.

    With P paths in all and P_E that avoid the objects of a class, the complexity is 1 - P_E / P ("linear", as the
    paper's text says) or 1 - sqrt(P_E / P) ("sqrt", as its published data was computed). 0 is open, 1 is closed.

    Attributes:
        start, goal: classes; paths lead from any instance of the first to any of the second.
        along: names of references that paths follow; together they must have no cycle.
        avoid: class of the objects that block a path.
    """

    metamodel: Metamodel
    start: str
    goal: str
    along: tuple[str, ...]
    avoid: str
    transform: Literal["sqrt", "linear"] = "linear"

    def evaluate(self, engine: Engine) -> float:
        """The complexity of the model at which the engine stands, in [0, 1]; 1.0 when there is no path at all.

        Raises:
            EvaluationError: the references form a cycle.
        """
        model = engine.model
        references = self._references()
        links = {
            node: tuple(target for ref in refs for target in model.targets(node, ref))
            for cls, refs in references.items()
            for node in model.exact_extent(cls)
        }
        order = _topological(links)
        if order is None:
            raise EvaluationError(f"path_complexity: the links along {', '.join(self.along)} form a cycle")
        starts, goals = set(model.extent(self.start)), set(model.extent(self.goal))
        blocked = set(model.extent(self.avoid))
        every = count_paths(order, links, starts, goals)
        free = count_paths([node for node in order if node not in blocked], links, starts, goals)
        share = free / every if every else 0.0
        return 1.0 - (sqrt(share) if self.transform == "sqrt" else share)

    def _references(self) -> dict[str, tuple[Reference, ...]]:
        """For each instantiable class, those of the references that it has."""
        found: dict[str, tuple[Reference, ...]] = {}
        for cls in self.metamodel.class_list:
            if cls.abstract:
                continue
            features = [self.metamodel.feature(cls.name, name) for name in self.along]
            references = tuple(feature for feature in features if isinstance(feature, Reference))
            if references:
                found[cls.name] = references
        return found


def _topological(links: dict[int, tuple[int, ...]]) -> list[int] | None:
    """The nodes with sources before targets (Kahn 1962), or None on a cycle."""
    incoming = dict.fromkeys(links, 0)
    for targets in links.values():
        for target in targets:
            if target in incoming:
                incoming[target] += 1
    order = [node for node, count in incoming.items() if not count]
    for node in order:
        for target in links[node]:
            if target in incoming:
                incoming[target] -= 1
                if not incoming[target]:
                    order.append(target)
    return order if len(order) == len(links) else None
