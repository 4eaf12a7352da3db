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

from envgraph.lang.format._document_builder import CHAIN_KINDS, DocumentBuilder, first_token
from envgraph.lang.format._layout_document import (
    EMPTY_TEXT,
    FORCED_LINE,
    LINE_OR_BLANK,
    SPACE,
    AlignmentMark,
    Document,
    TextDocument,
    group_documents,
    indent_documents,
    join_documents,
)
from envgraph.lang.format._token_table import Item, SyntaxPart

_ARROW_KINDS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})
_EFFECT_KINDS: Final = frozenset({"reward", "other", "apply", "end", "each_object", "visible", "tokens"})


def _assignment_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of `name = value`; a chain of operators that does not fit starts on a new line."""
    value = next((one for one in part.child_parts(*CHAIN_KINDS)), None)
    if value is None:
        return layout.default_document(part)
    place = part.items.index(value)
    return group_documents(
        layout.row_document(part.items[:place]),
        indent_documents(layout.gap_document(value.first, LINE_OR_BLANK), layout.chain_links_document(value)),
        *(document for item in part.items[place + 1 :] for document in (EMPTY_TEXT, layout.item_document(item))),
    )


def _graph_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of `a -ref-> b <-ref- c`, which is broken before the arrows if it does not fit.

    The attribute block of the last object is laid out by itself.
    """
    *items, last = part.items
    assert isinstance(last, SyntaxPart)
    start = next((place for place, item in enumerate(last.items) if layout.is_token(item, "{")), len(last.items))
    head = SyntaxPart(last.kind, last.items[:start], last.first, last.last)
    chain = group_documents(layout.row_document([*items, head], lines=_ARROW_KINDS))
    if start == len(last.items):
        return chain
    values = last.items[start:]
    return join_documents(
        (chain, layout.gap_document(first_token(values[0])), group_documents(layout.block_document(values)))
    )


def _alternatives_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of `a | b`, broken before each `|`; its blocks are all on one line or all on more."""
    if any(isinstance(item, SyntaxPart) and item.kind == "block" for item in part.items):
        return _nested_document(layout, part)
    found: list[Document] = []
    for place, item in enumerate(part.items):
        first = first_token(item)
        if place:
            found.append(layout.gap_document(first, LINE_OR_BLANK if layout.is_token(item, "|") else None))
        found.append(layout.item_document(item))
    return group_documents(layout.item_document(part.items[0]), indent_documents(*found[1:]))


def _list_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of comma-separated items without brackets, with as many items on a line as fit."""
    found = [layout.item_document(part.items[0])]
    for before, item in pairwise(part.items):
        if layout.is_token(before, ","):
            found.append(
                group_documents(
                    indent_documents(layout.gap_document(first_token(item), LINE_OR_BLANK)),
                    layout.item_document(item),
                )
            )
        else:
            found += [layout.gap_document(first_token(item)), layout.item_document(item)]
    return join_documents(found)


def _legend_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of `legend a = A, b = B`; the author's line breaks are kept, and lines are aligned."""
    first, *rest = part.items
    assert isinstance(first, int)
    found: list[Document] = [layout.item_document(rest[0])]
    for before, item in pairwise(rest):
        start = first_token(item)
        if not layout.is_token(before, ",") or layout.is_token(item, ";"):
            found += [layout.gap_document(start, EMPTY_TEXT), layout.item_document(item)]
        elif layout.is_on_new_line(start):
            found += [layout.gap_document(start, FORCED_LINE), layout.item_document(item)]
        else:
            found.append(group_documents(layout.gap_document(start, LINE_OR_BLANK), layout.item_document(item)))
    word = layout.tokens.texts[first]
    return join_documents(
        (
            layout.token_document(first),
            layout.gap_document(first + 1),
            indent_documents(*found, columns=len(word) + 1),
        ),
    )


def _definition_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of a definition: its annotations, then the definition itself."""
    notes = [item for item in part.items if isinstance(item, SyntaxPart) and item.kind == "annotation"]
    rest = part.items[len(notes) :]
    if not notes:
        return _definition_body_document(layout, part, rest)
    found: list[Document] = []
    for place, note in enumerate(notes):
        found += [_annotation_gap_document(layout, note.first)] if place else []
        found.append(layout.part_document(note))
    return join_documents(
        (
            *found,
            _annotation_gap_document(layout, first_token(rest[0]), last=True),
            _definition_body_document(layout, part, rest),
        )
    )


def _annotation_gap_document(layout: DocumentBuilder, index: int, last: bool = False) -> Document:
    gap = layout.tokens.gaps[index]
    if gap.comments:
        return layout.gap_document(index, FORCED_LINE if gap.has_line_break else SPACE)
    if gap.has_line_break:
        return FORCED_LINE
    mark = AlignmentMark("annotation", gap.blanks, counts_in_broken_groups=True)
    return join_documents((mark, SPACE)) if last else SPACE


def _definition_body_document(layout: DocumentBuilder, part: SyntaxPart, items: Sequence[Item]) -> Document:
    if part.kind == "pattern":
        return _pattern_document(layout, items)
    if part.kind == "action":
        return _clause_document(layout, SyntaxPart(part.kind, [*items], first_token(items[0]), part.last))
    return _rule_document(layout, items) if part.kind == "rule" else layout.row_document(items)


def _pattern_document(layout: DocumentBuilder, items: Sequence[Item]) -> Document:
    """Return the layout document of a pattern: either all of its bodies are on one line, or each is on several."""
    found: list[Document] = []
    for place, item in enumerate(items):
        found += [layout.gap_document(first_token(item))] if place else []
        if isinstance(item, SyntaxPart) and item.kind == "body":
            found.append(_pattern_body_document(layout, item))
        else:
            found.append(layout.item_document(item))
    return group_documents(*found)


def _pattern_body_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of a pattern's body; the group around all bodies decides where lines end."""
    start = _index_of_token(layout, part.items, "{")
    head = (
        [layout.row_document(part.items[:start]), layout.gap_document(first_token(part.items[start]))] if start else []
    )
    return join_documents((*head, layout.block_document(part.items[start:])))


