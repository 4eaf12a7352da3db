"""The data of a model in columns indexed by object id, and the elementary changes.

The store does not validate changes: `Graph` does. Every change is recorded in the journal (while recording), added to
the hash sum, and notified to the followers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from itertools import repeat
from typing import Any, ClassVar, TypeVar

from envgraph.graph.store._followers import Follower, Interrupted, NodeHook, ValueHook
from envgraph.graph.store._hashing import class_code, node_salts, value_code
from envgraph.graph.store._journal import IN, MOVE, OUT, SET, Extent, IndexedSet, Item, Journal, Ordered
from envgraph.graph.store._relation import Relation, columns
from envgraph.metamodel import Metamodel, Value, Values

_CODES_KEPT = 1 << 16

Change = TypeVar("Change", bound=Callable[..., None])


def _mended(change: Change) -> Change:
    """Decorate an elementary change so that interrupted writes are repaired before it.

    An exception in the change itself is repaired too, and then raised again.
    """

    @wraps(change)
    def mended(store: Store, *arguments: Any) -> None:
        if store.interrupted:
            store.interrupted.repair()
        try:
            change(store, *arguments)
        except BaseException:
            store.interrupted.append(None)
            store.interrupted.repair()
            raise

    return mended  # type: ignore[return-value]


class Store:
    """The columns of a model. Each list stays the same Python object for the life of the model.

    Matchers may read the columns directly and keep references to the lists. Only `Graph` may write to them.

    Attributes:
        classes: the index of each node's class in `metamodel.class_list`, or -1 if the node does not exist.
        place: the position of each node in its extent.
        extents: for each class the objects of exactly that class.
        values: for each attribute (by `index`) its column: a value, or None if unset. The values of a multi-valued
            attribute are a tuple or an `Ordered`.
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
        total: the sum behind the state hash.
        revision: a counter, increased by every change and every restoration.
        touched: the objects changed since a matcher set the dict to {}, each with the revision of its last change, in
            the order of these revisions. A key `node` means changed values, `~node` a changed class or place. None if
            no matcher has requested the record, and after a restoration.
        followers: the listeners, see `Follower`.
        value_added, value_removing: for each attribute (by `index`) a callback of node and value, or None.
        class_added, class_removing: for each class (by index) a callback of the node, or None.
        retyping: None, or a function that returns the two callbacks for a change from one class index to another.
        interrupted: interrupted writes, which must be repaired before any other use.
        crowd: a limit. An adjacency with more elements is an `IndexedSet`, otherwise a tuple. The values of a
            multi-valued attribute are an `Ordered` or a tuple by the same limit.

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
        self.forward, self.backward = columns(metamodel)
        self.relations = tuple(
            Relation(reference, metamodel, self.forward[reference.index], self.backward[reference.index])
            for reference in metamodel.references
        )
        self.names: list[str | None] = []
        self.by_name: dict[str, int | None] = {}
        self.next_id = 0
        self.journal: Journal = []
        self.interrupted = Interrupted()
        self.recording = False
        self.epoch = 0
        self.loading = False
        self.followers: list[Follower] = []
        self.value_added: list[ValueHook | None] = [None] * len(metamodel.attributes)
        self.value_removing: list[ValueHook | None] = [None] * len(metamodel.attributes)
        self.class_added: list[NodeHook | None] = [None] * len(metamodel.class_list)
        self.class_removing: list[NodeHook | None] = [None] * len(metamodel.class_list)
        self.retyping: Callable[[int, int], tuple[NodeHook | None, NodeHook | None]] | None = None
        self.total = 0
        self.revision = 0
        self.touched: dict[int, int] | None = None
        self.salts: tuple[list[int], list[int]] = ([], [])
        self._class_codes = tuple(class_code(cls) for cls in metamodel.class_list)
        self._value_codes: tuple[dict[Value | Values, int], ...] = tuple({} for _ in metamodel.attributes)
        for relation in self.relations:
            relation.connect = self._connector(relation)
            relation.disconnect = self._disconnector(relation)
        self.reserve(64)

    def reserve(self, count: int) -> None:
        """Lengthen shorter columns to hold all ids below `count`, and one more id that never exists."""
        size = count + 1
        if len(self.classes) >= size:
            return
        self.lengthen(size)

    def lengthen(self, size: int) -> None:
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

    def record(self, container: Any, key: Any, old: Any, opcode: int) -> None:
        """Write a journal entry for a change that follows, if the store is recording; see `_journal`.

        Followers, such as views, record the changes of their own data. These are undone and redone together with the
        changes of the model, in their order.
        """
        if self.recording:
            self.journal.extend((container, key, old, opcode))

    # --- elementary changes

    def enter(self, node: int, cls: int) -> None:
        """Make an object that has no class an instance of a class, and notify followers."""
        self._enter(node, cls)
        hook = self.class_added[cls]
        if hook is not None:
            hook(node)

    def _enter(self, node: int, cls: int) -> None:
        extent = self.extents[cls]
        if self.recording:
            self.journal.extend((extent, node, None, OUT))
        extent.add(node)
        self.total += self.salts[0][node] * self._class_codes[cls]
        self.revision += 1
        if self.touched is not None:
            self._touch(~node)

    def leave(self, node: int) -> None:
        """Notify followers, and remove an object from its class, so that the object no longer exists."""
        hook = self.class_removing[self.classes[node]]
        if hook is not None:
            hook(node)
        self._leave(node)

    def move(self, node: int, cls: int) -> None:
        """Change the class of an object. Followers are notified of lost and gained classes, not of shared classes."""
        old = self.classes[node]
        removing, added = self.retyping(old, cls) if self.retyping else (None, None)
        if removing is not None:
            removing(node)
        if old >= 0:  # otherwise an earlier call was interrupted
            self._leave(node)
        self._enter(node, cls)
        if added is not None:
            added(node)

    def _leave(self, node: int) -> None:
        cls = self.classes[node]
        extent = self.extents[cls]
        if self.recording:
            self.journal.extend((extent, node, self.place[node], IN))
        place = extent.take(node)
        self.total -= self.salts[0][node] * self._class_codes[cls]
        self.revision += 1
        if self.touched is not None:
            self._touch(~node, *(~moved for moved in extent[place : place + 1]))

    def put(self, node: int, attribute: int, value: Any) -> None:
        """Set or clear (None) the value of an attribute, and notify followers of the old and the new value."""
        if self.interrupted:
            self.interrupted.repair()
        if self.distinct[attribute]:
            self._put_many(node, attribute, value)
            return
        try:
            column = self.values[attribute]
            old = column[node]
            codes = self._value_codes[attribute]
            change = 0
            if old is not None:
                hook = self.value_removing[attribute]
                if hook is not None:
                    hook(node, old)
                change -= codes.get(old) or self._code(attribute, old)
            if value is not None:
                change += codes.get(value) or self._code(attribute, value)
            if self.recording:
                self.journal.extend((column, node, old, SET))
            column[node] = value
            self.total += self.salts[0][node] * change
            self.revision += 1
            if self.touched is not None:
                self._touch(node)
            if value is not None:
                hook = self.value_added[attribute]
                if hook is not None:
                    hook(node, value)
        except BaseException:
            self.interrupted.append(None)
            self.interrupted.repair()
            raise

    @_mended
    def _put_many(self, node: int, attribute: int, values: Values | None) -> None:
        """Replace the values of a multi-valued attribute. Notify followers of removed and added distinct values."""
        column, distinct = self.values[attribute], self.distinct[attribute]
        old, after = column[node], dict.fromkeys(values or ())
        before = dict.fromkeys(distinct[node])
        heard = self.value_removing[attribute] or self.value_added[attribute]
        for value in reversed(before) if heard else ():
            if value not in after:
                self._notify(node, attribute, value, False)
                self.drop_end(distinct, node, value)
        self.record(column, node, old, SET)
        column[node] = values if values is None or len(values) <= self.crowd else Ordered(values)
        codes, change = self._value_codes[attribute], 0
        for each in (values or ()), (old or ()):
            change = sum(codes.get(value) or self._code(attribute, value) for value in each) - change
        self.total -= self.salts[0][node] * change
        self.revision += 1
        self._touch(node)
        for value in after if heard else ():
            if value not in before:
                self.add_end(distinct, node, value)
                self._notify(node, attribute, value, True)
        self.keep_distinct(distinct, node, tuple(after))

    @_mended
    def splice(self, node: int, attribute: int, index: int, value: Value, inserting: bool) -> None:
        """Insert a value into a multi-valued attribute before the value at `index`, or remove the value at `index`.

        To remove (`inserting` is False), `value` must be the value at `index`. Followers are notified if the set of
        distinct values changes.
        """
        column, distinct = self.values[attribute], self.distinct[attribute]
        old = column[node] or ()
        many = distinct[node]
        stays = value in many if inserting else len(old) > len(many) and old.count(value) > 1
        if not (stays or inserting):
            self._notify(node, attribute, value, False)
            self.move_end(distinct, node, value, len(old))
            self.drop_end(distinct, node, value)
        _splice(self, column, node, index, value, inserting)
        sign = 1 if inserting else -1
        code = self._value_codes[attribute].get(value) or self._code(attribute, value)
        self.total += sign * self.salts[0][node] * code
        self.revision += 1
        self._touch(node)
        if inserting and not stays:
            self.add_end(distinct, node, value)
        if (stays or inserting) and index < len(column[node]) - inserting:
            held = column[node]
            first = held.index(value) if stays else index
            place = first if len(held) == len(distinct[node]) else len({*held[:first]})
            self.move_end(distinct, node, value, place)
        if inserting and not stays:
            self._notify(node, attribute, value, True)

    def _notify(self, node: int, attribute: int, value: Value, there: bool) -> None:
        hook = (self.value_added if there else self.value_removing)[attribute]
        if hook is not None:
            hook(node, value)

    def keep_distinct(self, distinct: Any, node: int, values: Values) -> None:
        """Store `values` as the adjacency of a node in a column, if it differs, and journal the change.

        The values are distinct values or targets, in their final order. Followers and the hash are not updated.
        """
        if tuple(distinct[node]) != values:
            self.record(distinct, node, distinct[node], SET)
            distinct[node] = self.grouped(values)

    @_mended
    def move_target(self, relation: Relation, source: int, target: int, index: int) -> None:
        """Move a target of a source object to another index among its targets, and journal the change."""
        self.move_end(relation.forward, source, target, index)
        self.revision += 1

    def _connector(self, relation: Relation) -> Callable[[int, int], object]:
        """Return the function `connect(source, target)`, which adds a missing link and notifies followers."""
        store, record, symmetric, flipped = self, self.journal.extend, relation.symmetric, relation.flipped
        forward, backward, crowd = relation.forward, relation.backward, self.crowd
        code, (first_salts, second_salts) = relation.code, self.salts
        interrupted = self.interrupted

        def connect(source: int, target: int) -> None:
            if interrupted:
                interrupted.repair()
            try:
                ends = forward[source]
                if len(ends) < crowd:
                    if store.recording:
                        record((forward, source, ends, SET))
                    forward[source] = (*ends, target)
                else:
                    store.add_end(forward, source, target)
                if not (symmetric and source == target):
                    ends = backward[target]
                    if len(ends) < crowd:
                        if store.recording:
                            record((backward, target, ends, SET))
                        backward[target] = (*ends, source)
                    else:
                        store.add_end(backward, target, source)
                first, second = source, target
                if flipped or (symmetric and source > target):
                    first, second = target, source
                store.total += code * first_salts[first] * second_salts[second]
                store.revision += 1
                if relation.added is not None:
                    relation.added(first, second)
            except BaseException:
                interrupted.append(None)
                interrupted.repair()
                raise

        return connect

    def _disconnector(self, relation: Relation) -> Callable[[int, int], object]:
        """Return the function `disconnect(source, target)`, which notifies followers and removes an existing link."""
        store, record, symmetric, flipped = self, self.journal.extend, relation.symmetric, relation.flipped
        forward, backward = relation.forward, relation.backward
        code, (first_salts, second_salts) = relation.code, self.salts
        interrupted = self.interrupted

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
                        record((forward, source, ends, SET))
                    forward[source] = ()
                else:
                    store.drop_end(forward, source, target)
                if not (symmetric and source == target):
                    ends = backward[target]
                    if len(ends) == 1:
                        if store.recording:
                            record((backward, target, ends, SET))
                        backward[target] = ()
                    else:
                        store.drop_end(backward, target, source)
                store.total -= code * first_salts[first] * second_salts[second]
                store.revision += 1
            except BaseException:
                interrupted.append(None)
                interrupted.repair()
                raise

        return disconnect

    @_mended
    def rename(self, node: int, name: str | None) -> None:
        """Set the name of an object, or remove it (None). Followers and the state hash ignore names."""
        old = self.names[node]
        if old is not None:
            self.map_name(old, None)
        if name is not None:
            self.map_name(name, node)
        self.record(self.names, node, old, SET)
        self.names[node] = name
        self.revision += 1

    # --- parts of elementary changes

    def map_name(self, name: str, node: int | None) -> None:
        """Map a name to an object, or to None if no object has the name any more, and journal the change."""
        self.record(self.by_name, name, self.by_name.get(name), SET)
        self.by_name[name] = node

    def grouped(self, items: Sequence[Item]) -> tuple[Item, ...] | IndexedSet[Item]:
        """Return elements as an adjacency: a tuple, or an `IndexedSet` if their number exceeds `crowd`."""
        return tuple(items) if len(items) <= self.crowd else IndexedSet(tuple(items))

    def add_end(self, column: Any, key: Any, item: Any) -> None:
        """Append an element to the adjacency (tuple or `IndexedSet`) at `key` of a column, and journal the change.

        The column belongs to the store, or is the table of a follower. A tuple that exceeds `crowd` becomes an
        `IndexedSet`.
        """
        old = column[key]
        if isinstance(old, IndexedSet):
            if self.recording:
                self.journal.extend((old, item, None, OUT))
            old.add(item)
            return
        if self.recording:
            self.journal.extend((column, key, old, SET))
        column[key] = self.grouped((*old, item))

    def drop_end(self, column: Any, key: Any, item: Any) -> None:
        """Remove an element from the adjacency (tuple or `IndexedSet`) at `key` of a column, and journal the change.

        In an `IndexedSet` the last element moves into the gap.
        """
        old = column[key]
        if isinstance(old, tuple):
            index = old.index(item)
            rest = old[:index] + old[index + 1 :]
        elif len(old) > self.crowd + 1:
            if self.recording:
                self.journal.extend((old, item, old.where(item), IN))
            old.take(item)
            return
        else:
            index = old.where(item)
            left = list(old)
            left[index] = left[-1]
            rest = tuple(left[:-1])
        if self.recording:
            self.journal.extend((column, key, old, SET))
        column[key] = rest

    def move_end(self, column: Any, key: Any, item: Any, index: int) -> None:
        """Move an element of the adjacency at `key` of a column to `index`, or to the end if `index` is greater.

        The elements between are shifted by one. The change is journalled.
        """
        old = column[key]
        index = min(index, len(old) - 1)
        at = old.where(item) if isinstance(old, IndexedSet) else old.index(item)
        if at == index:
            return
        if isinstance(old, IndexedSet):
            self.record(old, item, at, MOVE)
            old.move(item, index)
            return
        self.record(column, key, old, SET)
        rest = old[:at] + old[at + 1 :]
        column[key] = (*rest[:index], item, *rest[index:])

    def _code(self, attribute: int, value: Value | Values) -> int:
        codes = self._value_codes[attribute]
        if len(codes) >= _CODES_KEPT:
            codes.clear()
        codes[value] = number = value_code(self.metamodel.attributes[attribute], value)
        return number

    def replaced(self) -> None:
        """Begin a new revision whose changed objects are unknown: increase `revision` and set `touched` to None."""
        self.revision += 1
        self.touched = None

    def _touch(self, *nodes: int) -> None:
        """Record that nodes have changed in the current revision, if `touched` is a dict."""
        if self.touched is not None:
            for node in nodes:
                self.touched.pop(node, None)
                self.touched[node] = self.revision

    # --- reading

    def nodes(self) -> Iterator[int]:
        """Yield the ids of all objects, class by class in the order of declaration."""
        for extent in self.extents:
            yield from extent


def _splice(store: Store, column: list[Any], node: int, index: int, value: Value, inserting: bool) -> None:
    """Insert or remove a value in the column of an attribute, as `Store.splice` does, and journal the change.

    Followers, the distinct values and the hash are not updated.
    """
    old = column[node] or ()
    if isinstance(old, Ordered) and (inserting or len(old) > store.crowd + 1):
        key = (index, value, len(old) + inserting)
        store.record(old, key, *((None, OUT) if inserting else (index, IN)))
        old.put(key, None) if inserting else old.take(key)
        return
    store.record(column, node, column[node], SET)
    new = (*old[:index], value, *old[index:]) if inserting else (*old[:index], *old[index + 1 :])
    column[node] = new if len(new) <= store.crowd else Ordered(new)
