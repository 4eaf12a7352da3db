"""Pictures of boxes and lines: class diagrams of metamodels, and the objects and links of models.

>>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
>>> print(Picture("small", boxes, (PictureEdge("a", "b", "next"),)).to_dot())
digraph "small" {
...
  "a" -> "b" [label="next", dir="both", arrowtail="none", arrowhead="vee"];
}
"""

from envgraph.metamodel.picture._picture import (
    LAYOUTS,
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
    "LAYOUTS",
    "End",
    "Picture",
    "PictureEdge",
    "PictureNode",
    "class_colours",
    "markup",
    "shortened",
    "shown_value",
]
