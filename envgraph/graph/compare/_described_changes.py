"""Describe what changed in a model between two moments, as text for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Feature, Metamodel

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph

FeatureValues = tuple[Any, ...]
"""The values of a feature; those of a reference are ids of objects."""


@dataclass(frozen=True, slots=True)
class ModelSnapshot:
    """The names, classes and features of some objects at one moment, and the ids of all objects.

    >>> from envgraph.graph import Model
    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> model = Model(Metamodel("house", [Class("Door", features=(Attribute("height", Scalar.INT),))]))
    >>> door = model.create("Door", height=2)
    >>> before = ModelSnapshot.of(model.graph)
    >>> door.height = 3
    >>> before.changes(model.graph)
    ['Door#0.height = 3 (was 2)']
    """

    titles: Mapping[int, str]
    classes: Mapping[int, str]
    features: Mapping[int, Mapping[str, FeatureValues]]
    every: frozenset[int]

    @classmethod
    def of(cls, graph: Graph, objects: Iterable[int] | None = None) -> ModelSnapshot:
        """Return the present state of objects, which are given by id; None for all objects."""
        ids = list(graph.store.nodes() if objects is None else dict.fromkeys(objects))
        return cls(
            {one: _title(graph, one) for one in ids},
            {one: graph.class_of(one) for one in ids},
            {one: _feature_values(graph, one) for one in ids},
            frozenset(graph.store.nodes()),
        )

    def changes(self, graph: Graph) -> list[str]:
        """Return a text for each change since the snapshot: of its objects, and of objects that were created.

        A link that two opposite references hold is reported once.
        """
        found = [f"{self.titles[node]} is deleted" for node in self.titles if not graph.alive(node)]
        for node, title in self.titles.items():
            if graph.alive(node):
                if graph.class_of(node) != self.classes[node]:
                    found.append(f"{title} is now {graph.class_of(node)}")
                found += self._feature_changes(graph, node, title)
        return found + [f"{_title(graph, node)} is created" for node in graph.store.nodes() if node not in self.every]

    def _feature_changes(self, graph: Graph, node: int, title: str) -> Iterator[str]:
        features, before = graph.metamodel.features(graph.class_of(node)), self.features[node]
        for name, values in _feature_values(graph, node).items():
            feature, old = features[name], before.get(name, ())
            if values == old or name not in before or not _is_described(graph.metamodel, feature):
                continue
            if isinstance(feature, Attribute):
                yield f"{title}.{name} = {_values_text(values)} (was {_values_text(old)})"
            elif not feature.many:
                yield f"{title}.{name} = {', '.join(_title(graph, one) for one in values) or 'none'}"
            else:
                yield from (
                    f"{title}.{name}: {self._old_title(graph, one)} removed" for one in old if one not in values
                )
                yield from (f"{title}.{name}: {_title(graph, one)} added" for one in values if one not in old)

    def _old_title(self, graph: Graph, node: int) -> str:
        return self.titles.get(node) or _title(graph, node)


def _is_described(metamodel: Metamodel, feature: Feature) -> bool:
    """Return False if the opposite is described instead: of two opposites, the single-valued or else the first one."""
    if isinstance(feature, Attribute) or feature.opposite is None or not feature.many:
        return True
    opposite = metamodel.features(feature.target)[feature.opposite]
    return not isinstance(opposite, Attribute) and opposite.many and feature.index < opposite.index


def _title(graph: Graph, node: int) -> str:
    return graph.describe(node).strip("`")


def _feature_values(graph: Graph, node: int) -> dict[str, FeatureValues]:
    features = graph.metamodel.features(graph.class_of(node))
    return {name: tuple(graph.read_feature(node, feature)) for name, feature in features.items()}


def _values_text(values: FeatureValues) -> str:
    return ", ".join(str(one).lower() if isinstance(one, bool) else str(one) for one in values) or "none"
