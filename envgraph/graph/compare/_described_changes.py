"""Describe what changed in a model between two moments, as text for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.metamodel import Reference, Value

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph

FeatureValues = tuple[Value, ...]
"""The values of a feature; those of a reference are ids of objects."""


@dataclass(frozen=True, slots=True)
class DescribedObjects:
    """The names, classes and features of some objects at one moment, and the ids of all objects.

    >>> from envgraph.graph import Model
    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> model = Model(Metamodel("house", [Class("Door", features=(Attribute("height", Scalar.INT),))]))
    >>> door = model.create("Door", height=2)
    >>> before = DescribedObjects.of(model.graph, [door.id])
    >>> door.height = 3
    >>> before.changes(model.graph)
    ['Door#0.height = 3 (was 2)']
    """

    titles: Mapping[int, str]
    classes: Mapping[int, str]
    features: Mapping[int, Mapping[str, FeatureValues]]
    every: frozenset[int]

    @classmethod
    def of(cls, graph: Graph, objects: Iterable[int]) -> DescribedObjects:
        """Return the present state of objects, which are given by id."""
        ids = list(dict.fromkeys(objects))
        return cls(
            {one: _title(graph, one) for one in ids},
            {one: graph.class_of(one) for one in ids},
            {one: _feature_values(graph, one) for one in ids},
            frozenset(graph.store.nodes()),
        )

    def changes(self, graph: Graph) -> list[str]:
        """Return a text for each change since then: of the described objects, and of objects that were created."""
        found: list[str] = []
        for node, title in self.titles.items():
            if not graph.alive(node):
                found.append(f"{title} is deleted")
                continue
            if graph.class_of(node) != self.classes[node]:
                found.append(f"{title} is now {graph.class_of(node)}")
            found += _feature_changes(graph, node, title, self.features[node])
        return found + [f"{_title(graph, node)} is created" for node in graph.store.nodes() if node not in self.every]


def _title(graph: Graph, node: int) -> str:
    return graph.describe(node).strip("`")


def _feature_values(graph: Graph, node: int) -> dict[str, FeatureValues]:
    features = graph.metamodel.features(graph.class_of(node))
    return {name: tuple(graph.read_feature(node, feature)) for name, feature in features.items()}


def _feature_changes(graph: Graph, node: int, title: str, before: Mapping[str, FeatureValues]) -> list[str]:
    """Return texts for changed attributes and references with at most one target; other references have an opposite
    that says the same, or are of no interest in a short text.
    """
    features = graph.metamodel.features(graph.class_of(node))
    found = []
    for name, values in _feature_values(graph, node).items():
        feature, old = features[name], before.get(name, ())
        if values == old or name not in before:
            continue
        if not isinstance(feature, Reference):
            found.append(f"{title}.{name} = {_values_text(values)} (was {_values_text(old)})")
        elif not feature.many:
            found.append(f"{title}.{name} = {', '.join(_title(graph, int(one)) for one in values) or 'none'}")
    return found


def _values_text(values: FeatureValues) -> str:
    return ", ".join(str(one).lower() if isinstance(one, bool) else str(one) for one in values) or "none"
