"""Encode a member of a family as numbers: number its objects, and answer each query on its initial model once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Any, NamedTuple

from envgraph import code
from envgraph.behaviour import KeyIndex
from envgraph.code import dataclass
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._relations import (
    Cell,
    ClassInstances,
    ClosurePairs,
    FeatureRows,
    PatternMatches,
    Row,
    StaticRelation,
)
from envgraph.errors import InvalidArgument
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar, Value, reachable_nodes
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Engine

NO_OBJECT = -1
"""Represents a missing object; ids of objects are not negative."""
NO_INT = -(2**63)
"""Represents a missing int; other ints of 64 bits represent themselves."""


def emit_missing_value(type_: StaticType) -> code.Expression:
    """Emit code for the number that represents a missing value of the type."""
    return code.Name("NAN") if type_ is Scalar.FLOAT else code.Constant(int(missing_value(type_)))


def missing_value(type_: StaticType) -> Cell:
    """Return the number that represents a missing value: NaN for floats, `NO_INT` for ints, else `NO_OBJECT`."""
    if type_ is Scalar.FLOAT:
        return float("nan")
    return NO_INT if type_ is Scalar.INT else NO_OBJECT


def literal_ranks(type_: EnumType) -> dict[str, int]:
    """Return the number of each literal of the enum: its position in alphabetical order, in which rows are sorted."""
    return {literal: rank for rank, literal in enumerate(sorted(type_.literals))}


class MemberData:
    """The initial state of one member as numbers; its objects are numbered in the order of their ids.

    Args:
        engine: an engine in the member's initial state. If other members share it, relations can only be read until it
            is in another state.
        family: the members of the program, with what they share.

    Attributes:
        object_ids: the ids of the objects of the initial model, by number.
        reserved_numbers: the numbers reserved for objects that rules create; extents do not contain these numbers.
    """

    def __init__(self, engine: Engine, family: ProgramMembers) -> None:
        self.engine, self.family = engine, family
        self.model = engine.model
        self.metamodel = engine.model.metamodel
        concrete = [cls.name for cls in self.metamodel.class_list if not cls.abstract]
        extents = {cls: sorted(self.model.graph.exact_extent(cls)) for cls in concrete}
        self.object_ids = sorted(node for nodes in extents.values() for node in nodes)
        self.object_numbers = {node: number for number, node in enumerate(self.object_ids)}
        count, spare = len(self.object_ids), family.spare if family.created else 0
        self.reserved_numbers = range(count, count + spare)
        self._extents = {cls: [self.object_numbers[node] for node in nodes] for cls, nodes in extents.items()}
        self._rows: dict[StaticRelation, list[Row]] = {}

    def rows(self, relation: StaticRelation) -> list[Row]:
        """Return the rows of a relation in the initial model; each relation is evaluated once and cached."""
        if relation not in self._rows:
            self._rows[relation] = self._evaluated(relation)
        return self._rows[relation]

    def _evaluated(self, relation: StaticRelation) -> list[Row]:
        graph, ids = self.model.graph, self.object_ids
        match relation:
            case ClassInstances(cls, exact):
                return [(number,) for number in self.extent(cls, exact)]
            case FeatureRows(Reference() as reference):
                targets, numbers = graph.store.forward[reference.index], self.extent(reference.owner)
                return [(one, self.object_numbers[other]) for one in numbers for other in targets[ids[one]]]
            case FeatureRows(attribute):
                assert isinstance(attribute, Attribute)
                numbers, type_ = self.extent(attribute.owner), attribute.type
                return [(n, self.encode(value, type_)) for n in numbers for value in graph.values(ids[n], attribute)]
            case PatternMatches(pattern):
                return self._match_rows(pattern)
            case ClosurePairs(step, star):
                return self._closure_rows(step, star)

    def extent(self, cls: str, exact: bool = False) -> list[int]:
        """Return the numbers of the objects of a class, ascending; `exact` excludes objects of its subclasses."""
        classes = (cls,) if exact else self.metamodel.concrete_classes(cls)
        return sorted(number for one in classes for number in self._extents.get(one, ()))

    def encode(self, value: Value | None, type_: StaticType) -> Cell:
        """Return the number that represents a value of the type in a state."""
        if value is None:
            return missing_value(type_)
        match type_:
            case ObjectType():
                return self.object_numbers[value]  # type: ignore[index]
            case EnumType():
                return literal_ranks(type_)[str(value)]
            case Scalar.STRING:
                return self.family.strings.setdefault(str(value), NO_OBJECT)  # a query has computed it
            case Scalar.FLOAT:
                return float(value)
            case Scalar.INT:
                return check_int_range(int(value))
            case _:
                return int(value)

    def decode(self, value: Cell, type_: StaticType) -> Value | None:
        """Return the value that a number of a state represents, or None if the number represents a missing value."""
        if value == missing_value(type_) or value != value:  # noqa: PLR0124
            return None
        match type_:
            case ObjectType():
                return self.object_ids[int(value)]
            case EnumType():
                return sorted(type_.literals)[int(value)]
            case Scalar.STRING:
                return next(text for text, number in self.family.strings.items() if number == value)
            case Scalar.FLOAT:
                return float(value)
            case Scalar.BOOL:
                return bool(value)
            case _:
                return int(value)

    def attribute_value(self, number: int, attribute: Attribute) -> Cell:
        """Return the initial value of an object's attribute as a number; reserved numbers have the missing value."""
        if number in self.reserved_numbers:
            return missing_value(attribute.type)
        return self.encode(self.model.graph.value(self.object_ids[number], attribute), attribute.type)

    def _match_rows(self, pattern: str) -> list[Row]:
        """Return the matches of a pattern in the initial model, as numbers. Add the pattern to the engine if necessary.

        Computed strings that the family has no number for are added to `strings` as `NO_OBJECT`.
        """
        types = self.family.patterns.library.parameter_types(pattern)
        try:
            self.engine.library.get(pattern)
        except InvalidArgument:  # helper patterns of paths may not be added yet
            self.engine.add(self.family.patterns.library.get(pattern))
        return [tuple(map(self.encode, row, types)) for row in self.engine.matcher.prepare(pattern, ())()]

    def _closure_rows(self, step: str, star: bool) -> list[Row]:
        """Return the transitive closure of the binary pattern `step`; `star` adds (x, x) for each object x."""
        following: dict[Cell, list[Cell]] = {}
        for source, target in self._match_rows(step):
            following.setdefault(source, []).append(target)
        found: dict[Row, None] = {}
        for source, targets in following.items():
            reached = reachable_nodes(targets, lambda node: following.get(node, ()))
            found.update(((source, node), None) for node in reached)
        if star:
            type_ = self.family.patterns.library.parameter_types(step)[0]
            assert isinstance(type_, ObjectType)
            found.update(((node, node), None) for node in self.extent(type_.cls))
        return list(found)


