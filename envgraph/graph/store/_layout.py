"""Lookup tables computed from a metamodel, for the hot paths of a model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from envgraph.graph.store._journal import Extent
from envgraph.graph.store._relation import Relation
from envgraph.graph.store._store import Store
from envgraph.metamodel import Attribute, EnumType, Metamodel, Scalar, Value, Values

_KINDS: Mapping[Scalar, type] = {Scalar.INT: int, Scalar.FLOAT: float, Scalar.BOOL: bool, Scalar.STRING: str}

Initials = tuple[tuple[int, Value | Values], ...]
Retyping = tuple[tuple[int, ...], Initials, tuple[tuple[Relation, bool], ...]]


T = TypeVar("T")

_FEW: Final = 256
"""Metamodels with at most this many classes have full tables, computed at once."""


class _Rows(dict[int, T]):
    """A table whose rows are computed on first access, because a whole table is quadratic in the number of classes."""

    def __init__(self, make: Callable[[int], T]) -> None:
        self._make = make

    def __missing__(self, index: int) -> T:
        row = self[index] = self._make(index)
        return row


Rows = tuple[T, ...] | _Rows[T]


def _rows(count: int, make: Callable[[int], T]) -> Rows[T]:
    return tuple(map(make, range(count))) if count <= _FEW else _Rows(make)


class Layout:
    """Lookup tables of a metamodel, indexed by the numbers of classes and attributes, for the hot paths of a model."""

    def __init__(self, metamodel: Metamodel, store: Store) -> None:
        classes = metamodel.class_list
        self._metamodel = metamodel
        self._store = store
        self.numbers = {cls.name: index for index, cls in enumerate(classes)}
        self.concrete = {cls.name: index for index, cls in enumerate(classes) if not cls.abstract}
        self.extents = _rows(len(classes), self._extents)
        self.initials = _rows(len(classes), self._initials)
        self.attribute_ok = tuple(metamodel.instances(attribute.owner) for attribute in metamodel.attributes)
        self.kinds: tuple[type, ...] = tuple(
            str if isinstance(a.type, EnumType) else _KINDS[a.type] for a in metamodel.attributes
        )
        # The Python type alone does not validate NaN, strings that are not literals of an enum, or sequences of values.
        self.checked = tuple(
            a.many or isinstance(a.type, EnumType) or a.type is Scalar.FLOAT for a in metamodel.attributes
        )
        self.containments = _rows(len(classes), self._containments)
        # The last row is for the class index -1 of deleted objects.
        self.containers = _rows(len(classes) + 1, self._containers)
        self.incident = _rows(len(classes), self._incident)
        self._retypings: dict[tuple[int, int], Retyping] = {}

    def _extents(self, cls: int) -> tuple[Extent, ...]:
        name = self._metamodel.class_list[cls].name
        return tuple(self._store.extents[self.numbers[below]] for below in self._metamodel.concrete(name))

    def _initials(self, cls: int) -> Initials:
        features = self._metamodel.features(self._metamodel.class_list[cls].name)
        return tuple((f.index, f.initial) for f in features.values() if isinstance(f, Attribute))

    def _containments(self, cls: int) -> tuple[Relation, ...]:
        return tuple(r for r in self._store.relations if r.containment and r.source_ok[cls])

    def _containers(self, cls: int) -> tuple[Relation, ...]:
        return tuple(r for r in self._store.relations if r.containment and r.target_ok[cls])

    def _incident(self, cls: int) -> tuple[tuple[Relation, bool], ...]:
        """Return the relations of the links that objects of a class may have, with True as source and False as target.

        A reference with an opposite is listed as source only, because its opposite is listed for the other end.
        """
        found = []
        for relation in self._store.relations:
            if relation.source_ok[cls]:
                found.append((relation, True))
            if relation.opposite is None and relation.target_ok[cls]:
                found.append((relation, False))
        return tuple(found)

    def retyping(self, old: int, new: int) -> Retyping:
        """Return the effects of a change from class `old` to class `new`. The result is cached.

        Returns:
            The indexes of lost attributes; pairs of an added attribute's index and initial value; pairs of a relation
            whose links the new class does not allow, and True for links with the object as source, False as target.
        """
        found = self._retypings.get((old, new))
        if found is None:
            before = {attribute for attribute, _ in self.initials[old]}
            after = {attribute for attribute, _ in self.initials[new]}
            found = (
                tuple(attribute for attribute, _ in self.initials[old] if attribute not in after),
                tuple(
                    (attribute, initial)
                    for attribute, initial in self.initials[new]
                    if attribute not in before
                ),
                tuple(end for end in self.incident[old] if end not in self.incident[new]),
            )
            self._retypings[old, new] = found
        return found
