"""Tables of what follows from a metamodel, for the hot paths of a model."""

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
"""Up to so many classes, a table has a row for each from the beginning."""


class _Rows(dict[int, T]):
    """A table whose rows are made when they are read: all together may be the square of the classes."""

    def __init__(self, make: Callable[[int], T]) -> None:
        self._make = make

    def __missing__(self, index: int) -> T:
        row = self[index] = self._make(index)
        return row


Rows = tuple[T, ...] | _Rows[T]


def _rows(count: int, make: Callable[[int], T]) -> Rows[T]:
    return tuple(map(make, range(count))) if count <= _FEW else _Rows(make)


class Layout:
    """What follows from the metamodel, in tables for the hot paths; class and feature numbers are indexes."""

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
        # The type of the value does not tell everything: NaN, a string that is no literal, or many values.
        self.checked = tuple(
            a.many or isinstance(a.type, EnumType) or a.type is Scalar.FLOAT for a in metamodel.attributes
        )
        self.containments = _rows(len(classes), self._containments)
        # One more, for objects that are gone.
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
        """The relations that objects of a class take part in; True as source, False as target."""
        found = []
        for relation in self._store.relations:
            if relation.source_ok[cls]:
                found.append((relation, True))
            if relation.opposite is None and relation.target_ok[cls]:
                found.append((relation, False))
        return tuple(found)

    def retyping(self, old: int, new: int) -> Retyping:
        """Attributes that go, attributes that come with their values, and links that must not be there."""
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
