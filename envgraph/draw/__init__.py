"""Pictures of boxes and lines: class diagrams of metamodels, and the objects and links of models.

>>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
>>> print(Picture("small", boxes, (PictureEdge("a", "b", "next"),)).to_dot())
digraph "small" {
...
  "a" -> "b" [label="next", dir="both", arrowtail="none", arrowhead="vee"];
}
"""

from envgraph.draw._colour import (
    INK,
    PAPER,
    Colour,
    blend,
    colour_text,
    contrast,
    ink_on,
    parse_colour,
)
from envgraph.draw._diagram import (
    LAYOUTS,
    LINE_COLOUR,
    MARK,
    PALE,
    End,
    PictureEdge,
    PictureNode,
    markup,
    shortened,
    shown_value,
)
from envgraph.draw._picture import Picture
from envgraph.errors import shorten

__all__ = [
    "INK",
    "LAYOUTS",
    "LINE_COLOUR",
    "MARK",
    "PALE",
    "PAPER",
    "Colour",
    "End",
    "Picture",
    "PictureEdge",
    "PictureNode",
    "blend",
    "colour_text",
    "contrast",
    "ink_on",
    "markup",
    "parse_colour",
    "shortened",
    "shown_value",
]

shorten(globals(), __all__)
