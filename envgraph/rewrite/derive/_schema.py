"""A metamodel as derived operators see it: which links there may be, who contains whom, what is left alone."""

from __future__ import annotations

from collections.abc import Iterable

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, reached
from envgraph.pattern import Aggregate, Comparison, Constant, Edge, PathConstraint, Variable

LEFT_ALONE = ("frozen", "derived")
"""Annotations of features that no derived operator changes."""


@dataclass(frozen=True, slots=True)
class Association:
    """The links of a reference, which are also those of its opposite.

    Attributes:
        reference: of the two references of a pair the containing one, else the one that is declared first.
        opposite: the other one, or None.
        frozen: no operator adds or removes such a link.
    """

    reference: Reference
    opposite: Reference | None
    frozen: bool

    @property
    def symmetric(self) -> bool:
        """Whether the reference is its own opposite."""
        return self.opposite is not None and self.opposite.index == self.reference.index


@dataclass(frozen=True, slots=True)
class End:
    """An association from one of its ends: an object of class `near` has `lower..upper` links to objects of `far`."""

    association: Association
    forward: bool

    @property
    def reference(self) -> Reference:
        """The reference that stands in the rules."""
        return self.association.reference

    @property
    def name(self) -> str:
        """Name of the feature that holds the links at this end; of the one at the other end if there is none here."""
        opposite = self.association.opposite
        return self.reference.name if self.forward or opposite is None else opposite.name

    @property
    def held(self) -> bool:
        """Whether the links are a feature of the objects at this end."""
        return self.forward or self.association.opposite is not None

    @property
    def near(self) -> str:
        """Class of the objects at this end."""
        return self.reference.owner if self.forward else self.reference.target

    @property
    def far(self) -> str:
        """Class of the objects at the other end."""
        return self.reference.target if self.forward else self.reference.owner

    @property
    def lower(self) -> int:
        """How many links an object at this end needs."""
        feature = self.reference if self.forward else self.association.opposite
        return feature.lower if feature else 0

    @property
    def upper(self) -> int | None:
        """How many links an object at this end may have; None for any number."""
        feature = self.reference if self.forward else self.association.opposite
        if not self.forward and self.reference.containment:
            return 1
        return feature.upper if feature else None

    @property
    def contains(self) -> bool:
        """Whether the objects at this end contain those at the other."""
        return self.reference.containment and self.forward

    @property
    def contained(self) -> bool:
        """Whether the objects at the other end contain those at this one."""
        return self.reference.containment and not self.forward

    @property
    def flexible(self) -> bool:
        """Whether the number of links of one object may change."""
        return self.upper is None or self.lower < self.upper

    @property
    def other(self) -> End:
        """The same association from its other end."""
        return End(self.association, not self.forward)

    @property
    def both(self) -> End:
        """The end itself; of a symmetric reference, whose two ends are one, always the same."""
        return End(self.association, forward=True) if self.association.symmetric else self

    def edge(self, near: str, far: str) -> Edge:
        """The arrow between two variables."""
        return Edge(near, self.reference.name, far) if self.forward else Edge(far, self.reference.name, near)

    def path(self, near: str, far: str) -> PathConstraint:
        """`Class.reference(near, far)`."""
        ends = (near, far) if self.forward else (far, near)
        source, target = map(Variable, ends)
        return PathConstraint(self.reference.owner, (self.reference.name,), source, target)

    def count(self, near: str) -> Aggregate:
        """The number of links of an object."""
        return Aggregate("count", self.path(near, "_"))

    def counts_not(self, near: str, numbers: Iterable[int]) -> list[Comparison]:
        """The number of links of an object is none of these.

        In a valid model this says "more than `lower`" or "less than `upper`" without naming the number.
        """
        return [Comparison("!=", self.count(near), Constant(number)) for number in numbers]

    def room(self, near: str, links: int = 1) -> list[Comparison]:
        """An object may have so many links more."""
        return [] if self.upper is None else self.counts_not(near, range(self.upper, self.upper - links, -1))

    def spare(self, near: str, links: int = 1) -> list[Comparison]:
        """An object, which has them, may lose so many links."""
        return self.counts_not(near, range(self.lower, self.lower + links)) if self.lower else []


