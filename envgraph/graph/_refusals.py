"""Messages of refused writes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from envgraph.errors import EnvgraphError, InvalidArgument, RuleError, TypeMismatch, did_you_mean
from envgraph.metamodel import (
    LARGEST_INT,
    Attribute,
    EnumType,
    Feature,
    Metamodel,
    Reference,
    Scalar,
    Values,
    type_name,
)

if TYPE_CHECKING:
    from envgraph.graph._incidence import Link
    from envgraph.graph._model import Model


def missing(model: Model, node: object) -> InvalidArgument:
    """There is no such object."""
    return InvalidArgument(
        f"`{model.name}` has no object {node!r}: it was never created, was deleted, or was undone"
    )


def unknown_object(model: Model, object_name: object) -> InvalidArgument:
    """No object has this name."""
    if not isinstance(object_name, str):
        return InvalidArgument(
            f"objects are found by name, not by {object_name!r}; for an id write `model.node(id)`"
        )
    used = [
        *(name for name, node in model.store.by_name.items() if node is not None),
        *(place for place, node in model.places.items() if model.alive(node)),
    ]
    return InvalidArgument(f"`{model.name}` has no object `{object_name}`", did_you_mean(object_name, used))


def not_instantiable(metamodel: Metamodel, cls: str) -> TypeMismatch:
    """The class is unknown or abstract."""
    if cls not in metamodel.classes:
        return unknown_class(metamodel, cls)
    below = ", ".join(f"`{name}`" for name in metamodel.concrete(cls)) or "none"
    return TypeMismatch(f"`{cls}` is abstract", f"its concrete subclasses: {below}")


def unknown_class(metamodel: Metamodel, cls: str) -> TypeMismatch:
    """The class is unknown."""
    return TypeMismatch(f"unknown class `{cls}`", metamodel.likely(cls))


def lacks(model: Model, node: int, feature: Feature) -> EnvgraphError:
    """The object's class does not have the feature, or there is no such object."""
    if not model.alive(node):
        return missing(model, node)
    if feature in model.defined:
        text = f"`{feature}` is read-only: query `{model.defined[feature].query}` defines its values"
        return TypeMismatch(text, "change what the query reads")
    return TypeMismatch(f"`{model.class_of(node)}` has no feature `{feature.name}`; `{feature.owner}` has")


def no_list(attribute: Attribute, value: object) -> TypeMismatch:
    """One value where the attribute takes many."""
    return TypeMismatch(f"`{attribute}` takes several values: write a list of them, not {value!r}")


def wrong_value(attribute: Attribute, value: object) -> TypeMismatch:
    """The attribute does not take the value."""
    hint = None
    if isinstance(attribute.type, EnumType) and isinstance(value, str):
        hint = did_you_mean(value, attribute.type.literals)
        hint = hint or "its literals: " + ", ".join(f"`{literal}`" for literal in attribute.type.literals)
    kind = type_name(attribute.type)
    if attribute.type is Scalar.INT and type(value) is int:
        hint = f"an int has 64 bits: it is {LARGEST_INT} at most, and {-LARGEST_INT - 1} at least"
    try:
        shown = repr(value)
    except ValueError:  # Python does not show ints of thousands of digits
        shown = "one of thousands of digits"
    shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
    return TypeMismatch(f"`{attribute}` takes {kind}, not {shown} ({type(value).__name__})", hint)


def repeated(attribute: Attribute, values: Values) -> InvalidArgument:
    """A value is given twice."""
    twice = next(value for place, value in enumerate(values) if value in values[:place])
    message = f"`{attribute}` has each value once, and {twice!r} is given twice"
    return InvalidArgument(message, "`@nonunique` allows that")


def too_many(model: Model, node: int, attribute: Attribute, values: Values) -> RuleError:
    """More values than the attribute may have."""
    text = f"{model.describe(node)} would have {len(values)} of at most {attribute.upper} values of `{attribute.name}`"
    return RuleError(text, reason="full", details=[repr(value) for value in values])


def wrong_link(model: Model, source: int, reference: Reference, target: int | None) -> EnvgraphError:
    """An end of the link does not exist or is of the wrong class; target None stands for one that is right."""
    for end in (source, target):
        if end is not None and not model.alive(end):
            return missing(model, end)
    known = reference in model.defined or not model.metamodel.is_a(model.class_of(source), reference.owner)
    if target is None or known:
        return lacks(model, source, reference)
    found = f"{model.describe(target)} is of class `{model.class_of(target)}`"
    return TypeMismatch(f"`{reference}` leads to `{reference.target}`, but {found}")


def full(model: Model, node: int, reference: Reference) -> RuleError:
    """The reference of the object has as many targets as it may have."""
    ends = model.targets(node, reference)
    limit = f"{len(ends)} of at most {reference.upper} targets of `{reference.name}` already"
    relation = model.store.relations[reference.index]
    links = describe_links(model, ((relation, node, other) for other in ends))
    return RuleError(f"{model.describe(node)} has {limit}", reason="full", details=links)


def inside(model: Model, node: int, container: int) -> RuleError:
    """The object cannot be put into the container, being the container or around it."""
    text = f"{model.describe(node)} cannot be put into {model.describe(container)}, "
    text += "itself" if node == container else "which is inside it"
    return RuleError(text, reason="containment")


def dangling(model: Model, node: int, links: list[Link]) -> RuleError:
    """Deleting the object would leave links without an end."""
    text = f"{model.describe(node)} cannot be deleted: {_number(links)} would be left dangling"
    return RuleError(text, reason="dangling", details=describe_links(model, links))


def lost(model: Model, node: int, cls: str, links: list[Link]) -> RuleError:
    """The object cannot become an instance of the class and keep these links."""
    text = f"{model.describe(node)} cannot become `{cls}`: {_number(links)} would be lost"
    return RuleError(text, reason="lost-link", details=describe_links(model, links))


def describe_links(model: Model, links: Iterable[Link]) -> list[str]:
    """Links, for messages."""
    return [
        f"{model.describe(source)} -{relation.reference.name}-> {model.describe(target)}"
        for relation, source, target in links
    ]


def _number(links: list[Link]) -> str:
    return "1 link" if len(links) == 1 else f"{len(links)} links"
