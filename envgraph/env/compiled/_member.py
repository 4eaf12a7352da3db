"""A member of a family as data: its objects numbered, and what is asked about them once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias

from envgraph import code
from envgraph.behaviour import KeyIndex
from envgraph.env.compiled._refused import NotCompiled
from envgraph.errors import InvalidArgument
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar, Value
from envgraph.pattern import Library, ObjectType, StaticType
from envgraph.rewrite import Engine

NO_OBJECT = -1
NO_INT = -(2**31)
"""Stands for the absence of an int; ints in states have 32 bits."""
MOST_INT = 2**31 - 1
SPARE = 64
"""How many objects there may be that rules have created, where nobody says it."""

Cell: TypeAlias = "int | float"
Row: TypeAlias = "tuple[Cell, ...]"


class Relation(Protocol):
    """Something that can be asked of a member."""

    def rows(self, member: Member) -> list[Row]:
        """The tuples."""

    def __hash__(self) -> int: ...


def absent(type_: StaticType) -> code.Expression:
    """Code for the absence of a value."""
    return code.Name("NAN") if type_ is Scalar.FLOAT else code.Constant(int(missing(type_)))


def missing(type_: StaticType) -> Cell:
    """What stands for the absence of a value."""
    if type_ is Scalar.FLOAT:
        return float("nan")
    return NO_INT if type_ is Scalar.INT else NO_OBJECT


def ranks(type_: EnumType) -> dict[str, int]:
    """The number of each literal: in alphabetical order, in which rows are sorted."""
    return {literal: rank for rank, literal in enumerate(sorted(type_.literals))}


class Borrowed(NamedTuple):
    """How to come to the initial state of a member whose engine is that of others, too.

    Attributes:
        engine: takes the engine there, until somebody takes it to another member.
        own: makes an engine that is the member's alone.
    """

    engine: Callable[[], Engine]
    own: Callable[[], Engine]


class Member:
    """The initial state of one member, with its objects numbered in the order of their ids.

    Args:
        home: an engine whose model is that state, now and whenever something is asked; a borrowed one is asked after
            `arrive` alone.
        keys: the indices of objects over the family.
        library: of the domain: has the patterns that are asked about.

    Attributes:
        objects: the ids of those that are there, by number.
        texts: the strings in the model.
        strings: number of each string that the family has, in alphabetical order.
        created: the concrete classes of objects that rules create.
        spare: the numbers of those that rules may create: they are in none of the extents.
    """

    def __init__(self, home: Engine | Borrowed, keys: KeyIndex, library: Library) -> None:
        self._home = home
        self.engine = engine = home if isinstance(home, Engine) else home.engine()
        self.keys = keys
        self.model = engine.model
        self.metamodel = engine.model.metamodel
        concrete = [cls.name for cls in self.metamodel.class_list if not cls.abstract]
        extents = {cls: sorted(self.model.graph.exact_extent(cls)) for cls in concrete}
        self.objects = sorted(node for nodes in extents.values() for node in nodes)
        self.number = {node: number for number, node in enumerate(self.objects)}
        self.texts = strings_of(engine)
        self.strings: dict[str, int] = {}
        self.created: frozenset[str] = frozenset()
        self.spare = range(len(self.objects), len(self.objects))
        self._extents = {cls: [self.number[node] for node in nodes] for cls, nodes in extents.items()}
        self._library = library
        self._rows: dict[Relation, list[Row]] = {}

    def within(self, strings: dict[str, int], created: frozenset[str], spare: int) -> Member:
        """The same in a family and a program, whose rules may create so many objects of some classes."""
        other = self.with_spare(spare if created else 0)
        other.strings, other.created, other._rows = strings, created, {}
        return other

    def arrive(self) -> Member:
        """Take the engine to the initial state, if others use it, too."""
        if isinstance(self._home, Borrowed) and self.engine:
            self._home.engine()
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Return what `pickle` keeps: the model, what was asked of it, and bytes from which an engine can be made."""
        engine = self.own_engine()
        own = partial(pickle.loads, pickle.dumps(engine))
        changed = {"_home": Borrowed(own, own), "engine": None, "_library": None, "model": engine.model}
        return {**vars(self), **changed}

    def own_engine(self) -> Engine:
        """An engine in the initial state that may be changed."""
        return self._home if isinstance(self._home, Engine) else self._home.own()

    def with_spare(self, spare: int) -> Member:
        """The same with space for so many new objects."""
        other = Member.__new__(Member)
        vars(other).update(vars(self))
        other.spare = range(len(self.objects), len(self.objects) + spare)
        return other

    @property
    def size(self) -> int:
        """How many objects there may be."""
        return self.spare.stop

    def rows(self, relation: Relation) -> list[Row]:
        """The tuples of a relation, asked for once."""
        if relation not in self._rows:
            self._rows[relation] = relation.rows(self)
        return self._rows[relation]

    def extent(self, cls: str, exact: bool = False) -> list[int]:
        """The objects of a class, ascending."""
        classes = (cls,) if exact else self.metamodel.concrete(cls)
        return sorted(number for one in classes for number in self._extents.get(one, ()))

    def encoded(self, value: Value | None, type_: StaticType) -> Cell:
        """The number for a value."""
        if value is None:
            return missing(type_)
        match type_:
            case ObjectType():
                return self.number[value]  # type: ignore[index]
            case EnumType():
                return ranks(type_)[str(value)]
            case Scalar.STRING:
                return self.strings[str(value)]
            case Scalar.FLOAT:
                return float(value)
            case Scalar.INT:
                return checked(int(value))
            case _:
                return int(value)

    def decoded(self, value: Cell, type_: StaticType) -> Value | None:
        """The value that a number stands for."""
        if value == missing(type_) or value != value:  # noqa: PLR0124
            return None
        match type_:
            case ObjectType():
                return self.objects[int(value)]
            case EnumType():
                return sorted(type_.literals)[int(value)]
            case Scalar.STRING:
                return next(text for text, number in self.strings.items() if number == value)
            case Scalar.FLOAT:
                return float(value)
            case Scalar.BOOL:
                return bool(value)
            case _:
                return int(value)

    def value(self, number: int, attribute: Attribute) -> Cell:
        """The value of an object in an attribute."""
        if number in self.spare:
            return missing(attribute.type)
        return self.encoded(self.model.graph.value(self.objects[number], attribute), attribute.type)

    def links(self, feature: Reference | Attribute) -> list[Row]:
        """The links of a reference, or an object with each of its values."""
        found: list[Row] = []
        if isinstance(feature, Reference):
            targets = self.model.graph.store.forward[feature.index]
            numbers = self.extent(feature.owner)
            return [(one, self.number[other]) for one in numbers for other in targets[self.objects[one]]]
        for number in self.extent(feature.owner):
            node = self.objects[number]
            if feature.many:
                values: Sequence[Value] = self.model.graph.values(node, feature)
                found += [(number, self.encoded(value, feature.type)) for value in values]
            elif self.model.graph.value(node, feature) is not None:
                found.append((number, self.value(number, feature)))
        return found

    def matches(self, pattern: str) -> list[Row]:
        """The matches of a pattern."""
        types = self._library.parameter_types(pattern)
        if not self._knows(pattern):
            self.engine.add(self._library.get(pattern))
        rows = self.engine.matcher.prepare(pattern, ())()
        if any(
            type_ is Scalar.STRING and any(row[place] not in self.strings for row in rows)
            for place, type_ in enumerate(types)
        ):
            raise NotCompiled(f"strings that a query makes (`{pattern}`)", self._library.get(pattern).span)
        return [tuple(map(self.encoded, row, types)) for row in rows]

    def _knows(self, pattern: str) -> bool:
        """Whether the engine has a pattern; those of paths come when what has the path is asked for."""
        try:
            self.engine.library.get(pattern)
        except InvalidArgument:
            return False
        return True

    def reached(self, step: str, star: bool) -> list[Row]:
        """The pairs of a closure."""
        following: dict[Cell, list[Cell]] = {}
        for source, target in self.matches(step):
            following.setdefault(source, []).append(target)
        found: dict[Row, None] = {}
        for source, targets in following.items():
            todo = list(dict.fromkeys(targets))
            seen = set(todo)
            for node in todo:
                found[source, node] = None
                new = [other for other in following.get(node, ()) if other not in seen]
                todo += dict.fromkeys(new)
                seen.update(new)
        if star:
            type_ = self._library.parameter_types(step)[0]
            assert isinstance(type_, ObjectType)
            found.update(((node, node), None) for node in self.extent(type_.cls))
        return list(found)


def checked(value: int) -> int:
    """An int that fits a state.

    Raises:
        NotCompiled: it does not.
    """
    if not NO_INT < value <= MOST_INT:
        raise NotCompiled(f"an int beyond 32 bits ({value})")
    return value


def strings_of(engine: Engine) -> set[str]:
    """The strings in a model."""
    model = engine.model
    found: set[str] = set()
    for attribute in model.metamodel.attributes:
        if attribute.type is Scalar.STRING:
            for node in model.graph.extent(attribute.owner):
                if attribute.many:
                    found.update(map(str, model.graph.values(node, attribute)))
                elif (value := model.graph.value(node, attribute)) is not None:
                    found.add(str(value))
    return found


def width(type_: StaticType) -> int | None:
    """How many values a type has, for a table by value; 0 for objects, of which the member knows; None: too many."""
    match type_:
        case ObjectType():
            return 0
        case EnumType():
            return len(type_.literals)
        case Scalar.BOOL:
            return 2
        case _:
            return None
