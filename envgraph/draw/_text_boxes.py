"""Draw pictures as text: boxes of characters, in which each line to another box is listed by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from textwrap import wrap

from envgraph.draw._box_layout import text_columns
from envgraph.draw._diagram_data import STYLE, Diagram


def draw_text(picture: Diagram) -> str:
    """Return the picture as text: rows of boxes, each with the edges that start from it, and the note below them."""
    titles = {node.key: node.title for node in picture.nodes}
    links: dict[str, dict[str, list[str]]] = {node.key: {} for node in picture.nodes}
    for edge in picture.edges:
        links[edge.source].setdefault(edge.label, []).append(titles[edge.target])
    boxes = [
        _box_lines(
            node.title,
            [
                *(f"«{mark}»" for mark in node.highlight_names or ()),
                *node.lines,
                *_link_lines(links[node.key]),
            ],
        )
        for node in picture.nodes
    ]
    lines = [line for row in _box_rows(boxes) for line in _join_row(row)]
    return "\n".join([*lines, *([picture.note] if picture.note else [])])


def _link_lines(targets: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield lines such as "next -> two, three" for a box: each edge label with the titles of its targets, wrapped."""
    for label, ends in targets.items():
        yield from wrap(f"{label} -> {', '.join(ends)}".lstrip(), STYLE.targets, subsequent_indent="  ")


def _box_lines(title: str, lines: list[str]) -> list[str]:
    """Return the text lines of a box with a title and `lines` below it, all of the same width."""
    width = max(map(text_columns, (title, *lines)))

    def row(text: str) -> str:
        return f"│ {text}{' ' * (width - text_columns(text))} │"

    rule = "─" * (width + 2)
    below = [f"├{rule}┤", *map(row, lines)] if lines else []
    return [f"┌{rule}┐", row(title), *below, f"└{rule}┘"]


def _box_rows(boxes: list[list[str]]) -> Iterator[list[list[str]]]:
    """Yield lists of consecutive boxes that fit side by side into 100 columns; a wider box is alone in its list."""
    row: list[list[str]] = []
    used = 0
    for box in boxes:
        width = text_columns(box[0]) + 1
        if row and used + width > STYLE.columns:
            yield row
            row, used = [], 0
        row.append(box)
        used += width
    if row:
        yield row


def _join_row(boxes: list[list[str]]) -> Iterator[str]:
    for number in range(max(map(len, boxes))):
        parts = (box[number] if number < len(box) else " " * text_columns(box[0]) for box in boxes)
        yield " ".join(parts).rstrip()
