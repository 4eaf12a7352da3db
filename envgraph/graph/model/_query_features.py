"""Derived features, whose values are computed by queries. They can be read by handles and cannot be written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from envgraph.code import shorten_repr
from envgraph.graph.store._metamodel_tables import MetamodelTables
from envgraph.metamodel import Attribute, Feature

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


@shorten_repr
class FeatureDefinition(NamedTuple):
    """The definition of a derived feature by a query.

    It consists of the query's name, a function from an object to its values or target ids, and the matcher.
    """

    query: str
    read: Callable[[int], Sequence[Any]]
    matcher: object


def first_object_with_value(graph: Graph, feature: Feature) -> int | None:
    """Return the first object that has a target of `feature`, or a value other than the initial one, or None."""
    columns = graph.store.values if isinstance(feature, Attribute) else graph.store.forward
    usual = (feature.initial,) if isinstance(feature, Attribute) else ()
    held = ((node, columns[feature.index][node]) for node in graph.store.nodes())
    return next((node for node, one in held if one not in (None, (), *usual)), None)


def read_feature(graph: Graph, node: int, feature: Feature) -> Sequence[Any]:
    """Return the values of a feature, or the ids of its targets. A query computes them if it defines the feature.

    An unset single-valued attribute gives (None,).
    """
    if graph.defined_features and feature in graph.defined_features:
        return graph.defined_features[feature].read(node)
    columns = graph.store.values if isinstance(feature, Attribute) else graph.store.forward
    held = columns[feature.index][node]
    return (held,) if isinstance(feature, Attribute) and not feature.many else held or ()


def define_features(graph: Graph, defined: Mapping[Feature, FeatureDefinition]) -> None:
    """Make the features in `defined` read-only features that queries compute. Earlier definitions are replaced.

    No object may have stored values or links of these features.
    """
    if graph.defined_features == defined:
        return
    graph.defined_features, graph.tables = dict(defined), MetamodelTables(graph.metamodel, graph.store)
    no_class = (False,) * (len(graph.metamodel.class_list) + 1)
    for relation in graph.store.relations:
        owner = graph.metamodel.instance_flags(relation.reference.owner)
        relation.allows_source = no_class if relation.reference in defined else owner
    graph.tables.allows_attribute = tuple(
        no_class if attribute in defined else ok
        for attribute, ok in zip(graph.metamodel.attributes, graph.tables.allows_attribute, strict=True)
    )
