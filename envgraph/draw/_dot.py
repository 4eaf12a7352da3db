"""Draw pictures as DOT, the input language of Graphviz, and run Graphviz if it is installed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import sqrt

from envgraph.draw._box_layout import BoxFrame, place_boxes
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
from envgraph.errors import escape_unprintable

_ENDS: Mapping[End, str] = {"none": "none", "arrow": "vee", "diamond": "diamond", "triangle": "onormal"}
_FONT = "Helvetica,Arial,sans-serif"


def draw_dot(picture: Diagram) -> str:
    """Return the picture as one `digraph`, with one statement on each line.

    If at least one box has a position, all boxes get one; the layouts `neato` and `fdp` keep these positions.
    """
    return "\n".join([f"digraph {_quote(picture.name)} {{", *_dot_statements(picture), "}", ""])


def _dot_statements(picture: Diagram) -> Iterator[str]:
    graph = {"layout": picture.layout, "fontname": _FONT, "fontsize": "11", "rankdir": "TB"}
    pinned = any(node.place is not None for node in picture.nodes)
    frames = place_boxes(picture) if pinned else {}
    if picture.layout != "dot":
        graph.update(overlap=str(pinned).lower(), outputorder="edgesfirst", start="1")
        # Routing edges around many boxes takes seconds.
        graph.update(splines="true" if len(picture.nodes) <= STYLE.curved else "line")
    if picture.note:
        graph.update(label=picture.note, labelloc="b")
    yield f"  graph {_format_attributes(graph)};"
    yield f"  node {_format_attributes({'shape': 'box', 'style': 'filled', 'fontname': _FONT, 'fontsize': '10'})};"
    yield (
        f"  edge {_format_attributes({'color': LINE_COLOUR, 'fontname': _FONT, 'fontsize': '9', 'arrowsize': '0.7'})};"
    )
    for node in picture.nodes:
        yield f"  {_quote(node.key)} {_format_node(node, frames.get(node.key))};"
    degrees = Counter(end for edge in picture.edges for end in (edge.source, edge.target))
    for edge in picture.edges:
        stretched = picture.layout != "dot" and edge.tail == "diamond" and degrees[edge.target] > 1
        # Otherwise a container pulls all its contents together, whatever else they are linked to.
        length = max(1.0, sqrt(degrees[edge.source]) / 2) if stretched else 1.0
        yield f"  {_quote(edge.source)} -> {_quote(edge.target)} {_format_edge(edge, length)};"


def _format_attributes(attributes: Mapping[str, str]) -> str:
    return "[" + ", ".join(f"{name}={_quote(value)}" for name, value in attributes.items()) + "]"


def _quote(text: str) -> str:
    r"""Quote a text as a DOT string that is displayed unchanged.

    In labels Graphviz interprets escapes (`\n`, `\N`) and entities (`&amp;`).
    """
    escaped = escape_unprintable(text).replace("&", "&amp;").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _format_node(node: PictureNode, frame: BoxFrame | None) -> str:
    attributes = {"fillcolor": node.fill, "fontcolor": text_colour_on(node.fill), "margin": "0.05,0.03"}
    if node.highlight_names is not None:
        attributes.update(color=MARK, penwidth="3")
    if frame is not None:
        attributes.update(pos=f"{frame.x / STYLE.inch:.2f},{0.0 - frame.y / STYLE.inch:.2f}!")
    return f"{_format_attributes(attributes)[:-1]}, label=<{_format_label(node)}>]"


def _format_label(node: PictureNode) -> str:
    """Return the HTML-like label of a box for Graphviz: its marks, stereotype, title and lines."""
    head = [f"<i>{_escape_label(mark)}</i>" for mark in node.highlight_names or ()]
    if node.stereotype:
        head.append(f'<font point-size="8">«{_escape_label(node.stereotype)}»</font>')
    title = f"<b>{_escape_label(node.title)}</b>"
    head.append(f"<i>{title}</i>" if node.is_italic else title)
    rows = f"<tr><td>{'<br/>'.join(head)}</td></tr>"
    if node.lines:
        lines = "".join(f'{_escape_label(line)}<br align="left"/>' for line in node.lines)
        rows += f'<hr/><tr><td align="left" balign="left">{lines}</td></tr>'
    return f'<table border="0" cellborder="0" cellspacing="0" cellpadding="3">{rows}</table>'


def _escape_label(text: str) -> str:
    r"""Escape a text for an HTML-like label, in which Graphviz also interprets `\N`, `\G` and so on; " " for ""."""
    return escape_markup(text).replace("\\", "\\\\") or " "


def _format_edge(edge: PictureEdge, length: float) -> str:
    attributes = {"dir": "both", "arrowtail": _ENDS[edge.tail], "arrowhead": _ENDS[edge.head]}
    if edge.label:
        attributes = {"label": edge.label, **attributes}
    if "diamond" in (edge.tail, edge.head) or "triangle" in (edge.tail, edge.head):
        attributes["color"] = INK
    if length > 1:
        attributes["len"] = f"{length:.1f}"
    return _format_attributes(attributes)


def run_graphviz(text: str, timeout: float) -> str | None:
    """Return the `<svg>` element that the program `dot` creates from a DOT text, or None.

    Args:
        text: a graph in DOT.
        timeout: the maximum time in seconds.

    Returns:
        None if the program is not on the PATH, fails, takes too long or prints no SVG.
    """
    import shutil
    import subprocess

    program = shutil.which("dot")
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, "-Tsvg"], input=text.encode(), capture_output=True, timeout=timeout, check=False
        )
    except (OSError, subprocess.SubprocessError):
        return None
    svg = done.stdout.decode("utf-8", "replace")
    start = svg.find("<svg")
    return svg[start:].strip() if done.returncode == 0 and start >= 0 and "</svg>" in svg else None
