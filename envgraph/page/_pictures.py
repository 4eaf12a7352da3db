"""Draw the state of a model for the page, so that each drawn object can be found in the picture."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from envgraph.behaviour import Behaviour, DrawGrid
from envgraph.draw import Picture
from envgraph.env import Painter, scene_svg, scene_text
from envgraph.errors import SHOWN, EnvgraphError, InvalidArgument
from envgraph.graph import Model, object_text, value_text
from envgraph.metamodel import Attribute
from envgraph.page._work import JsonObject
from envgraph.rewrite import Engine

if TYPE_CHECKING:
    from collections.abc import Iterator


def draw_state(
    engine: Engine, behaviour: Behaviour | None, *, painter: Callable[[], Painter] | None = None
) -> JsonObject:
    """Return the picture of the engine's model: by the `draw` clause of the behaviour, or else as boxes and lines.

    Args:
        engine: the engine.
        behaviour: the environment whose `draw` clause is used; None for boxes and lines.
        painter: returns the painter of the behaviour; None to make one.

    Returns:
        `kind` is "grid", "graph" or "boxes". `svg` has an attribute `data-object` with the id of the object at each
        part that stands for one; it is missing if boxes cannot be placed here. `dot` is only given for boxes, in which
        the node `n12` is the object 12. `text` has one line for each row or object.
    """
    model = engine.model
    draw = None if behaviour is None else behaviour.draw
    if behaviour is None or draw is None:
        return _draw_boxes(model)
    try:
        make = painter or (lambda: Painter(model, draw, behaviour.parameters))
        scene, objects = make().draw_with_objects()
    except EnvgraphError as error:  # A token has no object, or the grid is too large.
        return {**_draw_boxes(model), "note": str(error).partition("\n")[0]}
    return {
        "kind": "grid" if isinstance(draw, DrawGrid) else "graph",
        "svg": scene_svg(scene, objects=objects),
        "text": scene_text(scene),
    }


def _draw_boxes(model: Model) -> JsonObject:
    picture = model.picture()
    found: JsonObject = {"kind": "boxes", "dot": picture.to_dot(), "text": "\n".join(_lines_of(model))}
    svg = svg_of_boxes(picture)
    return found if svg is None else {**found, "svg": svg}


def svg_of_boxes(picture: Picture) -> str | None:
    """Return a picture of a model as SVG, with the ids of the objects; None if the boxes cannot be placed."""
    try:
        svg = picture.to_svg(graphviz=False)
    except InvalidArgument:
        return None
    # Boxes are drawn in their order, after the background, and texts contain no `<`.
    background, *boxes = svg.split("<rect ")[1:]
    start = svg[: svg.index("<rect ")]
    named = zip(picture.nodes, boxes, strict=True)
    return f"{start}<rect {background}" + "".join(f'<rect data-object="{node.key[1:]}" {box}' for node, box in named)


def _lines_of(model: Model) -> Iterator[str]:
    """Yield a line for each object: its class, name, values and links."""
    for number, node in enumerate(model.nodes()):
        if number == SHOWN.rows:
            yield f"and {len(model) - number:,} more"
            return
        parts = []
        for feature in model.metamodel.features(node.cls).values():
            if isinstance(feature, Attribute):
                values = model.graph.values(node.id, feature)
                if values:
                    parts.append(f"{feature.name} = {', '.join(map(value_text, values))}")
            else:
                targets = model.graph.targets(node.id, feature)
                if targets:
                    parts.append(f"{feature.name} -> {', '.join(object_text(model.graph, one) for one in targets)}")
        yield f"{value_text(node)}: {'; '.join(parts)}" if parts else value_text(node)


def list_objects(model: Model) -> list[JsonObject]:
    """Return the id, name and class of each object; of many objects, only of the first ones."""
    numbered = zip(range(SHOWN.rows * 10), model.nodes(), strict=False)
    return [{"id": one.id, "name": value_text(one), "class": one.cls} for _, one in numbered]
