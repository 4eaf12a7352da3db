"""Objects of a model: created, deleted, and made instances of other classes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from envgraph.errors import InvalidArgument
from envgraph.graph import _refusals as refusals
from envgraph.graph._incidence import Link, contained_tree, dangling_links, links_at, links_of
from envgraph.graph._naming import check_alive, check_free
from envgraph.metamodel import Value, Values

if TYPE_CHECKING:
    from envgraph.graph._model import Model

Semantics = Literal["dpo", "spo"]


def new(model: Model, cls: str, object_name: str | None = None) -> int:
    """Create an object whose attributes have their initial values, and return its id.

    Raises:
        TypeMismatch: an unknown or abstract class.
        InvalidArgument: the object name is taken.
    """
    return model.new_at(model.store.next_id, cls, object_name)


def new_at(model: Model, node: int, cls: str, object_name: str | None = None) -> int:
    """As `new`, with a given id, for reading models back.

    The columns are as long as the largest id, so ids should be dense.

    Raises:
        InvalidArgument: the id is negative or that of an object; the object name is taken.
        TypeMismatch: an unknown or abstract class.
    """
    store = model.store
    number = _concrete(model, cls)
    if object_name is not None:
        check_free(model, object_name)
    if node < 0 or (node < store.next_id and store.classes[node] >= 0):
        raise InvalidArgument(f"{node} is not the id of a new object")
    try:
        return _new(model, node, number, object_name)
    except BaseException:
        store.interrupted.append((_new, (model, node, number, object_name)))
        store.interrupted.repair()
        raise


def _new(model: Model, node: int, cls: int, object_name: str | None) -> int:
    store = model.store
    if node >= store.next_id:
        if len(store.classes) <= node + 1:
            store.reserve(2 * node + 2)
        store.next_id = node + 1
    if store.classes[node] != cls:
        store.enter(node, cls)
    for attribute, initial in model._layout.initials[cls]:
        store.put(node, attribute, initial)
    if object_name is not None and store.names[node] is None:
        store.rename(node, object_name)
    return node


def delete(model: Model, node: int, semantics: Semantics = "dpo") -> None:
    """Delete an object and everything it contains.

    Args:
        node: the object.
        semantics: "dpo" refuses while other links would be left dangling: links between a deleted object and one
            that stays, except the link from the container, and links from the object to itself. "spo" deletes
            those too.

    Raises:
        RuleError: reason "dangling"; `details` has a line for each such link.
    """
    if semantics not in ("dpo", "spo"):
        raise InvalidArgument(f'semantics is "dpo" or "spo", not {semantics!r}')
    check_alive(model, node)
    store, layout = model.store, model._layout
    tree = contained_tree(store, layout, node)
    dangling = list(dangling_links(store, layout, tree)) if semantics == "dpo" else []
    if dangling:
        raise refusals.dangling(model, node, dangling)
    try:
        _delete(model, tree)
    except BaseException:
        store.interrupted.append(
            (
                _delete,
                (
                    model,
                    tree,
                ),
            )
        )
        store.interrupted.repair()
        raise


def _delete(model: Model, tree: Sequence[int]) -> None:
    """Delete what is there of a tree."""
    store, layout = model.store, model._layout
    for gone in tree:
        if store.classes[gone] >= 0:
            for relation, source, target in list(links_of(store, layout, gone)):
                relation.disconnect(source, target)
    for gone in reversed(tree):
        if store.classes[gone] >= 0:
            _erase(model, gone)


def _erase(model: Model, node: int) -> None:
    store = model.store
    for attribute, _ in model._layout.initials[store.classes[node]]:
        if store.values[attribute][node] is not None:
            store.put(node, attribute, None)
    if store.names[node] is not None:
        store.rename(node, None)
    store.leave(node)


def retype(model: Model, node: int, cls: str, lossy: bool = False) -> None:
    """Make an object a direct instance of another class; identity, name and shared features stay.

    Values of attributes that the new class lacks go; attributes that it adds get their initial values.

    Args:
        node: the object.
        cls: a concrete class.
        lossy: drop links that the new class does not allow, instead of refusing.

    Raises:
        TypeMismatch: an unknown or abstract class.
        RuleError: reason "lost-link"; `details` has a line for each such link.
    """
    store = model.store
    old = store.classes[node]
    new = _concrete(model, cls)
    if old < 0:
        check_alive(model, node)
    if old == new:
        return
    dropped, gained, forbidden = model._layout.retyping(old, new)
    lost = list(links_at(node, forbidden))
    if lost and not lossy:
        raise refusals.lost(model, node, cls, lost)
    try:
        _retype(model, node, new, lost, dropped, gained)
    except BaseException:
        store.interrupted.append((_retype, (model, node, new, lost, dropped, gained)))
        store.interrupted.repair()
        raise


def _retype(
    model: Model,
    node: int,
    cls: int,
    lost: Sequence[Link],
    dropped: Sequence[int],
    gained: Sequence[tuple[int, Value | Values]],
) -> None:
    """Do what is left of `retype`."""
    store = model.store
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


def _concrete(model: Model, cls: str) -> int:
    number = model._layout.concrete.get(cls)
    if number is None:
        raise refusals.not_instantiable(model.metamodel, cls)
    return number
