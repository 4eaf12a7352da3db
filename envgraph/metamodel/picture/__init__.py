"""Pictures of boxes and lines: class diagrams of metamodels, and the objects and links of models.

>>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
>>> print(Picture("small", boxes, (PictureEdge("a", "b", "next"),)).to_dot())
digraph "small" {
...
  "a" -> "b" [label="next", dir="both", arrowtail="none", arrowhead="vee"];
}
"""

from envgraph.errors import shorten
from envgraph.metamodel.picture._colour import (
    INK,
    PAPER,
    Colour,
    blend,
    colour_text,
    contrast,
    ink_on,
    parse_colour,
)
from envgraph.metamodel.picture._picture import (
    LAYOUTS,
    LINE_COLOUR,
    MARK,
    End,
    Picture,
    PictureEdge,
    PictureNode,
    class_colours,
    markup,
    shortened,
    shown_value,
)

__all__ = [
    "INK",
    "LAYOUTS",
    "LINE_COLOUR",
    "MARK",
    "PAPER",
    "Colour",
    "End",
    "Picture",
    "PictureEdge",
    "PictureNode",
    "blend",
    "class_colours",
    "colour_text",
    "contrast",
    "ink_on",
    "markup",
    "parse_colour",
    "shortened",
    "shown_value",
]

shorten(globals(), __all__)
