"""Emit the function that renumbers created objects between steps, to close the gaps that deleted ones leave.

Objects that rules create take reserved numbers in order.
"""

from __future__ import annotations

from envgraph import code
from envgraph.env.compiled._facts import Facts
from envgraph.env.compiled._layout import NOBODY, ONE, RI, TOP, ZERO, F, S, cell, entry, plus, table
from envgraph.env.compiled._member import absent
from envgraph.env.compiled._tables import (
    AttributeColumn,
    ClassSet,
    Column,
    Extent,
    LinkMatrix,
    Made,
    Spare,
)


def tidied(facts: Facts, group: tuple[str, ...]) -> code.Body:
    """Emit the body of the function that closes gaps in the numbers of created objects, without changing their order.

    Args:
        facts: emits code that reads the model; all columns of the program must be registered already.
        group: the classes whose objects rules create. If rules delete none of them, the body does nothing.
    """
    layout, fresh = facts.layout, facts.module.fresh
    if facts.changes.deleted.isdisjoint(group):
        return (code.Return(ZERO),)
    made = cell(layout.offset(Made()))
    used, kept, first, number, place = (fresh(prefix) for prefix in "ukfnp")
    inside = [facts.in_set(group, cls, place) for cls in group]
    begin = table(plus(layout.offset(Extent(group, "places")), first))
    row = entry(RI, plus(TOP, number), 0)
    gone = code.If(
        code.joined("or", inside, False),
        (code.Assign(row, kept), code.Assign(kept, ONE, "+=")),
        (code.Assign(row, NOBODY),),
    )
    moved: list[code.Statement] = [code.Assign(made, kept)]
    for column, _ in layout.columns():
        moved += _moved(facts, column, first, used)
    return (
        code.Assign(used, made),
        code.Assign(first, table(layout.offset(Spare("first")))),
        code.Assign(kept, ZERO),
        code.For(number, code.call("range", used), (code.Assign(place, plus(begin, number)), gone)),
        code.If(code.Operation("<", (kept, used)), tuple(moved)),
        code.Return(ZERO),
    )


def _matrix_moved(
    facts: Facts, matrix: LinkMatrix, first: code.Local, used: code.Local
) -> list[code.Statement]:
    """Emit code that closes the gaps of deleted objects in the rows and columns of a link matrix."""
    layout = facts.layout
    start, width = layout.offset(matrix), table(layout.offset(Extent(matrix.targets, "count")))
    found: list[code.Statement] = []
    for classes, across, step in (
        (matrix.sources, matrix.targets, width),
        (matrix.targets, matrix.sources, ONE),
    ):
        if not facts.changes.created.isdisjoint(classes):
            place, number = (
                table(plus(layout.offset(Extent(classes, "places")), first)),
                facts.module.fresh("n"),
            )
            apart = (place, width, number, ONE) if classes is matrix.sources else (place, ONE, number, width)
            begin = [code.Operation("*", pair) for pair in (apart[:2], apart[2:])]
            slid = code.Do(code.call("slide", S, plus(start, *begin), step, used, RI, TOP, ZERO))
            count = table(layout.offset(Extent(across, "count")))
            found.append(code.For(number, code.call("range", count), (slid,)))
    return found


def _moved(facts: Facts, column: Column, first: code.Local, used: code.Local) -> list[code.Statement]:
    """Emit code that closes the gaps of deleted objects in a column, and updates object numbers stored there."""
    layout = facts.layout
    start = layout.offset(column)
    if isinstance(column, LinkMatrix):
        return _matrix_moved(facts, column, first, used)
    classes = column.group if isinstance(column, ClassSet) else column.classes
    found: list[code.Statement] = []
    if not facts.changes.created.isdisjoint(classes):
        place = table(plus(layout.offset(Extent(classes, "places")), first))
        if isinstance(column, ClassSet):
            found.append(code.Do(code.call("slide_bits", S, start, place, used, RI, TOP)))
        else:
            nothing = absent(column.attribute.type) if isinstance(column, AttributeColumn) else NOBODY
            array = F if column.is_float else S
            found.append(code.Do(code.call("slide", array, plus(start, place), ONE, used, RI, TOP, nothing)))
    if not isinstance(column, ClassSet | AttributeColumn):
        count = table(layout.offset(Extent(classes, "count")))
        found.append(code.Do(code.call("renumber", S, start, count, first, RI, TOP)))
    return found
