"""Write values of attributes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.graph.store._undo_log import OrderedValues
from envgraph.graph.write import _write_errors as refusals
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
    layout = graph.tables
    if not layout.allows_attribute[index][graph.store.classes[node]]:
        raise refusals.lacks_feature_error(graph, node, attribute)
    kind = layout.value_types[index]
    if type(value) is not kind or layout.needs_value_check[index]:
        if attribute.many:
            value = _coerce_all(graph, node, attribute, () if value is None else value)
        elif value is not None:
            value = _coerce(graph, attribute, value)
    held = graph.store.values[index][node]
    if held != value and not (type(held) is OrderedValues and tuple(held) == value):
        graph.store.set_value(node, index, value)


def insert_value(graph: Graph, node: int, attribute: Attribute, index: int, value: Value) -> bool:
    """Insert a value before the value at `index`, as `list.insert` does.

    Return False if values must be unique and the value exists already.

    Raises:
        TypeMismatch: as for `set_value`.
        RuleError: the attribute has its maximal number of values ("full").
    """
    held, value = _stored_values(graph, node, attribute), _coerce(graph, attribute, value)
    if attribute.unique and value in graph.store.distinct[attribute.index][node]:
        return False
    if attribute.upper is not None and len(held) >= attribute.upper:
        raise refusals.too_many_values_error(graph, node, attribute, (*held, value))
    index = max(0, len(held) + index) if index < 0 else min(index, len(held))
    graph.store.splice_value(node, attribute.index, index, value, True)
    return True


def remove_value_at(graph: Graph, node: int, attribute: Attribute, index: int) -> None:
    """Remove the value at `index` (from 0; negative from the end) of a multi-valued attribute.

    Raises:
        IndexError: the attribute has no value at `index`.
    """
    held = _stored_values(graph, node, attribute)
    place = range(len(held))[index]
    graph.store.splice_value(node, attribute.index, place, held[place], False)


def _stored_values(graph: Graph, node: int, attribute: Attribute) -> Sequence[Value]:
    if not graph.tables.allows_attribute[attribute.index][graph.store.classes[node]]:
        raise refusals.lacks_feature_error(graph, node, attribute)
    return graph.store.values[attribute.index][node] or ()


def _coerce(graph: Graph, attribute: Attribute, value: object) -> Value:
    if not accepts(attribute.type, value):
        raise refusals.wrong_value_error(attribute, value)
    return graph.tables.value_types[attribute.index](value)  # type: ignore[no-any-return]


def _coerce_all(graph: Graph, node: int, attribute: Attribute, values: object) -> Values:
    if not isinstance(values, list | tuple):
        raise refusals.not_a_list_error(attribute, values)
    found = tuple(_coerce(graph, attribute, value) for value in values)
    if attribute.unique and len(dict.fromkeys(found)) < len(found):
        raise refusals.repeated_value_error(attribute, found)
    if attribute.upper is not None and len(found) > attribute.upper:
        raise refusals.too_many_values_error(graph, node, attribute, found)
    return found
