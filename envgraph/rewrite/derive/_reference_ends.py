"""A view of a metamodel for derivation: both ends of references, containments, frozen classes and features."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Generic, NamedTuple, TypeVar

from envgraph.code import dataclass
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, reachable_nodes
from envgraph.pattern import Aggregate, Comparison, Constant, PathConstraint, RuleEdge, Variable

UNCHANGED_ANNOTATIONS = ("frozen", "derived")
"""Annotations that keep derived operators from changing a feature."""


@dataclass(frozen=True, slots=True)
class ReferenceEnd:
    """An end of a pair of opposite references: objects of class `near_class` have `lower..upper` links to objects of
    `far_class`.

    Attributes:
        reference: the containment of the pair, or else the reference that is declared first.
        opposite: the opposite reference, or None.
        is_frozen: True if no operator adds or removes links of this pair.
        forward: True if `reference` starts at this end. A reference that is its own opposite has only this end.
    """

    reference: Reference
    opposite: Reference | None
    is_frozen: bool
    forward: bool = True

    @property
    def opposite_end(self) -> ReferenceEnd:
        """Return the opposite end of the same links, which is this end itself if the reference is its own opposite."""
        return self if self.is_symmetric else replace(self, forward=not self.forward)

    @property
    def is_symmetric(self) -> bool:
        """Return True if the reference is its own opposite."""
        return self.opposite is not None and self.opposite.index == self.reference.index

    @property
    def feature(self) -> Reference | None:
        """Return the feature that holds the links at this end, or None if this end has no feature."""
        return self.reference if self.forward else self.opposite

    @property
    def name(self) -> str:
        """Return the name of the feature at this end, or of the feature at the other end if this end has none."""
        return (self.feature or self.reference).name

    @property
    def near_class(self) -> str:
        """Return the class of the objects at this end."""
        return self.reference.owner if self.forward else self.reference.target

    @property
    def far_class(self) -> str:
        """Return the class of the objects at the other end."""
        return self.reference.target if self.forward else self.reference.owner

    @property
    def lower(self) -> int:
        """Return the minimal number of links of an object at this end."""
        return self.feature.lower if self.feature else 0

    @property
    def upper(self) -> int | None:
        """Return the maximal number of links of an object at this end; None means unlimited."""
        if self.is_contained:
            return 1
        return self.feature.upper if self.feature else None

    @property
    def is_container(self) -> bool:
        """Return True if the objects at this end contain the objects at the other end."""
        return self.reference.containment and self.forward

    @property
    def is_contained(self) -> bool:
        """Return True if the objects at the other end contain the objects at this end."""
        return self.reference.containment and not self.forward

    @property
    def holds_links(self) -> bool:
        """Return True if objects at this end own the links: they have a feature for them or are contained by them."""
        return self.feature is not None or self.is_contained

    @property
    def is_flexible(self) -> bool:
        """Return True if the number of links of an object at this end may vary, because the bounds differ."""
        return self.upper is None or self.lower < self.upper

    def edge(self, near: str, far: str) -> RuleEdge:
        """Return the edge, in rule syntax, for a link between the variables `near` (at this end) and `far`."""
        return RuleEdge(near, self.reference.name, far) if self.forward else RuleEdge(far, self.reference.name, near)

    def path(self, near: str, far: str = "_") -> PathConstraint:
        """Return the path constraint `Class.reference(source, target)` between `near` (at this end) and `far`."""
        source, target = (near, far) if self.forward else (far, near)
        return PathConstraint(self.reference.owner, (self.reference.name,), Variable(source), Variable(target))

    def count_links(self, near: str) -> Aggregate:
        """Return an aggregate that counts the links of an object at this end."""
        return Aggregate("count", self.path(near))

    def has_only_needed(self, near: str) -> Comparison:
        """Return a comparison that holds if an object has exactly the minimal number of links at this end."""
        return Comparison("==", self.count_links(near), Constant(self.lower))

    def allows_change(self, near: str, more: int) -> list[Comparison]:
        """Return comparisons that hold if the number of links of an object may grow by `more`, which may be negative.

        In a valid model the number is in `lower..upper`, so the comparisons exclude only numbers near one bound.
        """
        if more < 0:
            numbers = range(self.lower, self.lower - more) if self.lower else range(0)
        else:
            numbers = range(0) if self.upper is None else range(self.upper, self.upper - more, -1)
        return [Comparison("!=", self.count_links(near), Constant(number)) for number in numbers]


Object = TypeVar("Object", int, str)


class LinkChange(NamedTuple, Generic[Object]):
    """A link to add (sign 1) or to remove (sign -1), between the object `near` at an end and the object `far`."""

    sign: int
    end: ReferenceEnd
    near: Object
    far: Object


class Schema:
    """A metamodel prepared for derivation.

    Attributes:
        metamodel: the metamodel.
        ends: both ends of each association, in the order of declaration.
        concrete: the classes that are not abstract.
        roots: concrete classes whose objects need no container: only objects of the same class, or objects that they
            contain themselves, could contain them.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.is_a = metamodel.is_a
        self.overlap = metamodel.may_overlap
        self.frozen, self.ends_of = cache(self._is_frozen), cache(self._ends_of)
        self.contents = cache(self._contents)
        self._directly_inside = cache(metamodel.content_classes)
        self.ends = tuple(end for reference in metamodel.references for end in self._ends(reference))
        self.concrete = tuple(cls.name for cls in metamodel.class_list if not cls.abstract)
        self.roots = frozenset(filter(self._is_root, self.concrete))
        self._needs = {c: reachable_nodes(self._needed_by(c), self._needed_by) for c in self.concrete}

    def _is_frozen(self, cls: str) -> bool:
        """Return True if operators may not change objects of a class: it or a supertype is frozen or needs values."""
        marked = any(self.metamodel.classes[above].frozen for above in self.metamodel.supertypes(cls))
        return marked or self.needs_values(cls)

    def needs_values(self, cls: str) -> bool:
        """Return True if a multi-valued attribute of the class has a lower bound above 0: operators cannot fill it."""
        return any(_is_multi_valued(one) and one.lower for one in self.metamodel.features(cls).values())

    def frozen_below(self, cls: str) -> tuple[str, ...]:
        """Return the frozen classes among the concrete subclasses of a class (or itself), without their subclasses."""
        found = [sub for sub in self.metamodel.concrete_classes(cls) if self.frozen(sub)]
        return tuple(sub for sub in found if not any(sub != o and self.is_a(sub, o) for o in found))

    def is_left_unchanged(self, feature: Feature) -> bool:
        """Return True if operators do not change a feature: it is frozen or derived, or is a multi-valued attribute.

        Features of frozen classes are not changed either.
        """
        marked = any(annotation.name in UNCHANGED_ANNOTATIONS for annotation in feature.annotations)
        return marked or _is_multi_valued(feature) or self.frozen(feature.owner)

    def _ends_of(self, cls: str) -> list[ReferenceEnd]:
        """Return the ends at which objects of exactly this class may have links."""
        return [end for end in self.ends if self.is_a(cls, end.near_class)]

    def containers(self, cls: str) -> list[ReferenceEnd]:
        """Return the ends at which objects of exactly this class are contained."""
        return [end for end in self.ends_of(cls) if end.is_contained]

    def _contents(self, cls: str) -> list[ReferenceEnd]:
        """Return the ends at which objects of a class, or objects that they contain at any depth, contain others."""
        inside = reachable_nodes(self.metamodel.concrete_classes(cls), self._directly_inside)
        return [end for end in self.ends if end.is_container and any(self.is_a(one, end.near_class) for one in inside)]

    def need_each_other(self, cls: str, other: str) -> bool:
        """Return True if objects of the two classes need each other, directly or through other classes."""
        return other in self._needs[cls] and cls in self._needs[other]

    def holder(self, cls: str, feature: Feature) -> str:
        """Return the class itself if its objects have a feature, else the subclass that declares the feature."""
        return cls if self.is_a(cls, feature.owner) else feature.owner

    def features(self, cls: str) -> list[Feature]:
        """Return the features of a class, followed by the features that its subclasses add."""
        classes = (cls, *self.metamodel.concrete_classes(cls))
        return list({str(f): f for one in classes for f in self.metamodel.features(one).values()}.values())

    def _ends(self, reference: Reference) -> Iterable[ReferenceEnd]:
        opposite = self.metamodel.opposite(reference)
        pair = [reference] if opposite is None else [reference, opposite]
        if min(pair, key=lambda one: (not one.containment, one.index)) != reference:
            return ()
        end = ReferenceEnd(reference, opposite, any(map(self.is_left_unchanged, pair)))
        return dict.fromkeys((end, end.opposite_end))

    def _is_root(self, cls: str) -> bool:
        inside = reachable_nodes((cls,), self._directly_inside)
        above = (one for end in self.containers(cls) for one in self.metamodel.concrete_classes(end.far_class))
        return all(one in inside for one in above)

    def _needed_by(self, cls: str) -> Iterator[str]:
        """Yield the classes to which objects of a class need links, and its container class if only one is possible."""
        for end in self.ends_of(cls):
            if end.lower:
                yield from self.metamodel.concrete_classes(end.far_class)
        around = dict.fromkeys(
            one for end in self.containers(cls) for one in self.metamodel.concrete_classes(end.far_class)
        )
        if cls not in self.roots and len(around) == 1:
            yield from around


def _is_multi_valued(feature: Feature) -> bool:
    return isinstance(feature, Attribute) and feature.many
