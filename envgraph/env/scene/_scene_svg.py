"""Render scenes as SVG, for reports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.draw import INK, Colour, blend, escape_markup, format_colour, ink_on, parse_colour
from envgraph.env.scene._graph_layout import (
    STYLE,
    Point,
    arrow_head_corners,
    label_position,
    layout_graph,
    placeless_token_positions,
    token_positions,
)
from envgraph.env.scene._scene import EMPTY, DrawnObjects, GraphScene, GridScene, Mark, Scene
from envgraph.env.scene._text import scene_title

_HALO = ' stroke="#ffffff" stroke-width="0.12" stroke-linejoin="round" aria-hidden="true"'
"""The style of a white outline behind a text, which makes it readable above lines."""


def scene_svg(scene: Scene, cell: int = 32, objects: DrawnObjects | None = None) -> str:
    """Render a scene as one `<svg>` element that can be embedded in an HTML page.

    Args:
        scene: the scene.
        cell: side of a cell in CSS pixels.
        objects: the objects that the parts of the scene stand for, whose ids are written as attributes `data-object`.
    """
    known = objects or DrawnObjects(())
    if isinstance(scene, GridScene):
        width, height, parts = float(scene.width), float(scene.height), list(_draw_grid(scene, known))
    else:
        layout = layout_graph(scene, STYLE.letter)
        width, height, parts = layout.width, layout.height, list(_draw_graph(scene, known))
    if scene.aside is not None:
        for number, (mark, (x, y), radius) in enumerate(placeless_token_positions(scene, width)):
            parts.extend(_draw_token(mark, (x, height + y), radius, _reference(known.aside, number)))
        height += 1.0
    title = escape_markup(scene_title(scene))
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_format_number(width)} {_format_number(height)}" '
        f'width="{_format_number(width * cell)}" height="{_format_number(height * cell)}" role="img" '
        f'aria-label="{title}" font-family="ui-monospace, monospace" text-anchor="middle">\n<title>{title}</title>'
    )
    return "\n".join([head, *parts, "</svg>"])


def _format_number(number: float) -> str:
    return f"{number:.3f}".rstrip("0").rstrip(".")


def _reference(ids: Sequence[int | None], number: int) -> str:
    """Return the attribute that names the object of a part of the picture; "" if it stands for no object."""
    found = ids[number] if ids else None
    return "" if found is None else f' data-object="{found}"'


def _draw_grid(scene: GridScene, objects: DrawnObjects) -> Iterator[str]:
    below = {mark.place for mark in scene.marks}
    for position, kind in enumerate(scene.cells):
        if kind == EMPTY:
            continue
        row, column = divmod(position, scene.width)
        glyph = scene.glyphs[kind]
        colour = parse_colour(glyph.colour)
        yield (
            f'<rect x="{column}" y="{row}" width="1" height="1" fill="{escape_markup(glyph.colour)}" '
            f'stroke="{format_colour(blend(colour, INK, 0.16))}" stroke-width="0.03"'
            f"{_reference(objects.cells, position)}/>"
        )
        if (column, row) not in below:
            yield _draw_text((column + 0.5, row + 0.5), glyph.letter, 0.5, ink_on(colour, 0.62))
    for number, (mark, (dx, dy), radius) in enumerate(token_positions(scene.marks)):
        at = mark.place[0] + 0.5 + dx, mark.place[1] + 0.5 + dy
        yield from _draw_token(mark, at, radius, _reference(objects.marks, number))


def _draw_text(at: Point, text: str, size: float, colour: Colour, style: str = "") -> str:
    # The middle of a letter is about a third of its size above its base line. `dominant-baseline` would be exact, but
    # many viewers other than browsers ignore it.
    place = f'x="{_format_number(at[0])}" y="{_format_number(at[1] + size * 0.35)}" font-size="{_format_number(size)}"'
    return f'<text {place} fill="{format_colour(colour)}"{style}>{escape_markup(text)}</text>'


def _draw_token(mark: Mark, at: Point, radius: float, reference: str) -> Iterator[str]:
    yield (
        f'<circle cx="{_format_number(at[0])}" cy="{_format_number(at[1])}" r="{_format_number(radius)}" '
        f'fill="{escape_markup(mark.colour)}" '
        f'stroke="#ffffff" stroke-width="0.05"{reference}><title>{escape_markup(mark.name)}</title></circle>'
    )
    yield _draw_text(at, mark.letter, radius * 1.3, ink_on(parse_colour(mark.colour)))


def _draw_graph(scene: GraphScene, objects: DrawnObjects) -> Iterator[str]:
    layout = layout_graph(scene, STYLE.letter)
    yield f'<rect width="{_format_number(layout.width)}" height="{_format_number(layout.height)}" fill="#ffffff"/>'
    for number, (edge, line) in enumerate(layout.edges):
        broken = ' stroke-dasharray="0.18 0.14"' if edge.kind else ""
        one, other = arrow_head_corners(line[-2], line[-1], 0.22)
        ends = f"{scene.labels[edge.source]} to {scene.labels[edge.target]}"
        title = ", ".join(text for text in (ends, edge.label, edge.kind) if text)
        yield (
            f'<g fill="none" stroke="{escape_markup(edge.colour)}" stroke-width="0.05" stroke-linecap="round"'
            f"{_reference(objects.edges, number)}>"
            f"<title>{escape_markup(title)}</title>"
            f'<path d="{_path_data(line)}"{broken}/><path d="{_path_data((one, line[-1], other))}"/></g>'
        )
    for edge, line in layout.edges:
        if edge.label:
            at = label_position(line)
            yield _draw_text(at, edge.label, 0.3, parse_colour("#ffffff"), _HALO)
            yield _draw_text(at, edge.label, 0.3, INK)
    below = {mark.place[0] for mark in scene.marks}
    for number, (at, glyph) in enumerate(zip(layout.nodes, scene.glyphs, strict=True)):
        colour = parse_colour(glyph.colour)
        yield (
            f'<circle cx="{_format_number(at[0])}" cy="{_format_number(at[1])}" '
            f'r="{_format_number(STYLE.node_radius)}" fill="{escape_markup(glyph.colour)}" '
            f'stroke="{format_colour(blend(colour, INK, 0.3))}" stroke-width="0.05"'
            f"{_reference(objects.cells, number)}/>"
        )
        if number not in below:
            yield _draw_text(at, glyph.letter, 0.5, ink_on(colour, 0.62))
    for at, label in zip(layout.labels, layout.names, strict=True):
        yield _draw_text(at, label, 0.32, INK)
    for number, (mark, (dx, dy), radius) in enumerate(token_positions(scene.marks)):
        x, y = layout.nodes[mark.place[0]]
        yield from _draw_token(mark, (x + dx, y + dy), radius * 0.9, _reference(objects.marks, number))


def _path_data(points: Sequence[Point]) -> str:
    return "M" + " L".join(f"{_format_number(x)} {_format_number(y)}" for x, y in points)
