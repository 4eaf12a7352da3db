"""Render scenes as arrays of pixels, with NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import hypot

import numpy as np
from numpy.typing import NDArray

from envgraph.draw import INK, PAPER, Colour, blend, ink_on, parse_colour
from envgraph.env.scene._canvas import Canvas
from envgraph.env.scene._font import ADVANCE, HEIGHT
from envgraph.env.scene._graph_layout import (
    STYLE,
    Point,
    arrow_head_corners,
    label_position,
    layout_graph,
    placeless_token_positions,
    point_between,
    token_positions,
)
from envgraph.env.scene._scene import EMPTY, GraphScene, GridScene, Mark, Scene
from envgraph.errors import LIMITS, InvalidArgument


def scene_rgb(scene: Scene, cell: int = 32) -> NDArray[np.uint8]:
    """Render a scene as an array of pixels.

    Args:
        scene: the scene.
        cell: side of a cell in pixels, >= 1; letters are readable from 16.

    Returns:
        uint8 [height, width, 3].

    Raises:
        InvalidArgument: `cell` is not positive, or the picture would have more than 64 million pixels.
    """
    if cell < 1:
        raise InvalidArgument(f"`cell` is {cell}, but must be at least 1 pixel")
    return _draw_grid(scene, cell) if isinstance(scene, GridScene) else _draw_graph(scene, cell)


def _new_canvas(width: float, height: float) -> Canvas:
    if width * height > LIMITS["pixels"]:
        raise InvalidArgument(f"a picture of {width:.0f} x {height:.0f} pixels is too large: use smaller cells")
    return Canvas(max(1, round(width)), max(1, round(height)))


def _font_scale(cell: int) -> int:
    """Return the pixels for each pixel of the font, so that a letter fills almost half of a cell's height."""
    return max(1, round(cell * 0.45 / HEIGHT))


def _draw_grid(scene: GridScene, cell: int) -> NDArray[np.uint8]:
    canvas = _new_canvas(scene.width * cell, (scene.height + (scene.aside is not None)) * cell)
    below = {mark.place for mark in scene.marks}
    for position, kind in enumerate(scene.cells):
        if kind != EMPTY:
            row, column = divmod(position, scene.width)
            glyph = scene.glyphs[kind]
            letter = "" if (column, row) in below else glyph.letter
            _draw_tile(canvas, column * cell, row * cell, cell, parse_colour(glyph.colour), letter)
    for mark, (dx, dy), radius in token_positions(scene.marks):
        column, row = mark.place
        _draw_token(canvas, mark, ((column + 0.5 + dx) * cell, (row + 0.5 + dy) * cell), radius * cell, cell)
    _draw_placeless_tokens(canvas, scene, scene.width, scene.height, cell)
    return canvas.to_array()


def _draw_placeless_tokens(canvas: Canvas, scene: Scene, width: float, height: float, cell: int) -> None:
    for mark, (x, y), radius in placeless_token_positions(scene, width):
        _draw_token(canvas, mark, (x * cell, (height + y) * cell), radius * cell, cell)


def _draw_tile(canvas: Canvas, left: int, top: int, cell: int, colour: Colour, letter: str) -> None:
    canvas.fill_rectangle(left, top, cell, cell, colour)
    if cell >= 8:  # lighter edges above and left, darker ones below and right, separate tiles of one colour
        canvas.fill_rectangle(left, top, cell, 1, blend(colour, PAPER, 0.35))
        canvas.fill_rectangle(left, top, 1, cell, blend(colour, PAPER, 0.35))
        canvas.fill_rectangle(left, top + cell - 1, cell, 1, blend(colour, INK, 0.16))
        canvas.fill_rectangle(left + cell - 1, top, 1, cell, blend(colour, INK, 0.16))
    if cell >= 12:
        middle = cell / 2
        canvas.draw_text(left + middle, top + middle, letter, _font_scale(cell), ink_on(colour, 0.62))


def _draw_token(canvas: Canvas, mark: Mark, at: Point, radius: float, cell: int) -> None:
    colour = parse_colour(mark.colour)
    x, y = at
    canvas.fill_disc(x, y, radius + max(1.0, cell / 20), PAPER)
    canvas.fill_disc(x, y, radius, colour)
    scale = max(1, int(radius * 1.5 / HEIGHT))
    if radius >= 5:
        canvas.draw_text(x, y, mark.letter, scale, ink_on(colour))


def _draw_graph(scene: GraphScene, cell: int) -> NDArray[np.uint8]:
    small = max(1, _font_scale(cell) // 2)
    layout = layout_graph(scene, ADVANCE * small / cell)
    canvas = _new_canvas(layout.width * cell, (layout.height + (scene.aside is not None)) * cell)
    for edge, line in layout.edges:
        _draw_arrow(canvas, line, cell, parse_colour(edge.colour), bool(edge.kind))
    for edge, line in layout.edges:
        if edge.label:
            x, y = label_position(line)
            canvas.draw_label(x * cell, y * cell, edge.label, small, INK)
    below = {mark.place[0] for mark in scene.marks}
    for number, ((x, y), glyph) in enumerate(zip(layout.nodes, scene.glyphs, strict=True)):
        colour = parse_colour(glyph.colour)
        canvas.fill_disc(x * cell, y * cell, STYLE.node_radius * cell, blend(colour, INK, 0.3))
        canvas.fill_disc(x * cell, y * cell, STYLE.node_radius * cell - max(1.0, cell / 24), colour)
        if number not in below:
            canvas.draw_text(x * cell, y * cell, glyph.letter, _font_scale(cell), ink_on(colour, 0.62))
    for (x, y), label in zip(layout.labels, layout.names, strict=True):
        canvas.draw_text(x * cell, y * cell, label, small, INK)
    for mark, (dx, dy), radius in token_positions(scene.marks):
        x, y = layout.nodes[mark.place[0]]
        _draw_token(canvas, mark, ((x + dx) * cell, (y + dy) * cell), radius * cell * 0.9, cell)
    _draw_placeless_tokens(canvas, scene, layout.width, layout.height, cell)
    return canvas.to_array()


def _draw_arrow(canvas: Canvas, line: Sequence[Point], cell: int, colour: Colour, broken: bool) -> None:
    width = max(1.0, cell / 20)
    start, end = line[0], line[-1]
    points = list(line)
    if broken and len(line) == 2:
        pieces = max(1, round(hypot(end[0] - start[0], end[1] - start[1]) / STYLE.dash))
        points = [point_between(start, end, number / pieces) for number in range(pieces + 1)]
    for one, other in list(pairwise(points))[:: 2 if broken else 1]:
        canvas.draw_line((one[0] * cell, one[1] * cell), (other[0] * cell, other[1] * cell), width, colour)
    tip = end[0] * cell, end[1] * cell
    for x, y in arrow_head_corners(line[-2], end, 0.22):
        canvas.draw_line(tip, (x * cell, y * cell), width, colour)