def _index_of_token(layout: DocumentBuilder, items: Sequence[Item], word: str) -> int:
    """Return the index of the first item that is the token `word`."""
    return next(place for place, item in enumerate(items) if layout.is_token(item, word))


def _rule_document(layout: DocumentBuilder, items: Sequence[Item]) -> Document:
    """Return the layout document of a rule; one-line rules below each other may be aligned in columns."""
    start = _index_of_token(layout, items, "{")
    opening = first_token(items[start])
    mark = AlignmentMark("rule", layout.tokens.gaps[opening].blanks)
    block = group_documents(mark, layout.gap_document(opening), layout.block_document(items[start:], "rule"))
    return join_documents((layout.row_document(items[:start]), block))


def _nested_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of `try`, `if` or the like: either all of its blocks are on one line, or none is."""
    return group_documents(_blocks_document(layout, part))


def _blocks_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    found: list[Document] = []
    for place, item in enumerate(part.items):
        found += [layout.gap_document(first_token(item))] if place else []
        if isinstance(item, SyntaxPart) and item.kind == "block":
            found.append(layout.block_document(item.items))
        elif isinstance(item, SyntaxPart) and item.kind == "if":
            found.append(_blocks_document(layout, item))
        else:
            found.append(layout.item_document(item))
    return join_documents(found)


def _clause_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the document of an `action`, `on` or similar clause; effects that do not fit get lines of their own."""
    mark = "on" if part.kind == "on" else ""
    if part.kind != "action":
        return group_documents(layout.row_document(part.items, lines=_EFFECT_KINDS, mark=mark))
    place = _index_of_token(layout, part.items, "=")
    equals = first_token(part.items[place])
    return group_documents(
        layout.row_document(part.items[:place]),
        AlignmentMark("action", layout.tokens.gaps[equals].blanks),
        layout.gap_document(equals),
        layout.row_document(part.items[place:], lines=_EFFECT_KINDS),
    )


def _grid_rows_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of the letters of a grid, with one row on each line."""
    place = next(i for i in part.items if isinstance(i, int) and i > part.first)
    if layout.tokens.kinds[place] != "TEXT":
        return layout.default_document(part)
    lines = layout.tokens.texts[place][3:-3].split("\n")
    if len(lines) < 2 or lines[0].strip() or lines[-1].strip():
        return layout.default_document(part)
    letters = lines[1:-1]
    shared = min((len(row) - len(row.lstrip()) for row in letters if row.strip()), default=0)
    found: list[Document] = []
    for row in letters:
        found += [FORCED_LINE, TextDocument(row[shared:].rstrip())]
    text = join_documents((TextDocument('"""'), indent_documents(*found, FORCED_LINE, TextDocument('"""'))))
    rest = part.items[part.items.index(place) + 1 :]
    return join_documents(
        (
            layout.row_document(part.items[: -len(rest) - 1]),
            layout.gap_document(place),
            text,
            *map(layout.item_document, rest),
        )
    )


def _table_line_document(layout: DocumentBuilder, part: SyntaxPart) -> Document:
    """Return the layout document of a line of a table, whose values may be aligned in columns with other lines."""
    found: list[Document] = []
    for place, item in enumerate(part.items):
        first = first_token(item)
        if place and (layout.is_token(part.items[place - 1], ",") or layout.is_token(part.items[place - 1], ":")):
            found.append(AlignmentMark("table", layout.tokens.gaps[first].blanks, counts_in_broken_groups=True))
        found += [layout.gap_document(first)] if place else []
        found.append(layout.item_document(item))
    return join_documents(found)


DOCUMENT_FUNCTIONS: Final[Mapping[str, Callable[[DocumentBuilder, SyntaxPart], Document]]] = {
    **dict.fromkeys(
        ("header", "enum", "class", "attribute", "reference", "pattern", "rule", "unit", "derivation", "environment"),
        _definition_document,
    ),
    **dict.fromkeys(CHAIN_KINDS, DocumentBuilder.chain_document),
    **dict.fromkeys(("set", "assignment"), _assignment_document),
    **dict.fromkeys(("alap", "repeat", "try", "if", "atomic"), _nested_document),
    **dict.fromkeys(("choice", "branches"), _alternatives_document),
    **dict.fromkeys(("extends", "tokens"), _list_document),
    "action": _definition_document,
    **dict.fromkeys(("each", "on", "refused", "reset", "observation", "draw_grid", "draw_graph"), _clause_document),
    "graph": _graph_document,
    "legend": _legend_document,
    "rows": _grid_rows_document,
    "line": _table_line_document,
}  # fmt: skip
"""By kind of part: the function that lays it out. Parts of other kinds are laid out in one row."""
