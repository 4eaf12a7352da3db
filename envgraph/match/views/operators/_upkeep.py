"""Generate the functions that update a view: they change rows, support counts and groups, and call consumers.

Each form of a view gets its own code, without unnecessary parts. The undo entry is written to the journal before each
change, so that an interruption leaves only the last entry in doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.graph import IN, OUT, SET, Store

if TYPE_CHECKING:
    from envgraph.match.views.operators._operators import Rows

Change = Callable[[tuple[Any, ...]], None]


def changes(
    rows: Rows, counts: dict[Any, int] | None, arity: int
) -> tuple[Change, Change, Callable[[], None]]:
    """Generate three functions of a view: to add a derivation of a row, to remove one, and to process the queue.

    Args:
        rows: the operator, with its groups and consumers.
        counts: the support count of each row; None if no row has several derivations.
        arity: the number of values in a row.
    """
    groups = list(rows.groups.values())
    shape = tuple((each.positions, each.item) for each in groups)
    form = Form(
        shape, counts is not None, rows.listed, rows.added is not None, rows.removing is not None, arity
    )
    build = code.define((_tree(form),), "<view of envgraph>", {})["build"]
    values = {
        "rows": rows.rows,
        "store": rows.store,
        "counts": counts,
        "added": rows.added,
        "removing": rows.removing,
        "tables": [each.table for each in groups],
        "adds": [each.add for each in groups],
        "drops": [each.drop for each in groups],
        "queue": getattr(rows, "queue", None),
    }
    return build(**values)  # type: ignore[no-any-return]


Shape = tuple[tuple[tuple[int, ...], int | None], ...]


@dataclass(frozen=True, slots=True)
class Form:
    """The properties of a view on which the code of its update functions depends.

    Attributes:
        shape: for each grouping of the rows the positions of its key, and the position of its items (None for whole
            rows).
        counted: True if support counts are kept.
        listed: True if the rows are stored.
        added, removing: True if there are consumers of insertions, and of deletions.
        arity: the number of values in a row.
    """

    shape: Shape
    counted: bool
    listed: bool
    added: bool
    removing: bool
    arity: int


_ROW, _COUNT, _INDEX, _PLACE = map(code.Local, ("row", "count", "index", "place"))
_ROWS, _POSITION, _COUNTS, _QUEUE = map(code.Name, ("rows", "position", "counts", "queue"))
_RECORDING: Final = code.Member(code.Name("store"), "recording")
_ONE: Final = code.Constant(1)


def _tree(form: Form) -> code.Function:
    """Return the syntax tree of a function that takes the view's data and returns the three update functions."""
    outside = ("rows", "store", "counts", "added", "removing", "tables", "adds", "drops", "queue")
    entries, both, coming = map(code.Local, ("entries", "both", "coming"))
    changes_ = code.If(coming, _gain(form, code.Leave("continue")), _lose(form, code.Leave("continue")))
    work = (
        code.Assign(entries, code.Text("queue[:]")),
        code.Do(code.method(_QUEUE, "clear")),
        code.Assign(both, code.call("iter", entries)),
        code.For(code.tuple_of(_ROW, coming), code.call("zip", both, both), (changes_,)),
    )
    body: code.Body = (
        code.Assign(_POSITION, code.Member(_ROWS, "position")),
        code.Assign(code.Name("append"), code.Member(_ROWS, "append")),
        code.Assign(code.Name("pop"), code.Member(_ROWS, "pop")),
        code.Assign(code.Name("record"), code.Member(code.Member(code.Name("store"), "journal"), "extend")),
        *(
            code.Assign(
                code.Name(f"{what}{number}"), code.Index(code.Name(f"{what}s"), code.Constant(number))
            )
            for number in range(len(form.shape))
            for what in ("table", "add", "drop")
        ),
        code.Function("gain", (_ROW,), _gain(form, code.Return())),
        code.Function("lose", (_ROW,), _lose(form, code.Return())),
        code.Function("work", (), work),
        code.Return(code.tuple_of(code.Name("gain"), code.Name("lose"), code.Name("work"))),
    )
    return code.Function("build", tuple(map(code.Name, outside)), body)


