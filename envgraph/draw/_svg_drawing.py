"""Draw pictures as SVG, by Graphviz if it is installed, otherwise by functions of this module."""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

from envgraph.draw._box_layout import BoxFrame, head_lines, place_boxes, text_width
from envgraph.draw._diagram_data import (
    INK,
    LINE_COLOUR,
    MARK,
    STYLE,
    Diagram,
    End,
    PictureEdge,
    PictureNode,
    escape_markup,
    text_colour_on,
)
from envgraph.draw._dot import draw_dot, run_graphviz
from envgraph.errors import InvalidArgument

_HALO = 'fill="#ffffff" stroke="#ffffff" stroke-width="3" stroke-linejoin="round" aria-hidden="true"'
"""Attributes of a white copy behind a text, which makes the text readable over lines."""

Point = tuple[float, float]


def draw_svg(picture: Diagram, graphviz: bool | None, timeout: float) -> str:
    """Return the picture as SVG, by Graphviz or, if `graphviz` is False, or None and Graphviz fails, by this module.

    Raise InvalidArgument if `graphviz` is True and Graphviz fails.
    """
    if graphviz is not False:
        found = run_graphviz(draw_dot(picture), timeout)
        if found is not None:
            return found
    if graphviz:
        raise InvalidArgument(
            "Graphviz did not draw the picture: its program `dot` is not on the PATH, failed or took too long; "
            "install Graphviz, raise `timeout`, or pass `graphviz=False`"
        )
    return draw_frames(picture, place_boxes(picture))


def draw_frames(picture: Diagram, frames: dict[str, BoxFrame]) -> str:
    """Return SVG with the boxes at the given positions, and the lines between them."""
    border = STYLE.border
    width = max((f.x + f.half_width for f in frames.values()), default=0.0)
    height = max((f.y + f.half_height for f in frames.values()), default=0.0)
    width = max(width, text_width(picture.note)) + 2 * border
    total = height + 2 * border + (STYLE.line if picture.note else 0.0)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{-border:g} {-border:g} {_format_number(width)} '
        f'{_format_number(total)}" '
        f'width="{_format_number(width)}" height="{_format_number(total)}" role="img" '
        'font-family="Helvetica, Arial, sans-serif" '
        f'font-size="11" fill="{INK}" aria-label="{escape_markup(picture_title(picture))}">',
        f"<title>{escape_markup(picture_title(picture))}</title>",
        f'<rect x="{-border:g}" y="{-border:g}" width="{_format_number(width)}" '
        f'height="{_format_number(total)}" fill="#ffffff"/>',
    ]
    for edge, bend in _edge_bends(picture.edges):
        parts.extend(_draw_edge(edge, bend, frames))
    for node in picture.nodes:
        parts.extend(_draw_node(node, frames[node.key]))
    if picture.note:
        parts.append(
            _draw_text(width / 2 - border, height + border + STYLE.line / 2, picture.note, 'text-anchor="middle"')
        )
    return "\n".join([*parts, "</svg>"])


def picture_title(picture: Diagram) -> str:
    """Return a sentence for screen readers: the picture's name, and the numbers of its boxes and lines."""
    boxes, lines = len(picture.nodes), len(picture.edges)
    return f"{picture.name}: {boxes} box{'es' * (boxes != 1)} and {lines} line{'s' * (lines != 1)} between them"


def _format_number(number: float) -> str:
    return f"{round(number, 1) + 0.0:.1f}".removesuffix(".0")  # never "-0"


def _draw_text(x: float, y: float, text: str, style: str) -> str:
    return f'<text x="{_format_number(x)}" y="{_format_number(y)}" dy="0.35em" {style}>{escape_markup(text)}</text>'


def _draw_node(node: PictureNode, frame: BoxFrame) -> Iterator[str]:
    left, top = frame.x - frame.half_width, frame.y - frame.half_height
    stroke = (
        f'stroke="{MARK}" stroke-width="3"' if node.highlight_names is not None else f'stroke="{INK}" stroke-width="1"'
    )
    yield (
        f'<rect x="{_format_number(left)}" y="{_format_number(top)}" width="{_format_number(2 * frame.half_width)}" '
        f'height="{_format_number(2 * frame.half_height)}" fill="{node.fill}" {stroke}/>'
    )
    ink = f'fill="{text_colour_on(node.fill)}"'
    y = top + 4 + STYLE.line / 2
    head = head_lines(node)
    for number, line in enumerate(head):
        bold = ' font-weight="bold"' if number == len(head) - 1 else ""
        slanted = ' font-style="italic"' if not bold or node.is_italic else ""
        yield _draw_text(frame.x, y, line, f'{ink} text-anchor="middle"{bold}{slanted}')
        y += STYLE.line
    if node.lines:
        rule = y - STYLE.line / 2 + 2
        yield (
            f'<line x1="{_format_number(left)}" y1="{_format_number(rule)}" '
            f'x2="{_format_number(frame.x + frame.half_width)}" y2="{_format_number(rule)}" '
            f'stroke="{text_colour_on(node.fill)}" stroke-width="0.5"/>'
        )
    for line in node.lines:
        yield _draw_text(left + 8, y + 3, line, ink)
        y += STYLE.line


