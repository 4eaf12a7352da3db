"""Pictures of boxes and lines: class diagrams of metamodels, and the objects and links of models.

>>> from envgraph.draw import Picture, PictureEdge, PictureNode
>>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
>>> print(Picture("small", boxes, (PictureEdge("a", "b", "next"),)).to_dot())
digraph "small" {
...
  "a" -> "b" [label="next", dir="both", arrowtail="none", arrowhead="vee"];
}
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.draw._colour import (
        INK as INK,
        PAPER as PAPER,
        Colour as Colour,
        blend as blend,
        colour_text as colour_text,
        contrast as contrast,
        ink_on as ink_on,
        parse_colour as parse_colour,
    )
    from envgraph.draw._diagram import (
        LAYOUTS as LAYOUTS,
        LINE_COLOUR as LINE_COLOUR,
        PALE as PALE,
        End as End,
        PictureEdge as PictureEdge,
        PictureNode as PictureNode,
        markup as markup,
        shortened as shortened,
        shown_value as shown_value,
    )
    from envgraph.draw._picture import Picture as Picture

later(globals())
