"""Generate the functions that update a view: they change rows, support counts and groups, and call consumers.

Each form of a view gets its own code, without unnecessary parts. The undo entry is written to the journal before each
change, so that an interruption leaves only the last entry in doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.graph import ADDED, ASSIGNED, REMOVED, Store

if TYPE_CHECKING:
    from envgraph.match.views.operators._materialized_view import RowOperator

Change = Callable[[tuple[Any, ...]], None]


def make_update_functions(
    rows: RowOperator, counts: dict[Any, int] | None, arity: int
) -> tuple[Change, Change, Callable[[], None]]:
    """Generate three functions of a view: to add a derivation of a row, to remove one, and to process the queue.

    Args:
        rows: the operator, with its groups and consumers.
        counts: the support count of each row; None if no row has several derivations.
        arity: the number of values in a row.
    """
    groups = list(rows.groups.values())
    shape = tuple((each.positions, each.item) for each in groups)
    form = ViewForm(
        shape,
        counts is not None,
        rows.stores_rows,
        rows.on_inserted is not None,
        rows.on_deleting is not None,
        arity,
    )
    build = code.define_functions((_emit_build(form),), "<view of envgraph>", {})["build"]
    values = {
        "rows": rows.rows,
        "store": rows.store,
        "counts": counts,
        "added": rows.on_inserted,
        "removing": rows.on_deleting,
        "tables": [each.table for each in groups],
        "adds": [each.add for each in groups],
        "drops": [each.drop for each in groups],
        "queue": getattr(rows, "queue", None),
    }
    return build(**values)  # type: ignore[no-any-return]


GroupShapes = tuple[tuple[tuple[int, ...], int | None], ...]


@dataclass(frozen=True, slots=True)
class ViewForm:
    """The properties of a view on which the code of its update functions depends.

    Attributes:
        groups: for each grouping of the rows the positions of its key, and the position of its items (None for whole
            rows).
        has_counts: True if support counts are kept.
        stores_rows: True if the rows are stored.
        has_insert_hooks, has_delete_hooks: True if there are consumers of insertions, and of deletions.
        arity: the number of values in a row.
    """

    groups: GroupShapes
    has_counts: bool
    stores_rows: bool
    has_insert_hooks: bool
    has_delete_hooks: bool
    arity: int


_ROW, _COUNT, _INDEX, _PLACE = map(code.Local, ("row", "count", "index", "place"))
_ROWS, _POSITION, _COUNTS, _QUEUE = map(code.Name, ("rows", "position", "counts", "queue"))
_RECORDING: Final = code.AttributeAccess(code.Name("store"), "recording")
_ONE: Final = code.Constant(1)


def _emit_build(form: ViewForm) -> code.Function:
    """Return the syntax tree of a function that takes the view's data and returns the three update functions."""
    outside = ("rows", "store", "counts", "added", "removing", "tables", "adds", "drops", "queue")
    entries, both, coming = map(code.Local, ("entries", "both", "coming"))
    changes_ = code.If(
        coming,
        _emit_derive(form, code.BreakOrContinue("continue")),
        _emit_underive(form, code.BreakOrContinue("continue")),
    )
    work = (
        code.Assign(entries, code.PythonText("queue[:]")),
        code.ExpressionStatement(code.emit_method_call(_QUEUE, "clear")),
        code.Assign(both, code.emit_call("iter", entries)),
        code.For(code.emit_tuple(_ROW, coming), code.emit_call("zip", both, both), (changes_,)),
    )
    body: code.Body = (
        code.Assign(_POSITION, code.AttributeAccess(_ROWS, "position")),
        code.Assign(code.Name("append"), code.AttributeAccess(_ROWS, "append")),
        code.Assign(code.Name("pop"), code.AttributeAccess(_ROWS, "pop")),
        code.Assign(
            code.Name("record"),
            code.AttributeAccess(code.AttributeAccess(code.Name("store"), "journal"), "extend"),
        ),
        *(
            code.Assign(code.Name(f"{what}{number}"), code.Subscript(code.Name(f"{what}s"), code.Constant(number)))
            for number in range(len(form.groups))
            for what in ("table", "add", "drop")
        ),
        code.Function("gain", (_ROW,), _emit_derive(form, code.Return())),
        code.Function("lose", (_ROW,), _emit_underive(form, code.Return())),
        code.Function("work", (), work),
        code.Return(code.emit_tuple(code.Name("gain"), code.Name("lose"), code.Name("work"))),
    )
    return code.Function("build", tuple(map(code.Name, outside)), body)


