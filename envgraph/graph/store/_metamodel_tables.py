"""Lookup tables computed from a metamodel, for the hot paths of a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from envgraph.graph.store._relation import ReferenceStorage
from envgraph.graph.store._store import Store
from envgraph.graph.store._undo_log import Extent
from envgraph.metamodel import Attribute, EnumType, Metamodel, Scalar, Value, Values

_PYTHON_TYPES: Mapping[Scalar, type] = {
    Scalar.INT: int,
    Scalar.FLOAT: float,
    Scalar.BOOL: bool,
    Scalar.STRING: str,
}

InitialValues = tuple[tuple[int, Value | Values], ...]
RetypingEffects = tuple[tuple[int, ...], InitialValues, tuple[tuple[ReferenceStorage, bool], ...]]


T = TypeVar("T")

_MAX_EAGER_ROWS: Final = 256
"""Metamodels with at most this many classes have full tables, computed at once."""


class _LazyRows(dict[int, T]):
    """A table whose rows are computed on first access, because a whole table is quadratic in the number of classes."""

    def __init__(self, make: Callable[[int], T]) -> None:
        self._make = make

    def __missing__(self, index: int) -> T:
        row = self[index] = self._make(index)
        return row


ClassTable = tuple[T, ...] | _LazyRows[T]


def _make_table(count: int, make: Callable[[int], T]) -> ClassTable[T]:
    return tuple(map(make, range(count))) if count <= _MAX_EAGER_ROWS else _LazyRows(make)


class MetamodelTables:
    """Lookup tables of a metamodel, indexed by the numbers of classes and attributes, for the hot paths of a model."""

    def __init__(self, metamodel: Metamodel, store: Store) -> None:
        classes = metamodel.class_list
        self._metamodel = metamodel
        self._store = store
        self.class_indexes = {cls.name: index for index, cls in enumerate(classes)}
        self.concrete_class_indexes = {cls.name: index for index, cls in enumerate(classes) if not cls.abstract}
        self.class_extents = _make_table(len(classes), self._extents_of)
        self.initial_values = _make_table(len(classes), self._initials_of)
        self.allows_attribute = tuple(metamodel.instance_flags(attribute.owner) for attribute in metamodel.attributes)
        self.value_types: tuple[type, ...] = tuple(
            str if isinstance(a.type, EnumType) else _PYTHON_TYPES[a.type] for a in metamodel.attributes
        )
        # The Python type alone does not validate NaN, strings that are not literals of an enum, or sequences of values.
        self.needs_value_check = tuple(
            a.many or isinstance(a.type, EnumType) or a.type is Scalar.FLOAT for a in metamodel.attributes
        )
        self.containment_relations = _make_table(len(classes), self._containments_of)
        # The last row is for the class index -1 of deleted objects.
        self.container_relations = _make_table(len(classes) + 1, self._containers_of)
        self.incident_relations = _make_table(len(classes), self._incident_of)
        self._retyping_cache: dict[tuple[int, int], RetypingEffects] = {}

    def _extents_of(self, cls: int) -> tuple[Extent, ...]:
        name = self._metamodel.class_list[cls].name
        return tuple(self._store.extents[self.class_indexes[below]] for below in self._metamodel.concrete_classes(name))

    def _initials_of(self, cls: int) -> InitialValues:
        features = self._metamodel.features(self._metamodel.class_list[cls].name)
        return tuple((f.index, f.initial) for f in features.values() if isinstance(f, Attribute))

    def _containments_of(self, cls: int) -> tuple[ReferenceStorage, ...]:
        return tuple(r for r in self._store.relations if r.containment and r.allows_source[cls])

    def _containers_of(self, cls: int) -> tuple[ReferenceStorage, ...]:
        return tuple(r for r in self._store.relations if r.containment and r.allows_target[cls])

    def _incident_of(self, cls: int) -> tuple[tuple[ReferenceStorage, bool], ...]:
        """Return the relations of the links that objects of a class may have, with True as source and False as target.

        A reference with an opposite is listed as source only, because its opposite is listed for the other end.
        """
        found = []
        for relation in self._store.relations:
            if relation.allows_source[cls]:
                found.append((relation, True))
            if relation.opposite is None and relation.allows_target[cls]:
                found.append((relation, False))
        return tuple(found)

    def retyping_effects(self, old: int, new: int) -> RetypingEffects:
        """Return the effects of a change from class `old` to class `new`. The result is cached.

        Returns:
            The indexes of lost attributes; pairs of an added attribute's index and initial value; pairs of a relation
            whose links the new class does not allow, and True for links with the object as source, False as target.
        """
        found = self._retyping_cache.get((old, new))
        if found is None:
            before = {attribute for attribute, _ in self.initial_values[old]}
            after = {attribute for attribute, _ in self.initial_values[new]}
            found = (
                tuple(attribute for attribute, _ in self.initial_values[old] if attribute not in after),
                tuple(
                    (attribute, initial) for attribute, initial in self.initial_values[new] if attribute not in before
                ),
                tuple(end for end in self.incident_relations[old] if end not in self.incident_relations[new]),
            )
            self._retyping_cache[old, new] = found
        return found
