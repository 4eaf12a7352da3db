"""Check all invariants of a store from scratch, for tests."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from itertools import pairwise
from typing import Any

from envgraph.graph.store._relation import ReferenceStorage
from envgraph.graph.store._state_hash import recompute_hash_sum
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import IndexedSet, OrderedValues
from envgraph.metamodel import accepts


def check_store(store: Store) -> None:
    """Assert all invariants of a store: sizes, extents, links, values, names, containment and the hash sum.

    Raises:
        AssertionError: an invariant does not hold.
    """
    _check_sizes(store)
    for extent in store.extents:
        assert not (store.metamodel.class_list[extent.number].abstract and extent)
        for place, node in enumerate(extent):
            assert store.classes[node] == extent.number
            assert store.place[node] == place
    members = sum(map(len, store.extents))
    assert members == sum(1 for cls in store.classes if cls >= 0)
    assert all(cls < 0 for cls in store.classes[store.next_id :])
    for relation in store.relations:
        _check_relation(store, relation)
    _check_values(store)
    _check_names(store)
    _check_containment(store)
    assert recompute_hash_sum(store) == store.hash_sum


def _check_sizes(store: Store) -> None:
    size = len(store.classes)
    assert store.next_id < size
    attributes = store.metamodel.attributes
    columns: list[Sized] = [
        *(distinct for one, distinct in zip(attributes, store.distinct, strict=True) if one.many),
        store.place,
        store.names,
        *store.salts,
        *store.values,
        *store.forward,
        *store.backward,
    ]
    assert all(len(column) == size for column in columns)


def _check_relation(store: Store, relation: ReferenceStorage) -> None:
    for column in (relation.forward, relation.backward):
        _check_column(column)
    for node, targets in enumerate(relation.forward):
        if not targets:
            continue
        assert relation.allows_source[store.classes[node]]
        assert len(targets) <= relation.upper
        for target in targets:
            assert relation.allows_target[store.classes[target]]
            assert node in relation.backward[target]
    links = sum(map(len, relation.forward))
    assert links == sum(map(len, relation.backward))
    assert all(len(sources) <= relation.opposite_upper for sources in relation.backward)


def _check_column(column: Sequence[Any]) -> None:
    for ends in column:
        assert isinstance(ends, IndexedSet) == (len(ends) > Store.crowd)
        assert len(set(ends)) == len(ends)
        if isinstance(ends, IndexedSet):
            assert set(ends.position) == set(ends)
            assert [ends.where(end) for end in ends] == [*range(len(ends))]


def _check_values(store: Store) -> None:
    classes = store.metamodel.class_list
    for attribute, column in zip(store.metamodel.attributes, store.values, strict=True):
        for node, value in enumerate(column):
            if value is not None:
                assert store.classes[node] >= 0
                assert store.metamodel.is_a(classes[store.classes[node]].name, attribute.owner)
                assert isinstance(value, tuple | OrderedValues) == attribute.many
                assert isinstance(value, OrderedValues) == (attribute.many and len(value) > Store.crowd)
                assert all(accepts(attribute.type, each) for each in (value if attribute.many else (value,)))
    for attribute, column, distinct in zip(store.metamodel.attributes, store.values, store.distinct, strict=True):
        if attribute.many:
            _check_column(distinct)
            assert [*map(tuple, distinct)] == [tuple(dict.fromkeys(values or ())) for values in column]
            assert not attribute.unique or all(
                len(values or ()) == len(one) for values, one in zip(column, distinct, strict=True)
            )
            assert attribute.upper is None or all(len(values or ()) <= attribute.upper for values in column)


def _check_names(store: Store) -> None:
    named = {name: node for node, name in enumerate(store.names) if name is not None}
    assert named == {name: node for name, node in store.by_name.items() if node is not None}
    assert all(store.classes[node] >= 0 for node in named.values())


def _check_containment(store: Store) -> None:
    owner: dict[int, int] = {}
    for relation in store.relations:
        if relation.containment:
            for node, children in enumerate(relation.forward):
                for child in children:
                    assert child not in owner
                    owner[child] = node
    rooted: set[int] = set()
    for child in owner:
        path = [child]
        while path[-1] in owner and path[-1] not in rooted:
            path.append(owner[path[-1]])
            assert path[-1] not in path[:-1], "a cycle of containment"
        rooted.update(below for below, _ in pairwise(path))
        rooted.add(path[-1])
