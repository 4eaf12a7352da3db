"""Generated functions that change what a view holds: its rows, counts and groups, the journal, and its consumers.

One tree for each shape of a view, with nothing in it that the view does not need. What takes a change back is written
before it is made, so that an interruption leaves no more than the last entry in doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from envgraph.code import (
    NONE,
    Assign,
    Body,
    Constant,
    Do,
    Expression,
    For,
    Function,
    If,
    Index,
    Leave,
    Local,
    Member,
    Name,
    Operation,
    Return,
    Statement,
    Text,
    Tuple,
    call,
    dataclass,
    define,
    expression_text,
    method,
    some,
    tuple_of,
)
from envgraph.graph import IN, OUT, SET
from envgraph.match.views import _sets

if TYPE_CHECKING:
    from envgraph.match.views._operators import Rows

Change = Callable[[tuple[Any, ...]], None]


def changes(
    rows: Rows, counts: dict[Any, int] | None, arity: int
) -> tuple[Change, Change, Callable[[], None]]:
    """How a row gains and loses a derivation, and how a queue of both is worked off.

    Args:
        rows: what is held, with its groups and consumers.
        counts: derivations of each row, or None if there is one at most.
        arity: values in a row.
    """
    groups = list(rows.groups.values())
    shape = tuple((each.positions, each.item) for each in groups)
    form = Form(
        shape, counts is not None, rows.listed, rows.added is not None, rows.removing is not None, arity
    )
    build = define((_tree(form),), "<view of envgraph>", {})["build"]
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
    """What there is to be done when a row comes or goes.

    Attributes:
        shape: positions of the keys, and of what is kept, of each group.
        counted: derivations are counted.
        listed: the rows are kept.
        added, removing: there are consumers.
        arity: values in a row.
    """

    shape: Shape
    counted: bool
    listed: bool
    added: bool
    removing: bool
    arity: int


_ROW, _COUNT, _INDEX, _PLACE = map(Local, ("row", "count", "index", "place"))
_ROWS, _POSITION, _COUNTS, _QUEUE = map(Name, ("rows", "position", "counts", "queue"))
_RECORDING: Final = Member(Name("store"), "recording")
_ONE: Final = Constant(1)


def _tree(form: Form) -> Function:
    """Makes the other functions of what they refer to."""
    outside = ("rows", "store", "counts", "added", "removing", "tables", "adds", "drops", "queue")
    entries, both, coming = map(Local, ("entries", "both", "coming"))
    changes_ = If(coming, _gain(form, Leave("continue")), _lose(form, Leave("continue")))
    work = (
        Assign(entries, Text("queue[:]")),
        Do(method(_QUEUE, "clear")),
        Assign(both, call("iter", entries)),
        For(tuple_of(_ROW, coming), call("zip", both, both), (changes_,)),
    )
    body: Body = (
        Assign(_POSITION, Member(_ROWS, "position")),
        Assign(Name("append"), Member(_ROWS, "append")),
        Assign(Name("pop"), Member(_ROWS, "pop")),
        Assign(Name("record"), Member(Member(Name("store"), "journal"), "extend")),
        *(
            Assign(Name(f"{what}{number}"), Index(Name(f"{what}s"), Constant(number)))
            for number in range(len(form.shape))
            for what in ("table", "add", "drop")
        ),
        Function("gain", (_ROW,), _gain(form, Return())),
        Function("lose", (_ROW,), _lose(form, Return())),
        Function("work", (), work),
        Return(tuple_of(Name("gain"), Name("lose"), Name("work"))),
    )
    return Function("build", tuple(map(Name, outside)), body)


def _gain(form: Form, leave: Statement) -> Body:
    found: list[Statement] = []
    if form.counted:
        found += [
            Assign(_COUNT, method(_COUNTS, "get", _ROW, Constant(0))),
            _recorded(_COUNTS, _ROW, _COUNT, SET),
            Assign(Index(_COUNTS, _ROW), Operation("+", (_COUNT, _ONE))),
            If(_COUNT, (leave,)),
        ]
    if form.listed:
        found += [
            _logged(True),
            _recorded(_ROWS, _ROW, NONE, OUT),
            Assign(Index(_POSITION, _ROW), call("len", _ROWS)),
            Do(call("append", _ROW)),
            If(Member(_ROWS, "indexes"), (Do(method(_ROWS, "inserted", _ROW)),)),
        ]
    for number, (positions, item) in enumerate(form.shape):
        key, old, table = _group(number)
        short = Operation("<", (call("len", old), Constant(_sets.CROWD)))
        longer = Text(f"(*{old.name}, {expression_text(_item(item))})", reads=(old, _ROW))
        more = _recorded(table, key, old, SET), Assign(Index(table, key), longer)
        found += [
            *_looked_up(number, positions),
            If(Operation("and", (_is_tuple(old), short)), more, (Do(call(f"add{number}", _ROW)),)),
        ]
    if form.added:
        found.append(Do(call("added", *map(_item, range(form.arity)))))
    return tuple(found)


def _lose(form: Form, leave: Statement) -> Body:
    found: list[Statement] = []
    if form.counted:
        counted = Index(_COUNTS, _ROW)
        found += [
            Assign(_COUNT, counted),
            _recorded(_COUNTS, _ROW, _COUNT, SET),
            If(
                Operation(">", (_COUNT, _ONE)),
                (Assign(counted, Operation("-", (_COUNT, _ONE))), leave),
            ),
            If(_RECORDING, (Assign(counted, Constant(0)),), (_deleted(counted),)),
        ]
    if form.removing:
        found.append(Do(call("removing", *map(_item, range(form.arity)))))
    for number, (positions, item) in enumerate(form.shape):
        key, old, table = _group(number)
        shorter = Text(f"({old.name}[:place] + {old.name}[place + 1:])", reads=(old, _PLACE))
        less = (
            Assign(_PLACE, method(old, "index", _item(item))),
            _recorded(table, key, old, SET),
            Assign(Index(table, key), shorter),
        )
        found += [
            *_looked_up(number, positions),
            If(_is_tuple(old), less, (Do(call(f"drop{number}", _ROW)),)),
        ]
    if form.listed:
        place, last = Index(_POSITION, _ROW), Local("last")
        moved = Assign(Index(_ROWS, _INDEX), last), Assign(Index(_POSITION, last), _INDEX)
        found += [
            _logged(False),
            Assign(_INDEX, place),
            _recorded(_ROWS, _ROW, _INDEX, IN),
            _deleted(place),
            Assign(last, call("pop")),
            If(Operation("<", (_INDEX, call("len", _ROWS))), moved),
            If(Member(_ROWS, "indexes"), (Do(method(_ROWS, "deleted", _ROW)),)),
        ]
    return tuple(found)


def _recorded(container: Name, key: Expression, old: Expression, opcode: int) -> If:
    """Notes what takes a change back."""
    return If(_RECORDING, (Do(call("record", tuple_of(container, key, old, Constant(opcode)))),))


def _deleted(entry: Index) -> Do:
    return Do(Text(f"del {expression_text(entry)}", reads=(_ROW,)))


def _logged(coming: bool) -> If:
    log = Member(_ROWS, "log")
    return If(some(log), (Do(method(log, "extend", tuple_of(_ROW, Constant(coming)))),))


def _group(number: int) -> tuple[Local, Local, Name]:
    """The key of a row in a group, what is held there, and all that is held."""
    return Local(f"key{number}"), Local(f"old{number}"), Name(f"table{number}")


def _looked_up(number: int, positions: tuple[int, ...]) -> Body:
    key, old, table = _group(number)
    values = tuple(map(_item, positions))
    return Assign(key, values[0] if len(values) == 1 else Tuple(values)), Assign(old, Index(table, key))


def _is_tuple(old: Local) -> Operation:
    return Operation("is", (call("type", old), Name("tuple")))


def _item(item: int | None) -> Expression:
    return _ROW if item is None else Index(_ROW, Constant(item))
