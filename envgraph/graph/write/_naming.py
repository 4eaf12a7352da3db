"""Names of the objects of a model, and their grid positions such as `tile[3, 1]`, which serve as names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph.errors import InvalidArgument, escape_unprintable
from envgraph.graph.write import _write_errors as refusals

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


def find_object(graph: Graph, object_name: str) -> int | None:
    """Return the object with a name, or None. Objects of a grid are also found by position, such as `tile[3, 1]`."""
    found = graph.store.by_name.get(object_name)
    if found is None and graph.grid_positions:
        place = graph.grid_positions.get(object_name.replace(" ", ""), -1)
        return place if graph.alive(place) else None
    return found


def set_object_name(graph: Graph, node: int, object_name: str | None) -> None:
    """Set the name of an object, or remove it (None).

    Raises:
        InvalidArgument: the object does not exist, or another object has the name.
    """
    check_alive(graph, node)
    if object_name == graph.store.names[node]:
        return
    if object_name is not None:
        check_name_unused(graph, object_name)
    graph.store.set_name(node, object_name)


def display_name(graph: Graph, node: int) -> str | None:
    """Return the name of an object as files show it: its own name, else its grid position (`tile[3, 1]`), else None."""
    if len(graph.grid_titles) != len(graph.grid_positions):
        graph.grid_titles = {there: place.replace(",", ", ") for place, there in graph.grid_positions.items()}
    return graph.store.names[node] or graph.grid_titles.get(node)


def describe(graph: Graph, node: int) -> str:
    """Return the text for an object in messages. For an id without an object it is `object 3`.

    Otherwise it is the name or grid position, else the class with the values of its key (`Box {label = a}`), else the
    class with the id (`Box#3`).
    """
    if not graph.alive(node):
        return f"object {node!r}"
    cls = graph.class_of(node)
    features = graph.metamodel.features(cls)
    values = {name: next(iter(graph.read_feature(node, features[name])), None) for name in graph.metamodel.key(cls)}
    key = ", ".join(f"{name} = {value}" for name, value in values.items())
    known = f" {{{escape_unprintable(key)}}}" if key else f"#{node}"
    return f"`{graph.display_name(node) or cls + known}`"


def check_name_unused(graph: Graph, object_name: str) -> None:
    if graph.find_object(object_name) is not None:
        raise InvalidArgument(f"`{graph.name}` has an object `{object_name}` already")


def check_alive(graph: Graph, node: int) -> None:
    if not graph.alive(node):
        raise refusals.missing_object_error(graph, node)
