"""Draw metamodels as class diagrams."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph.draw import (
    FILL_COLOURS,
    End,
    Picture,
    PictureEdge,
    PictureNode,
    format_value,
)
from envgraph.errors import escape_unprintable
from envgraph.metamodel._features import Attribute, Class, EnumType, Reference, type_name


def class_diagram(
    name: str,
    classes: Sequence[Class],
    enums: Iterable[EnumType],
    references: Iterable[tuple[Reference, Reference | None]],
) -> Picture:
    """Return a picture of classes with their attributes, supertypes and references, and of enums with their literals.

    A pair of opposite references is drawn as one line.

    Args:
        name: name of the metamodel.
        classes, enums: in the order in which they are shown.
        references: the references of all classes, each with its opposite (None if it has none).
    """
    colours = class_colours(classes)
    # The superclass is the source, because layered layouts put it on top.
    supertypes = (
        PictureEdge(escape_unprintable(above), escape_unprintable(cls.name), tail="triangle", head="none")
        for cls in classes
        for above in cls.supertypes
    )
    return Picture(
        escape_unprintable(name),
        (*(_class_node(cls, colours[cls.name]) for cls in classes), *map(_enum_node, enums)),
        (*supertypes, *_reference_edges(references)),
    )


def class_colours(classes: Iterable[Class]) -> dict[str, str]:
    """Return a colour for each class: that of its glyph, or else a pale one chosen by its position."""
    return {
        cls.name: cls.glyph.colour if cls.glyph else FILL_COLOURS[number % len(FILL_COLOURS)]
        for number, cls in enumerate(classes)
    }


def _class_node(cls: Class, colour: str) -> PictureNode:
    return PictureNode(
        escape_unprintable(cls.name),
        escape_unprintable(cls.name),
        tuple(_attribute_line(feature, cls) for feature in cls.features if isinstance(feature, Attribute)),
        colour,
        is_italic=cls.abstract,
        stereotype="abstract" if cls.abstract else "",
    )


def _attribute_line(attribute: Attribute, cls: Class) -> str:
    key = " (key)" if attribute.name in cls.key else ""
    default = "" if attribute.default is None else f" = {_default_text(attribute)}"
    bounds = f"[{attribute.multiplicity}]" if attribute.many else ""
    return escape_unprintable(f"{attribute.name} : {type_name(attribute.type)}{bounds}{key}") + default


def _default_text(attribute: Attribute) -> str:
    if isinstance(attribute.type, EnumType):
        return escape_unprintable(str(attribute.default))
    return format_value(attribute.default)


def _enum_node(enum: EnumType) -> PictureNode:
    literals = tuple(escape_unprintable(literal) for literal in enum.literals)
    return PictureNode(
        f"enum {escape_unprintable(enum.name)}", escape_unprintable(enum.name), literals, stereotype="enum"
    )


def _reference_edges(references: Iterable[tuple[Reference, Reference | None]]) -> Iterator[PictureEdge]:
    for reference, opposite in references:
        if opposite is not None and not gives_direction(reference, opposite):
            continue
        label = _end_label(reference)
        if opposite is not None and opposite.index != reference.index:
            label += f" / {_end_label(opposite)}"
        tail: End = "diamond" if reference.containment else "arrow" if opposite else "none"
        yield PictureEdge(
            escape_unprintable(reference.owner),
            escape_unprintable(reference.target),
            escape_unprintable(label),
            tail,
            "arrow",
        )


def gives_direction(reference: Reference, opposite: Reference) -> bool:
    """Return True if a reference, not its opposite, determines the direction of the line that is drawn for both.

    The containment of the two determines the direction. If neither is one, the reference that was declared first does.
    """
    if reference.containment or opposite.containment:
        return reference.containment
    return reference.index <= opposite.index


def _end_label(reference: Reference) -> str:
    return f"{reference.name} [{reference.multiplicity}]"
