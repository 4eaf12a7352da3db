"""Build the layout document of each language construct from the syntax tree of a text.

- A block `{ .. }` stays on one line if the author wrote it there and it fits, else each statement gets its own line.
- Brackets `( .. )` stay on the line if they fit, else each item gets its own line.
- A chain of operators, arrows or alternatives that does not fit is broken before each of them.
- Comments stay between the same tokens. Empty lines between statements stay, but two or more become one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final

from envgraph.lang.format._document import (
    HARD,
    LINE,
    NOTHING,
    SPACE,
    Document,
    Mark,
    Text,
    grouped,
    indented,
    joined,
)
from envgraph.lang.format._layout import CHAINS, Layout, first_of
from envgraph.lang.format._tokens import Item, Part

_ARROWS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})
_EFFECTS: Final = frozenset({"reward", "other", "apply", "end", "each_object", "visible", "tokens"})


def _assignment(layout: Layout, part: Part) -> Document:
    """Return the layout document of `name = value`; a chain of operators that does not fit starts on a new line."""
    value = next((one for one in part.parts(*CHAINS)), None)
    if value is None:
        return layout.plain(part)
    place = part.items.index(value)
    return grouped(
        layout.row(part.items[:place]),
        indented(layout.between(value.first, LINE), layout.links(value)),
        *(document for item in part.items[place + 1 :] for document in (NOTHING, layout.item(item))),
    )


def _graph(layout: Layout, part: Part) -> Document:
    """Return the layout document of `a -ref-> b <-ref- c`, which is broken before the arrows if it does not fit.

    The attribute block of the last object is laid out by itself.
    """
    *items, last = part.items
    assert isinstance(last, Part)
    start = next(
        (place for place, item in enumerate(last.items) if layout.is_word(item, "{")), len(last.items)
    )
    head = Part(last.kind, last.items[:start], last.first, last.last)
    chain = grouped(layout.row([*items, head], lines=_ARROWS))
    if start == len(last.items):
        return chain
    values = last.items[start:]
    return joined((chain, layout.between(first_of(values[0])), grouped(layout.block(values))))


def _alternatives(layout: Layout, part: Part) -> Document:
    """Return the layout document of `a | b`, broken before each `|`; its blocks are all on one line or all on more."""
    if any(isinstance(item, Part) and item.kind == "block" for item in part.items):
        return _nested(layout, part)
    found: list[Document] = []
    for place, item in enumerate(part.items):
        first = first_of(item)
        if place:
            found.append(layout.between(first, LINE if layout.is_word(item, "|") else None))
        found.append(layout.item(item))
    return grouped(layout.item(part.items[0]), indented(*found[1:]))


def _listed(layout: Layout, part: Part) -> Document:
    """Return the layout document of comma-separated items without brackets, with as many items on a line as fit."""
    found = [layout.item(part.items[0])]
    for before, item in pairwise(part.items):
        if layout.is_word(before, ","):
            found.append(grouped(indented(layout.between(first_of(item), LINE)), layout.item(item)))
        else:
            found += [layout.between(first_of(item)), layout.item(item)]
    return joined(found)


def _legend(layout: Layout, part: Part) -> Document:
    """Return the layout document of `legend a = A, b = B`; the author's line breaks are kept, and lines are aligned."""
    first, *rest = part.items
    assert isinstance(first, int)
    found: list[Document] = [layout.item(rest[0])]
    for before, item in pairwise(rest):
        start = first_of(item)
        if not layout.is_word(before, ",") or layout.is_word(item, ";"):
            found += [layout.between(start, NOTHING), layout.item(item)]
        elif layout.ends_line(start):
            found += [layout.between(start, HARD), layout.item(item)]
        else:
            found.append(grouped(layout.between(start, LINE), layout.item(item)))
    word = layout.tokens.words[first]
    return joined(
        (layout.word(first), layout.between(first + 1), indented(*found, columns=len(word) + 1)),
    )


def _definition(layout: Layout, part: Part) -> Document:
    """Return the layout document of a definition: its annotations, then the definition itself."""
    notes = [item for item in part.items if isinstance(item, Part) and item.kind == "annotation"]
    rest = part.items[len(notes) :]
    if not notes:
        return _body(layout, part, rest)
    found: list[Document] = []
    for place, note in enumerate(notes):
        found += [_after_note(layout, note.first)] if place else []
        found.append(layout.part(note))
    return joined((*found, _after_note(layout, first_of(rest[0]), last=True), _body(layout, part, rest)))


def _after_note(layout: Layout, index: int, last: bool = False) -> Document:
    gap = layout.tokens.gaps[index]
    if gap.remarks:
        return layout.between(index, HARD if gap.ends_line else SPACE)
    if gap.ends_line:
        return HARD
    return joined((Mark("annotation", gap.spaces, always=True), SPACE)) if last else SPACE


def _body(layout: Layout, part: Part, items: Sequence[Item]) -> Document:
    if part.kind == "pattern":
        return _bodies(layout, items)
    return _rule(layout, items) if part.kind == "rule" else layout.row(items)


