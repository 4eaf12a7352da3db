"""A checked set of classes and enums, with look-ups by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import compress, count
from typing import TYPE_CHECKING, Final, TypeVar

from envgraph.code import shorten_repr
from envgraph.errors import ResolutionError, has_errors, name_hint
from envgraph.metamodel._class_check import check_classes
from envgraph.metamodel._class_diagram import class_diagram
from envgraph.metamodel._features import Attribute, Class, EnumType, Feature, Package, Reference, simple_name
from envgraph.metamodel._inheritance import linearise, supertypes_first
from envgraph.metamodel._reachability import reachable_nodes

if TYPE_CHECKING:
    from envgraph.draw import Picture


LinkEnd = TypeVar("LinkEnd")
"""The source or target of a link, in any representation: an object, a slot, a name."""
SortableEnd = TypeVar("SortableEnd", int, str)
"""The source or target of a link, in a representation that can be sorted."""

_MAX_TUPLE_CLASSES: Final = 256
"""The maximum number of classes for which tables are tuples, which are faster to read but larger."""


_DIGITS: Final = bytes.maketrans(b"01", b"\0\1")


def _with_indices(classes: Iterable[Class]) -> tuple[Class, ...]:
    """Return copies of the classes with owner and index filled in for every feature."""
    counts = {Attribute: count(), Reference: count()}
    return tuple(
        replace(
            cls,
            features=tuple(replace(f, owner=cls.name, index=next(counts[type(f)])) for f in cls.features),
        )
        for cls in classes
    )


def _bit_bytes(number: int) -> bytes:
    """Return the bits of a number as a `bytes` object of zeros and ones, the lowest bit first."""
    return format(number, "b")[::-1].encode().translate(_DIGITS)


@shorten_repr
class Metamodel:
    """An immutable set of classes and enums whose names, supertypes, opposites and defaults have been checked.

    Args:
        name: name of the metamodel.
        classes: in the order that extents, reports and derived rules follow.
        enums: the enumerations.
        uri: the URI by which other files may import it (in Ecore its nsURI), or None.
        packages: the namespaces of other tools' files, the metamodel's own first; None for its own only.

    Raises:
        ResolutionError: an unknown or duplicate name, a cycle of supertypes, opposites that do not point at each
            other, or a default of the wrong type; lists all problems.
    """

    def __init__(
        self,
        name: str,
        classes: Iterable[Class],
        enums: Iterable[EnumType] = (),
        uri: str | None = None,
        packages: Iterable[Package] | None = None,
    ) -> None:
        self.name = name
        self.uri = uri
        self.packages = (Package("", uri or name, name),) if packages is None else tuple(packages)
        declared = _with_indices(classes)
        self.enum_types = tuple(enums)
        problems = check_classes(declared, self.enum_types)
        if has_errors(problems):
            raise ResolutionError(problems)
        self.class_list = declared
        self.classes: Mapping[str, Class] = {cls.name: cls for cls in declared}
        self.enums: Mapping[str, EnumType] = {enum.name: enum for enum in self.enum_types}
        self._order = {cls.name: place for place, cls in enumerate(declared)}
        # The positions of each class and its subclasses, as a bit set.
        self._kinds = {name: 1 << place for name, place in self._order.items()}
        for (below,) in reversed(supertypes_first(self.classes)):
            for above in self.classes[below].supertypes:
                self._kinds[above] |= self._kinds[below]
        self._instantiable = sum(1 << place for place, cls in enumerate(declared) if not cls.abstract)
        # These are computed on demand, because all together may grow with the square of the number of classes.
        self._supers: dict[str, tuple[str, ...]] = {}
        self._features: dict[str, Mapping[str, Feature]] = {}
        self._concrete: dict[str, tuple[str, ...]] = {}
        self._instances: dict[str, Sequence[int]] = {}
        self.attributes: tuple[Attribute, ...] = tuple(
            f for cls in declared for f in cls.features if isinstance(f, Attribute)
        )
        self.references: tuple[Reference, ...] = tuple(
            f for cls in declared for f in cls.features if isinstance(f, Reference)
        )

    def full_names(self, simple: str) -> Mapping[str, str]:
        """Return the full names of all classes and enums with a simple name, by the path of their package.

        >>> one, other = Class("a::Part", package="a"), Class("b::Part", package="b")
        >>> dict(Metamodel("m", [one, other, Class("Whole")]).full_names("Part"))
        {'a': 'a::Part', 'b': 'b::Part'}
        """
        return self._named.get(simple, {})

    def suggest_class(self, name: str) -> str | None:
        """Return a hint for an unknown class name: its full names in packages, or a similar name (None: no hint)."""
        known = [one for one in self.full_names(simple_name(name)).values() if one != name]
        if known:
            return "write " + " or ".join(f"`{one}`" for one in sorted(known))
        return name_hint(name, self.classes)

    @cached_property
    def _named(self) -> Mapping[str, Mapping[str, str]]:
        types: list[Class | EnumType] = [*self.class_list, *self.enum_types]
        found: dict[str, dict[str, str]] = {}
        for one in types:
            found.setdefault(simple_name(one.name), {})[one.package] = one.name
        return found

    def supertypes(self, name: str) -> tuple[str, ...]:
        """Return the class itself and all its supertypes, nearest first."""
        found = self._supers.get(name)
        if found is None:
            found = self._supers[self.classes[name].name] = linearise(name, self.classes)
        return found

    def concrete_classes(self, name: str) -> tuple[str, ...]:
        """Return the instantiable classes among a class and its subclasses, in the order of declaration."""
        found = self._concrete.get(name)
        if found is None:
            found = tuple(compress(self.classes, _bit_bytes(self._kinds[name] & self._instantiable)))
            self._concrete[name] = found
        return found

    def is_a(self, name: str, above: str) -> bool:
        """Return True if a class is equal to the class `above` or is one of its subclasses."""
        place = self._order[name]
        return bool(self._kinds.get(above, 0) >> place & 1)

    def instance_flags(self, name: str) -> Sequence[int]:
        """Return for each class, in the order of declaration, 1 if it is a subclass of `name` or equal to it, else 0.

        The sequence has a 0 at its end, so that index -1 stands for no class.
        """
        found = self._instances.get(name)
        if found is None:
            table = _bit_bytes(self._kinds[name]).ljust(len(self.class_list) + 1, b"\0")
            # A tuple is faster to read, but needs eight times the memory.
            found = tuple(table) if len(table) <= _MAX_TUPLE_CLASSES else table
            self._instances[name] = found
        return found

    def covers(self, cls: str, other: str) -> bool:
        """Return True if every object of class `other` is also an object of `cls`, judging by concrete subclasses."""
        return set(self.concrete_classes(other)) <= set(self.concrete_classes(cls))

    def may_overlap(self, one: str, other: str) -> bool:
        """Return True if an object can be an instance of both classes."""
        return bool(self._kinds[one] & self._kinds[other] & self._instantiable)

    def content_classes(self, name: str) -> list[str]:
        """Return the concrete classes of objects that an object of exactly this class may directly contain."""
        held = (one for one in self.features(name).values() if isinstance(one, Reference) and one.containment)
        return list(dict.fromkeys(cls for one in held for cls in self.concrete_classes(one.target)))

    def all_content_classes(self, names: Iterable[str]) -> list[str]:
        """Return the concrete classes of objects that objects of exactly these classes may contain, at any depth."""
        return reachable_nodes((one for name in names for one in self.content_classes(name)), self.content_classes)

    def features(self, name: str) -> Mapping[str, Feature]:
        """Return all features of a class by name, inherited ones first."""
        found = self._features.get(name)
        return self._compute_features(name) if found is None else found

    def _compute_features(self, name: str) -> Mapping[str, Feature]:
        """Compute the features of a class; a class that adds none to its only supertype shares the latter's mapping."""
        same = [name]
        while not self.classes[same[-1]].features and len(self.classes[same[-1]].supertypes) == 1:
            same.append(self.classes[same[-1]].supertypes[0])
        found = self._features.get(same[-1])
        if found is None:
            supers = reversed(self.supertypes(same[-1]))
            found = {f.name: f for above in supers for f in self.classes[above].features}
        self._features.update(dict.fromkeys(same, found))
        return found

    def feature(self, name: str, feature: str) -> Feature | None:
        """Return a feature of a class, its own or inherited; None if there is none of this name."""
        return self.features(name).get(feature)

    def left_out_reason(self, name: str, feature: str) -> str | None:
        """Return why a feature in the file of a class or its supertypes was left out; None if it was not left out."""
        if self.feature(name, feature) is not None:
            return None
        for above in self.supertypes(name):
            for known, why in self.classes[above].left_out:
                if known == feature:
                    return why
        return None

    def opposite(self, reference: Reference) -> Reference | None:
        """Return the reference that holds the same links in the other direction, or None."""
        if reference.opposite is None:
            return None
        found = self.features(reference.target)[reference.opposite]
        assert isinstance(found, Reference)
        return found

    def canonical_link(
        self, reference: Reference, source: SortableEnd, target: SortableEnd
    ) -> tuple[Reference, SortableEnd, SortableEnd]:
        """Return a link in a normal form: a link and the equal link of the opposite reference give the same triple."""
        opposite = self.opposite(reference)
        # The ends of a link whose reference is its own opposite are sorted.
        if opposite is not None and (opposite.index, target, source) < (reference.index, source, target):
            return opposite, target, source
        return reference, source, target

    def containment_link(
        self, reference: Reference, source: LinkEnd, target: LinkEnd
    ) -> tuple[Reference, LinkEnd, LinkEnd] | None:
        """Return a link as (containment reference, container, content); None if neither end contains the other."""
        opposite = self.opposite(reference)
        if opposite is not None and opposite.containment:
            return opposite, target, source
        return (reference, source, target) if reference.containment else None

    def max_sources(self, reference: Reference) -> int | None:
        """Return the maximum number of objects that may have the same target; None for no limit."""
        opposite = self.opposite(reference)
        return 1 if reference.containment else None if opposite is None else opposite.upper

    def key(self, name: str) -> tuple[str, ...]:
        """Return the key attributes of a class, or of its nearest supertype with a key; () if there are none."""
        return next((self.classes[above].key for above in self.supertypes(name) if self.classes[above].key), ())

    def picture(self) -> Picture:
        """Return the class diagram as a picture that can be written as DOT or SVG."""
        references = ((reference, self.opposite(reference)) for reference in self.references)
        return class_diagram(self.name, self.class_list, self.enum_types, references)

    def to_dot(self) -> str:
        """Return the class diagram as DOT, the text format of Graphviz."""
        return self.picture().to_dot()

    def to_svg(self) -> str:
        """Return the class diagram as an `<svg>` element; see `Picture.to_svg`."""
        return self.picture().to_svg()

    def _repr_svg_(self) -> str | None:
        return self.picture()._repr_svg_()

    def __repr__(self) -> str:
        return f"<Metamodel {self.name}: {len(self.class_list)} classes>"
