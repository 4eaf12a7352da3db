"""What there is to say of each object of a model, so that models are compared object by object."""

from __future__ import annotations

from collections.abc import Iterable

from envgraph.graph import Model


def object_facts(model: Model) -> list[list[object]]:
    """Columns by the id of the object: first the number of its class, -1 where there is none, then values and links.

    A link belongs to the object whose reference is declared first; the order of links does not count.
    """
    store = model.graph.store
    links = [relation.forward for relation in store.relations if not relation.flipped]
    ends: Iterable[list[object]] = (
        [tuple(sorted(targets) if len(targets) > 1 else targets) for targets in column] for column in links
    )
    values = ([tuple(one) if isinstance(one, list) else one for one in column] for column in store.values)
    return [[*store.classes], *values, *ends]
