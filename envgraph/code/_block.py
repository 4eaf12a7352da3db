"""Bodies of functions that are built from the outside in."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

from envgraph.code._tree import Body, Expression, For, If, Local, Statement, Tuple

MOST_LOOPS: Final = 12
"""Loops of one function, of the 20 that CPython allows: what is done inside the last one has some too."""
MOST_LEVELS: Final = 38
"""Levels of indentation in it, of the 100 that CPython allows: tests between statements have levels and no loops."""


class Place(NamedTuple):
    """How much of a block is open."""

    heads: int
    loops: int
    levels: int


class Block:
    """A body in the making. Tests are collected until something stands under them.

    Attributes:
        loops: loops that are open.
        tests: those under which nothing stands yet, each with its origin.
    """

    def __init__(self) -> None:
        self.loops = 0
        self.tests: list[tuple[Expression, object]] = []
        self._levels = 0
        self._open: list[tuple[Local | Tuple | None, Expression]] = []  # loops, and tests with None
        self._origins: list[object] = []
        self._bodies: list[list[Statement]] = [[]]

    def add(self, *statements: Statement) -> None:
        """Add statements here, under the tests so far."""
        self._enter()
        self._bodies[-1] += statements

    def test(self, test: Expression) -> None:
        """What follows holds only if a test does."""
        self.tests.append((test, None))

    def loop(self, target: Local | Tuple, iterable: Expression) -> None:
        """What follows is done for each element."""
        self._enter()
        self._begin(target, iterable)
        self.loops += 1
        self._levels += 1

    def come_from(self, origin: object) -> None:
        """Say where the last test, loop or statement comes from."""
        if self.tests:
            self.tests[-1] = (self.tests[-1][0], origin)
        elif self._bodies[-1]:
            self._bodies[-1][-1] = replace(self._bodies[-1][-1], origin=origin)
        else:
            self._origins[-1] = origin

    @property
    def place(self) -> Place:
        """Where the block is."""
        return Place(len(self._open), self.loops, self._levels)

    def back_to(self, place: Place) -> None:
        """Close the loops and tests that were opened since the block was at a place."""
        self.tests = []
        while len(self._open) > place.heads:
            (target, value), origin = self._open.pop(), self._origins.pop()
            inside = tuple(self._bodies.pop())
            self._bodies[-1].append(
                If(value, inside, (), origin) if target is None else For(target, value, inside, origin)
            )
        self.loops, self._levels = place.loops, place.levels

    def body(self) -> Body:
        """Everything, with all loops and tests closed."""
        self.back_to(Place(0, 0, 0))
        return tuple(self._bodies[0])

    @property
    def full(self) -> bool:
        """Whether anything more should go into a function of its own."""
        return self.loops >= MOST_LOOPS or self._levels >= MOST_LEVELS

    def _enter(self) -> None:
        """Go inside the tests so far."""
        if self.tests:
            for test, origin in self.tests:
                self._begin(None, test, origin)
            self._levels += 1
            self.tests = []

    def _begin(self, target: Local | Tuple | None, value: Expression, origin: object = None) -> None:
        self._open.append((target, value))
        self._origins.append(origin)
        self._bodies.append([])
