"""What follows from a metamodel for the hot paths of a model, in tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from envgraph.graph._store import Relation, Store
from envgraph.metamodel import Attribute, EnumType, Metamodel, Scalar, Value

_KINDS: Mapping[Scalar, type] = {Scalar.INT: int, Scalar.FLOAT: float, Scalar.BOOL: bool, Scalar.STRING: str}

Retyping = tuple[tuple[int, ...], tuple[tuple[int, Value], ...], tuple[tuple[Relation, bool], ...]]


class Layout:
    """What follows from the metamodel, in tables for the hot paths; class and feature numbers are indexes."""

    def __init__(self, metamodel: Metamodel, store: Store) -> None:
        classes = metamodel.class_list
        self.numbers = {cls.name: index for index, cls in enumerate(classes)}
        self.concrete = {cls.name: index for index, cls in enumerate(classes) if not cls.abstract}
        self.extents = {
            cls.name: tuple(store.extents[self.numbers[name]] for name in metamodel.concrete(cls.name))
            for cls in classes
        }
        self.initials = tuple(
            tuple(
                (f.index, f.initial)
                for f in metamodel.features(cls.name).values()
                if isinstance(f, Attribute)
            )
            for cls in classes
        )
        self.attribute_ok = tuple(
            (*(metamodel.is_a(cls.name, attribute.owner) for cls in classes), False)
            for attribute in metamodel.attributes
        )
        self.kinds: tuple[type, ...] = tuple(
            str if isinstance(a.type, EnumType) else _KINDS[a.type] for a in metamodel.attributes
        )
        # The type of the value does not tell everything: NaN, or a string that is no literal.
        self.checked = tuple(
            isinstance(a.type, EnumType) or a.type is Scalar.FLOAT for a in metamodel.attributes
        )
        self.containments = tuple(
            tuple(r for r in store.relations if r.containment and r.source_ok[index])
            for index in range(len(classes))
        )
        self.containers = (
            *(
                tuple(r for r in store.relations if r.containment and r.target_ok[index])
                for index in range(len(classes))
            ),
            (),
        )
        self.incident = tuple(tuple(_incident(store, index)) for index in range(len(classes)))
        self._retypings: dict[tuple[int, int], Retyping] = {}

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


def _incident(store: Store, cls: int) -> Iterator[tuple[Relation, bool]]:
    """The relations that objects of a class take part in; True as source, False as target."""
    for relation in store.relations:
        if relation.source_ok[cls]:
            yield relation, True
        if relation.opposite is None and relation.target_ok[cls]:
            yield relation, False