def _emit_derive(form: ViewForm, skip: code.Statement) -> code.Body:
    """Return the code that adds a derivation of a row. If the row was already present, it ends with `skip`."""
    found: list[code.Statement] = []
    if form.has_counts:
        found += [
            code.Assign(_COUNT, code.emit_method_call(_COUNTS, "get", _ROW, code.Constant(0))),
            _emit_undo_entry(_COUNTS, _ROW, _COUNT, ASSIGNED),
            code.Assign(code.Subscript(_COUNTS, _ROW), code.Operation("+", (_COUNT, _ONE))),
            code.If(_COUNT, (skip,)),
        ]
    if form.stores_rows:
        found += [
            _emit_log(True),
            _emit_undo_entry(_ROWS, _ROW, code.NONE, ADDED),
            code.Assign(code.Subscript(_POSITION, _ROW), code.emit_call("len", _ROWS)),
            code.emit_call_statement("append", _ROW),
            code.If(
                code.AttributeAccess(_ROWS, "indexes"),
                (code.ExpressionStatement(code.emit_method_call(_ROWS, "inserted", _ROW)),),
            ),
        ]
    for number, (positions, item) in enumerate(form.groups):
        key, old, table = _group(number)
        short = code.Operation("<", (code.emit_call("len", old), code.Constant(Store.crowd)))
        longer = code.PythonText(f"(*{old.name}, {code.expression_text(_row_item(item))})", reads=(old, _ROW))
        more = _emit_undo_entry(table, key, old, ASSIGNED), code.Assign(code.Subscript(table, key), longer)
        found += [
            *_emit_group_lookup(number, positions),
            code.If(
                code.Operation("and", (_emit_is_tuple(old), short)),
                more,
                (code.emit_call_statement(f"add{number}", _ROW),),
            ),
        ]
    if form.has_insert_hooks:
        found.append(code.emit_call_statement("added", *map(_row_item, range(form.arity))))
    return tuple(found)


def _emit_underive(form: ViewForm, skip: code.Statement) -> code.Body:
    """Return the code that removes a derivation of a row. If the row has other derivations, it ends with `skip`."""
    found: list[code.Statement] = []
    if form.has_counts:
        counted = code.Subscript(_COUNTS, _ROW)
        found += [
            code.Assign(_COUNT, counted),
            _emit_undo_entry(_COUNTS, _ROW, _COUNT, ASSIGNED),
            code.If(
                code.Operation(">", (_COUNT, _ONE)),
                (code.Assign(counted, code.Operation("-", (_COUNT, _ONE))), skip),
            ),
            code.If(_RECORDING, (code.Assign(counted, code.Constant(0)),), (_deleted(counted),)),
        ]
    if form.has_delete_hooks:
        found.append(code.emit_call_statement("removing", *map(_row_item, range(form.arity))))
    for number, (positions, item) in enumerate(form.groups):
        key, old, table = _group(number)
        shorter = code.PythonText(f"({old.name}[:place] + {old.name}[place + 1:])", reads=(old, _PLACE))
        less = (
            code.Assign(_PLACE, code.emit_method_call(old, "index", _row_item(item))),
            _emit_undo_entry(table, key, old, ASSIGNED),
            code.Assign(code.Subscript(table, key), shorter),
        )
        found += [
            *_emit_group_lookup(number, positions),
            code.If(_emit_is_tuple(old), less, (code.emit_call_statement(f"drop{number}", _ROW),)),
        ]
    if form.stores_rows:
        place, last = code.Subscript(_POSITION, _ROW), code.Local("last")
        moved = (
            code.Assign(code.Subscript(_ROWS, _INDEX), last),
            code.Assign(code.Subscript(_POSITION, last), _INDEX),
        )
        found += [
            _emit_log(False),
            code.Assign(_INDEX, place),
            _emit_undo_entry(_ROWS, _ROW, _INDEX, REMOVED),
            _deleted(place),
            code.Assign(last, code.emit_call("pop")),
            code.If(code.Operation("<", (_INDEX, code.emit_call("len", _ROWS))), moved),
            code.If(
                code.AttributeAccess(_ROWS, "indexes"),
                (code.ExpressionStatement(code.emit_method_call(_ROWS, "deleted", _ROW)),),
            ),
        ]
    return tuple(found)


def _emit_undo_entry(container: code.Name, key: code.Expression, old: code.Expression, opcode: int) -> code.If:
    """Return code that writes an undo entry (container, key, old value, opcode) if the journal is on."""
    return code.If(
        _RECORDING,
        (code.emit_call_statement("record", code.emit_tuple(container, key, old, code.Constant(opcode))),),
    )


def _deleted(entry: code.Subscript) -> code.ExpressionStatement:
    """Return code that deletes the dict entry of a row."""
    return code.ExpressionStatement(code.PythonText(f"del {code.expression_text(entry)}", reads=(_ROW,)))


def _emit_log(inserting: bool) -> code.If:
    """Return code that appends an insertion or deletion of the row to the log, if there is a log."""
    log = code.AttributeAccess(_ROWS, "log")
    return code.If(
        code.emit_is_not_none(log),
        (
            code.ExpressionStatement(
                code.emit_method_call(log, "extend", code.emit_tuple(_ROW, code.Constant(inserting)))
            ),
        ),
    )


def _group(number: int) -> tuple[code.Local, code.Local, code.Name]:
    """Return, for one grouping of the rows, the local variables for its key and present items, and its table's name."""
    return code.Local(f"key{number}"), code.Local(f"old{number}"), code.Name(f"table{number}")


def _emit_group_lookup(number: int, positions: tuple[int, ...]) -> code.Body:
    """Return code that computes the key of the row in one grouping, and looks up the present items of this key."""
    key, old, table = _group(number)
    values = tuple(map(_row_item, positions))
    return code.Assign(key, values[0] if len(values) == 1 else code.Tuple(values)), code.Assign(
        old, code.Subscript(table, key)
    )


def _emit_is_tuple(old: code.Local) -> code.Operation:
    """Return code that tests if the items of a group are a tuple, not an `IndexedSet`."""
    return code.Operation("is", (code.emit_call("type", old), code.Name("tuple")))


def _row_item(item: int | None) -> code.Expression:
    """Return code for the value of the row at a position, or for the whole row if `item` is None."""
    return _ROW if item is None else code.Subscript(_ROW, code.Constant(item))
