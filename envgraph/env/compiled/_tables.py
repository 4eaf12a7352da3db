"""What a program is written over: tables that a member fills, and columns of its state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import bind_parameter, key_attributes, key_reader
from envgraph.code import dataclass
from envgraph.env.compiled._member import NO_OBJECT, Cell, Member, Row, missing, width
from envgraph.env.compiled._refused import Misfit, NotCompiled
from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar
from envgraph.pattern import Library, ObjectType, Parameter, StaticType

WORD: Final = 32
"""Bits of a word of a set."""


class Whole:
    """A table or column of whole numbers."""

    __slots__ = ()
    is_float = False


# --- relations that no rule changes


@dataclass(frozen=True, slots=True)
class Instances:
    """The objects of a class."""

    cls: str
    exact: bool = False

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Types of the columns."""
        return (ObjectType(self.cls),)

    def rows(self, member: Member) -> list[Row]:
        """The tuples."""
        return [(number,) for number in member.extent(self.cls, self.exact)]


@dataclass(frozen=True, slots=True)
class Links:
    """The links of a reference, or the objects with their values of an attribute."""

    feature: Reference | Attribute

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Types of the columns."""
        feature = self.feature
        end = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
        return ObjectType(feature.owner), end

    def rows(self, member: Member) -> list[Row]:
        """The tuples."""
        return member.links(self.feature)


@dataclass(frozen=True, slots=True)
class Matches:
    """The matches of a pattern."""

    pattern: str

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Types of the columns."""
        return library.parameter_types(self.pattern)

    def rows(self, member: Member) -> list[Row]:
        """The tuples."""
        return member.matches(self.pattern)


@dataclass(frozen=True, slots=True)
class Reached:
    """What is reached by the steps of a closure."""

    step: str
    star: bool

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Types of the columns."""
        return library.parameter_types(self.step)

    def rows(self, member: Member) -> list[Row]:
        """The tuples."""
        return member.reached(self.step, self.star)


Relation: TypeAlias = "Instances | Links | Matches | Reached"


# --- tables: a row of numbers for each member


@dataclass(frozen=True, slots=True)
class Keys:
    """Columns of a relation whose values have numbers below known ones: they make a place in a table.

    Attributes:
        widths: of each column how many values it may have; 0: as many as there are objects.
    """

    relation: Relation
    positions: tuple[int, ...]
    widths: tuple[int, ...]

    def sizes(self, stride: int) -> tuple[int, ...]:
        """How many values each column may have, where there are so many objects."""
        return tuple(width or stride for width in self.widths)

    def places(self, rows: Sequence[Row], sizes: Sequence[int]) -> list[int]:
        """The place of each row."""
        places = [0] * len(rows)
        for position, size in zip(self.positions, sizes, strict=True):
            places = [place * size + int(row[position]) for place, row in zip(places, rows, strict=True)]
        return places


@dataclass(frozen=True, slots=True)
class Bits(Whole):
    """Whether there is a row with some values: one bit for each place."""

    keys: Keys

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        sizes = self.keys.sizes(stride)
        bits = np.zeros(-(-max(prod(sizes), 1) // WORD) * WORD, dtype=np.uint8)
        bits[self.keys.places(member.rows(self.keys.relation), sizes)] = 1
        return _packed(bits)


@dataclass(frozen=True, slots=True)
class Values:
    """The value in a column of the one row with some values."""

    keys: Keys
    position: int
    shown: tuple[int, ...]
    type: StaticType

    @property
    def is_float(self) -> bool:
        """Whether the values are."""
        return self.type is Scalar.FLOAT

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member.

        Raises:
            Misfit: it has several rows for some values.
        """
        sizes = self.keys.sizes(stride)
        found = [missing(self.type)] * max(prod(sizes), 1)
        rows = member.rows(self.keys.relation)
        places = self.keys.places(rows, sizes)
        different = len(set(places))
        if different < len(places):
            shown = {
                (place, *[row[at] for at in self.shown]) for place, row in zip(places, rows, strict=True)
            }
            if different < len(shown):
                raise Misfit(One(self.keys, self.shown))
        for place, row in zip(places, rows, strict=True):
            found[place] = row[self.position]
        return found


