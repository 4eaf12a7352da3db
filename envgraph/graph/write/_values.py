"""Write values of attributes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.graph.store._journal import Ordered
from envgraph.graph.write import _refusals as refusals
from envgraph.metamodel import Attribute, Value, Values, accepts

if TYPE_CHECKING:
    from envgraph.graph.model._graph import Graph


def set_value(graph: Graph, node: int, attribute: Attribute, value: Value | Sequence[Value] | None) -> None:
    """Set an attribute of an object, or clear it (None). An int for a float attribute is converted to a float.

    A multi-valued attribute takes a list or tuple of values.

    Raises:
        TypeMismatch: the value is not of the attribute's type, or the object's class lacks the attribute.
        InvalidArgument: the object does not exist, or a value is given twice although values must be unique.
        RuleError: more values than the upper bound allows ("full").
    """
    index = attribute.index
    layout = graph.layout
    if not layout.attribute_ok[index][graph.store.classes[node]]:
        raise refusals.lacks(graph, node, attribute)
    kind = layout.kinds[index]
    if type(value) is not kind or layout.checked[index]:
        if attribute.many:
            value = _all_coerced(graph, node, attribute, () if value is None else value)
        elif value is not None:
            value = _coerced(graph, attribute, value)
    held = graph.store.values[index][node]
    if held != value and not (type(held) is Ordered and tuple(held) == value):
        graph.store.put(node, index, value)


def insert_value(graph: Graph, node: int, attribute: Attribute, index: int, value: Value) -> bool:
    """Insert a value before the value at `index`, as `list.insert` does.

    Return False if values must be unique and the value exists already.

    Raises:
        TypeMismatch: as for `set_value`.
        RuleError: the attribute has its maximal number of values ("full").
    """
    held, value = _held(graph, node, attribute), _coerced(graph, attribute, value)
    if attribute.unique and value in graph.store.distinct[attribute.index][node]:
        return False
    if attribute.upper is not None and len(held) >= attribute.upper:
        raise refusals.too_many(graph, node, attribute, (*held, value))
    index = max(0, len(held) + index) if index < 0 else min(index, len(held))
    graph.store.splice(node, attribute.index, index, value, True)
    return True


def remove_value_at(graph: Graph, node: int, attribute: Attribute, index: int) -> None:
    """Remove the value at `index` (from 0; negative from the end) of a multi-valued attribute.

    Raises:
        IndexError: the attribute has no value at `index`.
    """
    held = _held(graph, node, attribute)
    place = range(len(held))[index]
    graph.store.splice(node, attribute.index, place, held[place], False)


def _held(graph: Graph, node: int, attribute: Attribute) -> Sequence[Value]:
    if not graph.layout.attribute_ok[attribute.index][graph.store.classes[node]]:
        raise refusals.lacks(graph, node, attribute)
    return graph.store.values[attribute.index][node] or ()


def _coerced(graph: Graph, attribute: Attribute, value: object) -> Value:
    if not accepts(attribute.type, value):
        raise refusals.wrong_value(attribute, value)
    return graph.layout.kinds[attribute.index](value)  # type: ignore[no-any-return]


def _all_coerced(graph: Graph, node: int, attribute: Attribute, values: object) -> Values:
    if not isinstance(values, list | tuple):
        raise refusals.no_list(attribute, values)
    found = tuple(_coerced(graph, attribute, value) for value in values)
    if attribute.unique and len(dict.fromkeys(found)) < len(found):
        raise refusals.repeated(attribute, found)
    if attribute.upper is not None and len(found) > attribute.upper:
        raise refusals.too_many(graph, node, attribute, found)
    return found
