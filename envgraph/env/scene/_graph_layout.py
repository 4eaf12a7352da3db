"""Compute the positions of the parts of a scene, for pixels and SVG, in units of cells: x to the right, y down."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from math import cos, hypot, pi, sin
from typing import Final

from envgraph.code import dataclass
from envgraph.draw import shorten
from envgraph.env.scene._scene import Edge, GraphScene, Mark, Scene
from envgraph.errors import escape_unprintable


@dataclass(frozen=True, slots=True)
class SceneStyle:
    """The sizes of pictures of graphs, in units of cells."""

    node_radius: float = 0.42
    spacing: float = 2.4  # between nodes
    least_radius: float = 1.6  # of the circle of nodes, also of a single one: members of a family have equal sizes
    edge_labels: float = 3.4  # least distance of nodes if edges between them have labels
    label_share: float = 0.76  # of an edge before its label: near the end, away from that of the opposite edge
    label_gap: float = 0.42 + 0.32  # between the middle of a node and its label
    longest: int = 24  # letters of a label; a longer one is shortened
    letter: float = 0.2  # width of a letter in SVG
    edge_shift: float = 0.13  # of an edge from the line between its nodes
    bend: float = 0.3  # distance between the middles of edges that join the same two nodes
    pieces: int = 16  # straight lines of a curve
    dash: float = 0.22  # length of a dash, and of the gap after it


STYLE: Final = SceneStyle()
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class GraphLayout:
    """The positions of the parts of a graph.

    Attributes:
        nodes, labels: the centre of every node and of its label.
        names: the labels, shortened where they are long.
        edges: each edge with its points from start to end: two, or more for a curve.
    """

    width: float
    height: float
    nodes: tuple[Point, ...]
    labels: tuple[Point, ...]
    names: tuple[str, ...]
    edges: tuple[tuple[Edge, tuple[Point, ...]], ...]


def layout_graph(scene: GraphScene, letter_width: float) -> GraphLayout:
    """Place the nodes clockwise on a circle, the first at the top, with labels outside, where no edge crosses them.

    Args:
        scene: the graph.
        letter_width: width of a letter of a label.
    """
    count = len(scene.labels)
    names = tuple(shorten(escape_unprintable(label), STYLE.longest) for label in scene.labels)
    longest = max(map(len, names), default=0) * letter_width
    spacing = max(STYLE.spacing, longest + 0.3, *(STYLE.edge_labels * bool(edge.label) for edge in scene.edges))
    radius = STYLE.least_radius if count < 2 else max(STYLE.least_radius, spacing / (2 * sin(pi / count)))
    side = STYLE.label_gap + longest + 0.1
    rise = STYLE.label_gap + 0.3
    width, height = 2 * (radius + side), 2 * (radius + rise)
    angles = [2 * pi * number / max(count, 1) - pi / 2 for number in range(count)]
    radius = 0.0 if count < 2 else radius
    nodes = tuple((width / 2 + radius * cos(a), height / 2 + radius * sin(a)) for a in angles)
    labels = tuple(
        (
            x + cos(angle) * (STYLE.label_gap + len(label) * letter_width / 2),
            y + sin(angle) * STYLE.label_gap,
        )
        for (x, y), angle, label in zip(nodes, angles, names, strict=True)
    )
    seen: Counter[tuple[int, int]] = Counter()
    edges: list[tuple[Edge, tuple[Point, ...]]] = []
    for edge in scene.edges:
        ends = edge.source, edge.target
        if edge.source == edge.target:
            edges.append((edge, _loop_points(nodes[edge.source], angles[edge.source] + pi / 2, seen[ends])))
        else:
            edges.append((edge, _curve_points(*_edge_ends(nodes[edge.source], nodes[edge.target]), seen[ends])))
        seen[ends] += 1
    return GraphLayout(width, height, nodes, labels, names, tuple(edges))


def _loop_points(node: Point, angle: float, number: int) -> tuple[Point, ...]:
    """Return the points of a loop at a node, in the direction `angle`; loop `number` encloses those before it."""
    radius = 0.26 + 0.12 * number
    middle = STYLE.node_radius + 0.06 + radius * 0.7
    x, y = node[0] + middle * cos(angle), node[1] + middle * sin(angle)
    turns = [angle - 0.75 * pi + 1.5 * pi * step / STYLE.pieces for step in range(STYLE.pieces + 1)]
    return tuple((x + radius * cos(turn), y + radius * sin(turn)) for turn in turns)


def _curve_points(start: Point, end: Point, number: int) -> tuple[Point, ...]:
    """Return the points of an edge; edge `number` between the same nodes is bent further than those before it."""
    if not number:
        return start, end
    (ax, ay), (bx, by) = start, end
    length = max(hypot(bx - ax, by - ay), 1e-9)
    side_x, side_y = -(by - ay) / length * STYLE.bend * number, (bx - ax) / length * STYLE.bend * number
    shares = [step / STYLE.pieces for step in range(STYLE.pieces + 1)]
    places = [(point_between(start, end, share), 4 * share * (1 - share)) for share in shares]
    return tuple((x + side_x * bent, y + side_y * bent) for (x, y), bent in places)


def _edge_ends(start: Point, end: Point) -> tuple[Point, Point]:
    """Return the ends of an edge at the rims of its nodes, shifted to the right to keep opposite edges apart."""
    (ax, ay), (bx, by) = start, end
    length = hypot(bx - ax, by - ay)
    ux, uy = (bx - ax) / length, (by - ay) / length
    shift_x, shift_y = -uy * STYLE.edge_shift, ux * STYLE.edge_shift
    gap = STYLE.node_radius + 0.06
    return (
        (ax + ux * gap + shift_x, ay + uy * gap + shift_y),
        (bx - ux * gap + shift_x, by - uy * gap + shift_y),
    )


def label_position(points: Sequence[Point]) -> Point:
    """Return the position of an edge's label: near the end of an edge, half way on a loop."""
    start, end = points[0], points[-1]
    if len(points) == 2:
        return point_between(start, end, STYLE.label_share)
    loop = hypot(end[0] - start[0], end[1] - start[1]) < STYLE.node_radius * 2
    return points[round((0.5 if loop else STYLE.label_share) * STYLE.pieces)]


