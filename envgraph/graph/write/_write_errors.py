"""Construct the errors for refused writes to a model. The caller raises them."""

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
    from envgraph.graph.model._graph import Graph
    from envgraph.graph.store._dangling_links import Link


def missing_object_error(graph: Graph, node: object) -> InvalidArgument:
    """Return the error for an id that belongs to no object."""
    return InvalidArgument(f"`{graph.name}` has no object {node!r}: it was never created, was deleted, or was undone")


def unknown_object_error(graph: Graph, object_name: object) -> InvalidArgument:
    """Return the error for a name that belongs to no object, or for a value that is not a name."""
    if not isinstance(object_name, str):
        return InvalidArgument(f"objects are found by name, not by {object_name!r}; for an id write `model.node(id)`")
    used = [
        *(name for name, node in graph.store.by_name.items() if node is not None),
        *(place for place, node in graph.grid_positions.items() if graph.alive(node)),
    ]
    hint = did_you_mean(object_name, used) or "objects without a name are in `model.nodes(..)`, by class"
    return InvalidArgument(f"`{graph.name}` has no object `{object_name}`", hint)


def not_instantiable_error(metamodel: Metamodel, cls: str) -> TypeMismatch:
    """Return the error for creating an instance of an unknown or abstract class."""
    if cls not in metamodel.classes:
        return unknown_class_error(metamodel, cls)
    below = ", ".join(f"`{name}`" for name in metamodel.concrete_classes(cls)) or "none"
    return TypeMismatch(f"`{cls}` is abstract", f"use a concrete subclass: {below}")


def unknown_class_error(metamodel: Metamodel, cls: str) -> TypeMismatch:
    """Return the error for an unknown class."""
    return TypeMismatch(f"unknown class `{cls}`", metamodel.suggest_class(cls))


def lacks_feature_error(graph: Graph, node: int, feature: Feature) -> EnvgraphError:
    """Return the error for writing a feature that the object cannot be given.

    Either the object does not exist, or a query defines the feature, or the class of the object lacks the feature.
    """
    if not graph.alive(node):
        return missing_object_error(graph, node)
    if feature in graph.defined_features:
        text = f"`{feature}` is read-only: query `{graph.defined_features[feature].query}` defines its values"
        return TypeMismatch(text, "change the data that the query reads")
    return TypeMismatch(f"`{graph.class_of(node)}` has no feature `{feature.name}`; only `{feature.owner}` has it")


def not_a_list_error(attribute: Attribute, value: object) -> TypeMismatch:
    """Return the error for a single value given to a multi-valued attribute."""
    return TypeMismatch(f"`{attribute}` takes several values: write a list of them, not {value!r}")


def wrong_value_error(attribute: Attribute, value: object) -> TypeMismatch:
    """Return the error for a value of the wrong type, or outside the range of the attribute's type."""
    hint = None
    if isinstance(attribute.type, EnumType) and isinstance(value, str):
        hint = did_you_mean(value, attribute.type.literals)
        hint = hint or "its literals: " + ", ".join(f"`{literal}`" for literal in attribute.type.literals)
    kind = type_name(attribute.type)
    if attribute.type is Scalar.INT and type(value) is int:
        hint = f"write an int of 64 bits, from {-LARGEST_INT - 1} to {LARGEST_INT}"
    try:
        shown = repr(value)
    except ValueError:  # Python refuses to format ints of thousands of digits
        shown = "a number of thousands of digits"
    shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
    return TypeMismatch(f"`{attribute}` takes {kind}, not {shown} ({type(value).__name__})", hint)


def repeated_value_error(attribute: Attribute, values: Values) -> InvalidArgument:
    """Return the error for a duplicate in the values of an attribute whose values must be unique."""
    twice = next(value for place, value in enumerate(values) if value in values[:place])
    message = f"the values of `{attribute}` must be unique, but {twice!r} is given twice"
    return InvalidArgument(message, "remove the duplicate, or mark the attribute `@nonunique`")


def too_many_values_error(graph: Graph, node: int, attribute: Attribute, values: Values) -> RuleError:
    """Return the error for more values than the upper bound of an attribute allows; it lists them in order."""
    text = f"{graph.describe(node)} would have {len(values)} of at most {attribute.upper} values of `{attribute.name}`"
    return RuleError(text, reason="full", details=[repr(value) for value in sorted(values)])


def wrong_link_error(graph: Graph, source: int, reference: Reference, target: int | None) -> EnvgraphError:
    """Return the error for a link that cannot be written.

    An end does not exist or has the wrong class, or a query defines the reference. If `target` is None, only the source
    can be wrong.
    """
    for end in (source, target):
        if end is not None and not graph.alive(end):
            return missing_object_error(graph, end)
    known = reference in graph.defined_features or not graph.metamodel.is_a(graph.class_of(source), reference.owner)
    if target is None or known:
        return lacks_feature_error(graph, source, reference)
    found = f"{graph.describe(target)} is of class `{graph.class_of(target)}`"
    return TypeMismatch(f"`{reference}` leads to `{reference.target}`, but {found}")


def full_reference_error(graph: Graph, node: int, reference: Reference) -> RuleError:
    """Return the error for adding a target to a reference that already has its maximal number of targets."""
    ends = graph.targets(node, reference)
    limit = f"{len(ends)} of at most {reference.upper} targets of `{reference.name}` already"
    relation = graph.store.relations[reference.index]
    links = describe_links(graph, ((relation, node, other) for other in ends))
    return RuleError(f"{graph.describe(node)} has {limit}", reason="full", details=links)


def cyclic_containment_error(graph: Graph, node: int, container: int) -> RuleError:
    """Return the error for moving the object `node` into itself or into an object that it contains."""
    text = f"{graph.describe(node)} cannot be put into {graph.describe(container)}, "
    text += "itself" if node == container else "which is inside it"
    return RuleError(text, reason="containment")


def dangling_links_error(graph: Graph, node: int, links: list[Link]) -> RuleError:
    """Return the error for deleting an object, which would leave links dangling."""
    text = f"{graph.describe(node)} cannot be deleted: {_link_count_text(links)} would be left dangling"
    return RuleError(text, reason="dangling", details=describe_links(graph, links))


def lost_links_error(graph: Graph, node: int, cls: str, links: list[Link]) -> RuleError:
    """Return the error for retyping an object, which would lose links."""
    text = f"{graph.describe(node)} cannot become `{cls}`: {_link_count_text(links)} would be lost"
    return RuleError(text, reason="lost-link", details=describe_links(graph, links))


def describe_links(graph: Graph, links: Iterable[Link]) -> list[str]:
    """Return a text for each link, `source -reference-> target`, for messages, by reference and age of the objects."""
    found = sorted((relation.reference.index, source, target) for relation, source, target in links)
    return [
        f"{graph.describe(source)} -{graph.metamodel.references[index].name}-> {graph.describe(target)}"
        for index, source, target in found
    ]


def _link_count_text(links: list[Link]) -> str:
    return "1 link" if len(links) == 1 else f"{len(links)} links"
