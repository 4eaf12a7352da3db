"""Values of attributes are written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.graph import _refusals as refusals
from envgraph.metamodel import Attribute, Value, Values, accepts

if TYPE_CHECKING:
    from envgraph.graph._model import Model


def set_value(model: Model, node: int, attribute: Attribute, value: Value | Sequence[Value] | None) -> None:
    """Set or (None) clear an attribute; an int for a float attribute becomes a float.

    An attribute with many values takes a list or tuple of them.

    Raises:
        TypeMismatch: the value is not of the attribute's type, or the object's class lacks the attribute.
        InvalidArgument: a value is given twice that the attribute has once.
        RuleError: more values than the attribute may have ("full").
    """
    index = attribute.index
    layout = model._layout
    if not layout.attribute_ok[index][model.store.classes[node]]:
        raise refusals.lacks(model, node, attribute)
    kind = layout.kinds[index]
    if type(value) is not kind or layout.checked[index]:
        if attribute.many:
            value = _all_coerced(model, node, attribute, () if value is None else value)
        elif value is not None:
            value = _coerced(model, attribute, value)
    if model.store.values[index][node] != value:
        model.store.put(node, index, value)


def add_value(model: Model, node: int, attribute: Attribute, value: Value) -> bool:
    """Add a value behind the others of an attribute with many; False if each stands once, and it is there.

    Raises:
        TypeMismatch: as for `set_value`.
        RuleError: the attribute has as many values as it may have ("full").
    """
    values = model.values(node, attribute)
    if attribute.unique and value in values and accepts(attribute.type, value):
        return False
    model.set_value(node, attribute, (*values, value))
    return True


def remove_value(model: Model, node: int, attribute: Attribute, value: Value) -> bool:
    """Remove a value from an attribute with many, wherever it stands; False if it does not."""
    values = model.values(node, attribute)
    if value not in values:
        return False
    model.set_value(node, attribute, [one for one in values if one != value])
    return True


def _coerced(model: Model, attribute: Attribute, value: object) -> Value:
    if not accepts(attribute.type, value):
        raise refusals.wrong_value(attribute, value)
    return model._layout.kinds[attribute.index](value)  # type: ignore[no-any-return]


def _all_coerced(model: Model, node: int, attribute: Attribute, values: object) -> Values:
    if not isinstance(values, list | tuple):
        raise refusals.no_list(attribute, values)
    found = tuple(_coerced(model, attribute, value) for value in values)
    if attribute.unique and len(dict.fromkeys(found)) < len(found):
        raise refusals.repeated(attribute, found)
    if attribute.upper is not None and len(found) > attribute.upper:
        raise refusals.too_many(model, node, attribute, found)
    return found
