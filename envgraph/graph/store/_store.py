"""The data of a model in id-indexed columns, and the elementary changes to it.

Nothing here says what is allowed: `Graph` does. Every change is recorded in the journal (while recording), added to
the hash, and what follows the model is notified of it.
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
    """Let a change mend what was interrupted before, or what interrupts it."""

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
    """Columns of a model. Lists keep their identity for the life of the model, so that others may hold them.

    Reading them directly is for matchers; writing is for `Graph` alone.

    Attributes:
        classes: index of each node's class in `metamodel.class_list`, -1 for no such object.
        place: position of each node in its extent.
        extents: for each class the objects of exactly that class.
        values: for each attribute (by `index`) the column of values, None where there is none; many are a tuple, or
            an `Ordered`.
        distinct: for each attribute with many values the column of those that differ, which is what patterns see: a
            relation, of which one pair after the other changes. Empty lists for the others.
        forward, backward: for each reference (by `index`) the columns of targets and of sources.
        relations: for each reference how it is stored.
        names: name of each object, or None; `by_name` maps back (to None for names no longer in use).
        next_id: id of the next new object; the columns are longer, and empty from there on.
        journal: see `_journal`.
        recording: whether there is a state to go back to, so that changes are journalled.
        epoch: grows at each state that undoing may lead to; what is journalled as a whole is copied once in each.
        loading: whether the model is being built without a journal.
        total: the sum behind the state hash.
        revision: grows with every change and every restoration.
        touched: the objects whose values have changed since somebody set it to {}, and inverted (`~node`) those whose
            class or place in the extent has, each with the revision of its last change, the latest last; None while
            nobody asks, and after a restoration.
        followers: see `Follower`.
        value_added, value_removing: for each attribute (by `index`) a function of node and value, or None.
        class_added, class_removing: for each class (by index) a function of the node, or None.
        retyping: gives the two functions for a change from one class index to another, or None.
        interrupted: what is to be made good before anything else is done.
        crowd: an adjacency of more elements than this is an `IndexedSet`, of fewer a tuple; nothing else decides. Many
            values are an `Ordered` and a tuple in the same way.

    No more than 30 attributes: CPython reads those of objects with more of them in a slower way.

    Invariants: `distinct` has the values of `values`, each once; an adjacency is a tuple if it has at most `crowd`
    elements, else an `IndexedSet`; forward and backward hold the same links; a node that does not exist has no name,
    value or link.
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
        """Make the columns long enough for ids below `count`, and one more that never exists."""
        size = count + 1
        if len(self.classes) >= size:
            return
        self.lengthen(size)

    def lengthen(self, size: int) -> None:
        """Each column by what it lacks, as it may have been interrupted."""
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
        """Journal a change to something that follows the model, such as a view: see `_journal` for the four parts.

        It is then undone and redone with the model's own changes, and in their order.
        """
        if self.recording:
            self.journal.extend((container, key, old, opcode))

    # --- elementary changes

    def enter(self, node: int, cls: int) -> None:
        """The object becomes an instance of a class; it was none of any."""
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
        """The object is no longer an instance of its class."""
        hook = self.class_removing[self.classes[node]]
        if hook is not None:
            hook(node)
        self._leave(node)

    def move(self, node: int, cls: int) -> None:
        """The object becomes an instance of another class; what both classes are it never ceases to be."""
        old = self.classes[node]
        removing, added = self.retyping(old, cls) if self.retyping else (None, None)
        if removing is not None:
            removing(node)
        if old >= 0:  # else it has been interrupted
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
        """The object gets another value in an attribute, or None."""
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
        """The object gets other values; whoever follows hears of one after the other."""
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
        """Insert a value before the one at an index of an attribute with many, or remove it from there."""
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
        """Make these the distinct values, or the targets, of an object, in their order."""
        if tuple(distinct[node]) != values:
            self.record(distinct, node, distinct[node], SET)
            distinct[node] = self.grouped(values)

    @_mended
    def move_target(self, relation: Relation, source: int, target: int, index: int) -> None:
        """Move a target of an object to another position among them."""
        self.move_end(relation.forward, source, target, index)
        self.revision += 1

    def _connector(self, relation: Relation) -> Callable[[int, int], object]:
        """Adds links of one reference. Most objects have few of them, so these are dealt with on the spot."""
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
        """Removes links of one reference."""
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
        """The object gets another name, or none. Names are no facts: views and the hash ignore them."""
        old = self.names[node]
        if old is not None:
            self.map_name(old, None)
        if name is not None:
            self.map_name(name, node)
        self.record(self.names, node, old, SET)
        self.names[node] = name
        self.revision += 1

    # --- parts of them

    def map_name(self, name: str, node: int | None) -> None:
        """A name is that of an object, or of none."""
        self.record(self.by_name, name, self.by_name.get(name), SET)
        self.by_name[name] = node

    def grouped(self, items: Sequence[Item]) -> tuple[Item, ...] | IndexedSet[Item]:
        """These elements as an adjacency holds them."""
        return tuple(items) if len(items) <= self.crowd else IndexedSet(tuple(items))

    def add_end(self, column: Any, key: Any, item: Any) -> None:
        """Add an element under a key: to what a column, or a table that follows the model, holds there."""
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
        """Remove an element under a key."""
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
        """Move an element under a key to a position, at most to the end; those between shift by one."""
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
        """Begin a new revision that differs from the last one nobody knows in what."""
        self.revision += 1
        self.touched = None

    def _touch(self, *nodes: int) -> None:
        """Note that objects have changed in the present revision, if somebody wants to know."""
        if self.touched is not None:
            for node in nodes:
                self.touched.pop(node, None)
                self.touched[node] = self.revision

    # --- reading

    def nodes(self) -> Iterator[int]:
        """All objects, class by class in the order of declaration."""
        for extent in self.extents:
            yield from extent


def _splice(store: Store, column: list[Any], node: int, index: int, value: Value, inserting: bool) -> None:
    """Insert a value into those of an object, or remove it, and journal that."""
    old = column[node] or ()
    if isinstance(old, Ordered) and (inserting or len(old) > store.crowd + 1):
        key = (index, value, len(old) + inserting)
        store.record(old, key, *((None, OUT) if inserting else (index, IN)))
        old.put(key, None) if inserting else old.take(key)
        return
    store.record(column, node, column[node], SET)
    new = (*old[:index], value, *old[index:]) if inserting else (*old[:index], *old[index + 1 :])
    column[node] = new if len(new) <= store.crowd else Ordered(new)
