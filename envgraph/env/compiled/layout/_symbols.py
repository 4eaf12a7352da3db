"""Define the tables of a program, which hold facts of a member, and the columns, which hold the changeable state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from itertools import accumulate
from math import prod
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import bind_parameter
from envgraph.code import dataclass
from envgraph.env.compiled.layout._member_data import NO_OBJECT, MemberData, missing_value
from envgraph.env.compiled.layout._not_compiled import AssumptionViolated, NotCompiled
from envgraph.env.compiled.layout._relations import Cell, FeatureRows, KeyColumns, Row, value_count
from envgraph.metamodel import Attribute, AttributeType, Reference, Scalar, Value
from envgraph.pattern import Parameter, StaticType

WORD_BITS: Final = 32
"""Number of bits of a word of a bit set."""


class MemberNumbers(ABC):
    """The base class of tables of a member, and of columns of its states."""

    __slots__ = ()

    @property
    def is_float(self) -> bool:
        """Return True if the entries are floats."""
        return False

    @abstractmethod
    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        """Return the entries of a table, or of a column in the initial state.

        Args:
            member: that the entries are of.
            stride: the largest number of objects of a member.
        """


class StateNumbers(MemberNumbers):
    """The base class of columns of states."""

    __slots__ = ()


# --- tables: a row of numbers for each member


@dataclass(frozen=True, slots=True)
class BitTable(MemberNumbers):
    """A table with one bit for each position: 1 if the relation has a row with these key values."""

    keys: KeyColumns

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        sizes = self.keys.value_counts(stride)
        bits = np.zeros(-(-max(prod(sizes), 1) // WORD_BITS) * WORD_BITS, dtype=np.uint8)
        bits[self.keys.table_positions(member.rows(self.keys.relation), sizes)] = 1
        return _pack_bits(bits)


def _is_float(table: ValueTable | GroupedValues) -> bool:
    """Return True if the values of a table are floats."""
    return table.type is Scalar.FLOAT


def _cells_of(values: Sequence[Cell], type_: StaticType) -> Sequence[Cell]:
    """Return the cells that hold values: two for an int, of 32 bits, the lower one first; otherwise one."""
    if type_ is not Scalar.INT:
        return values
    words: list[int] = np.array(values, dtype="<i8").view("<i4").tolist()
    return words


@dataclass(frozen=True, slots=True)
class ValueTable(MemberNumbers):
    """A table of the value that one column has in the row with given key values; at most one such row may exist."""

    keys: KeyColumns
    position: int
    shown_columns: tuple[int, ...]
    type: StaticType
    is_float = property(_is_float)

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        sizes = self.keys.value_counts(stride)
        found = [missing_value(self.type)] * max(prod(sizes), 1)
        groups = _group_rows(self.keys, self.shown_columns, member, sizes)
        if any(len(rows) > 1 for rows in groups.values()):
            raise AssumptionViolated(AtMostOneRow(self.keys, self.shown_columns))
        column = self.shown_columns.index(self.position)
        for place, (row,) in groups.items():
            found[place] = row[column]
        return _cells_of(found, self.type)


@dataclass(frozen=True, slots=True)
class GroupStarts(MemberNumbers):
    """A table of the position in `GroupedValues` where the rows with given key values begin, and of the last row's
    end.
    """

    keys: KeyColumns
    shown_columns: tuple[int, ...]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        sizes = self.keys.value_counts(stride)
        groups = _group_rows(self.keys, self.shown_columns, member, sizes)
        return [0, *accumulate(len(groups.get(place, ())) for place in range(max(prod(sizes), 1)))]


@dataclass(frozen=True, slots=True)
class GroupedValues(MemberNumbers):
    """A table of the values in one column, of the distinct rows sorted by key values; `GroupStarts` divides the
    table.
    """

    keys: KeyColumns
    shown_columns: tuple[int, ...]
    position: int
    type: StaticType
    is_float = property(_is_float)

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        column = self.shown_columns.index(self.position)
        groups = _group_rows(self.keys, self.shown_columns, member, self.keys.value_counts(stride))
        return _cells_of([row[column] for place in sorted(groups) for row in groups[place]], self.type)


@dataclass(frozen=True, slots=True)
class BitSetTable(MemberNumbers):
    """A table with a bit set for each combination of key values: the objects of a group that these rows contain."""

    keys: KeyColumns
    position: int
    group: tuple[str, ...]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        sizes = self.keys.value_counts(stride)
        objects = object_numbers(member, self.group)
        bits = np.zeros((max(prod(sizes), 1), -(-len(objects) // WORD_BITS) * WORD_BITS), dtype=np.uint8)
        rank = {number: place for place, number in enumerate(objects)}
        rows = member.rows(self.keys.relation)
        for place, row in zip(self.keys.table_positions(rows, sizes), rows, strict=True):
            if row[self.position] in rank:
                bits[place, rank[int(row[self.position])]] = 1
        return _pack_bits(bits)


def _pack_bits(bits: NDArray[np.uint8], kind: str = "<i4") -> list[int]:
    """Return bits packed into 32-bit words, the lowest bit first; the number of bits is a multiple of 32."""
    words: list[int] = np.packbits(bits, bitorder="little").view(kind).tolist()
    return words


@dataclass(frozen=True, slots=True)
class AtMostOneRow:
    """The assumption that each member has at most one distinct row for each combination of key values."""

    keys: KeyColumns
    shown_columns: tuple[int, ...]


def _group_rows(
    keys: KeyColumns, shown: tuple[int, ...], member: MemberData, sizes: Sequence[int]
) -> dict[int, list[Row]]:
    """Return the distinct rows of the columns `shown`, sorted, by the table position of their key values."""
    groups: dict[int, set[Row]] = {}
    rows = member.rows(keys.relation)
    for place, row in zip(keys.table_positions(rows, sizes), rows, strict=True):
        groups.setdefault(place, set()).add(tuple([row[position] for position in shown]))
    return {place: sorted(rows) for place, rows in groups.items()}


@dataclass(frozen=True, slots=True)
class ValueDomain:
    """The values that a multi-valued attribute may have, as ascending numbers.

    Attributes:
        literals: numbers in rules.
        sources: attributes whose values in the member's initial model are among them, if they are numbers.
    """

    type: AttributeType
    literals: tuple[Value, ...]
    sources: tuple[Attribute, ...]

    @property
    def is_of_numbers(self) -> bool:
        """Return True if the values are ints or floats; otherwise the domain has all values of the type."""
        return self.type in (Scalar.INT, Scalar.FLOAT)

    def numbers(self, member: MemberData) -> list[Any]:
        """Return the numbers that represent the values for a member. Raise `NotCompiled` for ints beyond 32 bits."""
        if not self.is_of_numbers:
            return [*range(value_count(self.type) or len(member.family.strings))]
        found = {value for source in self.sources for _, value in member.rows(FeatureRows(source))}
        found.update(member.encode(literal, self.type) for literal in self.literals)
        if self.type is Scalar.INT and any(abs(number) >= 2 ** (WORD_BITS - 1) for number in found):
            raise NotCompiled("ints of more than 32 bits in attributes with many values")
        return sorted(found)


@dataclass(frozen=True, slots=True)
class ExtentTable(MemberNumbers):
    """A table about the objects of some classes, or about the values of a domain, selected by `kind`.

    `objects`: their numbers, ascending; `count`: how many; `words`: the words of a bit set of them; `places`: the
    position of each object of the member among them, -1 for objects of other classes.
    """

    classes: tuple[str, ...] | ValueDomain
    kind: Literal["objects", "count", "words", "places"]

    @property
    def is_float(self) -> bool:
        return self.kind == "objects" and isinstance(self.classes, ValueDomain) and self.classes.type is Scalar.FLOAT

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        objects = object_numbers(member, self.classes)
        match self.kind:
            case "objects":
                return objects
            case "count":
                return [len(objects)]
            case "words":
                return [-(-len(objects) // WORD_BITS)]
        found = [NO_OBJECT] * stride
        for place, number in enumerate(objects):
            found[number] = place
        return found


@dataclass(frozen=True, slots=True)
class AtMostOneObject:
    """The assumption that each member has at most one object of some classes, or a domain at most one value."""

    classes: tuple[str, ...] | ValueDomain

    def check(self, member: MemberData) -> None:
        """Check that the member satisfies the assumption.

        Raises:
            Misfit: the member has several objects of the classes.
        """
        if len(object_numbers(member, self.classes)) > 1:
            raise AssumptionViolated(self)


def object_numbers(member: MemberData, classes: Sequence[str] | ValueDomain) -> list[int]:
    """Return the numbers of the objects of some concrete classes, or of the values of a domain, ascending.

    If rules create objects of these classes, the numbers reserved for created objects follow.
    """
    if isinstance(classes, ValueDomain):
        return classes.numbers(member)
    found = sorted(number for cls in classes for number in member.extent(cls, exact=True))
    return found if member.family.created.isdisjoint(classes) else [*found, *member.reserved_numbers]


# --- columns: a row of numbers for each state


@dataclass(frozen=True, slots=True)
class AttributeColumn(StateNumbers):
    """A column with the value of an attribute for each object of the classes that have the attribute."""

    attribute: Attribute
    classes: tuple[str, ...]

    @property
    def is_float(self) -> bool:
        return self.attribute.type is Scalar.FLOAT

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        return [member.attribute_value(number, self.attribute) for number in self.objects(member)]

    def objects(self, member: MemberData) -> list[int]:
        """Return the objects that the entries belong to, in order."""
        return object_numbers(member, self.classes)


@dataclass(frozen=True, slots=True)
class LinkColumn(StateNumbers):
    """A column with the linked object for each object at an end of a reference with at most one link; -1 for none.

    Attributes:
        reference: the reference; of two opposite references, the first.
        belongs_to_sources: True if the column's objects are the sources of the links.
        classes: the concrete classes of the column's objects.
    """

    reference: Reference
    belongs_to_sources: bool
    classes: tuple[str, ...]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        links = member.rows(FeatureRows(self.reference))
        held = {ends[not self.belongs_to_sources]: ends[self.belongs_to_sources] for ends in links}
        return [held.get(number, NO_OBJECT) for number in object_numbers(member, self.classes)]


@dataclass(frozen=True, slots=True)
class LinkMatrix(StateNumbers):
    """A matrix [sources, targets] of a reference with many links at both ends: 1 if the two objects are linked.

    For a multi-valued attribute, a matrix [objects, values]: how many times an object has a value.
    """

    reference: Reference | Attribute
    sources: tuple[str, ...]
    targets: tuple[str, ...] | ValueDomain

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        links = Counter(member.rows(FeatureRows(self.reference)))
        ends = object_numbers(member, self.sources), object_numbers(member, self.targets)
        return [links[source, target] for source in ends[0] for target in ends[1]]


@dataclass(frozen=True, slots=True)
class ClassSet(StateNumbers):
    """A bit set of the objects that currently have a class, among those of a group of classes."""

    group: tuple[str, ...]
    cls: str

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        objects = object_numbers(member, self.group)
        inside = {*member.extent(self.cls, exact=True)}
        bits = np.zeros(-(-len(objects) // WORD_BITS) * WORD_BITS, dtype=np.uint8)
        bits[: len(objects)] = [number in inside for number in objects]
        return _pack_bits(bits, "<u4")


@dataclass(frozen=True, slots=True)
class CreatedCount(StateNumbers):
    """A column with one entry: how many reserved numbers are in use by objects that rules created."""

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        return [0]


@dataclass(frozen=True, slots=True)
class ReservedNumbers(MemberNumbers):
    """A table with one entry: the first number reserved for created objects, or how many numbers are reserved."""

    kind: Literal["first", "count"]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        return [member.reserved_numbers.start if self.kind == "first" else len(member.reserved_numbers)]


# --- what a behaviour names


@dataclass(frozen=True, slots=True)
class BoundParameter(MemberNumbers):
    """A table with one entry: the object that a parameter of the behaviour is bound to."""

    parameter: Parameter

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        return [member.object_numbers[bind_parameter(member.model, self.parameter)]]


@dataclass(frozen=True, slots=True)
class ObjectByIndex(MemberNumbers):
    """A table of the object at each index of a class, also of objects that may be retyped to the class; -1 for none."""

    cls: str
    candidates: tuple[str, ...]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        found, class_of = list[int](), member.model.graph.class_of
        for nodes in member.family.keys.candidates(member.model, self.cls):
            numbers = [member.object_numbers[node] for node in nodes if class_of(node) in self.candidates]
            if len(numbers) > 1:
                raise AssumptionViolated(OneObjectPerIndex(self.cls))
            found.append(max(numbers, default=NO_OBJECT))
        return found


@dataclass(frozen=True, slots=True)
class OneObjectPerIndex:
    """The assumption that at most one object of each member may have an index of a class."""

    cls: str


@dataclass(frozen=True, slots=True)
class IndexByObject(MemberNumbers):
    """A table of the index of each object within a class; -1 for objects without an index."""

    cls: str

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        found = [NO_OBJECT] * stride
        for index, nodes in enumerate(member.family.keys.candidates(member.model, self.cls)):
            for node in nodes:
                found[member.object_numbers[node]] = index
        return found


@dataclass(frozen=True, slots=True)
class KeyValues(MemberNumbers):
    """A table of the value of one key attribute at each index of a class."""

    type: StaticType
    values: tuple[Value, ...]
    is_float = property(_is_float)

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        return _cells_of([member.encode(value, self.type) for value in self.values], self.type)


@dataclass(frozen=True, slots=True)
class AgentTable(MemberNumbers):
    """A table of the agents in the order of their turns: their objects, their block numbers, or their count."""

    classes: tuple[str, ...]
    kind: Literal["object", "block", "count"]

    def fill(self, member: MemberData, stride: int) -> Sequence[Cell]:
        seats = [
            (member.object_numbers[node], block)
            for block, cls in enumerate(self.classes)
            for node in member.family.keys.objects(member.model, cls)
            if node is not None
        ]
        if self.kind == "count":
            return [len(seats)]
        return [node if self.kind == "object" else block for node, block in seats]


ProgramTable: TypeAlias = (
    "BitTable | ValueTable | GroupStarts | GroupedValues | BitSetTable | ExtentTable "
    "| ReservedNumbers | BoundParameter | ObjectByIndex | IndexByObject | KeyValues | AgentTable"
)
StateColumn: TypeAlias = "AttributeColumn | LinkColumn | LinkMatrix | ClassSet"
