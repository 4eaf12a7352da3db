"""The model: what is read of it is here, what is done to it are functions of the modules beside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy

from envgraph.graph import (
    _canonical,
    _facts,
    _hashing,
    _links,
    _naming,
    _objects,
    _picture,
    _query_features,
    _transactions,
    _values,
)
from envgraph.graph import _refusals as refusals
from envgraph.graph._history import History
from envgraph.graph._integrity import check_store
from envgraph.graph._journal import Ordered
from envgraph.graph._layout import Layout
from envgraph.graph._node import Node, assign_features
from envgraph.graph._query_features import Defined
from envgraph.graph._store import Store
from envgraph.graph._versions import Version
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, Value, Values


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
        defined: the derived features whose values queries compute, see `define`.
        places: what a file calls objects that have no name, `tile[3,1]` in a grid; for `find_object`.
        digits: the text of a decimal in its file, by object, index of the attribute, and value as a float.
    """

    def __init__(self, metamodel: Metamodel, name: str = "model") -> None:
        self.metamodel = metamodel
        self.name = name
        self.places: dict[str, int] = {}
        self.digits: dict[tuple[int, int, Value], str] = {}
        self.defined: dict[Feature, Defined] = {}
        self._titles: dict[int, str] = {}  # the same the other way round, made when it is asked for
        self.store = Store(metamodel)
        self._history = History(self, self.store)
        self._layout = Layout(metamodel, self.store)

    # Functions, and no methods of parts: a write calls nothing before it does what it is for.

    new = _objects.new
    new_at = _objects.new_at
    delete = _objects.delete
    retype = _objects.retype

    find_object = _naming.find_object
    set_object_name = _naming.set_object_name
    title = _naming.title
    describe = _naming.describe

    define = _query_features.define

    set_value = _values.set_value
    add_value = _values.add_value
    insert_value = _values.insert_value
    remove_value = _values.remove_value
    remove_value_at = _values.remove_value_at

    link = _links.link
    add_target = _links.add_target
    insert_target = _links.insert_target
    unlink = _links.unlink
    set_target = _links.set_target
    set_targets = _links.set_targets
    container = _links.container

    savepoint = _transactions.savepoint
    rollback = _transactions.rollback
    shelve = _transactions.shelve
    resume = _transactions.resume
    release = _transactions.release
    unwind = _transactions.unwind
    transaction = _transactions.transaction
    loading = _transactions.loading
    commit = _transactions.commit
    checkout = _transactions.checkout

    state_hash = _hashing.state_hash
    canonical_hash = _canonical.canonical_hash
    subscribe = _facts.subscribe
    unsubscribe = _facts.unsubscribe

    picture = _picture.picture
    to_dot = _picture.to_dot
    to_svg = _picture.to_svg
    _repr_svg_ = _picture.as_svg

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
            return _create(self, cls, object_name, features)
        with self.transaction():
            return _create(self, cls, object_name, features)

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
        """Return whether an object has this name, or this handle stands for an object of the model."""
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

    def class_of(self, node: int) -> str:
        """Name of an object's class.

        Raises:
            InvalidArgument: there is no such object.
        """
        index = self.store.classes[node] if 0 <= node < len(self.store.classes) else -1
        if index < 0:
            _naming.check_alive(self, node)
        return self.metamodel.class_list[index].name

    def alive(self, node: int) -> bool:
        """Return whether there is an object with this id."""
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

    # --- attributes

    def value(self, node: int, attribute: Attribute) -> Value | None:
        """Value of an attribute, or None: unset, or not an attribute of the object's class. For many see `values`."""
        found = self.store.values[attribute.index][node]
        return tuple(found) if type(found) is Ordered else found  # type: ignore[return-value]

    def values(self, node: int, attribute: Attribute) -> Values:
        """Values of an attribute with many, in their order; of any other its value, or () without one."""
        found = self.store.values[attribute.index][node]
        return tuple(found) if isinstance(found, tuple | list) else () if found is None else (found,)

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
        """Return whether there is such a link."""
        return target in self.store.forward[reference.index][source]

    # --- transactions and versions

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

    @property
    def revision(self) -> int:
        """A number that is another one whenever the state may be another one; for caches."""
        return self.store.revision

    # --- checks

    def check_integrity(self) -> None:
        """Assert that all columns, indexes, hash and journal agree, from scratch; for tests."""
        if self.store.interrupted:
            self.store.interrupted.repair()
        check_store(self.store)
        self._history.check_integrity()


def _create(model: Model, cls: str, object_name: str | None, features: Mapping[str, object]) -> Node:
    node = Node(model, model.new(cls, object_name))
    assign_features(node, features)
    return node
