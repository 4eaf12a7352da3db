"""The model: what may be written, and everything that can be asked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Literal, Unpack

from envgraph.draw import Picture
from envgraph.errors import InvalidArgument, visible
from envgraph.graph import _refusals as refusals
from envgraph.graph._canonical import canonical_hash
from envgraph.graph._facts import Listener
from envgraph.graph._hashing import condense
from envgraph.graph._history import History, Savepoint, Shelf
from envgraph.graph._incidence import Link, contained_tree, dangling_links, links_at, links_of
from envgraph.graph._integrity import check_store
from envgraph.graph._interrupts import guard, guarded, unguard
from envgraph.graph._layout import Layout
from envgraph.graph._node import Node, assign_features
from envgraph.graph._picture import PictureOptions, model_picture
from envgraph.graph._store import Relation, Store
from envgraph.graph._versions import Version
from envgraph.metamodel import Attribute, Metamodel, Reference, Value, Values, accepts

Semantics = Literal["dpo", "spo"]


class Model:
    """A typed attributed graph that instantiates a metamodel.

    People use handles (`create`, `node`, `model["name"]`); programs use ids, which are ints from 0, never
    used twice within the history of one version. Features are the resolved `Attribute` and `Reference` objects of
    `metamodel`.

    Every write is type-checked and raises `TypeMismatch`. What else is refused raises `RuleError` with a reason: "full"
    (upper bound), "containment" (a cycle), "dangling", "lost-link". Lower bounds are not checked on writing; see
    `check_conformance`.

    The order in which objects and links are listed is that of their creation until something is removed; a
    removal from an extent, or from an object with more than 32 links of a reference, moves the last
    one into the gap. In any case the order belongs to the state: it is the same however a version was reached.

    Args:
        metamodel: what the objects are instances of.
        name: for reports.

    Attributes:
        places: what a file calls objects that have no name, `tile[3,1]` in a grid; for `find_object`.
    """

    def __init__(self, metamodel: Metamodel, name: str = "model") -> None:
        self.metamodel = metamodel
        self.name = name
        self.places: dict[str, int] = {}
        self._titles: dict[int, str] = {}  # the same the other way round, made when it is asked for
        self.store = Store(metamodel)
        self._history = History(self, self.store)
        self._layout = Layout(metamodel, self.store)

    # --- handles

    def create(self, cls: str, /, *, object_name: str | None = None, **features: object) -> Node:
        """Create an object, set its features, and return a handle to it.

        Args:
            cls: a concrete class.
            object_name: unique name of the object, or None.
            **features: attribute values; targets as `Node`s, for a many-reference an iterable of them.

        Raises:
            TypeMismatch: an unknown or abstract class, an unknown feature, a value of the wrong type.
            InvalidArgument: the object name is taken.
            RuleError: a reference is full. The object is not created then.
        """
        if self._history.loading:
            return self._create(cls, object_name, features)
        with self.transaction():
            return self._create(cls, object_name, features)

    def _create(self, cls: str, object_name: str | None, features: Mapping[str, object]) -> Node:
        node = Node(self, self.new(cls, object_name))
        assign_features(node, features)
        return node

    def node(self, id: int) -> Node:
        """A handle to an object.

        Raises:
            InvalidArgument: there is no such object.
        """
        if not self.alive(id):
            raise refusals.missing(self, id)
        return Node(self, id)

    def nodes(self, cls: str | None = None) -> list[Node]:
        """Handles to all objects, or to the instances of a class, subclasses included."""
        ids = self.store.nodes() if cls is None else self.extent(cls)
        return [Node(self, id) for id in ids]

    def __getitem__(self, object_name: str) -> Node:
        """The object with this name.

        Raises:
            InvalidArgument: no object has it.
        """
        found = self.find_object(object_name)
        if found is None:
            raise refusals.unknown_object(self, object_name)
        return Node(self, found)

    def __contains__(self, item: object) -> bool:
        """Whether an object has this name, or this handle stands for an object of the model."""
        if isinstance(item, Node):
            return item.model is self and self.alive(item.id)
        return isinstance(item, str) and self.find_object(item) is not None

    def __iter__(self) -> Iterator[Node]:
        """Handles to all objects, as they are at the start."""
        return iter(self.nodes())

    def __len__(self) -> int:
        return sum(map(len, self.store.extents))

    def __bool__(self) -> bool:
        """True: a model without objects is a model."""
        return True

    def copy(self) -> Model:
        """Another model in the same state (ids, every order, hash), without versions, savepoints and listeners."""
        return copy(self)  # `envgraph.graph._copying` says how

    def __deepcopy__(self, _: object) -> Model:
        return self.copy()

    def __repr__(self) -> str:
        return f"<Model {self.name}: {len(self)} objects of {self.metamodel.name}>"

    # --- objects

    def new(self, cls: str, object_name: str | None = None) -> int:
        """Create an object whose attributes have their initial values, and return its id.

        Raises:
            TypeMismatch: an unknown or abstract class.
            InvalidArgument: the object name is taken.
        """
        return self.new_at(self.store.next_id, cls, object_name)

    def new_at(self, node: int, cls: str, object_name: str | None = None) -> int:
        """As `new`, with a given id, for reading models back.

        The columns are as long as the largest id, so ids should be dense.

        Raises:
            InvalidArgument: the id is negative or that of an object; the object name is taken.
            TypeMismatch: an unknown or abstract class.
        """
        store = self.store
        number = self._concrete(cls)
        if object_name is not None:
            self._check_free(object_name)
        if node < 0 or (node < store.next_id and store.classes[node] >= 0):
            raise InvalidArgument(f"{node} is not the id of a new object")
        try:
            return self._new(node, number, object_name)
        except BaseException:
            store.interrupted.append((self._new, (node, number, object_name)))
            store.interrupted.repair()
            raise

    def _new(self, node: int, cls: int, object_name: str | None) -> int:
        store = self.store
        if node >= store.next_id:
            if len(store.classes) <= node + 1:
                store.reserve(2 * node + 2)
            store.next_id = node + 1
        if store.classes[node] != cls:
            store.enter(node, cls)
        for attribute, initial in self._layout.initials[cls]:
            store.put(node, attribute, initial)
        if object_name is not None and store.names[node] is None:
            store.rename(node, object_name)
        return node

    def delete(self, node: int, semantics: Semantics = "dpo") -> None:
        """Delete an object and everything it contains.

        Args:
            node: the object.
            semantics: "dpo" refuses while other links would be left dangling: links between a deleted object and one
                that stays, except the link from the container, and links from the object to itself. "spo" deletes
                those too.

        Raises:
            RuleError: reason "dangling"; `details` has a line for each such link.
        """
        if semantics not in ("dpo", "spo"):
            raise InvalidArgument(f'semantics is "dpo" or "spo", not {semantics!r}')
        self._check_alive(node)
        store, layout = self.store, self._layout
        tree = contained_tree(store, layout, node)
        dangling = list(dangling_links(store, layout, tree)) if semantics == "dpo" else []
        if dangling:
            raise refusals.dangling(self, node, dangling)
        try:
            self._delete(tree)
        except BaseException:
            store.interrupted.append((self._delete, (tree,)))
            store.interrupted.repair()
            raise

    def _delete(self, tree: Sequence[int]) -> None:
        """Delete what is there of a tree."""
        store, layout = self.store, self._layout
        for gone in tree:
            if store.classes[gone] >= 0:
                for relation, source, target in list(links_of(store, layout, gone)):
                    store.disconnect(relation, source, target)
        for gone in reversed(tree):
            if store.classes[gone] >= 0:
                self._erase(gone)

    def _erase(self, node: int) -> None:
        store = self.store
        for attribute, _ in self._layout.initials[store.classes[node]]:
            if store.values[attribute][node] is not None:
                store.put(node, attribute, None)
        if store.names[node] is not None:
            store.rename(node, None)
        store.leave(node)

    def retype(self, node: int, cls: str, lossy: bool = False) -> None:
        """Make an object a direct instance of another class; identity, name and shared features stay.

        Values of attributes that the new class lacks go; attributes that it adds get their initial values.

        Args:
            node: the object.
            cls: a concrete class.
            lossy: drop links that the new class does not allow, instead of refusing.

        Raises:
            TypeMismatch: an unknown or abstract class.
            RuleError: reason "lost-link"; `details` has a line for each such link.
        """
        store = self.store
        old = store.classes[node]
        new = self._concrete(cls)
        if old < 0:
            self._check_alive(node)
        if old == new:
            return
        dropped, gained, forbidden = self._layout.retyping(old, new)
        lost = list(links_at(node, forbidden))
        if lost and not lossy:
            raise refusals.lost(self, node, cls, lost)
        try:
            self._retype(node, new, lost, dropped, gained)
        except BaseException:
            store.interrupted.append((self._retype, (node, new, lost, dropped, gained)))
            store.interrupted.repair()
            raise

    def _retype(
        self,
        node: int,
        cls: int,
        lost: Sequence[Link],
        dropped: Sequence[int],
        gained: Sequence[tuple[int, Value | Values]],
    ) -> None:
        """Do what is left of `retype`."""
        store = self.store
        for relation, source, target in lost:
            if target in relation.forward[source]:
                store.disconnect(relation, source, target)
        for attribute in dropped:
            if store.values[attribute][node] is not None:
                store.put(node, attribute, None)
        if store.classes[node] != cls:
            store.move(node, cls)
        for attribute, initial in gained:
            store.put(node, attribute, initial)

    def class_of(self, node: int) -> str:
        """Name of an object's class.

        Raises:
            InvalidArgument: there is no such object.
        """
        index = self.store.classes[node] if 0 <= node < len(self.store.classes) else -1
        if index < 0:
            self._check_alive(node)
        return self.metamodel.class_list[index].name

    def alive(self, node: int) -> bool:
        """Whether there is an object with this id."""
        return isinstance(node, int) and 0 <= node < self.store.next_id and self.store.classes[node] >= 0

    def extent(self, cls: str) -> Sequence[int]:
        """Instances of a class and its subclasses, concrete classes in the order of declaration.

        Not to be kept, nor written to the model while iterating.
        """
        index = self._layout.numbers.get(cls)
        if index is None:
            raise refusals.unknown_class(self.metamodel, cls)
        extents = self._layout.extents[index]
        if len(extents) == 1:
            return extents[0]
        return [node for extent in extents for node in extent]

    def exact_extent(self, cls: str) -> Sequence[int]:
        """Instances of exactly this class. Not to be kept, nor written to the model while iterating."""
        index = self._layout.numbers.get(cls)
        if index is None:
            raise refusals.unknown_class(self.metamodel, cls)
        return self.store.extents[index]

    def object_name(self, node: int) -> str | None:
        """Name of an object, or None."""
        return self.store.names[node]

    def find_object(self, object_name: str) -> int | None:
        """The object with this name, or None; one of a grid has that of its place, such as `tile[3, 1]`."""
        found = self.store.by_name.get(object_name)
        if found is None and self.places:
            place = self.places.get(object_name.replace(" ", ""), -1)
            return place if self.alive(place) else None
        return found

    def set_object_name(self, node: int, object_name: str | None) -> None:
        """Give an object another name, or none.

        Raises:
            InvalidArgument: the name is taken by another object.
        """
        self._check_alive(node)
        if object_name == self.store.names[node]:
            return
        if object_name is not None:
            self._check_free(object_name)
        self.store.rename(node, object_name)

    def title(self, node: int) -> str | None:
        """What a file calls an object, for `find_object`: its name, else its place in a grid, `tile[3, 1]`; or None."""
        if len(self._titles) != len(self.places):
            self._titles = {there: place.replace(",", ", ") for place, there in self.places.items()}
        return self.store.names[node] or self._titles.get(node)

    def describe(self, node: int) -> str:
        """An object for messages: what a file calls it, else its class with its key, `Box {label = a}`, or its id."""
        if not self.alive(node):
            return f"object {node!r}"
        key = ", ".join(
            f"{name} = {self.node(node)[name]}" for name in self.metamodel.key(self.class_of(node))
        )
        known = f" {{{visible(key)}}}" if key else f"#{node}"
        return f"`{self.title(node) or self.class_of(node) + known}`"

    # --- attributes

    def value(self, node: int, attribute: Attribute) -> Value | None:
        """Value of an attribute, or None: unset, or not an attribute of the object's class. For many see `values`."""
        return self.store.values[attribute.index][node]  # type: ignore[no-any-return]

    def values(self, node: int, attribute: Attribute) -> Values:
        """Values of an attribute with many, in their order; of any other its value, or () without one."""
        found = self.store.values[attribute.index][node]
        return found if isinstance(found, tuple) else () if found is None else (found,)

    def set_value(self, node: int, attribute: Attribute, value: Value | Sequence[Value] | None) -> None:
        """Set or (None) clear an attribute; an int for a float attribute becomes a float.

        An attribute with many values takes a list or tuple of them.

        Raises:
            TypeMismatch: the value is not of the attribute's type, or the object's class lacks the attribute.
            InvalidArgument: a value is given twice that the attribute has once.
            RuleError: more values than the attribute may have ("full").
        """
        index = attribute.index
        layout = self._layout
        if not layout.attribute_ok[index][self.store.classes[node]]:
            raise refusals.lacks(self, node, attribute)
        kind = layout.kinds[index]
        if type(value) is not kind or layout.checked[index]:
            if attribute.many:
                value = self._all_coerced(node, attribute, () if value is None else value)
            elif value is not None:
                value = self._coerced(attribute, value)
        if self.store.values[index][node] != value:
            self.store.put(node, index, value)

    def add_value(self, node: int, attribute: Attribute, value: Value) -> bool:
        """Add a value behind the others of an attribute with many; False if each stands once, and it is there.

        Raises:
            TypeMismatch: as for `set_value`.
            RuleError: the attribute has as many values as it may have ("full").
        """
        values = self.values(node, attribute)
        if attribute.unique and value in values and accepts(attribute.type, value):
            return False
        self.set_value(node, attribute, (*values, value))
        return True

    def remove_value(self, node: int, attribute: Attribute, value: Value) -> bool:
        """Remove a value from an attribute with many, wherever it stands; False if it does not."""
        values = self.values(node, attribute)
        if value not in values:
            return False
        self.set_value(node, attribute, [one for one in values if one != value])
        return True

    def _coerced(self, attribute: Attribute, value: object) -> Value:
        if not accepts(attribute.type, value):
            raise refusals.wrong_value(attribute, value)
        return self._layout.kinds[attribute.index](value)  # type: ignore[no-any-return]

    def _all_coerced(self, node: int, attribute: Attribute, values: object) -> Values:
        if not isinstance(values, list | tuple):
            raise refusals.no_list(attribute, values)
        found = tuple(self._coerced(attribute, value) for value in values)
        if attribute.unique and len(dict.fromkeys(found)) < len(found):
            raise refusals.repeated(attribute, found)
        if attribute.upper is not None and len(found) > attribute.upper:
            raise refusals.too_many(self, node, attribute, found)
        return found

    # --- links

    def targets(self, node: int, reference: Reference) -> Sequence[int]:
        """Targets of an object's links. Not to be kept, nor written to the model while iterating."""
        return self.store.forward[reference.index][node]

    def target(self, node: int, reference: Reference) -> int | None:
        """The first target, or None."""
        ends = self.store.forward[reference.index][node]
        return ends[0] if ends else None

    def sources(self, node: int, reference: Reference) -> Sequence[int]:
        """Objects with a link to this one. Not to be kept, nor written to the model while iterating."""
        return self.store.backward[reference.index][node]

    def has_link(self, source: int, reference: Reference, target: int) -> bool:
        """Whether there is such a link."""
        return target in self.store.forward[reference.index][source]

    def link(self, source: int, reference: Reference, target: int) -> bool:
        """Add a link, and so its opposite; False if it was there already.

        An object moves out of its old container when it is linked into another.

        Raises:
            TypeMismatch: an end is not of the class that the reference demands.
            RuleError: the reference, or its opposite at the target, is "full"; the link would be a cycle of
                "containment".
        """
        relation = self.store.relations[reference.index]
        classes = self.store.classes
        if not (relation.source_ok[classes[source]] and relation.target_ok[classes[target]]):
            raise refusals.wrong_link(self, source, reference, target)
        if relation.contained:
            assert relation.opposite is not None
            return self.link(target, relation.opposite, source)
        ends = relation.forward[source]
        if target in ends:
            return False
        if len(ends) >= relation.upper:
            raise refusals.full(self, source, reference)
        if relation.containment:
            return self._house(relation, source, target)
        if len(relation.backward[target]) >= relation.opposite_upper:
            assert relation.opposite is not None
            raise refusals.full(self, target, relation.opposite)
        self.store.connect(relation, source, target)
        return True

    def add_target(self, source: int, reference: Reference, target: int) -> bool:
        """As `link`, but where the opposite of a single target is taken, the object that holds it lets go.

        Raises:
            TypeMismatch, RuleError: as `link`.
        """
        relation = self.store.relations[reference.index]
        if relation.opposite is None or relation.opposite_upper != 1 or target in relation.forward[source]:
            return self.link(source, reference, target)
        self.set_target(target, relation.opposite, source)
        return True

    def _house(self, relation: Relation, container: int, node: int) -> bool:
        """Put an object into a container that is not inside it, after taking it out of another."""
        above: int | None = container
        while above is not None:
            if above == node:
                raise refusals.inside(self, node, container)
            found = self.container(above)
            above = found and found[0]
        old = self.container(node)
        try:
            if old:
                self.store.disconnect(self.store.relations[old[1].index], old[0], node)
            self.store.connect(relation, container, node)
        except BaseException:
            self.store.interrupted.append((self.link, (container, relation.reference, node)))
            self.store.interrupted.repair()
            raise
        return True

    def unlink(self, source: int, reference: Reference, target: int) -> bool:
        """Remove a link, and so its opposite; False if there is none."""
        relation = self.store.relations[reference.index]
        if target not in relation.forward[source]:
            return False
        self.store.disconnect(relation, source, target)
        return True

    def set_target(self, source: int, reference: Reference, target: int | None) -> None:
        """Make `target` the only target; None clears the reference.

        Unlike `link` this replaces: the old target goes, and where the opposite of a single reference is taken,
        the object that holds it lets go.

        Raises:
            TypeMismatch: an end is not of the class that the reference demands.
            RuleError: a cycle of "containment", or a full many-valued opposite; then nothing has changed.
        """
        relation = self.store.relations[reference.index]
        if not relation.plain:
            self.set_targets(source, reference, () if target is None else (target,))
            return
        classes = self.store.classes
        if not (
            relation.source_ok[classes[source]] and (target is None or relation.target_ok[classes[target]])
        ):
            raise refusals.wrong_link(self, source, reference, target)
        old = relation.forward[source]
        if old and old[0] == target:
            return
        try:
            if old:
                relation.disconnect(source, old[0])
            if target is not None:
                if relation.opposite_upper == 1:
                    holders = relation.backward[target]
                    if holders:
                        relation.disconnect(holders[0], target)
                relation.connect(source, target)
        except BaseException:
            self.store.interrupted.append((self.set_target, (source, reference, target)))
            self.store.interrupted.repair()
            raise

    def set_targets(self, source: int, reference: Reference, targets: Sequence[int]) -> None:
        """Make these the targets, in this order, as `set_target` does for one.

        Raises:
            InvalidArgument: a target is named twice.
        """
        relation = self.store.relations[reference.index]
        classes = self.store.classes
        if not relation.source_ok[classes[source]]:
            raise refusals.wrong_link(self, source, reference, None)
        for target in targets:
            if not relation.target_ok[classes[target]]:
                raise refusals.wrong_link(self, source, reference, target)
        old = relation.forward[source]
        if len(old) == len(targets) and tuple(old) == tuple(targets):
            return
        if not targets:  # nothing can be refused, so nothing has to be taken back
            try:
                self._clear(relation, source)
            except BaseException:
                self.store.interrupted.append((self._clear, (relation, source)))
                self.store.interrupted.repair()
                raise
            return
        if len(targets) > relation.upper:
            raise refusals.full(self, source, reference)
        if len(targets) > 1 and len(set(targets)) < len(targets):
            raise InvalidArgument(f"the targets of `{reference}` are different objects")
        with self._all_or_nothing():
            self._replace(relation, source, targets)

    def _clear(self, relation: Relation, source: int) -> None:
        for target in tuple(relation.forward[source]):
            relation.disconnect(source, target)

    def _replace(self, relation: Relation, source: int, targets: Sequence[int]) -> None:
        disconnect = self.store.disconnect
        old = tuple(relation.forward[source])
        wanted = set(targets)
        kept = [target for target in old if target in wanted]
        # Fewer changes if those that stay come first in the new order; else the order needs all of them anew.
        in_place = kept == list(targets[: len(kept)])
        for target in old:
            if not in_place or target not in wanted:
                disconnect(relation, source, target)
        if relation.opposite_upper == 1:
            for target in targets:
                holders = relation.backward[target]
                if holders and holders[0] != source:
                    disconnect(relation, holders[0], target)
        for target in targets:
            self.link(source, relation.reference, target)

    def container(self, node: int) -> tuple[int, Reference] | None:
        """The object that contains this one, and by which reference; None for a root."""
        for relation in self._layout.containers[self.store.classes[node]]:
            holders = relation.backward[node]
            if holders:
                return holders[0], relation.reference
        return None

    # --- transactions and versions

    def savepoint(self) -> Savepoint:
        """Open a savepoint; they nest. Close it with `rollback` or `release`, innermost first.

        Raises:
            TransactionError: the model is loading.
        """
        return self._history.savepoint()

    def rollback(self, savepoint: Savepoint) -> None:
        """Restore the state at the innermost savepoint exactly (ids, order, hash), and close it.

        Raises:
            TransactionError: it is not the innermost open one.
        """
        self._history.rollback(savepoint)

    def shelve(self, savepoint: Savepoint) -> Shelf:
        """As `rollback`, and return what was taken back, for `resume`.

        Raises:
            TransactionError: it is not the innermost open one.
        """
        return self._history.shelve(savepoint)

    def resume(self, shelf: Shelf) -> Savepoint:
        """Open a savepoint and make the changes of a shelf again, exactly (ids, order, hash).

        The state must be the one at the savepoint that was shelved: that is not checked.
        """
        return self._history.resume(shelf)

    def release(self, savepoint: Savepoint) -> None:
        """Close the innermost savepoint and keep what was changed since.

        Raises:
            TransactionError: it is not the innermost open one.
        """
        self._history.release(savepoint)

    def unwind(self, depth: int = 0) -> None:
        """Roll back until only so many savepoints are open.

        Ctrl-C may come before what `savepoint` returns has reached anybody. Then only this closes it.
        """
        self._history.unwind(depth)

    @contextmanager
    def transaction(self) -> Iterator[Savepoint]:
        """Everything inside happens, or, if an exception leaves the block, nothing of it."""
        depth, savepoint = self._history.depth, None
        outermost = not depth and guard()  # as `guarded` does, written out because transactions are many
        try:
            savepoint = self._history.savepoint()
            yield savepoint
            self._history.release(savepoint)
        except BaseException:
            # Nothing to do if a listener raises: the transaction has ended by then.
            self.store.interrupted.append(depth if savepoint is None else savepoint)
            self.store.interrupted.repair()
            raise
        finally:
            if outermost:
                unguard()

    @guarded
    def _all_or_nothing(self) -> Iterator[None]:
        if self._history.loading:
            yield
        else:
            with self.transaction():
                yield

    @guarded
    def loading(self) -> Iterator[None]:
        """Build a model without a journal and without telling listeners of each change.

        The listeners hear `restored` at the end.

        Raises:
            TransactionError: a savepoint is open or a version is held; or, inside the block, a savepoint is asked for.
        """
        history, store = self._history, self.store
        if history.loading:
            history.begin_loading()  # refuses
        listeners = store.listeners[:]

        def end() -> None:
            history.end_loading()
            store.listeners[:] = [*listeners, *(each for each in store.listeners if each not in listeners)]
            store.restored()

        try:
            history.begin_loading()
            store.listeners.clear()
            yield
            end()
        except BaseException:
            end()
            raise

    def commit(self) -> Version:
        """Name the present state. The version lives as long as somebody holds it.

        Raises:
            TransactionError: a savepoint is open.
        """
        return self._history.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Put the model into a committed state, exactly as it was then: ids, order, hash.

        Args:
            version: a version of this model.
            discard: lose uncommitted changes instead of refusing.

        Raises:
            InvalidArgument: that is no version.
            TransactionError: a version of another model, an open savepoint, or uncommitted changes.
        """
        self._history.checkout(version, discard)

    @property
    def version(self) -> Version | None:
        """The version that the model is in; None if there are uncommitted changes, or nobody holds a version."""
        return self._history.version()

    @property
    def in_transaction(self) -> bool:
        """Whether a savepoint is open."""
        return self._history.depth > 0

    @property
    def idle(self) -> bool:
        """Whether nothing is under way: no savepoint is open, nobody holds a version, and it is not loading."""
        return self._history.idle

    @property
    def depth(self) -> int:
        """How many savepoints are open."""
        return self._history.depth

    # --- observation

    def state_hash(self) -> int:
        """A 64-bit hash of all facts by identity: (node, class), (node, attribute, value), (source, reference, target).

        Kept incrementally, and the same in every process. Names of objects and the order of links do not count.
        """
        return condense(self.store.total)

    def canonical_hash(self) -> int:
        """A 64-bit hash that isomorphic models share, whatever their ids and orders; computed anew on each call.

        By colour refinement: models that differ may share it too if they are so regular that it cannot tell them
        apart. Names of objects do not count.
        """
        return canonical_hash(self.store)

    @property
    def revision(self) -> int:
        """A number that is another one whenever the state may be another one; for caches."""
        return self.store.revision

    def subscribe(self, listener: Listener) -> None:
        """Tell a listener of every change from now on, after those that are there already."""
        self.store.listeners.append(listener)

    def unsubscribe(self, listener: Listener) -> None:
        """Stop telling a listener.

        Raises:
            InvalidArgument: it is not subscribed.
        """
        for index, other in enumerate(self.store.listeners):
            if other is listener:
                del self.store.listeners[index]
                return
        raise InvalidArgument("the listener is not subscribed")

    # --- pictures

    def picture(self, **options: Unpack[PictureOptions]) -> Picture:
        """A picture of the present state; `PictureOptions` says what can be asked for.

        Raises:
            InvalidArgument: an unknown name or layout, a node of another model.
        """
        return model_picture(self, **options)

    def to_dot(self, **options: Unpack[PictureOptions]) -> str:
        """The picture as DOT, the text that Graphviz draws: the same state gives the same text."""
        return self.picture(**options).to_dot()

    def to_svg(self, **options: Unpack[PictureOptions]) -> str:
        """The picture as an `<svg>` element: drawn by Graphviz, without it by us; see `Picture.to_svg`."""
        return self.picture(**options).to_svg()

    def _repr_svg_(self) -> str | None:
        return self.picture()._repr_svg_()

    # --- checks

    def check_integrity(self) -> None:
        """Assert that all columns, indexes, hash and journal agree, from scratch; for tests."""
        if self.store.interrupted:
            self.store.interrupted.repair()
        check_store(self.store)
        self._history.check_integrity()

    def _concrete(self, cls: str) -> int:
        number = self._layout.concrete.get(cls)
        if number is None:
            raise refusals.not_instantiable(self.metamodel, cls)
        return number

    def _check_alive(self, node: int) -> None:
        if not self.alive(node):
            raise refusals.missing(self, node)

    def _check_free(self, object_name: str) -> None:
        if self.find_object(object_name) is not None:
            raise InvalidArgument(f"`{self.name}` has an object `{object_name}` already")
