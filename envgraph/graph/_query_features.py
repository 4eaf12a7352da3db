"""Derived features whose values queries compute: handles read them, and nothing writes them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from envgraph.graph._layout import Layout
from envgraph.metamodel import Attribute, Feature

if TYPE_CHECKING:
    from envgraph.graph._model import Model


class Defined(NamedTuple):
    """A derived feature: its pattern, a function that reads the values or target ids of an object, the matcher."""

    query: str
    read: Callable[[int], Sequence[Any]]
    matcher: object


def first_with(model: Model, feature: Feature) -> int | None:
    """Return the first object that has a target or a value other than the initial one; None if there is none."""
    columns = model.store.values if isinstance(feature, Attribute) else model.store.forward
    usual = (feature.initial,) if isinstance(feature, Attribute) else ()
    held = ((node, columns[feature.index][node]) for node in model.store.nodes())
    return next((node for node, one in held if one not in (None, (), *usual)), None)


def define(model: Model, defined: Mapping[Feature, Defined]) -> None:
    """Set the derived features, replacing earlier ones, and refuse to write them. No object may have stored values."""
    if model.defined == defined:
        return
    model.defined, model._layout = dict(defined), Layout(model.metamodel, model.store)
    no_class = (False,) * (len(model.metamodel.class_list) + 1)
    for relation in model.store.relations:
        owner = model.metamodel.instances(relation.reference.owner)
        relation.source_ok = no_class if relation.reference in defined else owner
    model._layout.attribute_ok = tuple(
        no_class if attribute in defined else ok
        for attribute, ok in zip(model.metamodel.attributes, model._layout.attribute_ok, strict=True)
    )