class MemberEngines(NamedTuple):
    """Access to the initial states of the members of a family, by number from 0.

    Attributes:
        read: returns an engine in a member's initial state, until another member is read.
        make: returns an engine of which only its user changes the model.
        order: the numbers of all members, in the order in which they are read fastest.
    """

    read: Callable[[int], Engine]
    make: Callable[[int], Engine]
    order: Sequence[int]

    @classmethod
    def of_list(cls, engines: Sequence[Engine]) -> MemberEngines:
        """Return access to the members with these engines, whose models stay in their initial states."""
        return cls(engines.__getitem__, lambda number: engines[number].copy(), range(len(engines)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the data to pickle, an engine of each member."""
        return MemberEngines.of_list, ([self.make(number) for number in range(len(self.order))],)


@dataclass(frozen=True, eq=False)
class ProgramMembers:
    """The members of a program. Each is read again when it is needed, so that memory need not hold all of them.

    Attributes:
        engines: access to their initial states.
        patterns: an engine with the patterns of the program.
        keys: the indices of objects over the family.
        strings: the number of each string of the family, in alphabetical order.
        created: the concrete classes whose objects rules create.
        spare: how many numbers are reserved for these objects.
    """

    engines: MemberEngines
    patterns: Engine
    keys: KeyIndex
    strings: dict[str, int] = field(default_factory=dict)
    created: frozenset[str] = frozenset()
    spare: int = 0

    def __len__(self) -> int:
        return len(self.engines.order)

    def __getitem__(self, number: int) -> MemberData:
        return MemberData(self.engines.read(number), self)

    def read_all(self) -> Iterator[tuple[int, MemberData]]:
        """Yield each member with its number. Its relations can only be read until the next one is requested."""
        return ((number, self[number]) for number in self.engines.order)


def check_int_range(value: int) -> int:
    """Return the int unchanged.

    Raises:
        NotCompiled: the int represents a missing value.
    """
    if value == NO_INT:
        raise NotCompiled(f"the int {value}, which represents a missing value")
    return value


def strings_in_model(engine: Engine) -> set[str]:
    """Return all attribute values of type string in the engine's model."""
    model = engine.model
    found: set[str] = set()
    for attribute in model.metamodel.attributes:
        if attribute.type is Scalar.STRING:
            for node in model.graph.extent(attribute.owner):
                found.update(map(str, model.graph.values(node, attribute)))
    return found
