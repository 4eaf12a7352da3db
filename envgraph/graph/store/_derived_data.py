"""Recompute the derived data of a store from its primary columns after an exception."""

from __future__ import annotations

from envgraph.graph.store._relation import AdjacencyColumn
from envgraph.graph.store._state_hash import recompute_hash_sum
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import IndexedSet


def recompute_derived_data(store: Store) -> None:
    """Recompute the data of a store that can be derived from its columns `classes`, `names`, `values` and `forward`.

    These are the extents (the lists of objects by class), the name index, the distinct values, the sources of links,
    and the hash sum. Begin a new revision whose changed objects are unknown. `History.repair` calls this function.
    """
    store.lengthen_columns(max(len(store.classes), len(store.place), len(store.salts[0])))
    _repair_extents(store)
    for name, node in list(store.by_name.items()):
        if node is not None and store.names[node] != name:
            store.map_name(name, None)
    for node, named in enumerate(store.names):
        if named is not None and store.by_name.get(named) != node:
            store.map_name(named, node)
    for attribute, values, distinct in zip(store.metamodel.attributes, store.values, store.distinct, strict=True):
        for node, kept in enumerate(distinct) if attribute.many else ():
            if isinstance(kept, IndexedSet):
                kept.mend()
            store.set_distinct(distinct, node, tuple(dict.fromkeys(values[node] or ())))
    for relation in store.relations:
        if not relation.is_flipped:
            _repair_sources(store, relation.forward, relation.backward)
    store.hash_sum = recompute_hash_sum(store)
    store.start_unknown_revision()


def _repair_extents(store: Store) -> None:
    """Make every object a member of the extent of its class exactly once, and recompute all recorded positions."""
    members = [set(extent) for extent in store.extents]
    for extent, inside in zip(store.extents, members, strict=True):
        if len(inside) < len(extent):  # an interrupted `put` has appended a second copy of a member
            extent.pop()
    for node, cls in enumerate(store.classes):
        if cls >= 0 and node not in members[cls]:
            store.extents[cls].append(node)
    for extent in store.extents:
        for place, node in enumerate(extent):
            store.classes[node], store.place[node] = extent.number, place


def _repair_sources(store: Store, forward: AdjacencyColumn, backward: AdjacencyColumn) -> None:
    """Make the sources column of a reference agree with its targets column.

    Sources in `backward` without a counterpart in `forward` are removed, and missing sources are added.
    """
    for ends in (*forward, *backward):
        if isinstance(ends, IndexedSet):
            ends.mend()
    for source, targets in enumerate(forward):
        for target in targets:
            if source not in backward[target]:
                store.add_item(backward, target, source)
    for target, sources in enumerate(backward):
        for source in [source for source in sources if target not in forward[source]]:
            store.remove_item(backward, target, source)
