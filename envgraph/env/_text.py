"""Scenes as plain text."""

from __future__ import annotations

from envgraph.env._scene import EMPTY, GraphScene, GridScene, Scene


def scene_text(scene: Scene) -> str:
    """A scene in letters, without colours; `(R)` is a cell or node on which a token stands.

    With more than one token, lines below the picture say where each of them stands.
    """
    lines = _grid(scene) if isinstance(scene, GridScene) else _graph(scene)
    return "\n".join(lines)


def _grid(scene: GridScene) -> list[str]:
    marked = {mark.place for mark in scene.marks}
    letters = [" " if kind == EMPTY else scene.glyphs[kind].letter for kind in scene.cells]
    lines = []
    for row in range(scene.height):
        cells = letters[row * scene.width : (row + 1) * scene.width]
        shown = (f"({cell})" if (x, row) in marked else f" {cell} " for x, cell in enumerate(cells))
        lines.append("".join(shown).rstrip())
    if len(scene.marks) > 1:
        lines.extend(f"{mark.name}: column {mark.place[0]}, row {mark.place[1]}" for mark in scene.marks)
    return lines


def _graph(scene: GraphScene) -> list[str]:
    marked = {mark.place[0] for mark in scene.marks}
    names = [f"({label})" if n in marked else f" {label} " for n, label in enumerate(scene.labels)]
    width = max(map(len, names), default=0)
    lines = []
    for number, name in enumerate(names):
        targets = dict.fromkeys(scene.labels[end] for start, end in scene.edges if start == number)
        arrow = f"-> {', '.join(targets)}" if targets else ""
        lines.append(f"{name:<{width}} {arrow}".rstrip())
    if len(scene.marks) > 1:
        lines.extend(f"{mark.name}: {scene.labels[mark.place[0]]}" for mark in scene.marks)
    return lines
