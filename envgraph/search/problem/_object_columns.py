"""List the class, attribute values and links of each object, so that models can be compared object by object."""

from __future__ import annotations

from collections.abc import Iterable

from envgraph.graph import Model


def object_fact_columns(model: Model) -> list[list[object]]:
    """Return columns indexed by object id: the class numbers, then a column per attribute, then a column per reference.

    The class number is -1 if no object has that id. Of two opposite references only the first declared one gets a
    column. The links of an object are sorted, so that models do not differ by the order of links.
    """
    store = model.graph.store
    links = [relation.forward for relation in store.relations if not relation.is_flipped]
    ends: Iterable[list[object]] = (
        [tuple(sorted(targets) if len(targets) > 1 else targets) for targets in column] for column in links
    )
    values = ([tuple(one) if isinstance(one, list) else one for one in column] for column in store.values)
    return [[*store.classes], *values, *ends]
