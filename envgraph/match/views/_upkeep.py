"""Generated functions that change what a view holds: its rows, counts and groups, the journal, and its consumers.

One text for each shape of a view, with nothing in it that the view does not need. What takes a change back is written
before it is made, so that an interruption leaves no more than the last entry in doubt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from envgraph.code import dataclass, define
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
    text = _text(form)
    build = define(text, "<view of envgraph>", {})["build"]
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


def _text(form: Form) -> str:
    shape = form.shape
    lines = [
        "def build(rows, store, counts, added, removing, tables, adds, drops, queue):",
        "    position = rows.position",
        "    append, pop = rows.append, rows.pop",
        "    record = store.journal.extend",
        *(f"    table{n}, add{n}, drop{n} = tables[{n}], adds[{n}], drops[{n}]" for n in range(len(shape))),
        "    def gain(row):",
        *_indented(_gain(form, "return"), 2),
        "    def lose(row):",
        *_indented(_lose(form, "return"), 2),
        "    def work():",
        "        entries = queue[:]",
        "        queue.clear()",
        "        both = iter(entries)",
        "        for row, coming in zip(both, both):",
        "            if coming:",
        *_indented(_gain(form, "continue"), 4),
        "            else:",
        *_indented(_lose(form, "continue"), 4),
        "    return gain, lose, work",
        "",
    ]
    return "\n".join(lines)


def _indented(lines: list[str], depth: int) -> list[str]:
    return ["    " * depth + line for line in lines]


def _gain(form: Form, leave: str) -> list[str]:
    lines = []
    if form.counted:
        lines += [
            "count = counts.get(row, 0)",
            f"if store.recording: record((counts, row, count, {SET}))",
            "counts[row] = count + 1",
            f"if count: {leave}",
        ]
    if form.listed:
        lines += [
            "if rows.log is not None: rows.log.extend((row, True))",
            f"if store.recording: record((rows, row, None, {OUT}))",
            "position[row] = len(rows)",
            "append(row)",
            "if rows.indexes: rows.inserted(row)",
        ]
    for number, (positions, item) in enumerate(form.shape):
        key, old = f"key{number}", f"old{number}"
        lines += [
            f"{key} = {_key(positions)}",
            f"{old} = table{number}[{key}]",
            f"if type({old}) is tuple and len({old}) < {_sets.CROWD}:",
            f"    if store.recording: record((table{number}, {key}, {old}, {SET}))",
            f"    table{number}[{key}] = (*{old}, {_item(item)})",
            f"else: add{number}(row)",
        ]
    if form.added:
        lines.append(f"added({_values(form.arity)})")
    return lines or ["pass"]


def _lose(form: Form, leave: str) -> list[str]:
    lines = []
    if form.counted:
        lines += [
            "count = counts[row]",
            f"if store.recording: record((counts, row, count, {SET}))",
            "if count > 1:",
            "    counts[row] = count - 1",
            f"    {leave}",
            "if store.recording: counts[row] = 0",
            "else: del counts[row]",
        ]
    if form.removing:
        lines.append(f"removing({_values(form.arity)})")
    for number, (positions, item) in enumerate(form.shape):
        key, old = f"key{number}", f"old{number}"
        lines += [
            f"{key} = {_key(positions)}",
            f"{old} = table{number}[{key}]",
            f"if type({old}) is tuple:",
            f"    place = {old}.index({_item(item)})",
            f"    if store.recording: record((table{number}, {key}, {old}, {SET}))",
            f"    table{number}[{key}] = {old}[:place] + {old}[place + 1:]",
            f"else: drop{number}(row)",
        ]
    if form.listed:
        lines += [
            "if rows.log is not None: rows.log.extend((row, False))",
            "index = position[row]",
            f"if store.recording: record((rows, row, index, {IN}))",
            "del position[row]",
            "last = pop()",
            "if index < len(rows):",
            "    rows[index] = last",
            "    position[last] = index",
            "if rows.indexes: rows.deleted(row)",
        ]
    return lines or ["pass"]


def _key(positions: tuple[int, ...]) -> str:
    if len(positions) == 1:
        return f"row[{positions[0]}]"
    return f"({''.join(f'row[{p}], ' for p in positions)})"


def _item(item: int | None) -> str:
    return "row" if item is None else f"row[{item}]"


def _values(arity: int) -> str:
    return ", ".join(f"row[{n}]" for n in range(arity))
