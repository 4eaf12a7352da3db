"""Render scenes as plain text."""

from __future__ import annotations

from envgraph.env.scene._scene import EMPTY, Edge, GraphScene, GridScene, Mark, Scene
from envgraph.errors import SHOWN, escape_unprintable


def scene_text(scene: Scene) -> str:
    """Render a scene as letters without colours. `(R)` is a token on a cell, the last one if there are several.

    With several tokens, or one without a place, lines below the picture give the place of each token.
    """
    lines = _grid_lines(scene) if isinstance(scene, GridScene) else _graph_lines(scene)
    if len(scene.marks) > 1 or scene.aside:
        lines.extend(escape_unprintable(f"{mark.name}: {_format_place(scene, mark)}") for mark in scene.marks)
        lines.extend(escape_unprintable(f"{mark.name}: nowhere") for mark in scene.aside or ())
    return "\n".join(lines)


def scene_title(scene: Scene) -> str:
    """Return a sentence that describes a picture, as a replacement for it in screen readers."""
    if isinstance(scene, GridScene):
        what = f"a grid of {scene.width} by {scene.height} cells"
    else:
        nodes, edges = len(scene.labels), len(scene.edges)
        what = f"a graph of {nodes} node{'s' * (nodes != 1)} and {edges} edge{'s' * (edges != 1)}"
    marks = [f"{mark.name} at {_format_place(scene, mark)}" for mark in scene.marks[: SHOWN.marks]]
    marks = [*marks, *(f"{mark.name} nowhere" for mark in scene.aside or ())][: SHOWN.marks]
    more = len(scene.marks) + len(scene.aside or ()) - len(marks)
    return "; ".join([what, *marks, *([f"{more} more"] if more else [])])


def _format_place(scene: Scene, mark: Mark) -> str:
    if isinstance(scene, GridScene):
        return f"column {mark.place[0]}, row {mark.place[1]}"
    return scene.labels[mark.place[0]]


def _grid_lines(scene: GridScene) -> list[str]:
    tokens = {mark.place: mark.letter for mark in scene.marks}
    letters = [" " if kind == EMPTY else scene.glyphs[kind].letter for kind in scene.cells]
    lines = []
    for row in range(scene.height):
        cells = letters[row * scene.width : (row + 1) * scene.width]
        shown = (f"({tokens[x, row]})" if (x, row) in tokens else f" {cell} " for x, cell in enumerate(cells))
        lines.append("".join(shown).rstrip())
    return lines


def _graph_lines(scene: GraphScene) -> list[str]:
    marked = {mark.place[0] for mark in scene.marks}
    labels = [escape_unprintable(label) for label in scene.labels]
    names = [f"({label})" if n in marked else f" {label} " for n, label in enumerate(labels)]
    if len(set(scene.kinds)) > 1:  # otherwise the legend or the clause gives the class of all nodes
        broad = max(map(len, names))
        names = [f"{name:<{broad}} {escape_unprintable(kind)}" for name, kind in zip(names, scene.kinds, strict=True)]
    width = max(map(len, names), default=0)
    lines = []
    for number, name in enumerate(names):
        targets = dict.fromkeys(_format_edge(edge, labels) for edge in scene.edges if edge.source == number)
        arrow = f"-> {', '.join(targets)}" if targets else ""
        lines.append(f"{name:<{width}} {arrow}".rstrip())
    return lines


def _format_edge(edge: Edge, labels: list[str]) -> str:
    """Format the target, label and kind of an edge: `Berlin (6.5, Link, not up)`."""
    said = [escape_unprintable(text) for text in (edge.label, edge.kind) if text]
    return labels[edge.target] + (f" ({', '.join(said)})" if said else "")