class Schema:
    """Everything about a metamodel that derivation asks for.

    Attributes:
        metamodel: the metamodel.
        associations: in the order of declaration.
        roots: concrete classes whose objects may stand outside of every container. They are those that nothing can
            contain but themselves and what they contain.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.associations = tuple(
            Association(reference, opposite, self._frozen_links(reference, opposite))
            for reference in metamodel.references
            for opposite in (metamodel.opposite(reference),)
            if _stands_for_both(reference, opposite)
        )
        self.ends = tuple(End(a, forward) for a in self.associations for forward in (True, False))
        self.concrete = tuple(cls.name for cls in metamodel.class_list if not cls.abstract)
        self.roots = self._roots()
        self._needs = {c: reached(self._needed_by(c), self._needed_by) for c in self.concrete}

    # --- classes

    def frozen(self, cls: str) -> bool:
        """Return whether operators leave the objects of a class alone: it or a supertype is frozen or needs values."""
        marked = any(self.metamodel.classes[above].frozen for above in self.metamodel.supertypes(cls))
        return marked or self.needs_values(cls)

    def needs_values(self, cls: str) -> bool:
        """Return whether an attribute with many needs some, which no operator can choose."""
        return any(_several(one) and one.lower for one in self.metamodel.features(cls).values())

    def frozen_below(self, cls: str) -> tuple[str, ...]:
        """The frozen classes among the concrete ones of a class, without the subclasses of others of them."""
        found = [sub for sub in self.metamodel.concrete(cls) if self.frozen(sub)]
        return tuple(sub for sub in found if not any(sub != o and self.metamodel.is_a(sub, o) for o in found))

    def is_a(self, cls: str, above: str) -> bool:
        """Return whether a class is the other or one of its subclasses."""
        return self.metamodel.is_a(cls, above)

    def ends_of(self, cls: str) -> list[End]:
        """The ends at which an object of exactly this class may stand; those of a symmetric reference are one."""
        return [end for end in self.ends if self.is_a(cls, end.near) and _counts(end)]

    def ends_over(self, cls: str) -> list[End]:
        """The ends at which some object of a class may stand."""
        return [end for end in self.ends if self.metamodel.overlap(cls, end.near) and _counts(end)]

    def containers(self, cls: str) -> list[End]:
        """The ends at which an object of exactly this class is contained."""
        return [end for end in self.ends_of(cls) if end.contained]

    def contents(self, classes: Iterable[str]) -> list[str]:
        """These concrete classes, and those of the objects that may be inside such objects, at any depth."""
        return reached(classes, self.metamodel.contents)

    def contains_any(self, cls: str) -> bool:
        """Return whether an object of exactly this class may contain something."""
        return any(end.contains for end in self.ends_of(cls))

    def coupled(self, cls: str, other: str) -> bool:
        """Return whether objects of the two classes need each other, directly or by way of others."""
        return other in self._needs[cls] and cls in self._needs[other]

    def holder(self, cls: str, feature: Feature) -> str:
        """The class itself if its objects have a feature, else the subclass that declares it."""
        return cls if self.is_a(cls, feature.owner) else feature.owner

    def features(self, cls: str) -> list[Feature]:
        """The features of a class, then those that its subclasses add."""
        classes = (cls, *self.metamodel.concrete(cls))
        found = {str(f): f for one in classes for f in self.metamodel.features(one).values()}
        return list(found.values())

    def left_alone(self, feature: Feature) -> bool:
        """Return whether operators leave a feature alone."""
        marked = any(annotation.name in LEFT_ALONE for annotation in feature.annotations)
        return marked or _several(feature) or self.frozen(feature.owner)

    def keyed(self, cls: str, attribute: Attribute) -> bool:
        """Return whether an attribute names the objects of a class or of one of its subclasses."""
        return any(attribute.name in self.metamodel.key(sub) for sub in self.metamodel.concrete(cls))

    # --- once

    def _frozen_links(self, reference: Reference, opposite: Reference | None) -> bool:
        return self.left_alone(reference) or (opposite is not None and self.left_alone(opposite))

    def _roots(self) -> frozenset[str]:
        inside = {cls: self.contents((cls,)) for cls in self.concrete}
        return frozenset(
            cls
            for cls in self.concrete
            if all(
                above in inside[cls]
                for end in self.containers(cls)
                for above in self.metamodel.concrete(end.far)
            )
        )

    def _needed_by(self, cls: str) -> list[str]:
        return [sub for end in self.ends_of(cls) if end.lower for sub in self.metamodel.concrete(end.far)]


def _stands_for_both(reference: Reference, opposite: Reference | None) -> bool:
    if opposite is None:
        return True
    if reference.containment != opposite.containment:
        return reference.containment
    return reference.index <= opposite.index


def _counts(end: End) -> bool:
    return end.forward or not end.association.symmetric


def _several(feature: Feature) -> bool:
    return isinstance(feature, Attribute) and feature.many