def _bodies(layout: Layout, items: Sequence[Item]) -> Document:
    """Return the layout document of a pattern: either all of its bodies are on one line, or each is on several."""
    found: list[Document] = []
    for place, item in enumerate(items):
        found += [layout.between(first_of(item))] if place else []
        if isinstance(item, Part) and item.kind == "body":
            found.append(_open_block(layout, item))
        else:
            found.append(layout.item(item))
    return grouped(*found)


def _open_block(layout: Layout, part: Part) -> Document:
    """Return the layout document of a pattern's body; the group around all bodies decides where lines end."""
    start = _place(layout, part.items, "{")
    head = [layout.row(part.items[:start]), layout.between(first_of(part.items[start]))] if start else []
    return joined((*head, layout.block(part.items[start:])))


def _place(layout: Layout, items: Sequence[Item], word: str) -> int:
    """Return the index of the first item that is the token `word`."""
    return next(place for place, item in enumerate(items) if layout.is_word(item, word))


def _rule(layout: Layout, items: Sequence[Item]) -> Document:
    """Return the layout document of a rule; one-line rules below each other may be aligned in columns."""
    start = _place(layout, items, "{")
    opening = first_of(items[start])
    mark = Mark("rule", layout.tokens.gaps[opening].spaces)
    block = grouped(mark, layout.between(opening), layout.block(items[start:], "rule"))
    return joined((layout.row(items[:start]), block))


def _nested(layout: Layout, part: Part) -> Document:
    """Return the layout document of `try`, `if` or the like: either all of its blocks are on one line, or none is."""
    return grouped(_blocks(layout, part))


def _blocks(layout: Layout, part: Part) -> Document:
    found: list[Document] = []
    for place, item in enumerate(part.items):
        found += [layout.between(first_of(item))] if place else []
        if isinstance(item, Part) and item.kind == "block":
            found.append(layout.block(item.items))
        elif isinstance(item, Part) and item.kind == "if":
            found.append(_blocks(layout, item))
        else:
            found.append(layout.item(item))
    return joined(found)


def _clause(layout: Layout, part: Part) -> Document:
    """Return the document of an `action`, `on` or similar clause; effects that do not fit get lines of their own."""
    mark = "on" if part.kind == "on" else ""
    if part.kind != "action":
        return grouped(layout.row(part.items, lines=_EFFECTS, mark=mark))
    place = _place(layout, part.items, "=")
    equals = first_of(part.items[place])
    return grouped(
        layout.row(part.items[:place]),
        Mark("action", layout.tokens.gaps[equals].spaces),
        layout.between(equals),
        layout.row(part.items[place:], lines=_EFFECTS),
    )


def _rows(layout: Layout, part: Part) -> Document:
    """Return the layout document of the letters of a grid, with one row on each line."""
    place = next(i for i in part.items if isinstance(i, int) and i > part.first)
    if layout.tokens.kinds[place] != "TEXT":
        return layout.plain(part)
    lines = layout.tokens.words[place][3:-3].split("\n")
    if len(lines) < 2 or lines[0].strip() or lines[-1].strip():
        return layout.plain(part)
    letters = lines[1:-1]
    shared = min((len(row) - len(row.lstrip()) for row in letters if row.strip()), default=0)
    found: list[Document] = []
    for row in letters:
        found += [HARD, Text(row[shared:].rstrip())]
    text = joined((Text('"""'), indented(*found, HARD, Text('"""'))))
    rest = part.items[part.items.index(place) + 1 :]
    return joined(
        (layout.row(part.items[: -len(rest) - 1]), layout.between(place), text, *map(layout.item, rest))
    )


def _line(layout: Layout, part: Part) -> Document:
    """Return the layout document of a line of a table, whose values may be aligned in columns with other lines."""
    found: list[Document] = []
    for place, item in enumerate(part.items):
        first = first_of(item)
        if place and (
            layout.is_word(part.items[place - 1], ",") or layout.is_word(part.items[place - 1], ":")
        ):
            found.append(Mark("table", layout.tokens.gaps[first].spaces, always=True))
        found += [layout.between(first)] if place else []
        found.append(layout.item(item))
    return joined(found)


CONSTRUCTS: Final[Mapping[str, Callable[[Layout, Part], Document]]] = {
    **dict.fromkeys(
        ("header", "enum", "class", "attribute", "reference", "pattern", "rule", "unit", "derivation", "environment"),
        _definition,
    ),
    **dict.fromkeys(CHAINS, Layout.chain),
    **dict.fromkeys(("set", "assignment"), _assignment),
    **dict.fromkeys(("alap", "repeat", "try", "if", "atomic"), _nested),
    **dict.fromkeys(("choice", "branches"), _alternatives),
    **dict.fromkeys(("extends", "tokens"), _listed),
    **dict.fromkeys(
        ("action", "each", "on", "reset", "observation", "draw_grid", "draw_graph"), _clause
    ),
    "graph": _graph,
    "legend": _legend,
    "rows": _rows,
    "line": _line,
}  # fmt: skip
"""By kind of part: the function that lays it out. Parts of other kinds are laid out in one row."""
