"""The content of a picture of boxes and lines, before it is rendered as DOT text or SVG."""

from __future__ import annotations

from html import escape
from typing import Final, Literal

from envgraph.code import dataclass
from envgraph.draw._colour import format_colour, ink_on, parse_colour
from envgraph.errors import escape_unprintable

End = Literal["none", "arrow", "diamond", "triangle"]
"""The symbol at an end of an edge: a diamond at a container, a triangle at a superclass."""

LAYOUTS = ("dot", "neato", "fdp", "sfdp", "circo", "twopi")
"""The layouts of Graphviz that a picture can use."""

INK = "#212529"
MARK = "#e03131"
LINE_COLOUR = "#5c636a"
"""The colour of a line between two boxes."""

FILL_COLOURS = ("#e7f5ff", "#fff3bf", "#ebfbee", "#fff0f6", "#f3f0ff", "#e6fcf5", "#fff4e6", "#f1f3f5")
"""Fill colours of boxes, one for each kind of object, repeated if there are more kinds."""


@dataclass(frozen=True, slots=True)
class DiagramStyle:
    """The sizes of boxes and lines, in CSS pixels; those of pictures as text are in columns."""

    longest: int = 40  # letters of a text; a longer one is shortened
    line: float = 14.0  # height of a line of text
    letter: float = 6.3  # width of a letter
    gap: float = 30.0  # between boxes
    widest_gap: float = 100.0  # between boxes whose line has a label
    border: float = 20.0  # around the picture
    row: float = 1600.0  # width of a row of parts that nothing connects
    rounds: int = 300  # in which overlapping boxes are moved apart
    inch: float = 72.0  # pixels of an inch of Graphviz
    curved: int = 50  # most boxes of a picture with curved lines
    columns: int = 100  # of a row of boxes, unless one box is wider
    targets: int = 60  # columns of a list of link targets, unless one name is longer


STYLE: Final = DiagramStyle()


@dataclass(frozen=True, slots=True)
class PictureNode:
    """A box of a picture.

    Attributes:
        key: a unique key, to which edges refer.
        title: the first line; `stereotype` is written small above it.
        lines: further lines, top to bottom.
        fill: "#rrggbb".
        highlight_names: the variables that a highlighted match binds to this box; None if the box is not highlighted.
        is_italic: True to write the title in italics.
        place: (x, y) with y downwards, in arbitrary units; None if the layout chooses the position.
    """

    key: str
    title: str
    lines: tuple[str, ...] = ()
    fill: str = "#ffffff"
    highlight_names: tuple[str, ...] | None = None
    is_italic: bool = False
    stereotype: str = ""
    place: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class PictureEdge:
    """A line from the box with key `source` to the box with key `target`; the layout "dot" draws the source above."""

    source: str
    target: str
    label: str = ""
    tail: End = "none"
    head: End = "arrow"


@dataclass(frozen=True, slots=True)
class Diagram:
    """Boxes and lines in output order; control characters in their texts are escaped when the picture is rendered.

    Attributes:
        note: a text below the picture; "" for none.
        layout: one of `LAYOUTS`.
    """

    name: str
    nodes: tuple[PictureNode, ...]
    edges: tuple[PictureEdge, ...]
    note: str = ""
    layout: str = "dot"


def escape_markup(text: str) -> str:
    r"""Escape a text for HTML and SVG, between tags and in attributes; control characters become text such as `\x00`.

    >>> print(escape_markup('<b> & "Rome"\x00'))
    &lt;b&gt; &amp; &quot;Rome&quot;\x00
    """
    return escape(escape_unprintable(text))  # XML cannot even name control characters


def shorten(text: str, most: int = STYLE.longest) -> str:
    """Return the text unchanged if it has at most `most` characters, otherwise its start and "…" in that length."""
    return text if len(text) <= most else text[: most - 1] + "…"


def format_value(value: object) -> str:
    r"""Format a data value in one line, cut after 40 characters: strings in quotes, Booleans as `true` and `false`.

    >>> print(format_value('say "hi"\n'), format_value(True), format_value(2.0))
    "say \"hi\"\n" true 2.0
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = value[: STYLE.longest + 1].replace("\\", "\\\\").replace('"', '\\"')
        return f'"{shorten(escape_unprintable(text))}"'
    return shorten(str(value))


def text_colour_on(fill: str) -> str:
    """Return a text colour "#rrggbb" that is readable on the fill colour "#rrggbb".

    >>> text_colour_on("#ffffff"), text_colour_on("#343a40")
    ('#212529', '#ffffff')
    """
    return format_colour(ink_on(parse_colour(fill)))
