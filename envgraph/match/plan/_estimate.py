"""Sizes that the metamodel suggests.

Plans must not depend on live statistics: the order of rows would follow what happened to be in the model when a
plan was made. So the planner works with what classes and multiplicities tell.
"""

from __future__ import annotations

from envgraph.metamodel import Attribute, Metamodel, Reference

MANY = 10.0
"""Links of a many-valued reference."""
PARTS = 50.0
"""Objects in a many-valued containment reference."""
UNKNOWN = 100.0
"""Objects of a class that nothing contains and that contains nothing."""
DEEPEST = 4
"""Levels of containment that are followed upward."""


class Sizes:
    """Estimated sizes of extents and of the two ends of references."""

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._exact: dict[str, float] = {}
        self._extents: dict[str, float] = {}

    def extent(self, cls: str) -> float:
        """Objects of a class and its subclasses.

        A class that owns others and is owned by none is the root of the model, of which there is one; the others
        are as many as their owners hold, shared equally among the classes that can stand there.
        """
        if cls not in self._extents:
            self._extents[cls] = sum(self.exact_extent(name) for name in self._metamodel.concrete(cls))
        return self._extents[cls]

    def exact_extent(self, cls: str) -> float:
        """Objects of exactly this class."""
        if cls not in self._exact:
            self._exact[cls] = self._estimate(cls, ())
        return self._exact[cls]

    def _estimate(self, cls: str, inside: tuple[str, ...]) -> float:
        metamodel = self._metamodel
        if cls in inside or len(inside) > DEEPEST:
            return 0.0  # a containment cycle: count what enters it from outside
        owners = [r for r in metamodel.references if r.containment and metamodel.is_a(cls, r.target)]
        if not owners:
            features = metamodel.features(cls).values()
            return 1.0 if any(isinstance(f, Reference) and f.containment for f in features) else UNKNOWN
        size = 0.0
        for reference in owners:
            held = PARTS if reference.upper is None else min(float(reference.upper), PARTS)
            shared = len(metamodel.concrete(reference.target))
            for owner in metamodel.concrete(reference.owner):
                size += self._estimate(owner, (*inside, cls)) * held / shared
        return min(max(size, 1.0), 10_000.0) if size else (0.0 if inside else UNKNOWN)

    def forward(self, reference: Reference | Attribute) -> float:
        """Targets of an object, or its values of an attribute with many."""
        if reference.many:
            return MANY if reference.upper is None else min(float(reference.upper), MANY)
        return 1.0 if reference.lower else 0.9

    def backward(self, reference: Reference | Attribute) -> float:
        """Sources of an object, or objects that have a value."""
        if isinstance(reference, Attribute):
            return max(self.extent(reference.owner) * self.link(reference), 1.0)
        opposite = self._metamodel.opposite(reference)
        if opposite is not None:
            return self.forward(opposite)
        if reference.containment:
            return 1.0
        ratio = (
            self.extent(reference.owner) * self.forward(reference) / max(self.extent(reference.target), 1.0)
        )
        return min(max(ratio, 0.1), MANY)

    def link(self, reference: Reference | Attribute) -> float:
        """The chance that two given objects are linked, or that an object has a given value among others."""
        if isinstance(reference, Attribute):
            return 0.2
        return min(self.forward(reference) / max(self.extent(reference.target), 1.0), 0.5)

    def single_source(self, reference: Reference | Attribute) -> bool:
        """Return whether an object has at most one source."""
        if isinstance(reference, Attribute):
            return False
        opposite = self._metamodel.opposite(reference)
        return reference.containment or (opposite is not None and not opposite.many)
