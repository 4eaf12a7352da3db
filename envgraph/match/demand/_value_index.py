"""Indexes of objects by value, for loops that look up objects by one value after another."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, islice, takewhile
from math import inf
from operator import ge, gt, le, lt
from typing import Any, Final

from envgraph.graph import Store
from envgraph.match._match_costs import DEMAND

Entries = Callable[[Iterable[int]], Iterator[tuple[Any, Any, int]]]
"""Yields for each of the given objects, in order, its key, its value compared with bounds, and the object."""
_HOLDS: Final[Mapping[str, Callable[[Any, Any], bool]]] = {"<": lt, "<=": le, ">": gt, ">=": ge}


class ValueIndex:
    """An index of objects by a key, and by a second value if that is compared with bounds.

    The third lookup builds the index. Later lookups update it if the store has recorded the changed objects, else
    rebuild it. Values between bounds are found by bisection. Keys and values are compared as in Python, like values of
    expressions. Objects without a value match no bounds.

    Args:
        store: the model; it may change between calls.
        classes: indices of concrete classes.
        operators: the operators of the bounds, with the value of the object on the left.
        is_local: True if keys and values depend only on attributes and class of the object.
    """

    def __init__(
        self, store: Store, classes: Sequence[int], operators: Sequence[str] = (), is_local: bool = True
    ) -> None:
        self._store, self._operators, self._alone = store, operators, is_local
        self._ranks = {cls: rank << 48 for rank, cls in enumerate(classes)}
        self._extents = [store.extents[index] for index in classes]
        self._table: dict[Any, list[Any]] = {}
        self._filed: dict[int, list[Any]] = {}
        self._touched: dict[int, int] | None = None
        self._revision, self._asked, self._made = -1, 0, False

    def rows(self, entries: Entries, key: Any, *bounds: Any) -> Sequence[int]:
        """Return the objects with a key and a value within bounds, in the order of the extents."""
        found = self.some(entries, key, *bounds)
        if self._made and self._operators:
            return sorted(dict.fromkeys(found), key=self._place)
        return found if isinstance(found, list) else list(dict.fromkeys(found))

    def some(self, entries: Entries, key: Any, *bounds: Any) -> Iterable[int]:
        """Return objects with a key and a value within bounds in any order, perhaps repeated or as an iterator."""
        if not self._is_ready(entries):
            return self.look(entries, key, bounds)
        bucket = self._table.get(key, ())
        return (bucket[place][1] for place in self._range_within(bucket, bounds)) if self._operators else bucket

    def count(self, entries: Entries, key: Any, *bounds: Any) -> int:
        """Return the number of objects with a key and a value within bounds, if each object has one value."""
        if not self._is_ready(entries):
            return sum(1 for _ in self.look(entries, key, bounds))
        bucket = self._table.get(key, ())
        return len(self._range_within(bucket, bounds)) if self._operators else len(bucket)

    def look(self, entries: Entries, key: Any, bounds: Sequence[Any]) -> Iterable[int]:
        """Yield the objects with a key and a value within bounds, by a scan of all objects without the index."""
        tests = [(_HOLDS[operator], bound) for operator, bound in zip(self._operators, bounds, strict=True)]
        for own, value, node in entries(chain.from_iterable(self._extents)):
            if own == key and (not tests or (value is not None and all(test(value, w) for test, w in tests))):
                yield node

    def _range_within(self, bucket: Sequence[tuple[Any, float]], bounds: Sequence[Any]) -> range:
        """Return the range of the entries of a sorted bucket whose values are within bounds."""
        low, high = 0, len(bucket)
        for operator, bound in zip(self._operators, bounds, strict=True):
            if operator in ("<", ">="):
                place = bisect_left(bucket, (bound, -1))
            else:
                place = bisect_right(bucket, (bound, inf))
            low, high = (low, min(high, place)) if operator[0] == "<" else (max(low, place), high)
        return range(low, high)

    def _is_ready(self, entries: Entries) -> bool:
        """Bring the index up to date, or build it after a few lookups. Return False if there is no index yet."""
        if self._revision != self._store.revision:
            self._update(entries)
        if not self._made:
            self._asked += 1
            if self._asked > DEMAND.few_lookups:
                self._table, self._filed = {}, {}
                for key, value, node in entries(chain.from_iterable(self._extents)):
                    self._table.setdefault(key, []).append((value, node) if self._operators else node)
                for bucket in self._table.values():
                    if self._operators:
                        bucket[:] = sorted(each for each in bucket if each[0] is not None)
                    elif not self._alone:
                        bucket[:] = dict.fromkeys(bucket)
                self._made = True
        return self._made

    def _update(self, entries: Entries) -> None:
        """Update the index; discard it after many or unrecorded changes. The store records changes from now on."""
        store, since, made = self._store, self._revision, self._made
        self._revision, self._made = store.revision, False
        if store.changed_nodes is None:
            store.changed_nodes = {}
        if self._alone and store.changed_nodes is self._touched:
            most = sum(map(len, self._extents)) // DEMAND.followed + 1
            recent = takewhile(lambda each: each[1] > since, reversed(store.changed_nodes.items()))
            nodes = [node for node, _ in islice(recent, most + 1)] if made else []
            if len(nodes) <= most:
                if nodes:
                    self._reindex_objects(entries, nodes)
                self._made = made
                return
        self._asked, self._touched = 0, store.changed_nodes

    def _reindex_objects(self, entries: Entries, nodes: Sequence[int]) -> None:
        """Remove changed objects (those of `Store.changed_nodes`), and insert them with their present values."""
        table, place = self._table, self._place
        if not self._filed:
            for key, bucket in table.items():
                for item in bucket:
                    self._filed.setdefault(item[1] if self._operators else item, []).append((key, item))
        new: dict[int, list[Any]] = {max(node, ~node): [] for node in nodes}
        for key, value, node in entries([n for n in new if self._store.classes[n] in self._ranks]):
            if value is not None or not self._operators:
                new[node].append((key, (value, node) if self._operators else node))
        moved = set() if self._operators else {~node for node in nodes if node < 0}
        new = {n: filed for n, filed in new.items() if n in moved or filed != self._filed.get(n, [])}
        for node in new:
            for key, item in self._filed.pop(node, ()):
                if self._operators:
                    del table[key][bisect_left(table[key], item)]
                else:  # a copy, since a caller may still iterate over the list
                    table[key] = [each for each in table[key] if each != node]
        for node, filed in new.items():
            for key, item in filed:
                bucket = table[key] = table.get(key, []) if self._operators else [*table.get(key, ())]
                insort(bucket, item, key=None if self._operators else place)
            self._filed[node] = filed

    def _place(self, node: int) -> int:
        """Return the position of an object in a loop over the extents, as a sort key."""
        return self._ranks[self._store.classes[node]] + self._store.place[node]


def attribute_lookup(
    store: Store, index: ValueIndex, classes: Sequence[int], attributes: Sequence[int]
) -> Callable[..., Sequence[int]]:
    """Return a function that takes attribute values and returns the objects with them, in the order of the extents.

    Args:
        store: the model; it may change between calls.
        index: the index of these objects. Its method `look` is replaced by a faster one.
        classes: indices of concrete classes.
        attributes: indices of attributes of all these classes, whose values are the arguments of the function. A
            many-valued attribute must be the only one.
    """
    extents = [store.extents[index] for index in classes]
    many = store.distinct[attributes[0]]
    first, *others = [many] if many else [store.values[index] for index in attributes]

    def entries(nodes: Iterable[int]) -> Iterator[tuple[Any, Any, int]]:
        if many:
            return ((value, None, node) for node in nodes for value in many[node])
        if others:
            return (((first[node], *(column[node] for column in others)), None, node) for node in nodes)
        return ((first[node], None, node) for node in nodes)

    def look(_: Entries, key: Any, bounds: Sequence[Any]) -> list[int]:
        """Return the objects with a key by a scan of all objects, like `ValueIndex.look`, but faster."""
        value = key[0] if others else key
        if many:
            return [node for extent in extents for node in extent if value in many[node]]
        nodes = [node for extent in extents for node in extent if first[node] == value]
        return [node for own, _, node in entries(nodes) if own == key] if others else nodes

    index.look = look  # type: ignore[method-assign, assignment]
    return (lambda *values: index.rows(entries, values)) if others else partial(index.rows, entries)
