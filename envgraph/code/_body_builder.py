"""Build the bodies of generated functions from the outermost loop or test inwards."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

from envgraph.code._syntax_tree import Body, Expression, For, If, Local, Statement, Tuple

MAX_LOOP_DEPTH: Final = 12
"""Maximal nesting of loops in one function. CPython allows 20; statements inside the last loop may need more."""
MAX_INDENTATION: Final = 38
"""Maximal levels of indentation in one function, of 100 that CPython allows: tests add levels but no loops."""


class BlockPosition(NamedTuple):
    """A position in a `BodyBuilder`: the numbers of open loops and tests, of open loops, and of levels of
    indentation.
    """

    open_count: int
    loop_count: int
    indentation: int


class BodyBuilder:
    """A builder of a function body that keeps loops and tests open for the statements added next.

    Attributes:
        loop_count: the number of open loops.
        pending_tests: the tests that contain no statement yet, each with its origin. The next statement or loop
            opens them.
    """

    def __init__(self) -> None:
        self.loop_count = 0
        self.pending_tests: list[tuple[Expression, object]] = []
        self._indentation = 0
        self._open_heads: list[tuple[Local | Tuple | None, Expression]] = []  # loops, and tests with None as the target
        self._origins: list[object] = []
        self._bodies: list[list[Statement]] = [[]]

    def add(self, *statements: Statement) -> None:
        """Append statements inside the open loops and tests."""
        self._open_pending_tests()
        self._bodies[-1] += statements

    def open_test(self, test: Expression) -> None:
        """Open an `if` test. Statements that are added until `close_to` closes the test are inside it."""
        self.pending_tests.append((test, None))

    def open_loop(self, target: Local | Tuple, iterable: Expression) -> None:
        """Open a `for` loop. Statements that are added until `close_to` closes the loop are inside it."""
        self._open_pending_tests()
        self._open_head(target, iterable)
        self.loop_count += 1
        self._indentation += 1

    def set_origin(self, origin: object) -> None:
        """Set the origin of the test, loop or statement that was added last."""
        if self.pending_tests:
            self.pending_tests[-1] = (self.pending_tests[-1][0], origin)
        elif self._bodies[-1]:
            self._bodies[-1][-1] = replace(self._bodies[-1][-1], origin=origin)
        else:
            self._origins[-1] = origin

    @property
    def position(self) -> BlockPosition:
        """Return the current nesting, to which `close_to` can return."""
        return BlockPosition(len(self._open_heads), self.loop_count, self._indentation)

    def close_to(self, position: BlockPosition) -> None:
        """Close all loops and tests that were opened after `position` was read; tests without statements are
        dropped.
        """
        self.pending_tests = []
        while len(self._open_heads) > position.open_count:
            (target, value), origin = self._open_heads.pop(), self._origins.pop()
            inside = tuple(self._bodies.pop())
            self._bodies[-1].append(
                If(value, inside, (), origin) if target is None else For(target, value, inside, origin)
            )
        self.loop_count, self._indentation = position.loop_count, position.indentation

    def finish_body(self) -> Body:
        """Close all loops and tests, and return the statements of the whole body."""
        self.close_to(BlockPosition(0, 0, 0))
        return tuple(self._bodies[0])

    @property
    def is_full(self) -> bool:
        """Return True if the nesting is near Python's limit, so that further code belongs in another function."""
        return self.loop_count >= MAX_LOOP_DEPTH or self._indentation >= MAX_INDENTATION

    def _open_pending_tests(self) -> None:
        """Open the collected tests, so that the next statement is added inside them."""
        if self.pending_tests:
            for test, origin in self.pending_tests:
                self._open_head(None, test, origin)
            self._indentation += 1
            self.pending_tests = []

    def _open_head(self, target: Local | Tuple | None, value: Expression, origin: object = None) -> None:
        self._open_heads.append((target, value))
        self._origins.append(origin)
        self._bodies.append([])
