"""What a picture of boxes and lines shows, before it is DOT text or SVG."""

from __future__ import annotations

from html import escape
from typing import Literal

from envgraph.code import dataclass
from envgraph.draw._colour import colour_text, ink_on, parse_colour
from envgraph.errors import visible

End = Literal["none", "arrow", "diamond", "triangle"]
"""What an edge ends with: a diamond sits at the container, a triangle at the superclass."""

LAYOUTS = ("dot", "neato", "fdp", "sfdp", "circo", "twopi")
"""The layouts of Graphviz that a picture may ask for."""

INK = "#212529"
MARK = "#e03131"
LINE_COLOUR = "#5c636a"
"""Of a line between two boxes."""

PALE = ("#e7f5ff", "#fff3bf", "#ebfbee", "#fff0f6", "#f3f0ff", "#e6fcf5", "#fff4e6", "#f1f3f5")
"""Fills of boxes, one for each kind of thing; they begin again where there are more kinds."""

_LONGEST = 40


@dataclass(frozen=True, slots=True)
class PictureNode:
    """A box.

    Attributes:
        title: its first line; `stereotype` stands small above it.
        lines: what else it says, top to bottom.
        fill: "#rrggbb".
        marks: what it is called in what is highlighted; None if it is not highlighted.
        slanted: the title is in italics.
        place: (x, y), y down, in units of the picture's own; None where the layout decides.
    """

    key: str
    title: str
    lines: tuple[str, ...] = ()
    fill: str = "#ffffff"
    marks: tuple[str, ...] | None = None
    slanted: bool = False
    stereotype: str = ""
    place: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class PictureEdge:
    """A line between two boxes, from `source` to `target`; a layout in layers puts the source above the target."""

    source: str
    target: str
    label: str = ""
    tail: End = "none"
    head: End = "arrow"


@dataclass(frozen=True, slots=True)
class Diagram:
    """Boxes and lines in the order in which they are written; all text is as `envgraph.errors.visible` makes it.

    Attributes:
        note: stands below; "" for none.
        layout: one of `LAYOUTS`.
    """

    name: str
    nodes: tuple[PictureNode, ...]
    edges: tuple[PictureEdge, ...]
    note: str = ""
    layout: str = "dot"


def markup(text: str) -> str:
    r"""A text inside of HTML and SVG, between tags and in attributes.

    >>> print(markup('<b> & "Rome"\x00'))
    &lt;b&gt; &amp; &quot;Rome&quot;\x00
    """
    return escape(visible(text))  # XML cannot even name control characters


def shortened(text: str, most: int = _LONGEST) -> str:
    """The text, cut where it would be too wide."""
    return text if len(text) <= most else text[: most - 1] + "…"


def shown_value(value: object) -> str:
    r"""A data value in one line: strings in quotes, Booleans as in the languages.

    >>> print(shown_value('say "hi"\n'), shown_value(True), shown_value(2.0))
    "say \"hi\"\n" true 2.0
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = value[: _LONGEST + 1].replace("\\", "\\\\").replace('"', '\\"')
        return f'"{shortened(visible(text))}"'
    return shortened(str(value))


def text_on(fill: str) -> str:
    """The colour of text that can be read on another.

    >>> text_on("#ffffff"), text_on("#343a40")
    ('#212529', '#ffffff')
    """
    return colour_text(ink_on(parse_colour(fill)))
