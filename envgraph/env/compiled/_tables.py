"""Define the tables of a program, which hold facts of a member, and the columns, which hold the changeable state."""

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
"""Number of bits of a word of a bit set."""


class Whole:
    """The base class of tables and columns of ints."""

    __slots__ = ()
    is_float = False


# --- relations that no rule changes


@dataclass(frozen=True, slots=True)
class Instances:
    """The objects of a class, as rows of one column."""

    cls: str
    exact: bool = False

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Return the types of the columns."""
        return (ObjectType(self.cls),)

    def rows(self, member: Member) -> list[Row]:
        """Return the rows of the relation in the member's initial model."""
        return [(number,) for number in member.extent(self.cls, self.exact)]


@dataclass(frozen=True, slots=True)
class Links:
    """The links of a reference, or the objects with their values of an attribute, as rows of two columns."""

    feature: Reference | Attribute

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Return the types of the columns."""
        feature = self.feature
        end = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
        return ObjectType(feature.owner), end

    def rows(self, member: Member) -> list[Row]:
        """Return the rows of the relation in the member's initial model."""
        return member.links(self.feature)


@dataclass(frozen=True, slots=True)
class Matches:
    """The matches of a pattern, as rows with one column for each parameter."""

    pattern: str

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Return the types of the columns."""
        return library.parameter_types(self.pattern)

    def rows(self, member: Member) -> list[Row]:
        """Return the rows of the relation in the member's initial model."""
        return member.matches(self.pattern)


@dataclass(frozen=True, slots=True)
class Reached:
    """The transitive closure of the binary pattern `step`, as pairs; `star` adds the pair (x, x) for each object x."""

    step: str
    star: bool

    def types(self, library: Library) -> tuple[StaticType, ...]:
        """Return the types of the columns."""
        return library.parameter_types(self.step)

    def rows(self, member: Member) -> list[Row]:
        """Return the rows of the relation in the member's initial model."""
        return member.reached(self.step, self.star)


Relation: TypeAlias = "Instances | Links | Matches | Reached"


# --- tables: a row of numbers for each member


@dataclass(frozen=True, slots=True)
class Keys:
    """The columns of a relation whose values, combined to one number, are the position of a row in a table.

    Attributes:
        widths: the number of possible values of each column; 0: the number of objects.
    """

    relation: Relation
    positions: tuple[int, ...]
    widths: tuple[int, ...]

    def sizes(self, stride: int) -> tuple[int, ...]:
        """Return the number of possible values of each key column; `stride` is this number for objects."""
        return tuple(width or stride for width in self.widths)

    def places(self, rows: Sequence[Row], sizes: Sequence[int]) -> list[int]:
        """Return the table position of each row, which is computed from the row's key values."""
        places = [0] * len(rows)
        for position, size in zip(self.positions, sizes, strict=True):
            places = [place * size + int(row[position]) for place, row in zip(places, rows, strict=True)]
        return places