def _edge_bends(edges: tuple[PictureEdge, ...]) -> Iterator[tuple[PictureEdge, float]]:
    """Yield each edge with its bend, so that several edges between the same two boxes are drawn apart.

    The bend is the distance of a control point from the straight line in pixels; for a loop, its size 1, 2, ..
    """
    groups: dict[tuple[str, str], list[PictureEdge]] = {}
    for edge in edges:
        one, other = sorted((edge.source, edge.target))
        groups.setdefault((one, other), []).append(edge)
    for (one, _), group in groups.items():
        for number, edge in enumerate(group):
            bend = (number - (len(group) - 1) / 2) * 44.0 if edge.source != edge.target else 1.0 + number
            yield edge, bend if edge.source == one else -bend


def _draw_edge(edge: PictureEdge, bend: float, frames: dict[str, BoxFrame]) -> Iterator[str]:
    source, target = frames[edge.source], frames[edge.target]
    if edge.source == edge.target:
        path, start, end, controls, middle = _loop_path(source, abs(bend))
    else:
        path, start, end, controls, middle = _curve_path(source, target, bend)
    colour = INK if {"diamond", "triangle"} & {edge.tail, edge.head} else LINE_COLOUR
    yield f'<path d="{path}" fill="none" stroke="{colour}"/>'
    yield from _draw_end(edge.tail, start, controls[0], colour)
    yield from _draw_end(edge.head, end, controls[1], colour)
    if edge.label:
        anchor = "start" if edge.source == edge.target else "middle"
        style = f'font-size="9.5" text-anchor="{anchor}"'
        yield _draw_text(*middle, edge.label, f"{style} {_HALO}")
        yield _draw_text(*middle, edge.label, style)


_EdgePath = tuple[str, Point, Point, tuple[Point, Point], Point]
"""The path, its start and end, the control points next to them, and the position of the label."""


def _curve_path(source: BoxFrame, target: BoxFrame, bend: float) -> _EdgePath:
    dx, dy = target.x - source.x, target.y - source.y
    length = max(hypot(dx, dy), 1e-9)
    control = (source.x + target.x) / 2 - dy / length * bend, (source.y + target.y) / 2 + dx / length * bend
    start, end = _border_point(source, control), _border_point(target, control)
    path = _format_path("M", start, "Q", control, end)
    middle = ((start[0] + end[0]) / 4 + control[0] / 2, (start[1] + end[1]) / 4 + control[1] / 2)
    return path, start, end, (control, control), middle


def _loop_path(frame: BoxFrame, size: float) -> _EdgePath:
    x, top = frame.x + frame.half_width, frame.y - frame.half_height
    start, end = (x - 14.0, top), (x, top + 10.0)
    out = 8.0 + 34.0 * size
    one, other = (start[0], top - out), (x + out, end[1])
    path = _format_path("M", start, "C", one, other, end)
    return path, start, end, (one, other), (x + out * 0.375, top - out * 0.375)


def _format_path(*parts: str | Point) -> str:
    return " ".join(
        part if isinstance(part, str) else f"{_format_number(part[0])} {_format_number(part[1])}" for part in parts
    )


def _border_point(frame: BoxFrame, toward: Point) -> Point:
    """Return the point where the line from the center of a box to `toward` leaves the box; `toward` if it is inside."""
    dx, dy = toward[0] - frame.x, toward[1] - frame.y
    share = max(abs(dx) / frame.half_width, abs(dy) / frame.half_height)
    if share <= 1.0:  # the point is inside
        return toward
    return frame.x + dx / share, frame.y + dy / share


def _draw_end(end: End, tip: Point, origin: Point, colour: str) -> Iterator[str]:
    if end == "none":
        return
    dx, dy = tip[0] - origin[0], tip[1] - origin[1]
    length = max(hypot(dx, dy), 1e-9)
    ux, uy = dx / length * 8.0, dy / length * 8.0
    back = (tip[0] - ux, tip[1] - uy)
    (x, y), wide = ((tip[0] - ux / 2, tip[1] - uy / 2), 0.35) if end == "diamond" else (back, 0.4)
    left, right = (x - uy * wide, y + ux * wide), (x + uy * wide, y - ux * wide)
    points = [tip, left, back, right] if end == "diamond" else [tip, left, right]
    fill = "#ffffff" if end == "triangle" else colour
    shape = " ".join(f"{_format_number(x)},{_format_number(y)}" for x, y in points)
    yield f'<polygon points="{shape}" fill="{fill}" stroke="{colour}"/>'
