"""Read and write a model by ids of objects; the functions that write are in the room `write`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.graph.history._history import History
from envgraph.graph.model import _query_features
from envgraph.graph.model._query_features import Defined
from envgraph.graph.store._integrity import check_store
from envgraph.graph.store._journal import Ordered
from envgraph.graph.store._layout import Layout
from envgraph.graph.store._store import Store
from envgraph.graph.write import _links, _naming, _objects, _refusals as refusals, _values
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, Value, Values

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


class Graph:
    """The objects, values and links of a model, for programs.

    Objects are ids: ints from 0, never used twice within the history of one version. Features are the resolved
    `Attribute` and `Reference` objects of `metamodel`.

    Every write is type-checked and raises `TypeMismatch`. What else is refused raises `RuleError` with a reason: "full"
    (upper bound), "containment" (a cycle), "dangling", "lost-link". Lower bounds are not checked on writing; see
    `check_conformance`.

    The order in which objects and links are listed is that of their creation until something is removed; a
    removal from an extent, or from an object with more than 32 links of a reference, moves the last
    one into the gap. In any case the order belongs to the state: it is the same however a version was reached.

    Attributes:
        store: the columns that hold everything.
        history: savepoints and versions.
        layout: what writes look up of the metamodel.
        defined: the derived features whose values queries compute, see `define`.
        places: what a file calls objects that have no name, `tile[3,1]` in a grid; for `find_object`.
        titles: the same the other way round, made when it is asked for.
        digits: the text of a decimal in its file, by object, index of the attribute, and value as a float.
    """

    def __init__(self, model: Model, metamodel: Metamodel, name: str) -> None:
        self.metamodel = metamodel
        self.name = name
        self.places: dict[str, int] = {}
        self.titles: dict[int, str] = {}
        self.digits: dict[tuple[int, int, Value], str] = {}
        self.defined: dict[Feature, Defined] = {}
        self.store = Store(metamodel)
        self.history = History(model, self.store)
        self.layout = Layout(metamodel, self.store)

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
    read = _query_features.read

    set_value = _values.set_value
    insert_value = _values.insert_value
    remove_value_at = _values.remove_value_at

    link = _links.link
    add_target = _links.add_target
    insert_target = _links.insert_target
    unlink = _links.unlink
    set_target = _links.set_target
    set_targets = _links.set_targets
    container = _links.container

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
        index = self.layout.numbers.get(cls)
        if index is None:
            raise refusals.unknown_class(self.metamodel, cls)
        extents = self.layout.extents[index]
        if len(extents) == 1:
            return extents[0]
        return [node for extent in extents for node in extent]

    def exact_extent(self, cls: str) -> Sequence[int]:
        """Instances of exactly this class. Not to be kept, nor written to the model while iterating."""
        index = self.layout.numbers.get(cls)
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

    def check_integrity(self) -> None:
        """Assert that all columns, indexes, hash and journal agree, from scratch."""
        if self.store.interrupted:
            self.store.interrupted.repair()
        check_store(self.store)
        self.history.check_integrity()
