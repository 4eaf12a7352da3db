"""Reachability for many pairs of nodes: the nodes that a node reaches are the bits of one integer."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from envgraph.match._match_costs import DEMAND
from envgraph.metamodel import strong_components


class CondensationTooLarge(Exception):
    """The error raised if the integers would take too much memory."""


class Condensation:
    """The sets of nodes that nodes of a graph reach, as bit sets, computed for the parts that are queried.

    Nodes of a strongly connected component share one integer, so such a component needs memory only once per node.

    >>> steps = {1: [2], 2: [1, 3], 3: []}
    >>> reached = Condensation(steps.__getitem__)
    >>> reached.reaches(1, 1), reached.reaches(3, 2), reached.size(2)
    (True, False, 3)

    Args:
        following: returns the successors of a node, which must not change.

    Attributes:
        nodes: all visited nodes, in the order of their bits.
    """

    def __init__(self, following: Callable[[Any], Iterable[Any]]) -> None:
        self._following = following
        self._bits: dict[Any, int] = {}
        self._place: dict[Any, int] = {}
        self.nodes: list[Any] = []
        self._bytes = 0

    def reaches(self, start: Any, goal: Any) -> bool:
        """Return True if a node reaches another node by one or more edges.

        Raises:
            TooLarge: the integers take too much memory.
        """
        bits = self._bits.get(start)
        if bits is None:
            bits = self._explore_safely(start)
        place = self._place.get(goal)
        return place is not None and bool(bits >> place & 1)

    def reached(self, start: Any) -> int:
        """Return the bit set of the nodes that a node reaches. The nodes of a component share one int object.

        Raises:
            TooLarge: the integers take too much memory.
        """
        bits = self._bits.get(start)
        return self._explore_safely(start) if bits is None else bits

    def bit(self, node: Any) -> int:
        """Return the integer with only the bit of a visited node."""
        return 1 << self._place[node]

    def size(self, start: Any) -> int:
        """Return the number of nodes that a node reaches.

        Raises:
            TooLarge: the integers take too much memory.
        """
        bits = self._bits.get(start)
        return (self._explore_safely(start) if bits is None else bits).bit_count()

    def _explore_safely(self, start: Any) -> int:
        """Compute and return the bit set of a new start. After an exception, remove all nodes without bit sets."""
        try:
            return self._explore(start)
        except BaseException:  # Also for Ctrl-C: a component may have bits although its reached set is unknown.
            self.nodes[:] = [node for node in self._place if node in self._bits]
            self._place = {node: place for place, node in enumerate(self.nodes)}
            raise

    def _explore(self, start: Any) -> int:
        """Compute the bit sets of all nodes that a start reaches, and return the start's."""
        known, place = self._bits, self._place
        for component, exits in strong_components([start], self._unknown):
            if component[0] in known:
                continue
            first = len(place)
            for node in component:
                place[node] = len(place)
            self.nodes += component
            own = (1 << len(component)) - 1 << first
            bits = own if len(component) > 1 or component[0] in exits else 0
            for node in exits:
                if node in known:
                    bits |= known[node] | 1 << place[node]
            self._bytes += bits.bit_length() >> 3
            if self._bytes > DEMAND.most_bytes:
                raise CondensationTooLarge
            known.update(dict.fromkeys(component, bits))
        return known[start]

    def _unknown(self, node: Any) -> Iterable[Any]:
        """Return the successors of a node; () if the node has a bit set, so that its reached nodes are known."""
        return () if node in self._bits else self._following(node)
