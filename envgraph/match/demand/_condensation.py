"""Reachability of many pairs: each node knows all that it reaches as the bits of one integer."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

from envgraph.metamodel import components

MOST_BYTES: Final = 64_000_000
"""Size of all these integers: about that of a chain of 30,000 nodes."""


class TooLarge(Exception):
    """The integers would take too much memory."""


class Condensation:
    """What the nodes of a graph reach by one or more steps, made for the part that has been asked about.

    Nodes that reach each other share one integer, so a connected graph costs no more than its nodes.

    >>> steps = {1: [2], 2: [1, 3], 3: []}
    >>> reached = Condensation(steps.__getitem__)
    >>> reached.holds(1, 1), reached.holds(3, 2), reached.size(2)
    (True, False, 3)

    Args:
        following: where one step leads; it must give the same for as long as this is used.

    Attributes:
        nodes: all that have been met, in the order of their bits.
    """

    def __init__(self, following: Callable[[Any], Iterable[Any]]) -> None:
        self._following = following
        self._bits: dict[Any, int] = {}
        self._place: dict[Any, int] = {}
        self.nodes: list[Any] = []
        self._bytes = 0

    def holds(self, start: Any, goal: Any) -> bool:
        """Return whether one node reaches another.

        Raises:
            TooLarge: as this is found out.
        """
        bits = self._bits.get(start)
        if bits is None:
            bits = self._explored(start)
        place = self._place.get(goal)
        return place is not None and bool(bits >> place & 1)

    def reached(self, start: Any) -> int:
        """Return bits at the places of what a node reaches. Nodes share the object only if they reach the same.

        Raises:
            TooLarge: as this is found out.
        """
        bits = self._bits.get(start)
        return self._explored(start) if bits is None else bits

    def bit(self, node: Any) -> int:
        """The bit of a node that has been asked about."""
        return 1 << self._place[node]

    def size(self, start: Any) -> int:
        """Return how many nodes one node reaches.

        Raises:
            TooLarge: as this is found out.
        """
        bits = self._bits.get(start)
        return (self._explored(start) if bits is None else bits).bit_count()

    def _explored(self, start: Any) -> int:
        try:
            return self._explore(start)
        except BaseException:  # Ctrl-C, too: a component may have places, and is not known
            self.nodes[:] = [node for node in self._place if node in self._bits]
            self._place = {node: place for place, node in enumerate(self.nodes)}
            raise

    def _explore(self, start: Any) -> int:
        known, place = self._bits, self._place
        for component, exits in components([start], self._unknown):
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
            if self._bytes > MOST_BYTES:
                raise TooLarge
            known.update(dict.fromkeys(component, bits))
        return known[start]

    def _unknown(self, node: Any) -> Iterable[Any]:
        """Steps from a node that is met for the first time: what lies behind the others is known."""
        return () if node in self._bits else self._following(node)
