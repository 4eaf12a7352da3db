"""A metamodel as derived operators see it: the ends of its references, who contains whom, what is left alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Generic, NamedTuple, TypeVar

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, reached
from envgraph.pattern import Aggregate, Comparison, Constant, Edge, PathConstraint, Variable

LEFT_ALONE = ("frozen", "derived")
"""Annotations of features that no derived operator changes."""


@dataclass(frozen=True, slots=True)
class End:
    """A reference and its opposite from one end: an object of class `near` has `lower..upper` links to such of `far`.

    Attributes:
        reference: of the two references of a pair the containing one, else the one that is declared first.
        opposite: the other one, or None.
        frozen: no operator adds or removes such a link.
        forward: the reference starts at this end. One that is its own opposite has this end alone.
    """

    reference: Reference
    opposite: Reference | None
    frozen: bool
    forward: bool = True

    @property
    def other(self) -> End:
        """The same links from their other end."""
        return self if self.symmetric else replace(self, forward=not self.forward)

    @property
    def symmetric(self) -> bool:
        """Whether the reference is its own opposite."""
        return self.opposite is not None and self.opposite.index == self.reference.index

    @property
    def feature(self) -> Reference | None:
        """The feature that holds the links at this end, if there is one."""
        return self.reference if self.forward else self.opposite

    @property
    def name(self) -> str:
        """Name of the feature that holds the links at this end; of the one at the other end if there is none here."""
        return (self.feature or self.reference).name

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
        return self.feature.lower if self.feature else 0

    @property
    def upper(self) -> int | None:
        """How many links an object at this end may have; None for any number."""
        if self.contained:
            return 1
        return self.feature.upper if self.feature else None

    @property
    def contains(self) -> bool:
        """Whether the objects at this end contain those at the other."""
        return self.reference.containment and self.forward

    @property
    def contained(self) -> bool:
        """Whether the objects at the other end contain those at this one."""
        return self.reference.containment and not self.forward

    @property
    def held(self) -> bool:
        """Whether the links belong to the objects at this end."""
        return self.feature is not None or self.contained

    @property
    def flexible(self) -> bool:
        """Whether the number of links of one object may change."""
        return self.upper is None or self.lower < self.upper

    def edge(self, near: str, far: str) -> Edge:
        """The arrow between two variables."""
        return Edge(near, self.reference.name, far) if self.forward else Edge(far, self.reference.name, near)

    def path(self, near: str, far: str = "_") -> PathConstraint:
        """`Class.reference(near, far)`."""
        source, target = (near, far) if self.forward else (far, near)
        return PathConstraint(
            self.reference.owner, (self.reference.name,), Variable(source), Variable(target)
        )

    def count(self, near: str) -> Aggregate:
        """The number of links of an object."""
        return Aggregate("count", self.path(near))

    def least(self, near: str) -> Comparison:
        """An object has no link that it can spare."""
        return Comparison("==", self.count(near), Constant(self.lower))

    def allows(self, near: str, more: int) -> list[Comparison]:
        """An object may have so many links more, or so many less if negative.

        In a valid model it has `lower..upper` of them, so that it has no number near the end of this range says it.
        """
        if more < 0:
            numbers = range(self.lower, self.lower - more) if self.lower else range(0)
        else:
            numbers = range(0) if self.upper is None else range(self.upper, self.upper - more, -1)
        return [Comparison("!=", self.count(near), Constant(number)) for number in numbers]


Object = TypeVar("Object", int, str)


class Link(NamedTuple, Generic[Object]):
    """A link that is added (sign 1) or removed (-1) between the object at an end and the one at its other end."""

    sign: int
    end: End
    near: Object
    far: Object


class Schema:
    """Everything about a metamodel that derivation asks for.

    Attributes:
        metamodel: the metamodel.
        ends: both ends of each association, in the order of declaration.
        concrete: the classes that have objects.
        roots: concrete classes whose objects may stand outside of every container. They are those that nothing can
            contain but themselves and what they contain.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.is_a = metamodel.is_a
        self.overlap = metamodel.overlap
        self.frozen, self.ends_of = cache(self._frozen), cache(self._ends_of)
        self.contents = cache(self._contents)
        self._directly_inside = cache(metamodel.contents)
        self.ends = tuple(end for reference in metamodel.references for end in self._ends(reference))
        self.concrete = tuple(cls.name for cls in metamodel.class_list if not cls.abstract)
        self.roots = frozenset(filter(self._root, self.concrete))
        self._needs = {c: reached(self._needed_by(c), self._needed_by) for c in self.concrete}

    def _frozen(self, cls: str) -> bool:
        """Return whether operators leave the objects of a class alone: it or a supertype is frozen or needs values."""
        marked = any(self.metamodel.classes[above].frozen for above in self.metamodel.supertypes(cls))
        return marked or self.needs_values(cls)

    def needs_values(self, cls: str) -> bool:
        """Return whether an attribute with many needs some, which no operator can choose."""
        return any(_several(one) and one.lower for one in self.metamodel.features(cls).values())

    def frozen_below(self, cls: str) -> tuple[str, ...]:
        """The frozen classes among the concrete ones of a class, without the subclasses of others of them."""
        found = [sub for sub in self.metamodel.concrete(cls) if self.frozen(sub)]
        return tuple(sub for sub in found if not any(sub != o and self.is_a(sub, o) for o in found))

    def left_alone(self, feature: Feature) -> bool:
        """Return whether operators leave a feature alone."""
        marked = any(annotation.name in LEFT_ALONE for annotation in feature.annotations)
        return marked or _several(feature) or self.frozen(feature.owner)

    def _ends_of(self, cls: str) -> list[End]:
        """The ends at which an object of exactly this class may stand."""
        return [end for end in self.ends if self.is_a(cls, end.near)]

    def containers(self, cls: str) -> list[End]:
        """The ends at which an object of exactly this class is contained."""
        return [end for end in self.ends_of(cls) if end.contained]

    def _contents(self, cls: str) -> list[End]:
        """The ends of the containers that may be an object of a class or inside it."""
        inside = reached(self.metamodel.concrete(cls), self._directly_inside)
        return [end for end in self.ends if end.contains and any(self.is_a(one, end.near) for one in inside)]

    def coupled(self, cls: str, other: str) -> bool:
        """Return whether objects of the two classes need each other, directly or by way of others."""
        return other in self._needs[cls] and cls in self._needs[other]

    def holder(self, cls: str, feature: Feature) -> str:
        """The class itself if its objects have a feature, else the subclass that declares it."""
        return cls if self.is_a(cls, feature.owner) else feature.owner

    def features(self, cls: str) -> list[Feature]:
        """The features of a class, then those that its subclasses add."""
        classes = (cls, *self.metamodel.concrete(cls))
        return list({str(f): f for one in classes for f in self.metamodel.features(one).values()}.values())

    def _ends(self, reference: Reference) -> Iterable[End]:
        opposite = self.metamodel.opposite(reference)
        pair = [reference] if opposite is None else [reference, opposite]
        if min(pair, key=lambda one: (not one.containment, one.index)) != reference:
            return ()
        end = End(reference, opposite, any(map(self.left_alone, pair)))
        return dict.fromkeys((end, end.other))

    def _root(self, cls: str) -> bool:
        inside = reached((cls,), self._directly_inside)
        above = (one for end in self.containers(cls) for one in self.metamodel.concrete(end.far))
        return all(one in inside for one in above)

    def _needed_by(self, cls: str) -> Iterator[str]:
        """The classes that multiplicities demand, and the one container of what is nowhere else."""
        for end in self.ends_of(cls):
            if end.lower:
                yield from self.metamodel.concrete(end.far)
        around = dict.fromkeys(
            one for end in self.containers(cls) for one in self.metamodel.concrete(end.far)
        )
        if cls not in self.roots and len(around) == 1:
            yield from around


def _several(feature: Feature) -> bool:
    return isinstance(feature, Attribute) and feature.many
