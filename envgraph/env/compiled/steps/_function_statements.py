"""Collect the statements of a function that calls others, and that may save the state in the row buffers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from envgraph import code
from envgraph.env.compiled.effects._statement_list import StatementList
from envgraph.env.compiled.layout._program_layout import RF, RI, TOP, F, ProgramLayout, S, Width, emit_call, emit_sum
from envgraph.env.compiled.matching._model_reading import ProgramModule


class FunctionStatements(StatementList):
    """The statements of a function, and the rows of the row buffers that it uses itself.

    Args:
        error_return: the return statement of the function after an error.
        module: has the functions that are called.
        layout: the tables and columns.

    Attributes:
        first_row, row_regions_above: the first row for functions that are called, and the number of regions before it.
    """

    def __init__(self, error_return: code.Return, module: ProgramModule, layout: ProgramLayout) -> None:
        super().__init__(error_return)
        self.module = module
        self._layout = layout
        self.first_row: code.Expression = TOP
        self.row_regions_above = 0

    @contextmanager
    def reserved_rows(self, count: code.Expression) -> Iterator[code.Local]:
        """Reserve rows of the row buffers: calls within the block use later rows. Yield the variable of the first row.

        `count` is at most the size of a region.
        """
        before = self.first_row, self.row_regions_above
        first, above = self.module.new_local("t"), self.module.new_local("t")
        self.append_assignment(first, self.first_row)
        self.append_assignment(above, emit_sum(first, count))
        self.first_row, self.row_regions_above = above, self.row_regions_above + 1
        self.module.record_levels(self.row_regions_above + 1)
        yield first
        self.first_row, self.row_regions_above = before

    @contextmanager
    def saved_state(self, needed: bool = True) -> Iterator[code.Body]:
        """Emit code that saves the state in reserved rows. Yield the statement that restores it, but for its error.

        If this is not `needed`, emit nothing, and yield no statement.
        """
        if not needed:
            yield ()
            return
        widths = Width("S"), Width("F"), Width("rows")
        ints, floats, rows = (self._layout.offset(width) for width in widths)
        with self.reserved_rows(rows) as first:
            state = S, F, ints, floats, RI, RF, first
            self.append(code.emit_call_statement("keep", *state))
            yield (code.emit_call_statement("put_back", *state),)

    def emit_function_call(self, name: str, *arguments: code.Expression) -> code.Call:
        """Return code that calls a function of the program, and record that the current function calls it."""
        self.module.record_call(name, self.row_regions_above)
        return emit_call(name, *arguments, top=self.first_row)
