"""Convert models to networkx graphs and back."""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING

from envgraph.errors import EnvgraphError, InvalidArgument, RuleError, TypeMismatch, did_you_mean
from envgraph.graph.model._model import Model
from envgraph.graph.write._write_errors import wrong_value_error
from envgraph.metamodel import Attribute, Metamodel, Reference, accepts

if TYPE_CHECKING:
    import networkx as nx

_CLASS_KEY = "class"
_NAME_KEY = "object_name"


def to_networkx(model: Model) -> nx.MultiDiGraph:
    """Return the current state as a `networkx.MultiDiGraph`.

    Nodes are the ids. Node attributes are "class", "object_name" (if the object has a name) and every attribute with a
    value, as a list if multi-valued. Edges lead from source to target, with the name of the reference as key. A link of
    an opposite pair is an edge in each direction.

    Raises:
        InvalidArgument: an attribute of the metamodel is called "class" or "object_name".
    """
    import networkx as nx

    for attribute in model.metamodel.attributes:
        if attribute.name in (_CLASS_KEY, _NAME_KEY):
            raise InvalidArgument(
                f"attribute `{attribute}` has the name of a node attribute that `to_networkx` sets itself: rename it"
            )
    graph = nx.MultiDiGraph(name=model.name, metamodel=model.metamodel.name)
    for node in model.graph.store.nodes():
        graph.add_node(node, **_node_attributes(model, node))
    for node in model.graph.store.nodes():
        for feature in model.metamodel.features(model.graph.class_of(node)).values():
            if isinstance(feature, Reference):
                graph.add_edges_from((node, target, feature.name) for target in model.graph.targets(node, feature))
    return graph


def _node_attributes(model: Model, node: int) -> dict[str, object]:
    cls = model.graph.class_of(node)
    found: dict[str, object] = {_CLASS_KEY: cls}
    name = model.graph.object_name(node)
    if name is not None:
        found[_NAME_KEY] = name
    for feature in model.metamodel.features(cls).values():
        if isinstance(feature, Attribute) and (values := model.graph.values(node, feature)):
            found[feature.name] = list(values) if feature.many else values[0]
    return found


def from_networkx(graph: nx.MultiDiGraph, metamodel: Metamodel) -> Model:
    """Return a model for a graph in the form that `to_networkx` returns.

    If all nodes are ints of 0 or more, they are the ids. Else objects are numbered in the order of the nodes. Edges of
    opposite references may be omitted. Attributes that a node lacks are unset.

    Raises:
        InvalidArgument: not a directed multigraph; a node without a class or with an unknown feature; an edge whose key
            is not a reference of its source.
        TypeMismatch: a class, value or target that the metamodel does not allow.
        RuleError: too many edges for a reference, two containers for an object, or cyclic containment.
    """
    import networkx as nx

    if not (isinstance(graph, nx.Graph) and graph.is_directed() and graph.is_multigraph()):
        raise InvalidArgument(f"a model is made from a networkx.MultiDiGraph, not from {graph!r}")
    model = Model(metamodel, str(graph.graph.get("name") or "model"))
    are_ids = all(type(label) is int and label >= 0 for label in graph.nodes)
    ids = {label: label if are_ids else index for index, label in enumerate(graph.nodes)}
    with model.loading():
        for label, attributes in graph.nodes(data=True):
            _add_node(model, label, ids[label], attributes)
        for source, target, key in graph.edges(keys=True):
            _add_edge(model, source, ids[source], ids[target], key)
    return model


def _add_node(model: Model, label: Hashable, node: int, attributes: dict[str, object]) -> None:
    cls = attributes.get(_CLASS_KEY)
    if not isinstance(cls, str):
        raise InvalidArgument(f"node {label!r}: {_CLASS_KEY!r} must be the name of a class, not {cls!r}")
    name = attributes.get(_NAME_KEY)
    if name is not None and not isinstance(name, str):
        raise InvalidArgument(f"node {label!r} has the name {name!r}, which is not a string")
    try:
        model.graph.new_at(node, cls, name)
    except TypeMismatch as error:
        raise TypeMismatch(f"node {label!r}: {error}") from None
    features = model.metamodel.features(cls)
    for key in attributes:
        if key not in (_CLASS_KEY, _NAME_KEY) and not isinstance(features.get(key), Attribute):
            hint = did_you_mean(str(key), (f.name for f in features.values() if isinstance(f, Attribute)))
            raise InvalidArgument(f"node {label!r}: `{cls}` has no attribute `{key}`" + (f"; {hint}" if hint else ""))
    for feature in features.values():
        if isinstance(feature, Attribute):
            try:
                value = attributes.get(feature.name)
                if value is not None and not feature.many and not accepts(feature.type, value):
                    raise wrong_value_error(feature, value)
                model.graph.set_value(node, feature, value)  # type: ignore[arg-type]  # checked
            except EnvgraphError as error:
                raise TypeMismatch(f"node {label!r}: {error}") from None


def _add_edge(model: Model, label: Hashable, source: int, target: int, key: object) -> None:
    cls = model.graph.class_of(source)
    reference = model.metamodel.feature(cls, key) if isinstance(key, str) else None
    if not isinstance(reference, Reference):
        raise InvalidArgument(f"an edge from node {label!r} has the key {key!r}, which is not a reference of `{cls}`")
    relation = model.graph.store.relations[reference.index]
    child = target if relation.containment else source if relation.is_contained else None
    if (
        child is not None
        and model.graph.container(child) is not None
        and not model.graph.has_link(source, reference, target)
    ):
        raise RuleError(f"{model.graph.describe(child)} has two containers", reason="containment")
    model.graph.link(source, reference, target)