def point_between(start: Point, end: Point, share: float) -> Point:
    """Return the point on a line at a share (0 to 1) of its length from the start."""
    return start[0] + (end[0] - start[0]) * share, start[1] + (end[1] - start[1]) * share


def arrow_head_corners(start: Point, end: Point, size: float) -> tuple[Point, Point]:
    """Return the two back corners of an arrow head whose tip is `end`."""
    (ax, ay), (bx, by) = start, end
    length = max(hypot(bx - ax, by - ay), 1e-9)
    ux, uy = (bx - ax) / length * size, (by - ay) / length * size
    return (bx - ux - uy * 0.6, by - uy + ux * 0.6), (bx - ux + uy * 0.6, by - uy - ux * 0.6)


def token_positions(marks: Sequence[Mark]) -> list[tuple[Mark, Point, float]]:
    """Return every token with its offset from the middle of its cell or node, and its radius.

    Several tokens on one place are arranged in a ring.
    """
    total = Counter(mark.place for mark in marks)
    seen: Counter[Point] = Counter()
    placed = []
    for mark in marks:
        number, count = seen[mark.place], total[mark.place]
        seen[mark.place] += 1
        if count == 1:
            placed.append((mark, (0.0, 0.0), 0.34))
        else:
            angle = 2 * pi * number / count + pi / 4 * 3
            placed.append((mark, (0.22 * cos(angle), 0.22 * sin(angle)), 0.22))
    return placed


def placeless_token_positions(scene: Scene, width: float) -> list[tuple[Mark, Point, float]]:
    """Return every token without a place, with its position in a row below a picture of this width, and its radius."""
    columns = max(1, int(width))
    marks = [replace(mark, place=(n % columns, 0)) for n, mark in enumerate(scene.aside or ())]
    return [(mark, (mark.place[0] + 0.5 + dx, 0.5 + dy), size) for mark, (dx, dy), size in token_positions(marks)]
