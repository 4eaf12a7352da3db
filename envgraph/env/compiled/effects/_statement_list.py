"""Collect the statements of a generated function."""

from __future__ import annotations

from collections.abc import Callable

from envgraph import code
from envgraph.env.compiled.layout._program_layout import emit_error


class StatementList:
    """A list of statements of a generated function, to which methods append.

    Args:
        error_return: the return statement of the function after an error.
    """

    def __init__(self, error_return: code.Return) -> None:
        self.error_return = error_return
        self._statements: list[code.Statement] = []

    def append(self, *statements: code.Statement) -> None:
        """Append statements to the function."""
        self._statements += statements

    def append_assignment(self, target: code.Local, value: code.Expression) -> None:
        """Append an assignment of `value` to the variable `target`."""
        self.append(code.Assign(target, value))

    def collect(self, write: Callable[[], None]) -> code.Body:
        """Return the statements that the callback `write` adds, without appending them."""
        before, self._statements = self._statements, []
        write()
        made, self._statements = self.all_statements(), before
        return made

    def append_if(self, test: code.Expression, write: Callable[[], None]) -> None:
        """Append an if statement around the statements that `write` adds; append nothing if `write` adds none."""
        body = self.collect(write)
        if body:
            self.append(code.If(test, body))

    def failure_statements(self, error: str = "FAILED") -> code.Body:
        """Return the statements that store an error code in the state and leave the function."""
        return emit_error(error), self.error_return

    def append_fail_if(self, test: code.Expression, error: str = "FAILED") -> None:
        """Append code that stores the error code `error` in the state and leaves the function if the test is true."""
        self.append(code.If(test, self.failure_statements(error)))

    def all_statements(self) -> code.Body:
        """Return all collected statements."""
        return tuple(self._statements)
