"""Statements of a function in the making."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.env.compiled._layout import failed


class Statements:
    """Collects statements.

    Args:
        leave: how the function ends where the live engine raises an error.
    """

    def __init__(self, leave: code.Return) -> None:
        self.leave = leave
        self._statements: list[code.Statement] = []

    def add(self, *statements: code.Statement) -> None:
        """Add statements."""
        self._statements += statements

    def assign(self, target: code.Local, value: code.Expression) -> None:
        """Give a variable a value."""
        self.add(code.Assign(target, value))

    def collected(self, write: Callable[[], None]) -> code.Body:
        """The statements that something writes."""
        before, self._statements = self._statements, []
        write()
        made, self._statements = self.written(), before
        return made

    def when(self, test: code.Expression, write: Callable[[], None]) -> None:
        """Statements under a test."""
        body = self.collected(write)
        if body:
            self.add(code.If(test, body))

    def fail(self, error: str = "FAILED") -> code.Body:
        """What is done where the live engine raises an error, or the program has no space."""
        return failed(error), self.leave

    def fail_if(self, test: code.Expression, error: str = "FAILED") -> None:
        """There is an error if a test holds."""
        self.add(code.If(test, self.fail(error)))

    def written(self) -> code.Body:
        """All statements."""
        return tuple(self._statements)
