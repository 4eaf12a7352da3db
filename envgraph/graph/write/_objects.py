"""Create, delete and retype objects of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from envgraph.errors import InvalidArgument
from envgraph.graph.store._incidence import Link, contained_tree, dangling_links, links_at, links_of
from envgraph.graph.write import _refusals as refusals
from envgraph.graph.write._naming import check_alive, check_free
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
    number = _concrete(graph, cls)
    if object_name is not None:
        check_free(graph, object_name)
    if node < 0 or (node < store.next_id and store.classes[node] >= 0):
        raise InvalidArgument(f"a new object cannot have the id {node}: the id is negative or in use")
    try:
        return _new(graph, node, number, object_name)
    except BaseException:
        store.interrupted.append((_new, (graph, node, number, object_name)))
        store.interrupted.repair()
        raise


def _new(graph: Graph, node: int, cls: int, object_name: str | None) -> int:
    store = graph.store
    if node >= store.next_id:
        if len(store.classes) <= node + 1:
            store.reserve(2 * node + 2)
        store.next_id = node + 1
    if store.classes[node] != cls:
        store.enter(node, cls)
    for attribute, initial in graph.layout.initials[cls]:
        store.put(node, attribute, initial)
    if object_name is not None and store.names[node] is None:
        store.rename(node, object_name)
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
    store, layout = graph.store, graph.layout
    tree = contained_tree(store, layout, node)
    dangling = list(dangling_links(store, layout, tree)) if semantics == "dpo" else []
    if dangling:
        raise refusals.dangling(graph, node, dangling)
    try:
        _delete(graph, tree)
    except BaseException:
        store.interrupted.append(
            (
                _delete,
                (
                    graph,
                    tree,
                ),
            )
        )
        store.interrupted.repair()
        raise


def _delete(graph: Graph, tree: Sequence[int]) -> None:
    """Delete the given objects with all their links, skipping objects that are deleted already."""
    store, layout = graph.store, graph.layout
    for gone in tree:
        if store.classes[gone] >= 0:
            for relation, source, target in list(links_of(store, layout, gone)):
                relation.disconnect(source, target)
    for gone in reversed(tree):
        if store.classes[gone] >= 0:
            _erase(graph, gone)


def _erase(graph: Graph, node: int) -> None:
    store = graph.store
    for attribute, _ in graph.layout.initials[store.classes[node]]:
        if store.values[attribute][node] is not None:
            store.put(node, attribute, None)
    if store.names[node] is not None:
        store.rename(node, None)
    store.leave(node)


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
    new = _concrete(graph, cls)
    if old < 0:
        check_alive(graph, node)
    if old == new:
        return
    dropped, gained, forbidden = graph.layout.retyping(old, new)
    lost = list(links_at(node, forbidden))
    if lost and not lossy:
        raise refusals.lost(graph, node, cls, lost)
    try:
        _retype(graph, node, new, lost, dropped, gained)
    except BaseException:
        store.interrupted.append((_retype, (graph, node, new, lost, dropped, gained)))
        store.interrupted.repair()
        raise


def _retype(
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
            store.put(node, attribute, None)
    if store.classes[node] != cls:
        store.move(node, cls)
    for attribute, initial in gained:
        store.put(node, attribute, initial)


def _concrete(graph: Graph, cls: str) -> int:
    number = graph.layout.concrete.get(cls)
    if number is None:
        raise refusals.not_instantiable(graph.metamodel, cls)
    return number
