"""Create, delete and retype objects of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from envgraph.errors import InvalidArgument
from envgraph.graph.store._dangling_links import Link, contained_tree, dangling_links, links_in, links_of
from envgraph.graph.write import _write_errors as refusals
from envgraph.graph.write._naming import check_alive, check_name_unused
from envgraph.metamodel import Value, Values

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph

Semantics = Literal["dpo", "spo"]


def new(graph: Graph, cls: str, object_name: str | None = None) -> int:
    """Create an object whose attributes have their initial values, and return its id.

    Raises:
        TypeMismatch: an unknown or abstract class.
        InvalidArgument: another object has the name.
    """
    return graph.new_at(graph.store.next_id, cls, object_name)


def new_at(graph: Graph, node: int, cls: str, object_name: str | None = None) -> int:
    """Create an object with a given id, for reading stored models, and return the id. Later objects get greater ids.

    The columns are as long as the largest id, so ids should be dense.

    Raises:
        InvalidArgument: the id is negative or in use, or another object has the name.
        TypeMismatch: an unknown or abstract class.
    """
    store = graph.store
    number = _concrete_class_index(graph, cls)
    if object_name is not None:
        check_name_unused(graph, object_name)
    if node < 0 or (node < store.next_id and store.classes[node] >= 0):
        raise InvalidArgument(f"a new object cannot have the id {node}: the id is negative or in use")
    try:
        return _create_at(graph, node, number, object_name)
    except BaseException:
        store.interrupted_writes.append((_create_at, (graph, node, number, object_name)))
        store.interrupted_writes.repair()
        raise


def _create_at(graph: Graph, node: int, cls: int, object_name: str | None) -> int:
    store = graph.store
    if node >= store.next_id:
        if len(store.classes) <= node + 1:
            store.reserve_ids(2 * node + 2)
        store.next_id = node + 1
    if store.classes[node] != cls:
        store.add_to_class(node, cls)
    for attribute, initial in graph.tables.initial_values[cls]:
        store.set_value(node, attribute, initial)
    if object_name is not None and store.names[node] is None:
        store.set_name(node, object_name)
    return node


def delete(graph: Graph, node: int, semantics: Semantics = "dpo") -> None:
    """Delete an object and everything that it contains.

    Args:
        node: the object.
        semantics: "dpo" (double pushout) refuses if links would be left dangling. These are the links between a deleted
            object and a remaining object (except the link from the container), and the links from the object to itself.
            "spo" (single pushout) deletes these links too.

    Raises:
        InvalidArgument: no object has this id.
        RuleError: reason "dangling"; `details` has a line for each dangling link.
    """
    if semantics not in ("dpo", "spo"):
        raise InvalidArgument(f'`semantics` is {semantics!r}, but must be "dpo" or "spo"')
    check_alive(graph, node)
    store, layout = graph.store, graph.tables
    tree = contained_tree(store, layout, node)
    dangling = list(dangling_links(store, layout, tree)) if semantics == "dpo" else []
    if dangling:
        raise refusals.dangling_links_error(graph, node, dangling)
    store.interrupted_writes.run(_delete_tree, graph, tree)


def _delete_tree(graph: Graph, tree: Sequence[int]) -> None:
    """Delete the given objects with all their links, skipping objects that are deleted already."""
    store, layout = graph.store, graph.tables
    for gone in tree:
        if store.classes[gone] >= 0:
            for relation, source, target in list(links_of(store, layout, gone)):
                relation.disconnect(source, target)
    for gone in reversed(tree):
        if store.classes[gone] >= 0:
            _delete_object(graph, gone)


def _delete_object(graph: Graph, node: int) -> None:
    store = graph.store
    for attribute, _ in graph.tables.initial_values[store.classes[node]]:
        if store.values[attribute][node] is not None:
            store.set_value(node, attribute, None)
    if store.names[node] is not None:
        store.set_name(node, None)
    store.remove_from_class(node)


def retype(graph: Graph, node: int, cls: str, lossy: bool = False) -> None:
    """Make an object a direct instance of another class. Its identity, name and shared features are kept.

    Values of attributes that the new class lacks are removed. Added attributes get their initial values.

    Args:
        node: the object.
        cls: a concrete class.
        lossy: remove links that the new class does not allow, instead of refusing.

    Raises:
        TypeMismatch: an unknown or abstract class.
        RuleError: reason "lost-link"; `details` has a line for each link that would be lost.
    """
    store = graph.store
    old = store.classes[node]
    new = _concrete_class_index(graph, cls)
    if old < 0:
        check_alive(graph, node)
    if old == new:
        return
    dropped, gained, forbidden = graph.tables.retyping_effects(old, new)
    lost = list(links_in(node, forbidden))
    if lost and not lossy:
        raise refusals.lost_links_error(graph, node, cls, lost)
    store.interrupted_writes.run(_retype_object, graph, node, new, lost, dropped, gained)


def _retype_object(
    graph: Graph,
    node: int,
    cls: int,
    lost: Sequence[Link],
    dropped: Sequence[int],
    gained: Sequence[tuple[int, Value | Values]],
) -> None:
    """Change the class, links and values of an object as `retype` says. Steps that are done already are skipped."""
    store = graph.store
    for relation, source, target in lost:
        if target in relation.forward[source]:
            relation.disconnect(source, target)
    for attribute in dropped:
        if store.values[attribute][node] is not None:
            store.set_value(node, attribute, None)
    if store.classes[node] != cls:
        store.change_class(node, cls)
    for attribute, initial in gained:
        store.set_value(node, attribute, initial)


def _concrete_class_index(graph: Graph, cls: str) -> int:
    number = graph.tables.concrete_class_indexes.get(cls)
    if number is None:
        raise refusals.not_instantiable_error(graph.metamodel, cls)
    return number
