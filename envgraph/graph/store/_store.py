"""The data of a model in columns indexed by object id, and the elementary changes.

The store does not validate changes: `Graph` does. Every change is recorded in the journal (while recording), added to
the hash sum, and notified to the followers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from itertools import repeat
from typing import Any, ClassVar, TypeVar

from envgraph.graph.store._followers import Follower, InterruptedWrites, NodeCallback, ValueCallback
from envgraph.graph.store._relation import ReferenceStorage, make_columns
from envgraph.graph.store._state_hash import class_hash, node_salts, value_hash
from envgraph.graph.store._undo_log import (
    ADDED,
    ASSIGNED,
    MOVED,
    REMOVED,
    Extent,
    IndexedSet,
    Item,
    Journal,
    OrderedValues,
)
from envgraph.metamodel import Metamodel, Value, Values

_MAX_CACHED_HASHES = 1 << 16

Change = TypeVar("Change", bound=Callable[..., None])


def _repairs_interruptions(change: Change) -> Change:
    """Decorate an elementary change so that interrupted writes are repaired before it.

    An exception in the change itself is repaired too, and then raised again.
    """

    @wraps(change)
    def change_with_repair(store: Store, *arguments: Any) -> None:
        if store.interrupted_writes:
            store.interrupted_writes.repair()
        try:
            change(store, *arguments)
        except BaseException:
            store.interrupted_writes.append(None)
            store.interrupted_writes.repair()
            raise

    return change_with_repair  # type: ignore[return-value]


class Store:
    """The columns of a model. Each list stays the same Python object for the life of the model.

    Matchers may read the columns directly and keep references to the lists. Only `Graph` may write to them.

    Attributes:
        classes: the index of each node's class in `metamodel.class_list`, or -1 if the node does not exist.
        place: the position of each node in its extent.
        extents: for each class the objects of exactly that class.
        values: for each attribute (by `index`) its column: a value, or None if unset. The values of a multi-valued
            attribute are a tuple or an `OrderedValues`.
        distinct: for each multi-valued attribute the column of its distinct values; empty lists for other attributes.
            Patterns see these columns as relations, which change by one pair at a time.
        forward, backward: for each reference (by `index`) the columns of targets and of sources.
        relations: for each reference its storage.
        names: the name of each object, or None. `by_name` maps names to ids, or to None if a name is no longer used.
        next_id: the id of the next created object. The columns are longer, and empty from this index on.
        journal: the undo log, see `_journal`.
        recording: True if changes are written to the journal, because a savepoint is open or a version is in use.
        epoch: a counter, increased at each state that undoing may restore. Data that is journalled as a whole is copied
            once in each epoch.
        loading: True while the model is loaded without a journal.
        hash_sum: the sum behind the state hash.
        revision: a counter, increased by every change and every restoration.
        changed_nodes: the objects changed since a matcher set the dict to {}, each with the revision of its last
            change, in the order of these revisions. A key `node` means changed values, `~node` a changed class or
            place. None if no matcher has requested the record, and after a restoration.
        followers: the listeners, see `Follower`.
        value_added, value_removing: for each attribute (by `index`) a callback of node and value, or None.
        class_added, class_removing: for each class (by index) a callback of the node, or None.
        retyping_callbacks: None, or a function that returns the two callbacks for a change from one class index to
            another.
        interrupted_writes: interrupted writes, which must be repaired before any other use.
        crowd: a limit. An adjacency with more elements is an `IndexedSet`, otherwise a tuple. The values of a
            multi-valued attribute are an `OrderedValues` or a tuple by the same limit.

    A store has at most 30 attributes, because CPython reads the attributes of larger objects more slowly.

    Invariants: `distinct` has each of the `values` once. `forward` and `backward` contain the same links. A node that
    does not exist has no name, value or link.
    """

    crowd: ClassVar[int] = 32

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.classes: list[int] = []
        self.place: list[int] = []
        self.extents = tuple(Extent(i, self.classes, self.place) for i in range(len(metamodel.class_list)))
        self.values: tuple[list[Any], ...] = tuple([] for _ in metamodel.attributes)
        self.distinct: tuple[list[Values | IndexedSet[Value]], ...] = tuple([] for _ in metamodel.attributes)
        self.forward, self.backward = make_columns(metamodel)
        self.relations = tuple(
            ReferenceStorage(reference, metamodel, self.forward[reference.index], self.backward[reference.index])
            for reference in metamodel.references
        )
        self.names: list[str | None] = []
        self.by_name: dict[str, int | None] = {}
        self.next_id = 0
        self.journal: Journal = []
        self.interrupted_writes = InterruptedWrites()
        self.recording = False
        self.epoch = 0
        self.loading = False
        self.followers: list[Follower] = []
        self.value_added: list[ValueCallback | None] = [None] * len(metamodel.attributes)
        self.value_removing: list[ValueCallback | None] = [None] * len(metamodel.attributes)
        self.class_added: list[NodeCallback | None] = [None] * len(metamodel.class_list)
        self.class_removing: list[NodeCallback | None] = [None] * len(metamodel.class_list)
        self.retyping_callbacks: Callable[[int, int], tuple[NodeCallback | None, NodeCallback | None]] | None = None
        self.hash_sum = 0
        self.revision = 0
        self.changed_nodes: dict[int, int] | None = None
        self.salts: tuple[list[int], list[int]] = ([], [])
        self._class_hashes = tuple(class_hash(cls) for cls in metamodel.class_list)
        self._value_hashes: tuple[dict[Value | Values, int], ...] = tuple({} for _ in metamodel.attributes)
        for relation in self.relations:
            relation.connect = self._make_connect(relation)
            relation.disconnect = self._make_disconnect(relation)
        self.reserve_ids(64)

    def reserve_ids(self, count: int) -> None:
        """Lengthen shorter columns to hold all ids below `count`, and one more id that never exists."""
        size = count + 1
        if len(self.classes) >= size:
            return
        self.lengthen_columns(size)

    def lengthen_columns(self, size: int) -> None:
        """Lengthen each column that is shorter than `size`. After an interruption the lengths may differ."""
        first, second = self.salts
        start = min(len(first), len(second))
        first[start:], second[start:] = node_salts(start, size)
        self.place.extend(repeat(0, size - len(self.place)))
        self.names.extend(repeat(None, size - len(self.names)))
        for column in self.values:
            column.extend(repeat(None, size - len(column)))
        for attribute, distinct in zip(self.metamodel.attributes, self.distinct, strict=True):
            if attribute.many:
                distinct.extend(repeat((), size - len(distinct)))
        for ends in {id(ends): ends for ends in (*self.forward, *self.backward)}.values():
            ends.extend(repeat((), size - len(ends)))
        self.classes.extend(repeat(-1, size - len(self.classes)))

    def record_change(self, container: Any, key: Any, old: Any, opcode: int) -> None:
        """Write a journal entry for a change that follows, if the store is recording; see `_journal`.

        Followers, such as views, record the changes of their own data. These are undone and redone together with the
        changes of the model, in their order.
        """
        if self.recording:
            self.journal.extend((container, key, old, opcode))

    # --- elementary changes

    def add_to_class(self, node: int, cls: int) -> None:
        """Make an object that has no class an instance of a class, and notify followers."""
        self._add_to_extent(node, cls)
        hook = self.class_added[cls]
        if hook is not None:
            hook(node)

    def _add_to_extent(self, node: int, cls: int) -> None:
        extent = self.extents[cls]
        if self.recording:
            self.journal.extend((extent, node, None, ADDED))
        extent.add(node)
        self.hash_sum += self.salts[0][node] * self._class_hashes[cls]
        self.revision += 1
        if self.changed_nodes is not None:
            self._record_changed(~node)

    def remove_from_class(self, node: int) -> None:
        """Notify followers, and remove an object from its class, so that the object no longer exists."""
        hook = self.class_removing[self.classes[node]]
        if hook is not None:
            hook(node)
        self._remove_from_extent(node)

    def change_class(self, node: int, cls: int) -> None:
        """Change the class of an object. Followers are notified of lost and gained classes, not of shared classes."""
        old = self.classes[node]
        removing, added = self.retyping_callbacks(old, cls) if self.retyping_callbacks else (None, None)
        if removing is not None:
            removing(node)
        if old >= 0:  # otherwise an earlier call was interrupted
            self._remove_from_extent(node)
        self._add_to_extent(node, cls)
        if added is not None:
            added(node)

    def _remove_from_extent(self, node: int) -> None:
        cls = self.classes[node]
        extent = self.extents[cls]
        if self.recording:
            self.journal.extend((extent, node, self.place[node], REMOVED))
        place = extent.take(node)
        self.hash_sum -= self.salts[0][node] * self._class_hashes[cls]
        self.revision += 1
        if self.changed_nodes is not None:
            self._record_changed(~node, *(~moved for moved in extent[place : place + 1]))

    def set_value(self, node: int, attribute: int, value: Any) -> None:
        """Set or clear (None) the value of an attribute, and notify followers of the old and the new value."""
        if self.interrupted_writes:
            self.interrupted_writes.repair()
        if self.distinct[attribute]:
            self._set_values(node, attribute, value)
            return
        try:
            column = self.values[attribute]
            old = column[node]
            codes = self._value_hashes[attribute]
            change = 0
            if old is not None:
                hook = self.value_removing[attribute]
                if hook is not None:
                    hook(node, old)
                change -= codes.get(old) or self._cached_value_hash(attribute, old)
            if value is not None:
                change += codes.get(value) or self._cached_value_hash(attribute, value)
            if self.recording:
                self.journal.extend((column, node, old, ASSIGNED))
            column[node] = value
            self.hash_sum += self.salts[0][node] * change
            self.revision += 1
            if self.changed_nodes is not None:
                self._record_changed(node)
            if value is not None:
                hook = self.value_added[attribute]
                if hook is not None:
                    hook(node, value)
        except BaseException:
            self.interrupted_writes.append(None)
            self.interrupted_writes.repair()
            raise

    @_repairs_interruptions
    def _set_values(self, node: int, attribute: int, values: Values | None) -> None:
        """Replace the values of a multi-valued attribute. Notify followers of removed and added distinct values."""
        column, distinct = self.values[attribute], self.distinct[attribute]
        old, after = column[node], dict.fromkeys(values or ())
        before = dict.fromkeys(distinct[node])
        heard = self.value_removing[attribute] or self.value_added[attribute]
        for value in reversed(before) if heard else ():
            if value not in after:
                self._notify_value(node, attribute, value, False)
                self.remove_item(distinct, node, value)
        self.record_change(column, node, old, ASSIGNED)
        column[node] = values if values is None or len(values) <= self.crowd else OrderedValues(values)
        codes, change = self._value_hashes[attribute], 0
        for each in (values or ()), (old or ()):
            change = sum(codes.get(value) or self._cached_value_hash(attribute, value) for value in each) - change
        self.hash_sum -= self.salts[0][node] * change
        self.revision += 1
        self._record_changed(node)
        for value in after if heard else ():
            if value not in before:
                self.add_item(distinct, node, value)
                self._notify_value(node, attribute, value, True)
        self.set_distinct(distinct, node, tuple(after))

    @_repairs_interruptions
    def splice_value(self, node: int, attribute: int, index: int, value: Value, inserting: bool) -> None:
        """Insert a value into a multi-valued attribute before the value at `index`, or remove the value at `index`.

        To remove (`inserting` is False), `value` must be the value at `index`. Followers are notified if the set of
        distinct values changes.
        """
        column, distinct = self.values[attribute], self.distinct[attribute]
        old = column[node] or ()
        many = distinct[node]
        stays = value in many if inserting else len(old) > len(many) and old.count(value) > 1
        if not (stays or inserting):
            self._notify_value(node, attribute, value, False)
            self.move_item(distinct, node, value, len(old))
            self.remove_item(distinct, node, value)
        _splice_column(self, column, node, index, value, inserting)
        sign = 1 if inserting else -1
        code = self._value_hashes[attribute].get(value) or self._cached_value_hash(attribute, value)
        self.hash_sum += sign * self.salts[0][node] * code
        self.revision += 1
        self._record_changed(node)
        if inserting and not stays:
            self.add_item(distinct, node, value)
        if (stays or inserting) and index < len(column[node]) - inserting:
            held = column[node]
            first = held.index(value) if stays else index
            place = first if len(held) == len(distinct[node]) else len({*held[:first]})
            self.move_item(distinct, node, value, place)
        if inserting and not stays:
            self._notify_value(node, attribute, value, True)

    def _notify_value(self, node: int, attribute: int, value: Value, is_added: bool) -> None:
        hook = (self.value_added if is_added else self.value_removing)[attribute]
        if hook is not None:
            hook(node, value)

    def set_distinct(self, distinct: Any, node: int, values: Values) -> None:
        """Store `values` as the adjacency of a node in a column, if it differs, and journal the change.

        The values are distinct values or targets, in their final order. Followers and the hash are not updated.
        """
        if tuple(distinct[node]) != values:
            self.record_change(distinct, node, distinct[node], ASSIGNED)
            distinct[node] = self.as_adjacency(values)

    @_repairs_interruptions
    def move_target(self, relation: ReferenceStorage, source: int, target: int, index: int) -> None:
        """Move a target of a source object to another index among its targets, and journal the change."""
        self.move_item(relation.forward, source, target, index)
        self.revision += 1

    def _make_connect(self, relation: ReferenceStorage) -> Callable[[int, int], object]:
        """Return the function `connect(source, target)`, which adds a missing link and notifies followers."""
        store, record, symmetric, flipped = (
            self,
            self.journal.extend,
            relation.is_symmetric,
            relation.is_flipped,
        )
        forward, backward, crowd = relation.forward, relation.backward, self.crowd
        code, (first_salts, second_salts) = relation.code, self.salts
        interrupted = self.interrupted_writes

        def connect(source: int, target: int) -> None:
            if interrupted:
                interrupted.repair()
            try:
                ends = forward[source]
                if len(ends) < crowd:
                    if store.recording:
                        record((forward, source, ends, ASSIGNED))
                    forward[source] = (*ends, target)
                else:
                    store.add_item(forward, source, target)
                if not (symmetric and source == target):
                    ends = backward[target]
                    if len(ends) < crowd:
                        if store.recording:
                            record((backward, target, ends, ASSIGNED))
                        backward[target] = (*ends, source)
                    else:
                        store.add_item(backward, target, source)
                first, second = source, target
                if flipped or (symmetric and source > target):
                    first, second = target, source
                store.hash_sum += code * first_salts[first] * second_salts[second]
                store.revision += 1
                if relation.added is not None:
                    relation.added(first, second)
            except BaseException:
                interrupted.append(None)
                interrupted.repair()
                raise

        return connect

    def _make_disconnect(self, relation: ReferenceStorage) -> Callable[[int, int], object]:
        """Return the function `disconnect(source, target)`, which notifies followers and removes an existing link."""
        store, record, symmetric, flipped = (
            self,
            self.journal.extend,
            relation.is_symmetric,
            relation.is_flipped,
        )
        forward, backward = relation.forward, relation.backward
        code, (first_salts, second_salts) = relation.code, self.salts
        interrupted = self.interrupted_writes

        def disconnect(source: int, target: int) -> None:
            if interrupted:
                interrupted.repair()
            try:
                first, second = source, target
                if flipped or (symmetric and source > target):
                    first, second = target, source
                if relation.removing is not None:
                    relation.removing(first, second)
                ends = forward[source]
                if len(ends) == 1:
                    if store.recording:
                        record((forward, source, ends, ASSIGNED))
                    forward[source] = ()
                else:
                    store.remove_item(forward, source, target)
                if not (symmetric and source == target):
                    ends = backward[target]
                    if len(ends) == 1:
                        if store.recording:
                            record((backward, target, ends, ASSIGNED))
                        backward[target] = ()
                    else:
                        store.remove_item(backward, target, source)
                store.hash_sum -= code * first_salts[first] * second_salts[second]
                store.revision += 1
            except BaseException:
                interrupted.append(None)
                interrupted.repair()
                raise

        return disconnect

    @_repairs_interruptions
    def set_name(self, node: int, name: str | None) -> None:
        """Set the name of an object, or remove it (None). Followers and the state hash ignore names."""
        old = self.names[node]
        if old is not None:
            self.map_name(old, None)
        if name is not None:
            self.map_name(name, node)
        self.record_change(self.names, node, old, ASSIGNED)
        self.names[node] = name
        self.revision += 1

    # --- parts of elementary changes

    def map_name(self, name: str, node: int | None) -> None:
        """Map a name to an object, or to None if no object has the name any more, and journal the change."""
        self.record_change(self.by_name, name, self.by_name.get(name), ASSIGNED)
        self.by_name[name] = node

    def as_adjacency(self, items: Sequence[Item]) -> tuple[Item, ...] | IndexedSet[Item]:
        """Return elements as an adjacency: a tuple, or an `IndexedSet` if their number exceeds `crowd`."""
        return tuple(items) if len(items) <= self.crowd else IndexedSet(tuple(items))

    def add_item(self, column: Any, key: Any, item: Any) -> None:
        """Append an element to the adjacency (tuple or `IndexedSet`) at `key` of a column, and journal the change.

        The column belongs to the store, or is the table of a follower. A tuple that exceeds `crowd` becomes an
        `IndexedSet`.
        """
        old = column[key]
        if isinstance(old, IndexedSet):
            if self.recording:
                self.journal.extend((old, item, None, ADDED))
            old.add(item)
            return
        if self.recording:
            self.journal.extend((column, key, old, ASSIGNED))
        column[key] = self.as_adjacency((*old, item))

    def remove_item(self, column: Any, key: Any, item: Any) -> None:
        """Remove an element from the adjacency (tuple or `IndexedSet`) at `key` of a column, and journal the change.

        In an `IndexedSet` the last element moves into the gap.
        """
        old = column[key]
        if isinstance(old, tuple):
            index = old.index(item)
            rest = old[:index] + old[index + 1 :]
        elif len(old) > self.crowd + 1:
            if self.recording:
                self.journal.extend((old, item, old.where(item), REMOVED))
            old.take(item)
            return
        else:
            index = old.where(item)
            left = list(old)
            left[index] = left[-1]
            rest = tuple(left[:-1])
        if self.recording:
            self.journal.extend((column, key, old, ASSIGNED))
        column[key] = rest

    def move_item(self, column: Any, key: Any, item: Any, index: int) -> None:
        """Move an element of the adjacency at `key` of a column to `index`, or to the end if `index` is greater.

        The elements between are shifted by one. The change is journalled.
        """
        old = column[key]
        index = min(index, len(old) - 1)
        at = old.where(item) if isinstance(old, IndexedSet) else old.index(item)
        if at == index:
            return
        if isinstance(old, IndexedSet):
            self.record_change(old, item, at, MOVED)
            old.move(item, index)
            return
        self.record_change(column, key, old, ASSIGNED)
        rest = old[:at] + old[at + 1 :]
        column[key] = (*rest[:index], item, *rest[index:])

    def _cached_value_hash(self, attribute: int, value: Value | Values) -> int:
        codes = self._value_hashes[attribute]
        if len(codes) >= _MAX_CACHED_HASHES:
            codes.clear()
        codes[value] = number = value_hash(self.metamodel.attributes[attribute], value)
        return number

    def start_unknown_revision(self) -> None:
        """Begin a new revision whose changed objects are unknown: increase `revision` and set `changed_nodes` to
        None.
        """
        self.revision += 1
        self.changed_nodes = None

    def _record_changed(self, *nodes: int) -> None:
        """Record that nodes have changed in the current revision, if `changed_nodes` is a dict."""
        if self.changed_nodes is not None:
            for node in nodes:
                self.changed_nodes.pop(node, None)
                self.changed_nodes[node] = self.revision

    # --- reading

    def nodes(self) -> Iterator[int]:
        """Yield the ids of all objects, class by class in the order of declaration."""
        for extent in self.extents:
            yield from extent


def _splice_column(store: Store, column: list[Any], node: int, index: int, value: Value, inserting: bool) -> None:
    """Insert or remove a value in the column of an attribute, as `Store.splice_value` does, and journal the change.

    Followers, the distinct values and the hash are not updated.
    """
    old = column[node] or ()
    if isinstance(old, OrderedValues) and (inserting or len(old) > store.crowd + 1):
        key = (index, value, len(old) + inserting)
        store.record_change(old, key, *((None, ADDED) if inserting else (index, REMOVED)))
        old.put(key, None) if inserting else old.take(key)
        return
    store.record_change(column, node, column[node], ASSIGNED)
    new = (*old[:index], value, *old[index:]) if inserting else (*old[:index], *old[index + 1 :])
    column[node] = new if len(new) <= store.crowd else OrderedValues(new)
