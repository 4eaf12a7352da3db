"""Pictures of boxes and lines: class diagrams of metamodels, and objects and links of models. Animations of pictures.

>>> from envgraph.draw import Picture, PictureEdge, PictureNode
>>> boxes = (PictureNode("a", "one"), PictureNode("b", "two", ("n = 1",)))
>>> print(Picture("small", boxes, (PictureEdge("a", "b", "next"),)).to_dot())
digraph "small" {
...
  "a" -> "b" [label="next", dir="both", arrowtail="none", arrowhead="vee"];
}
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.draw._colour import (
        INK as INK,
        PAPER as PAPER,
        Colour as Colour,
        blend as blend,
        contrast as contrast,
        format_colour as format_colour,
        ink_on as ink_on,
        parse_colour as parse_colour,
    )
    from envgraph.draw._diagram_data import (
        FILL_COLOURS as FILL_COLOURS,
        LAYOUTS as LAYOUTS,
        LINE_COLOUR as LINE_COLOUR,
        End as End,
        PictureEdge as PictureEdge,
        PictureNode as PictureNode,
        escape_markup as escape_markup,
        format_value as format_value,
        shorten as shorten,
    )
    from envgraph.draw._notebook_html import (
        html_fields as html_fields,
        html_picture as html_picture,
        html_table as html_table,
        html_text as html_text,
    )
    from envgraph.draw._rendered_picture import Picture as Picture
    from envgraph.draw._svg_film import (
        LAST_STEPS as LAST_STEPS,
        STEP_SECONDS as STEP_SECONDS,
        SvgFrame as SvgFrame,
        film as film,
    )

export_lazily(globals())
