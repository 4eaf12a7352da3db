"""Pictures of boxes and lines that can be rendered as DOT, text and SVG."""

from __future__ import annotations

from envgraph.draw._diagram_data import Diagram
from envgraph.draw._dot import draw_dot
from envgraph.draw._svg_drawing import draw_svg
from envgraph.draw._text_boxes import draw_text

TIMEOUT = 10.0
"""Default maximum time for Graphviz, in seconds."""


class Picture(Diagram):
    """A diagram with methods that render it as DOT, text and SVG.

    Attributes:
        name, nodes, edges: the title, and the boxes and lines in output order.
        note: a text below the picture; "" for none.
        layout: one of `LAYOUTS`.
    """

    __slots__ = ()

    def to_dot(self) -> str:
        """Return the picture as DOT, the input language of Graphviz."""
        return draw_dot(self)

    def to_text(self) -> str:
        """Return the picture as boxes of characters for terminals; each box lists the lines that start from it.

        >>> from envgraph.draw import PictureEdge, PictureNode
        >>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
        >>> print(Picture("small", boxes, (PictureEdge("b", "a", "next"),)).to_text())
        ┌─────┐ ┌─────────────┐
        │ one │ │ two         │
        └─────┘ ├─────────────┤
                │ n = 1       │
                │ next -> one │
                └─────────────┘
        """
        return draw_text(self)

    def to_svg(self, *, graphviz: bool | None = None, timeout: float = TIMEOUT) -> str:
        """Return the picture as one `<svg>` element, which can be part of an HTML page.

        The positions of boxes depend on the program that draws; do not compare pictures of different machines.

        Args:
            graphviz: True requires Graphviz. False uses our own layout. None uses Graphviz, or our own layout if
                Graphviz is missing or fails.
            timeout: the maximum time for Graphviz, in seconds.

        Raises:
            InvalidArgument: Graphviz is required, but its program `dot` is not on the PATH, fails or takes too long.
        """
        return draw_svg(self, graphviz, timeout)

    def _repr_svg_(self) -> str:
        """Return the SVG for notebooks."""
        return self.to_svg()