@dataclass(frozen=True, slots=True)
class Starts(Whole):
    """Where the rows with some values begin, and behind the last one where they end."""

    keys: Keys
    shown: tuple[int, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        sizes = self.keys.sizes(stride)
        groups = _grouped(self.keys, self.shown, member, sizes)
        found = [0]
        for place in range(max(prod(sizes), 1)):
            found.append(found[-1] + len(groups.get(place, ())))
        return found


@dataclass(frozen=True, slots=True)
class Listed:
    """The values in a column, of rows in the order of `Starts`."""

    keys: Keys
    shown: tuple[int, ...]
    position: int
    is_float: bool

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        column = self.shown.index(self.position)
        groups = _grouped(self.keys, self.shown, member, self.keys.sizes(stride))
        return [row[column] for place in sorted(groups) for row in groups[place]]


@dataclass(frozen=True, slots=True)
class SetsOf(Whole):
    """Which objects of a group the rows with some values have in a column: as many words as a set of the group has."""

    keys: Keys
    position: int
    group: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        sizes = self.keys.sizes(stride)
        objects = members(member, self.group)
        bits = np.zeros((max(prod(sizes), 1), -(-len(objects) // WORD) * WORD), dtype=np.uint8)
        rank = {number: place for place, number in enumerate(objects)}
        rows = member.rows(self.keys.relation)
        for place, row in zip(self.keys.places(rows, sizes), rows, strict=True):
            if row[self.position] in rank:
                bits[place, rank[int(row[self.position])]] = 1
        return _packed(bits)


def _packed(bits: NDArray[np.uint8], kind: str = "<i4") -> list[int]:
    """Truth values, as many as words have bits, as words."""
    words: list[int] = np.packbits(bits, bitorder="little").view(kind).tolist()
    return words


@dataclass(frozen=True, slots=True)
class One:
    """The assumption that some values have one row at most."""

    keys: Keys
    shown: tuple[int, ...]


def _grouped(
    keys: Keys, shown: tuple[int, ...], member: Member, sizes: Sequence[int]
) -> dict[int, list[Row]]:
    """The different rows, of some columns, by the place that others make; sorted."""
    groups: dict[int, set[Row]] = {}
    rows = member.rows(keys.relation)
    for place, row in zip(keys.places(rows, sizes), rows, strict=True):
        groups.setdefault(place, set()).add(tuple([row[position] for position in shown]))
    return {place: sorted(rows) for place, rows in groups.items()}


@dataclass(frozen=True, slots=True)
class Extent(Whole):
    """The objects of some classes: all of them, ascending; how many they are; how many words a set of them has; or the
    place of each object among them, -1 for others."""

    classes: tuple[str, ...]
    of: Literal["objects", "count", "words", "places"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        objects = members(member, self.classes)
        match self.of:
            case "objects":
                return objects
            case "count":
                return [len(objects)]
            case "words":
                return [-(-len(objects) // WORD)]
        found = [NO_OBJECT] * stride
        for place, number in enumerate(objects):
            found[number] = place
        return found


@dataclass(frozen=True, slots=True)
class Single:
    """The assumption that there is one object at most of some classes."""

    classes: tuple[str, ...]

    def check(self, member: Member) -> None:
        """See that a member is so.

        Raises:
            Misfit: it is not.
        """
        if len(members(member, self.classes)) > 1:
            raise Misfit(self)


def members(member: Member, classes: Sequence[str]) -> list[int]:
    """The objects of some concrete classes, ascending, and behind them those that rules may create."""
    found = sorted(number for cls in classes for number in member.extent(cls, exact=True))
    return found if member.created.isdisjoint(classes) else [*found, *member.spare]


# --- columns: a row of numbers for each state


@dataclass(frozen=True, slots=True)
class AttributeColumn:
    """The value of each object that has an attribute."""

    attribute: Attribute
    classes: tuple[str, ...]

    @property
    def is_float(self) -> bool:
        """Whether the values are."""
        return self.attribute.type is Scalar.FLOAT

    def initial(self, member: Member) -> Sequence[Cell]:
        """The column in the initial state."""
        return [member.value(number, self.attribute) for number in self.objects(member)]

    def objects(self, member: Member) -> list[int]:
        """The objects that the entries are about."""
        return members(member, self.classes)


@dataclass(frozen=True, slots=True)
class LinkColumn(Whole):
    """The other end of each object at one end of a reference, where it has one at most.

    Attributes:
        reference: of a pair of opposites the first.
        at_source: whether that is the end where links begin.
        classes: concrete classes of the objects at that end.
    """

    reference: Reference
    at_source: bool
    classes: tuple[str, ...]

    def initial(self, member: Member) -> Sequence[Cell]:
        """The column in the initial state."""
        links = member.rows(Links(self.reference))
        held = {ends[not self.at_source]: ends[self.at_source] for ends in links}
        return [held.get(number, NO_OBJECT) for number in members(member, self.classes)]


@dataclass(frozen=True, slots=True)
class LinkMatrix(Whole):
    """Whether each object at one end of a reference has a link to each at the other, where both may have many."""

    reference: Reference
    sources: tuple[str, ...]
    targets: tuple[str, ...]

    def initial(self, member: Member) -> Sequence[Cell]:
        """The column in the initial state, row by row."""
        links = {(int(source), int(target)) for source, target in member.rows(Links(self.reference))}
        ends = members(member, self.sources), members(member, self.targets)
        return [int((source, target) in links) for source in ends[0] for target in ends[1]]


@dataclass(frozen=True, slots=True)
class ClassSet(Whole):
    """Which of the objects of a group are of a class: a bit for each."""

    group: tuple[str, ...]
    cls: str

    def initial(self, member: Member) -> Sequence[Cell]:
        """The column in the initial state."""
        objects = members(member, self.group)
        inside = {*member.extent(self.cls, exact=True)}
        bits = np.zeros(-(-len(objects) // WORD) * WORD, dtype=np.uint8)
        bits[: len(objects)] = [number in inside for number in objects]
        return _packed(bits, "<u4")


@dataclass(frozen=True, slots=True)
class Made(Whole):
    """How many of the spare objects rules have taken."""

    def initial(self, member: Member) -> Sequence[Cell]:
        """The column in the initial state."""
        return [0]


@dataclass(frozen=True, slots=True)
class Spare(Whole):
    """The number of the first object that rules may create, or how many there are of these."""

    of: Literal["first", "count"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        return [member.spare.start if self.of == "first" else len(member.spare)]


# --- what a behaviour names


@dataclass(frozen=True, slots=True)
class Bound(Whole):
    """The object that a parameter of the behaviour stands for."""

    parameter: Parameter

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        return [member.number[bind_parameter(member.model, self.parameter)]]


@dataclass(frozen=True, slots=True)
class Keyed(Whole):
    """The object that has each index among a class, or will have it when it is retyped; -1 for none."""

    cls: str
    candidates: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member.

        Raises:
            NotCompiled: two objects may have one index.
        """
        found = [NO_OBJECT] * member.keys.size(self.cls)
        for number, index in _indexed(member, self.cls, self.candidates):
            if index != NO_OBJECT:
                if found[index] != NO_OBJECT:
                    raise NotCompiled(f"objects that share a key, and may both become a `{self.cls}`")
                found[index] = number
        return found


@dataclass(frozen=True, slots=True)
class IndexOf(Whole):
    """The index of each object among a class; -1 for those that have none."""

    cls: str
    candidates: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        found = [NO_OBJECT] * stride
        for number, index in _indexed(member, self.cls, self.candidates):
            found[number] = index
        return found


def indexable(metamodel: Metamodel, cls: str) -> tuple[str, ...]:
    """The concrete classes of the objects that have the key of a class."""
    key = key_attributes(metamodel, cls)
    return tuple(
        one.name
        for one in metamodel.class_list
        if not one.abstract
        and (
            metamodel.is_a(one.name, cls)
            or (key and all(metamodel.is_a(one.name, attribute.owner) for attribute in key))
        )
    )


def _indexed(member: Member, cls: str, classes: Sequence[str]) -> Iterator[tuple[int, int]]:
    """The objects of some classes with their indices among a class.

    Raises:
        NotCompiled: one that a rule creates may have an index.
    """
    key_of = key_reader(member.model, cls)
    rank = {key: position for position, key in enumerate(member.keys.of_class(cls))}
    if not member.created.isdisjoint(classes) and any(
        key >= (member.model.graph.store.next_id,) for key in rank
    ):
        raise NotCompiled(
            f"objects without a key that rules create, where other members have more of them (`{cls}`)"
        )
    for number in (number for number in members(member, classes) if number not in member.spare):
        yield number, rank.get(key_of(member.objects[number]), NO_OBJECT)


@dataclass(frozen=True, slots=True)
class Seats(Whole):
    """The agents in the order of their turns: their objects, or the numbers of their blocks."""

    classes: tuple[str, ...]
    of: Literal["object", "block", "count"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """The table of a member."""
        seats = [
            (member.number[node], block)
            for block, cls in enumerate(self.classes)
            for node in member.keys.objects(member.model, cls)
            if node is not None
        ]
        if self.of == "count":
            return [len(seats)]
        return [node if self.of == "object" else block for node, block in seats]


Table: TypeAlias = (
    "Bits | Values | Starts | Listed | SetsOf | Extent | Spare | Bound | Keyed | IndexOf | Seats"
)
Column: TypeAlias = "AttributeColumn | LinkColumn | LinkMatrix | ClassSet"


def keys_of(relation: Relation, library: Library, bound: Sequence[int]) -> tuple[Keys, tuple[int, ...]]:
    """Those of the bound columns that make a place, and the others."""
    types = relation.types(library)
    widths = {position: width(types[position]) for position in bound}
    usable = tuple(position for position in bound if widths[position] is not None)
    rest = tuple(position for position in bound if widths[position] is None)
    return Keys(relation, usable, tuple(widths[position] or 0 for position in usable)), rest
