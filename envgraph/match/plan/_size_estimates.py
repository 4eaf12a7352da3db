"""Size estimates from the metamodel: multiplicities and containment.

Plans must not depend on live statistics, because the order of rows would then depend on the model at planning time.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

from envgraph.match._match_costs import PLAN
from envgraph.metamodel import Attribute, Metamodel, Reference, strong_components


class SizeEstimates:
    """Estimates, from the metamodel alone, of the number of objects of classes and of links of an object."""

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._exact: dict[str, float] = {}
        self._extents: dict[str, float] = {}

    def extent_size(self, cls: str) -> float:
        """Return the estimated number of objects of a class and its subclasses.

        A class that contains others and is not contained is the root of the model: one object. Contained classes have
        as many objects as their containers hold, in equal shares for the classes that the containment reference allows.
        A class that neither contains nor is contained has `PLAN.unknown` objects.
        """
        if cls not in self._extents:
            self._extents[cls] = sum(self.direct_extent_size(name) for name in self._metamodel.concrete_classes(cls))
        return self._extents[cls]

    def direct_extent_size(self, cls: str) -> float:
        """Return the estimated number of direct instances of a class, without those of subclasses."""
        if not self._exact:
            self._exact = _Populations(self._metamodel).sizes
        return self._exact[cls]

    def targets_per_source(self, reference: Reference | Attribute) -> float:
        """Return the estimated number of targets of an object, or of its values of a many-valued attribute."""
        if reference.many:
            return PLAN.many if reference.upper is None else min(float(reference.upper), PLAN.many)
        return 1.0 if reference.lower else 0.9

    def sources_per_target(self, reference: Reference | Attribute) -> float:
        """Return the estimated number of sources of a target object, or of objects with a given attribute value."""
        if isinstance(reference, Attribute):
            return max(self.extent_size(reference.owner) * self.link_probability(reference), 1.0)
        opposite = self._metamodel.opposite(reference)
        if opposite is not None:
            return self.targets_per_source(opposite)
        if reference.containment:
            return 1.0
        ratio = (
            self.extent_size(reference.owner)
            * self.targets_per_source(reference)
            / max(self.extent_size(reference.target), 1.0)
        )
        return min(max(ratio, 0.1), PLAN.many)

    def link_probability(self, reference: Reference | Attribute) -> float:
        """Return the estimated probability that two objects are linked, or that an attribute contains a value."""
        if isinstance(reference, Attribute):
            return 0.2
        return min(self.targets_per_source(reference) / max(self.extent_size(reference.target), 1.0), 0.5)

    def single_source(self, reference: Reference | Attribute) -> bool:
        """Return True if at most one object can link to a target by this reference; False for an attribute."""
        return isinstance(reference, Reference) and self._metamodel.max_sources(reference) == 1


class _Populations:
    """An estimate of the number of direct instances of each concrete class, computed from containers to contents.

    Classes that can contain each other form a component, estimated in waves: first the classes that a class outside can
    contain, then those that the first wave can contain, and so on. References to this or an earlier wave add nothing.

    Attributes:
        sizes: the estimates, by class.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._into: defaultdict[str, list[Reference]] = defaultdict(list)
        self._below: defaultdict[str, list[str]] = defaultdict(list)
        self._held: defaultdict[str, float] = defaultdict(float)  # objects by class, in containers so far
        owners, parts = set[str](), set[str]()
        for reference in metamodel.references:
            if reference.containment:
                self._into[reference.target].append(reference)
                owners.update(metamodel.concrete_classes(reference.owner))
                parts.update(metamodel.concrete_classes(reference.target))
        for cls in metamodel.class_list:
            for above in cls.supertypes:
                self._below[above].append(cls.name)
        concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
        roots = [name for name in concrete if name not in parts]
        self.sizes = {name: 1.0 if name in owners else PLAN.unknown for name in roots}
        for nodes, _ in strong_components([("exact", name) for name in concrete], self._containers):
            self._estimate(dict.fromkeys(nodes))
        self.sizes = dict.fromkeys(concrete, PLAN.unknown) | self.sizes  # the others contain only each other

    def _containers(self, node: tuple[str, str]) -> Iterator[tuple[str, str]]:
        """Yield the graph nodes one step from a class towards the classes that may contain its objects.

        A node is a kind and a class. A path leads from kind "exact" to supertypes ("part"), over a containment
        reference, and then to subclasses ("owner").
        """
        kind, name = node
        if kind == "exact":
            yield "part", name
        elif kind == "part":
            yield from (("owner", reference.owner) for reference in self._into[name])
            yield from (("part", above) for above in self._metamodel.classes[name].supertypes)
        else:
            if not self._metamodel.classes[name].abstract:
                yield "exact", name
            yield from (("owner", below) for below in self._below[name])

    def _estimate(self, nodes: Mapping[tuple[str, str], None]) -> None:
        """Estimate the classes among the graph nodes of a component, wave by wave, and store them in `sizes`."""
        left = [name for kind, name in nodes if kind == "exact" and name not in self.sizes]
        into = [reference for kind, name in nodes if kind == "part" for reference in self._into[name]]
        inner = [reference for reference in into if ("owner", reference.owner) in nodes]
        self._distribute(into, self.sizes)
        while wave := {
            name: min(max(self._held[name], 1.0), PLAN.most_contained) for name in left if name in self._held
        }:
            self.sizes.update(wave)
            left = [name for name in left if name not in wave]
            self._distribute(inner, wave)

    def _distribute(self, references: Iterable[Reference], owners: Mapping[str, float]) -> None:
        """Add the objects that the owners contain to the counts of the target classes, in equal shares."""
        shares: defaultdict[str, float] = defaultdict(float)
        for reference in references:
            held = PLAN.parts if reference.upper is None else min(float(reference.upper), PLAN.parts)
            known = (owners[name] for name in self._metamodel.concrete_classes(reference.owner) if name in owners)
            shares[reference.target] += held * sum(known)
        for target, size in shares.items():
            classes = self._metamodel.concrete_classes(target) if size else ()
            for name in classes:
                self._held[name] += size / len(classes)
