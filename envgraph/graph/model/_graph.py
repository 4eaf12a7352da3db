"""The model for programs: objects are ids. The functions that write are in the package `write`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from envgraph.graph.history._history import History
from envgraph.graph.model import _query_features
from envgraph.graph.model._query_features import FeatureDefinition
from envgraph.graph.store._integrity import check_store
from envgraph.graph.store._metamodel_tables import MetamodelTables
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import OrderedValues
from envgraph.graph.write import (
    _link_writes,
    _naming,
    _object_writes,
    _value_writes,
    _write_errors as refusals,
)
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, Value, Values

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


class Graph:
    """The objects, values and links of a model, for programs.

    Objects are ids: ints from 0, never used twice within the history of one version. Features are the resolved
    `Attribute` and `Reference` objects of `metamodel`.

    Every write is type-checked and raises `TypeMismatch`. Other refused writes raise `RuleError` with a reason: "full"
    (upper bound), "containment" (a cycle), "dangling", "lost-link". Lower bounds are not checked on writing; see
    `check_conformance`.

    Objects and links are listed in the order of their creation until the first removal. A removal from an extent, or
    from an object with more than 32 links of a reference, moves the last element into the gap. The order belongs to
    the state: it is the same however a version was reached.

    Attributes:
        store: the columns with all data.
        history: savepoints and versions.
        tables: lookup tables of the metamodel, for writes.
        defined_features: the derived features whose values queries compute, see `define_features`.
        grid_positions: object ids by grid position in a file, such as `tile[3,1]`, for objects without names; for
            `find_object`.
        grid_titles: grid positions by object id, the inverse of `grid_positions`, computed on request.
        decimal_texts: the text of a decimal number in its file, by object, index of the attribute, and value as a
            float.
        schema_locations: by namespace URI, the file or URL of a metamodel that the `.xmi` file of the model names.
    """

    def __init__(self, model: Model, metamodel: Metamodel, name: str) -> None:
        self.metamodel = metamodel
        self.name = name
        self.grid_positions: dict[str, int] = {}
        self.grid_titles: dict[int, str] = {}
        self.decimal_texts: dict[tuple[int, int, Value], str] = {}
        self.schema_locations: dict[str, str] = {}
        self.defined_features: dict[Feature, FeatureDefinition] = {}
        self.store = Store(metamodel)
        self.history = History(model, self.store)
        self.tables = MetamodelTables(metamodel, self.store)

    # These functions are methods here, not methods of separate objects, so that a write costs only one call.

    new = _object_writes.new
    new_at = _object_writes.new_at
    delete = _object_writes.delete
    retype = _object_writes.retype

    find_object = _naming.find_object
    set_object_name = _naming.set_object_name
    display_name = _naming.display_name
    describe = _naming.describe

    define_features = _query_features.define_features
    read_feature = _query_features.read_feature

    set_value = _value_writes.set_value
    insert_value = _value_writes.insert_value
    remove_value_at = _value_writes.remove_value_at

    link = _link_writes.link
    add_target = _link_writes.add_target
    insert_target = _link_writes.insert_target
    unlink = _link_writes.unlink
    set_target = _link_writes.set_target
    set_targets = _link_writes.set_targets
    container = _link_writes.container

    def class_of(self, node: int) -> str:
        """Return the name of an object's class.

        Raises:
            InvalidArgument: no object has this id.
        """
        index = self.store.classes[node] if 0 <= node < len(self.store.classes) else -1
        if index < 0:
            _naming.check_alive(self, node)
        return self.metamodel.class_list[index].name

    def alive(self, node: int) -> bool:
        """Return True if an object with this id exists."""
        return isinstance(node, int) and 0 <= node < self.store.next_id and self.store.classes[node] >= 0

    def extent(self, cls: str) -> Sequence[int]:
        """Return the instances of a class and its subclasses, concrete classes in the order of declaration.

        The sequence may change with the model: do not store it, and do not write to the model while iterating.
        """
        index = self.tables.class_indexes.get(cls)
        if index is None:
            raise refusals.unknown_class_error(self.metamodel, cls)
        extents = self.tables.class_extents[index]
        if len(extents) == 1:
            return extents[0]
        return [node for extent in extents for node in extent]

    def exact_extent(self, cls: str) -> Sequence[int]:
        """Return the direct instances of a class. Do not store the sequence, nor write while iterating."""
        index = self.tables.class_indexes.get(cls)
        if index is None:
            raise refusals.unknown_class_error(self.metamodel, cls)
        return self.store.extents[index]

    def object_name(self, node: int) -> str | None:
        """Return the name of an object, or None."""
        return self.store.names[node]

    # --- attributes

    def value(self, node: int, attribute: Attribute) -> Value | None:
        """Return the value of an attribute. None means unset, or that the object's class lacks the attribute.

        For a multi-valued attribute the result is a tuple; see `values`.
        """
        found = self.store.values[attribute.index][node]
        return tuple(found) if type(found) is OrderedValues else found  # type: ignore[return-value]

    def values(self, node: int, attribute: Attribute) -> Values:
        """Return the values of a multi-valued attribute in order, or a single value as a tuple. () if unset."""
        found = self.store.values[attribute.index][node]
        return tuple(found) if isinstance(found, tuple | list) else () if found is None else (found,)

    # --- links

    def targets(self, node: int, reference: Reference) -> Sequence[int]:
        """Return the targets of an object's links. Do not store the sequence, nor write while iterating."""
        return self.store.forward[reference.index][node]

    def target(self, node: int, reference: Reference) -> int | None:
        """Return the first target of an object's links, or None if there are none."""
        ends = self.store.forward[reference.index][node]
        return ends[0] if ends else None

    def sources(self, node: int, reference: Reference) -> Sequence[int]:
        """Return the objects with a link to `node`. Do not store the sequence, nor write while iterating."""
        return self.store.backward[reference.index][node]

    def has_link(self, source: int, reference: Reference, target: int) -> bool:
        """Return True if the reference links `source` to `target`."""
        return target in self.store.forward[reference.index][source]

    def check_integrity(self) -> None:
        """Repair interrupted writes. Assert that all columns, indexes, the hash and the journal are consistent."""
        if self.store.interrupted_writes:
            self.store.interrupted_writes.repair()
        check_store(self.store)
        self.history.check_integrity()
