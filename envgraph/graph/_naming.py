"""Names of objects of a model, and the places of those in grids."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph.errors import InvalidArgument, visible
from envgraph.graph import _refusals as refusals

if TYPE_CHECKING:
    from envgraph.graph._model import Model


def find_object(model: Model, object_name: str) -> int | None:
    """The object with this name, or None; one of a grid has that of its place, such as `tile[3, 1]`."""
    found = model.store.by_name.get(object_name)
    if found is None and model.places:
        place = model.places.get(object_name.replace(" ", ""), -1)
        return place if model.alive(place) else None
    return found


def set_object_name(model: Model, node: int, object_name: str | None) -> None:
    """Give an object another name, or none.

    Raises:
        InvalidArgument: the name is taken by another object.
    """
    check_alive(model, node)
    if object_name == model.store.names[node]:
        return
    if object_name is not None:
        check_free(model, object_name)
    model.store.rename(node, object_name)


def title(model: Model, node: int) -> str | None:
    """Return the name of an object in files, for `find_object`, else its place in a grid, `tile[3, 1]`; or None."""
    if len(model._titles) != len(model.places):
        model._titles = {there: place.replace(",", ", ") for place, there in model.places.items()}
    return model.store.names[node] or model._titles.get(node)


def describe(model: Model, node: int) -> str:
    """An object for messages: what a file calls it, else its class with its key, `Box {label = a}`, or its id."""
    if not model.alive(node):
        return f"object {node!r}"
    key = ", ".join(
        f"{name} = {model.node(node)[name]}" for name in model.metamodel.key(model.class_of(node))
    )
    known = f" {{{visible(key)}}}" if key else f"#{node}"
    return f"`{model.title(node) or model.class_of(node) + known}`"


def check_free(model: Model, object_name: str) -> None:
    if model.find_object(object_name) is not None:
        raise InvalidArgument(f"`{model.name}` has an object `{object_name}` already")


def check_alive(model: Model, node: int) -> None:
    if not model.alive(node):
        raise refusals.missing(model, node)
