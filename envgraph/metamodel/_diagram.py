"""Draw metamodels as class diagrams."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

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
    return Picture(
        visible(name),
        (*(_class(cls, colours[cls.name]) for cls in classes), *map(_enum, enums)),
        (*_supertypes(classes), *_references(references)),
    )


def class_colours(classes: Iterable[Class]) -> dict[str, str]:
    """Return a colour for each class: that of its glyph, or else a pale one chosen by its position."""
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


def _supertypes(classes: Iterable[Class]) -> Iterator[PictureEdge]:
    for cls in classes:
        for above in cls.supertypes:
            # The superclass is the source, because layered layouts put it on top.
            yield PictureEdge(visible(above), visible(cls.name), tail="triangle", head="none")


def _references(references: Iterable[tuple[Reference, Reference | None]]) -> Iterator[PictureEdge]:
    for reference, opposite in references:
        if opposite is not None and not _leads(reference, opposite):
            continue
        label = _end(reference)
        if opposite is not None and opposite.index != reference.index:
            label += f" / {_end(opposite)}"
        tail: End = "diamond" if reference.containment else "arrow" if opposite else "none"
        yield PictureEdge(visible(reference.owner), visible(reference.target), visible(label), tail, "arrow")


def _leads(reference: Reference, opposite: Reference) -> bool:
    """Return True if a reference, not its opposite, determines the direction of the line that is drawn for both.

    The containment of the two determines the direction. If neither is one, the reference that was declared first does.
    """
    if reference.containment or opposite.containment:
        return reference.containment
    return reference.index <= opposite.index


def _end(reference: Reference) -> str:
    return f"{reference.name} [{reference.multiplicity}]"
