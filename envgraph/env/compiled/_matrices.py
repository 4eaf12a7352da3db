"""Links that change and may be many at both ends, as code: a cell for each pair of objects."""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled._facts import Facts
from envgraph.env.compiled._layout import cell, plus
from envgraph.env.compiled._tables import LinkMatrix


def matrix_cell(
    facts: Facts,
    matrix: LinkMatrix,
    source: code.Expression,
    target: code.Expression,
    *,
    sure: tuple[bool, bool],
) -> tuple[code.Index, list[code.Expression]]:
    """The cell of two objects, and what has to hold before it is looked at."""
    row, first = facts.place(matrix.sources, source, sure=sure[0])
    column, second = facts.place(matrix.targets, target, sure=sure[1])
    return _entry(facts, matrix, row, column), [*first, *second]


def linked_with(
    facts: Facts,
    block: code.Block,
    matrix: LinkMatrix,
    node: code.Expression,
    *,
    forward: bool,
    sure: bool,
) -> tuple[code.Local, code.Index]:
    """What follows is done for each target of an object, or each source of it, of which this is the cell."""
    near, far = (matrix.sources, matrix.targets) if forward else (matrix.targets, matrix.sources)
    here, guard = facts.place(near, node, sure=sure)
    for test in guard:
        block.test(test)
    other, there = facts.each(block, far)
    linked = _entry(facts, matrix, *((here, there) if forward else (there, here)))
    block.test(code.equal(linked, code.Constant(1)))
    return other, linked


def _entry(facts: Facts, matrix: LinkMatrix, row: code.Expression, column: code.Expression) -> code.Index:
    """The cell at two places."""
    before = code.Operation("*", (row, facts.count(matrix.targets)))
    return cell(plus(facts.layout.offset(matrix), before, column))
