"""Compute positions of boxes without Graphviz: a spring layout spreads them, and overlapping boxes are moved apart.

networkx computes the spring layout. Without networkx, as in a browser, Python code computes another one.
"""

from __future__ import annotations

from cmath import exp, pi
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import combinations
from unicodedata import east_asian_width

from envgraph.code import dataclass
from envgraph.draw._diagram_data import STYLE, Diagram, PictureNode


@dataclass(slots=True)
class BoxFrame:
    """The position of a box in CSS pixels: its center, and half of its width and height."""

    x: float
    y: float
    half_width: float
    half_height: float


def text_columns(text: str) -> int:
    """Return the number of terminal columns that a text takes; wide characters take two."""
    return sum(2 if east_asian_width(letter) in "WF" else 1 for letter in text)


def text_width(text: str) -> float:
    """Return the approximate width of a text in pixels."""
    return text_columns(text) * STYLE.letter


def head_lines(node: PictureNode) -> list[str]:
    """Return the lines in the upper part of a box: its marks, its stereotype in «», and its title."""
    stereotype = [f"«{node.stereotype}»"] if node.stereotype else []
    return [*(node.highlight_names or ()), *stereotype, node.title]


def place_boxes(picture: Diagram) -> dict[str, BoxFrame]:
    """Return the frame of each box by its key, at nonnegative coordinates, after overlapping boxes were moved apart.

    If boxes have positions, these are multiplied by the size of the largest such box. Any other box is put beside the
    positioned boxes linked to it, or at the left if it is linked to none or to more than 4 of them. If no box has a
    position, each connected part is laid out by itself, and the parts are put into rows.
    """
    frames = {node.key: _frame_at_origin(node) for node in picture.nodes}
    label = max((text_width(edge.label) for edge in picture.edges), default=0.0)
    gap = min(STYLE.gap + label, STYLE.widest_gap)
    if any(node.place is not None for node in picture.nodes):
        _place_pinned(picture, frames, gap)
        return _move_to_origin(frames, frames)
    right = top = bottom = 0.0
    for part in _connected_parts(picture):
        _lay_out_part(picture, part, frames, gap)
        _move_to_origin(frames, part)
        width = max(frames[key].x + frames[key].half_width for key in part)
        if right and right + width > STYLE.row:
            right, top = 0.0, bottom + STYLE.gap
        for key in part:
            frames[key].x += right
            frames[key].y += top
            bottom = max(bottom, frames[key].y + frames[key].half_height)
        right += width + STYLE.gap
    return frames


def _frame_at_origin(node: PictureNode) -> BoxFrame:
    head = head_lines(node)
    width = max(text_width(line) for line in (*head, *node.lines))
    return BoxFrame(0.0, 0.0, width / 2 + 8, (len(head) + len(node.lines)) * STYLE.line / 2 + (6 if node.lines else 4))


def _move_to_origin(frames: dict[str, BoxFrame], keys: Sequence[str] | dict[str, BoxFrame]) -> dict[str, BoxFrame]:
    left = min((frames[key].x - frames[key].half_width for key in keys), default=0.0)
    top = min((frames[key].y - frames[key].half_height for key in keys), default=0.0)
    for key in keys:
        frames[key].x -= left
        frames[key].y -= top
    return frames


def _connected_parts(picture: Diagram) -> list[list[str]]:
    """Return the connected parts of the picture as lists of keys, the largest first, then in the order of the boxes."""
    above = {node.key: node.key for node in picture.nodes}

    def root(key: str) -> str:
        while above[key] != key:
            above[key] = key = above[above[key]]
        return key

    for edge in picture.edges:
        above[root(edge.target)] = root(edge.source)
    parts: dict[str, list[str]] = {}
    for node in picture.nodes:
        parts.setdefault(root(node.key), []).append(node.key)
    return sorted(parts.values(), key=len, reverse=True)