def _gain(form: Form, leave: code.Statement) -> code.Body:
    """Return the code that adds a derivation of a row. If the row was already present, it ends with `leave`."""
    found: list[code.Statement] = []
    if form.counted:
        found += [
            code.Assign(_COUNT, code.method(_COUNTS, "get", _ROW, code.Constant(0))),
            _recorded(_COUNTS, _ROW, _COUNT, SET),
            code.Assign(code.Index(_COUNTS, _ROW), code.Operation("+", (_COUNT, _ONE))),
            code.If(_COUNT, (leave,)),
        ]
    if form.listed:
        found += [
            _logged(True),
            _recorded(_ROWS, _ROW, code.NONE, OUT),
            code.Assign(code.Index(_POSITION, _ROW), code.call("len", _ROWS)),
            code.Do(code.call("append", _ROW)),
            code.If(code.Member(_ROWS, "indexes"), (code.Do(code.method(_ROWS, "inserted", _ROW)),)),
        ]
    for number, (positions, item) in enumerate(form.shape):
        key, old, table = _group(number)
        short = code.Operation("<", (code.call("len", old), code.Constant(Store.crowd)))
        longer = code.Text(f"(*{old.name}, {code.expression_text(_item(item))})", reads=(old, _ROW))
        more = _recorded(table, key, old, SET), code.Assign(code.Index(table, key), longer)
        found += [
            *_looked_up(number, positions),
            code.If(
                code.Operation("and", (_is_tuple(old), short)),
                more,
                (code.Do(code.call(f"add{number}", _ROW)),),
            ),
        ]
    if form.added:
        found.append(code.Do(code.call("added", *map(_item, range(form.arity)))))
    return tuple(found)


def _lose(form: Form, leave: code.Statement) -> code.Body:
    """Return the code that removes a derivation of a row. If the row has other derivations, it ends with `leave`."""
    found: list[code.Statement] = []
    if form.counted:
        counted = code.Index(_COUNTS, _ROW)
        found += [
            code.Assign(_COUNT, counted),
            _recorded(_COUNTS, _ROW, _COUNT, SET),
            code.If(
                code.Operation(">", (_COUNT, _ONE)),
                (code.Assign(counted, code.Operation("-", (_COUNT, _ONE))), leave),
            ),
            code.If(_RECORDING, (code.Assign(counted, code.Constant(0)),), (_deleted(counted),)),
        ]
    if form.removing:
        found.append(code.Do(code.call("removing", *map(_item, range(form.arity)))))
    for number, (positions, item) in enumerate(form.shape):
        key, old, table = _group(number)
        shorter = code.Text(f"({old.name}[:place] + {old.name}[place + 1:])", reads=(old, _PLACE))
        less = (
            code.Assign(_PLACE, code.method(old, "index", _item(item))),
            _recorded(table, key, old, SET),
            code.Assign(code.Index(table, key), shorter),
        )
        found += [
            *_looked_up(number, positions),
            code.If(_is_tuple(old), less, (code.Do(code.call(f"drop{number}", _ROW)),)),
        ]
    if form.listed:
        place, last = code.Index(_POSITION, _ROW), code.Local("last")
        moved = code.Assign(code.Index(_ROWS, _INDEX), last), code.Assign(code.Index(_POSITION, last), _INDEX)
        found += [
            _logged(False),
            code.Assign(_INDEX, place),
            _recorded(_ROWS, _ROW, _INDEX, IN),
            _deleted(place),
            code.Assign(last, code.call("pop")),
            code.If(code.Operation("<", (_INDEX, code.call("len", _ROWS))), moved),
            code.If(code.Member(_ROWS, "indexes"), (code.Do(code.method(_ROWS, "deleted", _ROW)),)),
        ]
    return tuple(found)


def _recorded(container: code.Name, key: code.Expression, old: code.Expression, opcode: int) -> code.If:
    """Return code that writes an undo entry (container, key, old value, opcode) if the journal is on."""
    return code.If(
        _RECORDING, (code.Do(code.call("record", code.tuple_of(container, key, old, code.Constant(opcode)))),)
    )


def _deleted(entry: code.Index) -> code.Do:
    """Return code that deletes the dict entry of a row."""
    return code.Do(code.Text(f"del {code.expression_text(entry)}", reads=(_ROW,)))


def _logged(coming: bool) -> code.If:
    """Return code that appends an insertion or deletion of the row to the log, if there is a log."""
    log = code.Member(_ROWS, "log")
    return code.If(
        code.some(log), (code.Do(code.method(log, "extend", code.tuple_of(_ROW, code.Constant(coming)))),)
    )


def _group(number: int) -> tuple[code.Local, code.Local, code.Name]:
    """Return, for one grouping of the rows, the local variables for its key and present items, and its table's name."""
    return code.Local(f"key{number}"), code.Local(f"old{number}"), code.Name(f"table{number}")


def _looked_up(number: int, positions: tuple[int, ...]) -> code.Body:
    """Return code that computes the key of the row in one grouping, and looks up the present items of this key."""
    key, old, table = _group(number)
    values = tuple(map(_item, positions))
    return code.Assign(key, values[0] if len(values) == 1 else code.Tuple(values)), code.Assign(
        old, code.Index(table, key)
    )


def _is_tuple(old: code.Local) -> code.Operation:
    """Return code that tests if the items of a group are a tuple, not an `IndexedSet`."""
    return code.Operation("is", (code.call("type", old), code.Name("tuple")))


def _item(item: int | None) -> code.Expression:
    """Return code for the value of the row at a position, or for the whole row if `item` is None."""
    return _ROW if item is None else code.Index(_ROW, code.Constant(item))
