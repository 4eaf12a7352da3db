"""Generated functions that change what a view holds: its rows, counts and groups, the journal, and its consumers.

One text for each shape of a view, with nothing in it that the view does not need.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import CodeType
from typing import TYPE_CHECKING, Any

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
    text = _text(shape, counts is not None, rows.added is not None, rows.removing is not None, arity)
    namespace: dict[str, Any] = {}
    exec(_code(text), namespace)
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
    return namespace["build"](**values)  # type: ignore[no-any-return]


@lru_cache(maxsize=512)
def _code(text: str) -> CodeType:
    return compile(text, "<view of envgraph>", "exec")


Shape = tuple[tuple[tuple[int, ...], int | None], ...]


def _text(shape: Shape, counted: bool, added: bool, removing: bool, arity: int) -> str:
    lines = [
        "def build(rows, store, counts, added, removing, tables, adds, drops, queue):",
        "    position = rows.position",
        "    append, pop, discard = rows.append, rows.pop, rows.position.pop",
        "    record = store.journal.extend",
        *(f"    table{n}, add{n}, drop{n} = tables[{n}], adds[{n}], drops[{n}]" for n in range(len(shape))),
        "    def gain(row):",
        *_indented(_gain(shape, counted, added, arity, "return"), 2),
        "    def lose(row):",
        *_indented(_lose(shape, counted, removing, arity, "return"), 2),
        "    def work():",
        "        entries = queue[:]",
        "        queue.clear()",
        "        both = iter(entries)",
        "        for row, coming in zip(both, both):",
        "            if coming:",
        *_indented(_gain(shape, counted, added, arity, "continue"), 4),
        "            else:",
        *_indented(_lose(shape, counted, removing, arity, "continue"), 4),
        "    return gain, lose, work",
        "",
    ]
    return "\n".join(lines)


def _indented(lines: list[str], depth: int) -> list[str]:
    return ["    " * depth + line for line in lines]


def _gain(shape: Shape, counted: bool, added: bool, arity: int, leave: str) -> list[str]:
    lines, record = [], [f"rows, row, None, {OUT}"]
    if counted:
        lines += [
            "count = counts.get(row, 0)",
            f"if store.recording: record((counts, row, count, {SET}))",
            "counts[row] = count + 1",
            f"if count: {leave}",
        ]
    lines += ["position[row] = len(rows)", "append(row)"]
    for number, (positions, item) in enumerate(shape):
        key, old = f"key{number}", f"old{number}"
        lines += [
            f"{key} = {_key(positions)}",
            f"{old} = table{number}[{key}]",
            f"if type({old}) is tuple and len({old}) < {_sets.CROWD}:",
            f"    table{number}[{key}] = (*{old}, {_item(item)})",
            f"    if store.recording: record((table{number}, {key}, {old}, {SET}))",
            f"else: add{number}(row)",
        ]
    lines += [
        f"if store.recording: record(({', '.join(record)}))",
        "if rows.log is not None: rows.log.extend((row, True))",
    ]
    if added:
        lines.append(f"added({_values(arity)})")
    return lines


def _lose(shape: Shape, counted: bool, removing: bool, arity: int, leave: str) -> list[str]:
    lines = []
    if counted:
        lines += [
            "count = counts[row]",
            f"if store.recording: record((counts, row, count, {SET}))",
            "if count > 1:",
            "    counts[row] = count - 1",
            f"    {leave}",
            "if store.recording: counts[row] = 0",
            "else: del counts[row]",
        ]
    if removing:
        lines.append(f"removing({_values(arity)})")
    for number, (positions, item) in enumerate(shape):
        key, old = f"key{number}", f"old{number}"
        lines += [
            f"{key} = {_key(positions)}",
            f"{old} = table{number}[{key}]",
            f"if type({old}) is tuple:",
            f"    place = {old}.index({_item(item)})",
            f"    table{number}[{key}] = {old}[:place] + {old}[place + 1:]",
            f"    if store.recording: record((table{number}, {key}, {old}, {SET}))",
            f"else: drop{number}(row)",
        ]
    lines += [
        "index = discard(row)",
        "last = pop()",
        "if index < len(rows):",
        "    rows[index] = last",
        "    position[last] = index",
        f"if store.recording: record((rows, row, index, {IN}))",
        "if rows.log is not None: rows.log.extend((row, False))",
    ]
    return lines


def _key(positions: tuple[int, ...]) -> str:
    if len(positions) == 1:
        return f"row[{positions[0]}]"
    return f"({''.join(f'row[{p}], ' for p in positions)})"


def _item(item: int | None) -> str:
    return "row" if item is None else f"row[{item}]"


def _values(arity: int) -> str:
    return ", ".join(f"row[{n}]" for n in range(arity))