def _lay_out_part(picture: Diagram, part: list[str], frames: dict[str, BoxFrame], gap: float) -> None:
    """Set the frames of one connected part by a spring layout along its edges; leave a single box at its position."""
    if len(part) == 1:
        return
    inside, joined = set(part), dict[frozenset[str], tuple[str, str]]()
    for edge in picture.edges:
        if edge.source in inside and edge.source != edge.target:
            joined.setdefault(frozenset((edge.source, edge.target)), (edge.source, edge.target))
    has_networkx = find_spec("networkx") and find_spec("numpy")  # which it needs for this
    places = (_spring_layout if has_networkx else _python_spring_layout)(part, [*joined.values()])
    wide = max(2 * frames[key].half_width for key in part) + gap
    high = max(2 * frames[key].half_height for key in part) + gap
    lengths = sorted(abs(places[a] - places[b]) for a, b in joined.values())
    step = max(lengths[len(lengths) // 2], 1e-6)
    for key in part:
        frames[key].x = places[key].real / step * (wide + high) / 2
        frames[key].y = places[key].imag / step * (wide + high) / 2
    _push_apart([frames[key] for key in part])


def _spring_layout(part: Sequence[str], edges: Sequence[tuple[str, str]]) -> dict[str, complex]:
    """Return the places of connected boxes."""
    import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(part)
    graph.add_edges_from(edges)
    begin = nx.spectral_layout(graph) if len(part) > 3 else nx.circular_layout(graph)
    # A spring layout cannot separate boxes at equal positions, which the spectral layout gives to equal leaves.
    begin = {
        key: (x + 1e-3 * (number % 7), y + 1e-3 * (number % 11)) for number, (key, (x, y)) in enumerate(begin.items())
    }
    places = nx.spring_layout(graph, pos=begin, iterations=100, seed=1)
    return {key: complex(float(x), float(y)) for key, (x, y) in places.items()}


def _python_spring_layout(part: Sequence[str], edges: Sequence[tuple[str, str]]) -> dict[str, complex]:
    """Return the places of connected boxes, without networkx (Fruchterman and Reingold 1991, figure 1)."""
    count, rounds = len(part), 50
    ideal = count**-0.5
    places = {key: exp(2j * pi * number / count) / 2 for number, key in enumerate(part)}
    for turn in range(rounds):
        moves = dict.fromkeys(part, 0j)
        for first, second in combinations(part, 2):
            apart = places[first] - places[second]
            push = apart * (ideal / max(abs(apart), 1e-3)) ** 2
            moves[first] += push
            moves[second] -= push
        for first, second in edges:
            apart = places[first] - places[second]
            pull = apart * abs(apart) / ideal
            moves[first] -= pull
            moves[second] += pull
        furthest = 0.1 * (1 - turn / rounds)
        for key, move in moves.items():
            places[key] += move * min(1.0, furthest / max(abs(move), 1e-9))
    return places


def _place_pinned(picture: Diagram, frames: dict[str, BoxFrame], gap: float) -> None:
    placed = {node.key: node.place for node in picture.nodes if node.place is not None}
    wide = max(2 * frames[key].half_width for key in placed) + gap
    high = max(2 * frames[key].half_height for key in placed) + STYLE.gap
    for key, (x, y) in placed.items():
        frames[key].x, frames[key].y = x * wide, y * high
    edge_of_all = min(frames[key].x for key in placed) - wide
    top = min(frames[key].y for key in placed)
    for number, node in enumerate(node for node in picture.nodes if node.place is None):
        near = [
            frames[other]
            for edge in picture.edges
            for one, other in ((edge.source, edge.target), (edge.target, edge.source))
            if one == node.key and other in placed
        ]
        frame = frames[node.key]
        if 0 < len(near) <= 4:
            frame.x = sum(other.x for other in near) / len(near) + wide / 2
            frame.y = sum(other.y for other in near) / len(near) + high / 2
        else:
            frame.x, frame.y = edge_of_all, top + number * high
    _push_apart(list(frames.values()))


def _push_apart(frames: list[BoxFrame]) -> None:
    """Move overlapping boxes apart along the shorter side of each overlap, in at most 300 rounds."""
    widest = 2 * max((frame.half_width for frame in frames), default=0.0) + STYLE.gap / 2
    for _ in range(STYLE.rounds):
        moved = False
        row = sorted(frames, key=lambda frame: frame.x)
        for number, one in enumerate(row):
            for other in row[number + 1 :]:
                if other.x - one.x > 2 * widest:  # twice the width, because boxes move during the loop
                    break
                moved = _separate(one, other) or moved
        if not moved:
            return


def _separate(first: BoxFrame, second: BoxFrame) -> bool:
    """Move two boxes apart if they overlap or are closer than 15 pixels; return True if they were moved."""
    across = first.half_width + second.half_width + STYLE.gap / 2 - abs(first.x - second.x)
    along = first.half_height + second.half_height + STYLE.gap / 2 - abs(first.y - second.y)
    if across <= 1e-6 or along <= 1e-6:
        return False
    if across < along:
        shift = across / 2 + 1e-3 if first.x <= second.x else -across / 2 - 1e-3
        first.x, second.x = first.x - shift, second.x + shift
    else:
        shift = along / 2 + 1e-3 if first.y <= second.y else -along / 2 - 1e-3
        first.y, second.y = first.y - shift, second.y + shift
    return True
