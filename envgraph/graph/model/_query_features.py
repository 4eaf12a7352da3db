"""Derived features, whose values are computed by queries. They can be read by handles and cannot be written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from envgraph.code import short_repr
from envgraph.graph.store._layout import Layout
from envgraph.metamodel import Attribute, Feature

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


@short_repr
class Defined(NamedTuple):
    """The definition of a derived feature by a query.

    It consists of the query's name, a function from an object to its values or target ids, and the matcher.
    """

    query: str
    read: Callable[[int], Sequence[Any]]
    matcher: object


def first_with(graph: Graph, feature: Feature) -> int | None:
    """Return the first object that has a target of `feature`, or a value other than the initial one, or None."""
    columns = graph.store.values if isinstance(feature, Attribute) else graph.store.forward
    usual = (feature.initial,) if isinstance(feature, Attribute) else ()
    held = ((node, columns[feature.index][node]) for node in graph.store.nodes())
    return next((node for node, one in held if one not in (None, (), *usual)), None)


def read(graph: Graph, node: int, feature: Feature) -> Sequence[Any]:
    """Return the values of a feature, or the ids of its targets. A query computes them if it defines the feature.

    An unset single-valued attribute gives (None,).
    """
    if graph.defined and feature in graph.defined:
        return graph.defined[feature].read(node)
    columns = graph.store.values if isinstance(feature, Attribute) else graph.store.forward
    held = columns[feature.index][node]
    return (held,) if isinstance(feature, Attribute) and not feature.many else held or ()


def define(graph: Graph, defined: Mapping[Feature, Defined]) -> None:
    """Make the features in `defined` read-only features that queries compute. Earlier definitions are replaced.

    No object may have stored values or links of these features.
    """
    if graph.defined == defined:
        return
    graph.defined, graph.layout = dict(defined), Layout(graph.metamodel, graph.store)
    no_class = (False,) * (len(graph.metamodel.class_list) + 1)
    for relation in graph.store.relations:
        owner = graph.metamodel.instances(relation.reference.owner)
        relation.source_ok = no_class if relation.reference in defined else owner
    graph.layout.attribute_ok = tuple(
        no_class if attribute in defined else ok
        for attribute, ok in zip(graph.metamodel.attributes, graph.layout.attribute_ok, strict=True)
    )
