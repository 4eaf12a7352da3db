"""Collect the statements of a generated function."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.env.compiled._layout import failed


class Statements:
    """A list of statements of a generated function, to which methods append.

    Args:
        leave: the return statement of the function after an error.
    """

    def __init__(self, leave: code.Return) -> None:
        self.leave = leave
        self._statements: list[code.Statement] = []

    def add(self, *statements: code.Statement) -> None:
        """Append statements to the function."""
        self._statements += statements

    def assign(self, target: code.Local, value: code.Expression) -> None:
        """Append an assignment of `value` to the variable `target`."""
        self.add(code.Assign(target, value))

    def collected(self, write: Callable[[], None]) -> code.Body:
        """Return the statements that the callback `write` adds, without appending them."""
        before, self._statements = self._statements, []
        write()
        made, self._statements = self.written(), before
        return made

    def when(self, test: code.Expression, write: Callable[[], None]) -> None:
        """Append an if statement around the statements that `write` adds; append nothing if `write` adds none."""
        body = self.collected(write)
        if body:
            self.add(code.If(test, body))

    def fail(self, error: str = "FAILED") -> code.Body:
        """Return the statements that store an error code in the state and leave the function."""
        return failed(error), self.leave

    def fail_if(self, test: code.Expression, error: str = "FAILED") -> None:
        """Append code that stores the error code `error` in the state and leaves the function if the test is true."""
        self.add(code.If(test, self.fail(error)))

    def written(self) -> code.Body:
        """Return all collected statements."""
        return tuple(self._statements)
