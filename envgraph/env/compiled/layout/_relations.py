"""Define relations that no rule changes, and the key columns by which tables of a program find their rows."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import TypeAlias

from envgraph.code import dataclass
from envgraph.errors import EvaluationError
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar
from envgraph.pattern import Library, ObjectType, StaticType

Cell: TypeAlias = "int | float"
Row: TypeAlias = "tuple[Cell, ...]"


@dataclass(frozen=True, slots=True)
class ClassInstances:
    """The objects of a class, as rows of one column."""

    cls: str
    exact: bool = False


@dataclass(frozen=True, slots=True)
class FeatureRows:
    """The links of a reference, or the objects with their values of an attribute, as rows of two columns."""

    feature: Reference | Attribute


@dataclass(frozen=True, slots=True)
class PatternMatches:
    """The matches of a pattern, as rows with one column for each parameter."""

    pattern: str


@dataclass(frozen=True, slots=True)
class ClosurePairs:
    """The transitive closure of the binary pattern `step`, as pairs; `star` adds the pair (x, x) for each object x."""

    step: str
    star: bool


StaticRelation: TypeAlias = "ClassInstances | FeatureRows | PatternMatches | ClosurePairs"


def column_types(relation: StaticRelation, library: Library) -> tuple[StaticType, ...]:
    """Return the types of the columns of a relation."""
    match relation:
        case ClassInstances(cls):
            return (ObjectType(cls),)
        case FeatureRows(feature):
            end = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
            return ObjectType(feature.owner), end
        case PatternMatches(pattern) | ClosurePairs(pattern):
            return library.parameter_types(pattern)


@dataclass(frozen=True, slots=True)
class KeyColumns:
    """The columns of a relation whose values, combined to one number, are the position of a row in a table.

    Attributes:
        widths: the number of possible values of each column; 0: the number of objects.
    """

    relation: StaticRelation
    positions: tuple[int, ...]
    widths: tuple[int, ...]

    def value_counts(self, stride: int) -> tuple[int, ...]:
        """Return the number of possible values of each key column; `stride` is this number for objects."""
        sizes = tuple(width or stride for width in self.widths)
        if prod(sizes) > 2**28:
            raise EvaluationError(f"a table of {prod(sizes):,} entries is too large", hint='use `engine="live"`')
        return sizes

    def table_positions(self, rows: Sequence[Row], sizes: Sequence[int]) -> list[int]:
        """Return the table position of each row, which is computed from the row's key values."""
        places = [0] * len(rows)
        for position, size in zip(self.positions, sizes, strict=True):
            places = [place * size + int(row[position]) for place, row in zip(places, rows, strict=True)]
        return places


def split_key_columns(
    relation: StaticRelation, library: Library, bound: Sequence[int]
) -> tuple[KeyColumns, tuple[int, ...]]:
    """Split bound columns into those that form a table position, and the positions of those with too many values."""
    types = column_types(relation, library)
    widths = {position: value_count(types[position]) for position in bound}
    usable = tuple(position for position in bound if widths[position] is not None)
    rest = tuple(position for position in bound if widths[position] is None)
    return KeyColumns(relation, usable, tuple(widths[position] or 0 for position in usable)), rest


def value_count(type_: StaticType) -> int | None:
    """Return how many values a type has, for a table indexed by value.

    Returns:
        0 for objects, whose number depends on the member; None for types with too many values (numbers, strings).
    """
    match type_:
        case ObjectType():
            return 0
        case EnumType():
            return len(type_.literals)
        case Scalar.BOOL:
            return 2
        case _:
            return None
