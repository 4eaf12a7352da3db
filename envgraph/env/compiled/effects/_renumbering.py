"""Emit the function that renumbers created objects between steps, to close the gaps that deleted ones leave.

Objects that rules create take reserved numbers in order.
"""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled.layout._member_data import emit_missing_value
from envgraph.env.compiled.layout._program_layout import (
    NOBODY,
    ONE,
    RI,
    TOP,
    ZERO,
    F,
    S,
    emit_entry,
    emit_state_entry,
    emit_sum,
    emit_table_entry,
)
from envgraph.env.compiled.layout._symbols import (
    AttributeColumn,
    ClassSet,
    CreatedCount,
    ExtentTable,
    LinkMatrix,
    ReservedNumbers,
    StateColumn,
)
from envgraph.env.compiled.matching._model_reading import ModelReader


def emit_tidy_body(facts: ModelReader, group: tuple[str, ...]) -> code.Body:
    """Emit the body of the function that closes gaps in the numbers of created objects, without changing their order.

    Args:
        facts: emits code that reads the model; all columns of the program must be registered already.
        group: the classes whose objects rules create. If rules delete none of them, the body does nothing.
    """
    layout, fresh = facts.layout, facts.module.new_local
    if facts.changes.deleted.isdisjoint(group):
        return (code.Return(ZERO),)
    made = emit_state_entry(layout.offset(CreatedCount()))
    used, kept, first, number, place = (fresh(prefix) for prefix in "ukfnp")
    inside = [facts.emit_is_in_set(group, cls, place) for cls in group]
    begin = emit_table_entry(emit_sum(layout.offset(ExtentTable(group, "places")), first))
    row = emit_entry(RI, emit_sum(TOP, number), 0)
    gone = code.If(
        code.emit_joined("or", inside, False),
        (code.Assign(row, kept), code.Assign(kept, ONE, "+=")),
        (code.Assign(row, NOBODY),),
    )
    moved: list[code.Statement] = [code.Assign(made, kept)]
    for column, _ in layout.columns():
        moved += _emit_move_column(facts, column, first, used)
    return (
        code.Assign(used, made),
        code.Assign(first, emit_table_entry(layout.offset(ReservedNumbers("first")))),
        code.Assign(kept, ZERO),
        code.For(number, code.emit_call("range", used), (code.Assign(place, emit_sum(begin, number)), gone)),
        code.If(code.Operation("<", (kept, used)), tuple(moved)),
        code.Return(ZERO),
    )


def _emit_move_matrix(
    facts: ModelReader, matrix: LinkMatrix, first: code.Local, used: code.Local
) -> list[code.Statement]:
    """Emit code that closes the gaps of deleted objects in the rows and columns of a link matrix."""
    layout = facts.layout
    start, width = (
        layout.offset(matrix),
        emit_table_entry(layout.offset(ExtentTable(matrix.targets, "count"))),
    )
    found: list[code.Statement] = []
    for classes, across, step in (
        (matrix.sources, matrix.targets, width),
        (matrix.targets, matrix.sources, ONE),
    ):
        if isinstance(classes, tuple) and not facts.changes.created.isdisjoint(classes):
            place, number = (
                emit_table_entry(emit_sum(layout.offset(ExtentTable(classes, "places")), first)),
                facts.module.new_local("n"),
            )
            apart = (place, width, number, ONE) if classes is matrix.sources else (place, ONE, number, width)
            begin = [code.Operation("*", pair) for pair in (apart[:2], apart[2:])]
            slid = code.emit_call_statement("slide", S, emit_sum(start, *begin), step, used, RI, TOP, ZERO)
            count = emit_table_entry(layout.offset(ExtentTable(across, "count")))
            found.append(code.For(number, code.emit_call("range", count), (slid,)))
    return found


def _emit_move_column(
    facts: ModelReader, column: StateColumn, first: code.Local, used: code.Local
) -> list[code.Statement]:
    """Emit code that closes the gaps of deleted objects in a column, and updates object numbers stored there."""
    layout = facts.layout
    start = layout.offset(column)
    if isinstance(column, LinkMatrix):
        return _emit_move_matrix(facts, column, first, used)
    classes = column.group if isinstance(column, ClassSet) else column.classes
    found: list[code.Statement] = []
    if not facts.changes.created.isdisjoint(classes):
        place = emit_table_entry(emit_sum(layout.offset(ExtentTable(classes, "places")), first))
        if isinstance(column, ClassSet):
            found.append(code.emit_call_statement("slide_bits", S, start, place, used, RI, TOP))
        else:
            nothing = emit_missing_value(column.attribute.type) if isinstance(column, AttributeColumn) else NOBODY
            array = F if column.is_float else S
            found.append(code.emit_call_statement("slide", array, emit_sum(start, place), ONE, used, RI, TOP, nothing))
    if not isinstance(column, ClassSet | AttributeColumn):
        count = emit_table_entry(layout.offset(ExtentTable(classes, "count")))
        found.append(code.emit_call_statement("renumber", S, start, count, first, RI, TOP))
    return found
