"""Write objects and values of models as text for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from envgraph.graph.model._handles import Node

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


def object_text(graph: Graph, node: int) -> str:
    """Return the class and the name of an object, such as `Box a`; its class and id if it has no name.

    Of an object that was deleted, only the id is known: `#7`.
    """
    if not graph.alive(node):
        return f"#{node}"
    title = graph.display_name(node)
    return f"{graph.class_of(node)} {title}" if title else graph.describe(node).strip("`")


def value_text(value: Any) -> str:
    """Return an object as its `object_text`, and another value as the languages write it."""
    if isinstance(value, Node):
        return object_text(value.model.graph, value.id)
    return str(value).lower() if isinstance(value, bool) else str(value)
