"""Build the bodies of generated functions from the outermost loop or test inwards."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

from envgraph.code._tree import Body, Expression, For, If, Local, Statement, Tuple

MOST_LOOPS: Final = 12
"""Maximal nesting of loops in one function. CPython allows 20; statements inside the last loop may need more."""
MOST_LEVELS: Final = 38
"""Maximal levels of indentation in one function, of 100 that CPython allows: tests add levels but no loops."""


class Place(NamedTuple):
    """A position in a `Block`: the numbers of open loops and tests, of open loops, and of levels of indentation."""

    heads: int
    loops: int
    levels: int


class Block:
    """A builder of a function body that keeps loops and tests open for the statements added next.

    Attributes:
        loops: the number of open loops.
        tests: the tests that contain no statement yet, each with its origin. The next statement or loop opens them.
    """

    def __init__(self) -> None:
        self.loops = 0
        self.tests: list[tuple[Expression, object]] = []
        self._levels = 0
        self._open: list[
            tuple[Local | Tuple | None, Expression]
        ] = []  # loops, and tests with None as the target
        self._origins: list[object] = []
        self._bodies: list[list[Statement]] = [[]]

    def add(self, *statements: Statement) -> None:
        """Append statements inside the open loops and tests."""
        self._enter()
        self._bodies[-1] += statements

    def test(self, test: Expression) -> None:
        """Open an `if` test. Statements that are added until `back_to` closes the test are inside it."""
        self.tests.append((test, None))

    def loop(self, target: Local | Tuple, iterable: Expression) -> None:
        """Open a `for` loop. Statements that are added until `back_to` closes the loop are inside it."""
        self._enter()
        self._begin(target, iterable)
        self.loops += 1
        self._levels += 1

    def come_from(self, origin: object) -> None:
        """Set the origin of the test, loop or statement that was added last."""
        if self.tests:
            self.tests[-1] = (self.tests[-1][0], origin)
        elif self._bodies[-1]:
            self._bodies[-1][-1] = replace(self._bodies[-1][-1], origin=origin)
        else:
            self._origins[-1] = origin

    @property
    def place(self) -> Place:
        """Return the current nesting, to which `back_to` can return."""
        return Place(len(self._open), self.loops, self._levels)

    def back_to(self, place: Place) -> None:
        """Close all loops and tests that were opened after `place` was read; tests without statements are dropped."""
        self.tests = []
        while len(self._open) > place.heads:
            (target, value), origin = self._open.pop(), self._origins.pop()
            inside = tuple(self._bodies.pop())
            self._bodies[-1].append(
                If(value, inside, (), origin) if target is None else For(target, value, inside, origin)
            )
        self.loops, self._levels = place.loops, place.levels

    def body(self) -> Body:
        """Close all loops and tests, and return the statements of the whole body."""
        self.back_to(Place(0, 0, 0))
        return tuple(self._bodies[0])

    @property
    def full(self) -> bool:
        """Return True if the nesting is near Python's limit, so that further code belongs in another function."""
        return self.loops >= MOST_LOOPS or self._levels >= MOST_LEVELS

    def _enter(self) -> None:
        """Open the collected tests, so that the next statement is added inside them."""
        if self.tests:
            for test, origin in self.tests:
                self._begin(None, test, origin)
            self._levels += 1
            self.tests = []

    def _begin(self, target: Local | Tuple | None, value: Expression, origin: object = None) -> None:
        self._open.append((target, value))
        self._origins.append(origin)
        self._bodies.append([])
