"""Metamodels as class diagrams."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from envgraph.draw import (
    PALE,
    End,
    Picture,
    PictureEdge,
    PictureNode,
    shown_value,
)
from envgraph.errors import visible
from envgraph.metamodel._features import Attribute, Class, EnumType, Reference, type_name

if TYPE_CHECKING:
    from envgraph.metamodel._metamodel import Metamodel


def class_diagram(metamodel: Metamodel) -> Picture:
    """Classes with their attributes, enums with their literals, supertypes and references; opposites are one line."""
    colours = class_colours(metamodel.class_list)
    return Picture(
        visible(metamodel.name),
        (
            *(_class(cls, colours[cls.name]) for cls in metamodel.class_list),
            *(_enum(enum) for enum in metamodel.enum_types),
        ),
        (*_supertypes(metamodel), *_references(metamodel)),
    )


def class_colours(classes: Iterable[Class]) -> dict[str, str]:
    """A colour for each class: that of its glyph, else a pale one by its place."""
    return {
        cls.name: cls.glyph.colour if cls.glyph else PALE[number % len(PALE)]
        for number, cls in enumerate(classes)
    }


def _class(cls: Class, colour: str) -> PictureNode:
    return PictureNode(
        visible(cls.name),
        visible(cls.name),
        tuple(_attribute(feature, cls) for feature in cls.features if isinstance(feature, Attribute)),
        colour,
        slanted=cls.abstract,
        stereotype="abstract" if cls.abstract else "",
    )


def _attribute(attribute: Attribute, cls: Class) -> str:
    key = " (key)" if attribute.name in cls.key else ""
    default = "" if attribute.default is None else f" = {_default(attribute)}"
    bounds = f"[{attribute.multiplicity}]" if attribute.many else ""
    return visible(f"{attribute.name} : {type_name(attribute.type)}{bounds}{key}") + default


def _default(attribute: Attribute) -> str:
    if isinstance(attribute.type, EnumType):
        return visible(str(attribute.default))
    return shown_value(attribute.default)


def _enum(enum: EnumType) -> PictureNode:
    literals = tuple(visible(literal) for literal in enum.literals)
    return PictureNode(f"enum {visible(enum.name)}", visible(enum.name), literals, stereotype="enum")


def _supertypes(metamodel: Metamodel) -> Iterator[PictureEdge]:
    for cls in metamodel.class_list:
        for above in cls.supertypes:
            # The superclass is the source: layouts in layers put it on top.
            yield PictureEdge(visible(above), visible(cls.name), tail="triangle", head="none")


def _references(metamodel: Metamodel) -> Iterator[PictureEdge]:
    for reference in metamodel.references:
        opposite = metamodel.opposite(reference)
        if opposite is not None and not _leads(reference, opposite):
            continue
        label = _end(reference)
        if opposite is not None and opposite.index != reference.index:
            label += f" / {_end(opposite)}"
        tail: End = "diamond" if reference.containment else "arrow" if opposite else "none"
        yield PictureEdge(visible(reference.owner), visible(reference.target), visible(label), tail, "arrow")


def _leads(reference: Reference, opposite: Reference) -> bool:
    """Whether this one of a pair gives the line its direction: the containment, else the one declared first."""
    if reference.containment or opposite.containment:
        return reference.containment
    return reference.index <= opposite.index


def _end(reference: Reference) -> str:
    return f"{reference.name} [{reference.multiplicity}]"
