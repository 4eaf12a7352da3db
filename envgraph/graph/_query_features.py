"""Features whose values queries give: they are read through handles, and never written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from envgraph.graph._layout import Layout
from envgraph.metamodel import Attribute, Feature

if TYPE_CHECKING:
    from envgraph.graph._model import Model


class Defined(NamedTuple):
    """The query that defines a feature, what gives the values, or ids of targets, of an object, and the matcher."""

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
    """Let queries give the values of these features, which no object has, and of no others; refuse to write them."""
    if model.defined == defined:
        return
    model.defined, model._layout = dict(defined), Layout(model.metamodel, model.store)
    nobody = (False,) * (len(model.metamodel.class_list) + 1)
    for relation in model.store.relations:
        owner = model.metamodel.instances(relation.reference.owner)
        relation.source_ok = nobody if relation.reference in defined else owner
    model._layout.attribute_ok = tuple(
        nobody if attribute in defined else ok
        for attribute, ok in zip(model.metamodel.attributes, model._layout.attribute_ok, strict=True)
    )
