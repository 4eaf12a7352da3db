"""Draw models as pictures: boxes for objects, lines for links."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, TypedDict, Unpack

from envgraph.draw import (
    LAYOUTS,
    End,
    Picture,
    PictureEdge,
    PictureNode,
    format_value,
    shorten,
)
from envgraph.errors import SHOWN, InvalidArgument, did_you_mean, escape_unprintable
from envgraph.graph.model._handles import Node
from envgraph.metamodel import (
    Attribute,
    EnumType,
    Feature,
    Metamodel,
    Scalar,
    class_colours,
    gives_direction,
)

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model

_MAX_LAYERED_FAN = 16
"""If an object has more lines than this, a layout in layers would be far wider than high."""

Highlight = Node | Mapping[str, object] | Iterable["Node | Mapping[str, object]"]
"""Nodes to highlight: a node, a match (the nodes among its values), or several nodes and matches."""


class PictureOptions(TypedDict, total=False):
    """The options of a picture of a model.

    Names of features may be qualified (`Tile.right`).

    Attributes:
        classes: draw only instances of these classes and their subclasses. The default is all objects.
        references: draw only links of these references. The default is all links; `()` draws none.
        attributes: show only these attributes. The default is all attributes with a value; `()` shows none.
        labels: write the names of references at the lines; True by default.
        highlight: a match, a node, or several of them: drawn with a red border and the names of the variables.
        around: a match, a node, or several: draw only these objects and objects at most `distance` links away.
        distance: the maximal number of links from `around`; 1 by default.
        limit: the maximal number of objects; `SHOWN.rows` by default. Objects close to highlighted objects are chosen
            first, or close to the first object if none are highlighted. A note on the picture states the total
            number.
        layout: a layout of Graphviz. The default is "dot" (layers, containers on top), or "neato" if an object has many
            links.
        position: two numeric attributes with the coordinates of an object, x to the right and y down, in units of about
            one box. The layout is "neato" then.
    """

    classes: Iterable[str] | None
    references: Iterable[str] | None
    attributes: Iterable[str] | None
    labels: bool
    highlight: Highlight
    around: Highlight
    distance: int
    limit: int
    layout: str
    position: tuple[str, str]


def picture(
    model: Model,
    *,
    classes: Iterable[str] | None = None,
    references: Iterable[str] | None = None,
    attributes: Iterable[str] | None = None,
    labels: bool = True,
    highlight: Highlight = (),
    around: Highlight | None = None,
    distance: int = 1,
    limit: int = SHOWN.rows,
    layout: str | None = None,
    position: tuple[str, str] | None = None,
) -> Picture:
    """Return a picture of the current state; see `PictureOptions` for the options.

    Raises:
        InvalidArgument: an unknown name or layout, a limit or distance below 0, a node of another model.
    """
    for name, number in (("limit", limit), ("distance", distance)):
        if number < 0:
            raise InvalidArgument(f"`{name}` is {number}, but must be 0 or more")
    if layout is not None and layout not in LAYOUTS:
        hint = did_you_mean(layout, LAYOUTS) or f"the layouts are {', '.join(LAYOUTS)}"
        raise InvalidArgument(f"there is no layout {layout!r}: {hint}")
    metamodel = model.metamodel
    marks = _highlighted_names(model, highlight)
    centre = None if around is None else _highlighted_names(model, around)
    view = _DrawnPart(
        model,
        _drawn_classes(metamodel, classes),
        set(_feature_indexes(metamodel, metamodel.references, references, "reference")),
    )
    shown, total = view.choose_objects([*marks, *(centre or ())], None if centre is None else distance, limit)
    drawing = _ObjectStyle(
        metamodel,
        set(_feature_indexes(metamodel, metamodel.attributes, attributes, "attribute")),
        marks,
        position,
    )
    edges = tuple(view.drawn_edges(shown, labels))
    if layout is None:
        fans = Counter(end for edge in edges for end in (edge.source, edge.target))
        layout = "dot" if position is None and max(fans.values(), default=0) <= _MAX_LAYERED_FAN else "neato"
    return Picture(
        escape_unprintable(model.name),
        tuple(drawing.box_of(model, id) for id in shown),
        edges,
        f"{len(shown):,} of {total:,} objects are drawn" if len(shown) < total else "" if total else "no objects",
        layout,
    )


def to_dot(model: Model, **options: Unpack[PictureOptions]) -> str:
    """Return the picture as DOT, the language of Graphviz. Equal states give equal texts."""
    return model.picture(**options).to_dot()


def to_svg(model: Model, **options: Unpack[PictureOptions]) -> str:
    """Return the picture as an `<svg>` element, drawn by Graphviz if it is installed; see `Picture.to_svg`."""
    return model.picture(**options).to_svg()


def notebook_svg(model: Model) -> str | None:
    """Return the picture as SVG for notebooks, or None if it cannot be drawn, so that notebooks show the `repr`."""
    return model.picture()._repr_svg_()


def _highlighted_names(model: Model, marked: Highlight) -> dict[int, list[str]]:
    """Return the objects to highlight, each with the names of the variables bound to it in the given matches."""
    found: dict[int, list[str]] = {}

    def add(item: object, name: str | None) -> None:
        if not isinstance(item, Node):
            return
        if item.model is not model:
            raise InvalidArgument(f"{item!r} is an object of another model")
        names = found.setdefault(model.node(item.id).id, [])
        if name is not None and name not in names:
            names.append(name)

    several: Iterable[object] = marked if isinstance(marked, Iterable) and not isinstance(marked, Mapping) else [marked]
    for item in several:
        if isinstance(item, Mapping):
            for name, value in item.items():
                add(value, escape_unprintable(name))
        elif isinstance(item, Node):
            add(item, None)
        else:
            raise InvalidArgument(f"`highlight` and `around` take nodes and matches, not {item!r}")
    return found


def _drawn_classes(metamodel: Metamodel, names: Iterable[str] | None) -> tuple[bool, ...]:
    """Return for each class index True if its objects are drawn. The last item is False, for the index -1."""
    if names is None:
        return (*(True for _ in metamodel.class_list), False)
    wanted = _check_name_list(names, "classes")
    for name in wanted:
        if name not in metamodel.classes:
            raise InvalidArgument(_unknown_name_message("class", name, metamodel.classes))
    return (*(any(metamodel.is_a(cls.name, name) for name in wanted) for cls in metamodel.class_list), False)


def _feature_indexes(
    metamodel: Metamodel, features: Sequence[Feature], names: Iterable[str] | None, kind: str
) -> Iterator[int]:
    """Yield the indexes of the features with the given names, which may be qualified by a class (`Tile.right`).

    If `names` is None, yield the indexes of all features. `kind` is the word for a feature in the error message.
    """
    if names is None:
        yield from (feature.index for feature in features)
        return
    for name in _check_name_list(names, f"{kind}s"):
        cls, _, simple = name.rpartition(".")
        found = [
            feature.index
            for feature in features
            if feature.name == simple and (not cls or (cls in metamodel.classes and metamodel.is_a(cls, feature.owner)))
        ]
        if not found:
            raise InvalidArgument(
                _unknown_name_message(kind, name, [text for f in features for text in (f.name, str(f))])
            )
        yield from found


def _check_name_list(names: Iterable[str], option: str) -> list[str]:
    if isinstance(names, str):
        raise InvalidArgument(f"`{option}` takes several names: write [{names!r}]")
    return list(names)


def _unknown_name_message(kind: str, name: str, known: Iterable[str]) -> str:
    hint = did_you_mean(name, known)
    return f"the metamodel has no {kind} `{name}`" + (f"; {hint}" if hint else "")


class _DrawnPart:
    """The part of a model to draw: the instances of selected classes and the links of selected references."""

    def __init__(self, model: Model, classes: Sequence[bool], references: set[int]) -> None:
        self.store = model.graph.store
        self.classes = classes
        self.relations = [relation for relation in self.store.relations if relation.reference.index in references]
        self.references = references

    def _is_drawn(self, node: int) -> bool:
        return self.classes[self.store.classes[node]]

    def choose_objects(self, start_nodes: Sequence[int], distance: int | None, limit: int) -> tuple[list[int], int]:
        """Return the objects to draw, sorted by id, and the number of objects that would be drawn without the limit.

        Args:
            start_nodes: the objects from which to start; objects close to them are chosen first.
            distance: the maximal number of links from these objects; None for no maximum.
            limit: the maximal number of objects.
        """
        near = self._by_distance(start_nodes, distance)
        if distance is not None:
            found = list(near)
            return sorted(found[:limit]), len(found)
        total = sum(len(extent) for extent, drawn in zip(self.store.extents, self.classes, strict=False) if drawn)
        return sorted(node for node, _ in zip(near, range(limit), strict=False)), total

    def _by_distance(self, start_nodes: Sequence[int], distance: int | None) -> Iterator[int]:
        """Yield drawn objects breadth-first from `start_nodes`, and then all others if there is no maximal distance."""
        seen = dict.fromkeys(node for node in start_nodes if self._is_drawn(node))
        level = list(seen)
        depth = 0
        others = iter(self.store.nodes() if distance is None else ())
        while True:
            yield from level
            if distance is not None and depth == distance:
                return
            following: list[int] = []
            for node in level:
                for other in chain.from_iterable((*r.forward[node], *r.backward[node]) for r in self.relations):
                    if other not in seen and self._is_drawn(other):
                        seen[other] = None
                        following.append(other)
            if not following:
                alone = next((node for node in others if node not in seen and self._is_drawn(node)), None)
                if alone is None:
                    return
                seen[alone] = None
                following = [alone]
            level, depth = following, depth + 1

    def drawn_edges(self, shown: Sequence[int], labels: bool) -> Iterator[PictureEdge]:
        """Yield a line for each link between drawn objects. Opposite references share a line if both are drawn."""
        inside = set(shown)
        for relation in self.relations:
            opposite = relation.opposite
            if opposite is not None and opposite.index not in self.references:
                opposite = None
            if opposite is not None and not gives_direction(relation.reference, opposite):
                continue
            label = escape_unprintable(relation.reference.name) if labels else ""
            if labels and opposite is not None and not relation.is_symmetric:
                label += f" / {escape_unprintable(opposite.name)}"
            tail: End = "diamond" if relation.containment else "arrow" if opposite else "none"
            head: End = "diamond" if relation.is_contained else "arrow"
            for source in shown:
                for target in relation.forward[source]:
                    if target in inside and not (relation.is_symmetric and source > target):
                        yield PictureEdge(f"n{source}", f"n{target}", label, tail, head)


class _ObjectStyle:
    """The appearance of objects: shown attributes, colours, highlights and positions."""

    def __init__(
        self,
        metamodel: Metamodel,
        attributes: set[int],
        marks: Mapping[int, Sequence[str]],
        position: tuple[str, str] | None,
    ) -> None:
        self.metamodel = metamodel
        self.attributes = attributes
        self.marks = marks
        self.position = position
        self.colours = class_colours(metamodel.class_list)
        if position is not None:
            for name in position:
                if not any(_is_number(feature) for feature in metamodel.attributes if feature.name == name):
                    numbers = [feature.name for feature in metamodel.attributes if _is_number(feature)]
                    raise InvalidArgument(_unknown_name_message("numeric attribute", name, numbers))

    def box_of(self, model: Model, id: int) -> PictureNode:
        """Return the box that is drawn for an object."""
        cls = model.graph.class_of(id)
        name = model.graph.object_name(id)
        features = self.metamodel.features(cls)
        return PictureNode(
            f"n{id}",
            f"{cls}#{id}" if name is None else f"{shorten(escape_unprintable(name))} : {cls}",
            tuple(
                f"{escape_unprintable(feature.name)} = {_format_value(feature, model.graph.value(id, feature))}"
                for feature in features.values()
                if isinstance(feature, Attribute) and feature.index in self.attributes
                if model.graph.values(id, feature)
            ),
            self.colours[cls],
            tuple(self.marks[id]) if id in self.marks else None,
            place=self._position_of(model, id, features),
        )

    def _position_of(self, model: Model, id: int, features: Mapping[str, Feature]) -> tuple[float, float] | None:
        if self.position is None:
            return None
        found: list[float] = []
        for name in self.position:
            feature = features.get(name)
            value = model.graph.value(id, feature) if isinstance(feature, Attribute) else None
            if isinstance(value, int | float):
                found.append(float(value))
        return (found[0], found[1]) if len(found) == 2 else None


def _is_number(attribute: Attribute) -> bool:
    return attribute.type in (Scalar.INT, Scalar.FLOAT) and not attribute.many


def _format_value(attribute: Attribute, value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_format_value(attribute, one) for one in value)}]"
    return escape_unprintable(str(value)) if isinstance(attribute.type, EnumType) else format_value(value)
