"""Pictures of a model, as its behaviour says how to draw it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import Draw, scene_of
from envgraph.env.scene._svg import scene_svg
from envgraph.env.scene._text import scene_text
from envgraph.graph import Model
from envgraph.pattern import Parameter


def render_text(model: Model, draw: Draw, parameters: Iterable[Parameter] = ()) -> str:
    """A model in letters; `(R)` is a cell or node on which a token stands.

    Args:
        model: any model of the behaviour's metamodel.
        draw: the `draw` clause of a behaviour without errors.
        parameters: those of the behaviour; a token that is none of them is the object of that name.

    Raises:
        ResolutionError: a token's parameter has no object.
        InvalidArgument: the grid is too large to be drawn.
    """
    return scene_text(scene_of(model, draw, parameters))


def render_rgb(
    model: Model, draw: Draw, parameters: Iterable[Parameter] = (), *, cell: int = 32
) -> NDArray[np.uint8]:
    """A model as pixels, uint8 [height, width, 3]; `cell` is the side of a cell in pixels. See `render_text`."""
    return scene_rgb(scene_of(model, draw, parameters), cell)


def render_svg(model: Model, draw: Draw, parameters: Iterable[Parameter] = (), *, cell: int = 32) -> str:
    """A model as one `<svg>` element; `cell` is the side of a cell in CSS pixels. See `render_text`."""
    return scene_svg(scene_of(model, draw, parameters), cell)