@dataclass(frozen=True, slots=True)
class Bits(Whole):
    """A table with one bit for each position: 1 if the relation has a row with these key values."""

    keys: Keys

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        sizes = self.keys.sizes(stride)
        bits = np.zeros(-(-max(prod(sizes), 1) // WORD) * WORD, dtype=np.uint8)
        bits[self.keys.places(member.rows(self.keys.relation), sizes)] = 1
        return _packed(bits)


@dataclass(frozen=True, slots=True)
class Values:
    """A table of the value that one column has in the row with given key values; at most one such row may exist."""

    keys: Keys
    position: int
    shown: tuple[int, ...]
    type: StaticType

    @property
    def is_float(self) -> bool:
        """Return True if the values are floats."""
        return self.type is Scalar.FLOAT

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; positions without a row have the missing value.

        Raises:
            Misfit: the member has several different rows for the same key values.
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
    """A table of the position in `Listed` where the rows with given key values begin, and of the last row's end."""

    keys: Keys
    shown: tuple[int, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        sizes = self.keys.sizes(stride)
        groups = _grouped(self.keys, self.shown, member, sizes)
        found = [0]
        for place in range(max(prod(sizes), 1)):
            found.append(found[-1] + len(groups.get(place, ())))
        return found


@dataclass(frozen=True, slots=True)
class Listed:
    """A table of the values in one column, of the distinct rows sorted by key values; `Starts` divides the table."""

    keys: Keys
    shown: tuple[int, ...]
    position: int
    is_float: bool

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        column = self.shown.index(self.position)
        groups = _grouped(self.keys, self.shown, member, self.keys.sizes(stride))
        return [row[column] for place in sorted(groups) for row in groups[place]]


@dataclass(frozen=True, slots=True)
class SetsOf(Whole):
    """A table with a bit set for each combination of key values: the objects of a group that these rows contain."""

    keys: Keys
    position: int
    group: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
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
    """Return bits packed into 32-bit words, the lowest bit first; the number of bits is a multiple of 32."""
    words: list[int] = np.packbits(bits, bitorder="little").view(kind).tolist()
    return words


@dataclass(frozen=True, slots=True)
class One:
    """The assumption that each member has at most one distinct row for each combination of key values."""

    keys: Keys
    shown: tuple[int, ...]


def _grouped(
    keys: Keys, shown: tuple[int, ...], member: Member, sizes: Sequence[int]
) -> dict[int, list[Row]]:
    """Return the distinct rows of the columns `shown`, sorted, by the table position of their key values."""
    groups: dict[int, set[Row]] = {}
    rows = member.rows(keys.relation)
    for place, row in zip(keys.places(rows, sizes), rows, strict=True):
        groups.setdefault(place, set()).add(tuple([row[position] for position in shown]))
    return {place: sorted(rows) for place, rows in groups.items()}


@dataclass(frozen=True, slots=True)
class Extent(Whole):
    """A table about the objects of some classes, selected by `of`.

    `objects`: their numbers, ascending; `count`: how many; `words`: the words of a bit set of them; `places`: the
    position of each object of the member among them, -1 for objects of other classes.
    """

    classes: tuple[str, ...]
    of: Literal["objects", "count", "words", "places"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
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
    """The assumption that each member has at most one object of some classes."""

    classes: tuple[str, ...]

    def check(self, member: Member) -> None:
        """Check that the member satisfies the assumption.

        Raises:
            Misfit: the member has several objects of the classes.
        """
        if len(members(member, self.classes)) > 1:
            raise Misfit(self)


def members(member: Member, classes: Sequence[str]) -> list[int]:
    """Return the numbers of the objects of some concrete classes, ascending.

    If rules create objects of these classes, the numbers reserved for created objects follow.
    """
    found = sorted(number for cls in classes for number in member.extent(cls, exact=True))
    return found if member.created.isdisjoint(classes) else [*found, *member.spare]


# --- columns: a row of numbers for each state


@dataclass(frozen=True, slots=True)
class AttributeColumn:
    """A column with the value of an attribute for each object of the classes that have the attribute."""

    attribute: Attribute
    classes: tuple[str, ...]

    @property
    def is_float(self) -> bool:
        """Return True if the values are floats."""
        return self.attribute.type is Scalar.FLOAT

    def initial(self, member: Member) -> Sequence[Cell]:
        """Return the column in the member's initial state."""
        return [member.value(number, self.attribute) for number in self.objects(member)]

    def objects(self, member: Member) -> list[int]:
        """Return the objects that the entries belong to, in order."""
        return members(member, self.classes)


@dataclass(frozen=True, slots=True)
class LinkColumn(Whole):
    """A column with the linked object for each object at an end of a reference with at most one link; -1 for none.

    Attributes:
        reference: the reference; of two opposite references, the first.
        at_source: True if the column's objects are the sources of the links.
        classes: the concrete classes of the column's objects.
    """

    reference: Reference
    at_source: bool
    classes: tuple[str, ...]

    def initial(self, member: Member) -> Sequence[Cell]:
        """Return the column in the member's initial state."""
        links = member.rows(Links(self.reference))
        held = {ends[not self.at_source]: ends[self.at_source] for ends in links}
        return [held.get(number, NO_OBJECT) for number in members(member, self.classes)]


@dataclass(frozen=True, slots=True)
class LinkMatrix(Whole):
    """A matrix [sources, targets] of a reference with many links at both ends: 1 if the two objects are linked."""

    reference: Reference
    sources: tuple[str, ...]
    targets: tuple[str, ...]

    def initial(self, member: Member) -> Sequence[Cell]:
        """Return the matrix in the member's initial state, row by row."""
        links = {(int(source), int(target)) for source, target in member.rows(Links(self.reference))}
        ends = members(member, self.sources), members(member, self.targets)
        return [int((source, target) in links) for source in ends[0] for target in ends[1]]


@dataclass(frozen=True, slots=True)
class ClassSet(Whole):
    """A bit set of the objects that currently have a class, among those of a group of classes."""

    group: tuple[str, ...]
    cls: str

    def initial(self, member: Member) -> Sequence[Cell]:
        """Return the words of the bit set in the member's initial state."""
        objects = members(member, self.group)
        inside = {*member.extent(self.cls, exact=True)}
        bits = np.zeros(-(-len(objects) // WORD) * WORD, dtype=np.uint8)
        bits[: len(objects)] = [number in inside for number in objects]
        return _packed(bits, "<u4")


@dataclass(frozen=True, slots=True)
class Made(Whole):
    """A column with one entry: how many reserved numbers are in use by objects that rules created."""

    def initial(self, member: Member) -> Sequence[Cell]:
        """Return the column in the initial state: 0."""
        return [0]


@dataclass(frozen=True, slots=True)
class Spare(Whole):
    """A table with one entry: the first number reserved for created objects, or how many numbers are reserved."""

    of: Literal["first", "count"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        return [member.spare.start if self.of == "first" else len(member.spare)]


# --- what a behaviour names


@dataclass(frozen=True, slots=True)
class Bound(Whole):
    """A table with one entry: the object that a parameter of the behaviour is bound to."""

    parameter: Parameter

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        return [member.number[bind_parameter(member.model, self.parameter)]]


@dataclass(frozen=True, slots=True)
class Keyed(Whole):
    """A table of the object at each index of a class, also of objects that may be retyped to the class; -1 for none."""

    cls: str
    candidates: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member.

        Raises:
            NotCompiled: two objects may have the same index.
        """
        found = [NO_OBJECT] * member.keys.size(self.cls)
        for number, index in _indexed(member, self.cls, self.candidates):
            if index != NO_OBJECT:
                if found[index] != NO_OBJECT:
                    raise NotCompiled(f"objects with the same key that may both become a `{self.cls}`")
                found[index] = number
        return found


@dataclass(frozen=True, slots=True)
class IndexOf(Whole):
    """A table of the index of each object within a class; -1 for objects without an index."""

    cls: str
    candidates: tuple[str, ...]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
        found = [NO_OBJECT] * stride
        for number, index in _indexed(member, self.cls, self.candidates):
            found[number] = index
        return found


def indexable(metamodel: Metamodel, cls: str) -> tuple[str, ...]:
    """Return the concrete classes that have the key attributes of a class, so that their objects can have an index."""
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
    """Yield the initial objects of some classes, each with its index within a class, or -1 without an index.

    Raises:
        NotCompiled: an object that a rule creates may have an index.
    """
    key_of = key_reader(member.model, cls)
    rank = {key: position for position, key in enumerate(member.keys.of_class(cls))}
    if not member.created.isdisjoint(classes) and any(
        key >= (member.model.graph.store.next_id,) for key in rank
    ):
        raise NotCompiled(
            f"rules that create objects without a key, of which other members have more (`{cls}`)"
        )
    for number in (number for number in members(member, classes) if number not in member.spare):
        yield number, rank.get(key_of(member.objects[number]), NO_OBJECT)


@dataclass(frozen=True, slots=True)
class Seats(Whole):
    """A table of the agents in the order of their turns: their objects, their block numbers, or their count."""

    classes: tuple[str, ...]
    of: Literal["object", "block", "count"]

    def fill(self, member: Member, stride: int) -> Sequence[Cell]:
        """Return the entries of the table for a member; `stride` is the largest number of objects of a member."""
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
    """Split bound columns into those that form a table position, and the positions of those with too many values."""
    types = relation.types(library)
    widths = {position: width(types[position]) for position in bound}
    usable = tuple(position for position in bound if widths[position] is not None)
    rest = tuple(position for position in bound if widths[position] is None)
    return Keys(relation, usable, tuple(widths[position] or 0 for position in usable)), rest
