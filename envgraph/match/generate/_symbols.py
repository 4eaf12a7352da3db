"""Symbols: descriptions of the values that generated source gets as parameters."""

from __future__ import annotations

from enum import Enum, StrEnum
from typing import Literal as OneOf

from envgraph.code import Function, dataclass, print_source
from envgraph.match.plan._search_plan import PatternQuery
from envgraph.pattern import Closure, ClosureAtom


class ResultMode(StrEnum):
    """The kind of result of a generated function."""

    ROWS = "rows"
    """A list of matches, as tuples of all parameters."""
    VALUES = "values"
    """A list of the wanted values: bare values if one position is wanted, else tuples."""
    BAG = "bag"
    """A list with the value at the last wanted position of each match."""
    EXISTS = "exists"
    """True if there is a match."""
    COUNT = "count"
    """The number of matches."""
    FIRST = "first"
    """The first match of `ROWS`, or None."""
    EACH = "each"
    """An iterator over the matches of `ROWS` that finds each match on demand."""


@dataclass(frozen=True, slots=True)
class StoreColumn:
    """A list of the store: the class index of each object, an extent of one class, or the values or ends of a feature.

    An extent has only direct instances. A many-valued attribute gives its distinct values.
    """

    kind: OneOf["classes", "extents", "values", "forward", "backward"]
    index: int = 0


@dataclass(frozen=True, slots=True)
class ClassTable:
    """A tuple of bools: for each class index, True if the class is `cls` or one of its subclasses."""

    cls: str


@dataclass(frozen=True, slots=True)
class Valued:
    """An index of the objects of some classes by attribute values or, without attributes, by computed values.

    Classes and attributes are given by their indices.

    Attributes:
        operators, is_local: see `ValueIndex`.
        number: distinguishes the indexes by computed values.
    """

    classes: tuple[int, ...]
    attributes: tuple[int, ...] = ()
    operators: tuple[str, ...] = ()
    is_local: bool = True
    number: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ConstantSymbol:
    """A constant of a pattern, or a user function that it calls. Compared by identity, as 1, 1.0 and True are equal."""

    value: object


@dataclass(frozen=True, slots=True)
class PatternFunction:
    """The generated function of a pattern query."""

    key: PatternQuery
    mode: ResultMode


@dataclass(frozen=True, slots=True)
class RecursiveFunction:
    """The function that returns all matches of a recursive pattern for values at the bound positions."""

    pattern: str
    bound: tuple[int, ...]


class ClosureQuestion(Enum):
    """The question that a closure function answers, from a source or (backward) from a target."""

    ALL = "all"
    """All nodes reached from a start."""
    REACHES = "holds"
    """True if a source reaches a target."""
    PAIRS = "pairs"
    """All pairs of a source and a reached target."""
    NEW_NODES = "spread"
    """The nodes reached from a start, without those reached from earlier starts."""
    STEP = "step"
    """The nodes that one step leads to."""
    REACHES_ANY = "join"
    """True if at least one of several ends is reached."""
    SHARED_VALUE = "alike"
    """A value that depends on the start only through the set of reached nodes."""
    SIZE = "size"
    """The number of reached nodes."""


@dataclass(frozen=True, slots=True)
class ClosureFunction:
    """The function that answers a question about the closure of a binary pattern.

    `reflexive` is True for `*`, and `forward` is True if the search starts at the source.
    """

    step: str
    reflexive: bool
    question: ClosureQuestion
    forward: bool = True


def closure_function(closure: ClosureAtom, question: ClosureQuestion, forward: bool = True) -> ClosureFunction:
    """Return the symbol of the function that answers a question about the closure in a goal."""
    return ClosureFunction(closure.step, closure.closure is Closure.STAR, question, forward)


@dataclass(frozen=True, slots=True)
class ReachAggregateSymbol:
    """The computation of an aggregate from the set of nodes that a closure in a pattern reaches.

    Attributes:
        pattern, start, given, wanted: see `Ends` in `envgraph.match.plan._shared_searches`.
        function: count, sum, avg, min or max.
        column: the wanted position that is aggregated; None for count.
    """

    pattern: str
    start: int
    given: tuple[int, ...]
    wanted: tuple[int, ...]
    function: str
    column: int | None


@dataclass(frozen=True, slots=True)
class Builtin:
    """A function of this package or the standard library, by name."""

    name: str


@dataclass(frozen=True, slots=True)
class MatchLimitCheck:
    """A function that raises an error if a pattern has too many matches: see `at_most`."""

    pattern: str
    counts_failures: bool = False


@dataclass(frozen=True, slots=True)
class OperatorSymbol:
    """A data structure or method of a view operator: its kind `kind`, the operator's name, and row positions."""

    kind: str
    name: str
    positions: tuple[int, ...] = ()


Symbol = (
    MatchLimitCheck
    | Builtin
    | ClassTable
    | ClosureFunction
    | StoreColumn
    | OperatorSymbol
    | ConstantSymbol
    | RecursiveFunction
    | ReachAggregateSymbol
    | Valued
    | PatternFunction
)


@dataclass(frozen=True, slots=True)
class GeneratedSource:
    """Generated source: a function `build` that takes the values of its symbols and returns the specialised function.

    Attributes:
        build: the function as a syntax tree; equal plans give equal trees.
        symbols: for each parameter of `build` its name and the symbol that it stands for.
    """

    build: Function
    symbols: tuple[tuple[str, Symbol], ...]

    @property
    def text(self) -> str:
        """Return the source as Python text."""
        return print_source((self.build,)).text
