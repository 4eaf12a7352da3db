"""Pictures of boxes and lines, and what they can be rendered to."""

from __future__ import annotations

from envgraph.draw._boxes import picture_text
from envgraph.draw._diagram import Diagram
from envgraph.draw._dot import picture_dot
from envgraph.draw._svg import picture_svg
from envgraph.errors import InvalidArgument

TIMEOUT = 10.0
"""How long Graphviz may take for a picture, in seconds."""


class Picture(Diagram):
    """A diagram that can be shown; see `Diagram` for what it is made of.

    Attributes:
        name, nodes, edges: boxes and lines in the order in which they are written.
        note: stands below; "" for none.
        layout: one of `LAYOUTS`.
    """

    __slots__ = ()

    def to_dot(self) -> str:
        """The picture as DOT, the text that Graphviz draws."""
        return picture_dot(self)

    def to_text(self) -> str:
        """The picture as boxes of letters, for terminals; each box lists the lines that begin at it.

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
        return picture_text(self)

    def to_svg(self, *, graphviz: bool | None = None, timeout: float = TIMEOUT) -> str:
        """The picture as one `<svg>` element that can stand in an HTML page.

        Where the boxes stand depends on who draws; do not compare pictures of different machines.

        Args:
            graphviz: True insists on Graphviz, False does without (then networkx places the boxes); None takes it where
                it works.
            timeout: how long Graphviz may take, in seconds.

        Raises:
            InvalidArgument: Graphviz is insisted on, and its program `dot` is not on the PATH, fails or takes too long;
                or there is neither Graphviz nor networkx.
        """
        return picture_svg(self, graphviz, timeout)

    def _repr_svg_(self) -> str | None:
        """For notebooks; None where nothing can draw it, so that they show the `repr`."""
        try:
            return self.to_svg()
        except InvalidArgument:
            return None
