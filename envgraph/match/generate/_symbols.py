"""Symbols: descriptions of the values that generated source gets as parameters."""

from __future__ import annotations

from enum import Enum, StrEnum
from typing import Literal as OneOf

from envgraph.code import Function, dataclass, printed
from envgraph.match.plan._plan import ViewKey
from envgraph.pattern import Closure, ClosureAtom


class Mode(StrEnum):
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
class Column:
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
        operators, alone: see `ValueIndex`.
        number: distinguishes the indexes by computed values.
    """

    classes: tuple[int, ...]
    attributes: tuple[int, ...] = ()
    operators: tuple[str, ...] = ()
    alone: bool = True
    number: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Literal:
    """A constant of a pattern, or a user function that it calls. Compared by identity, as 1, 1.0 and True are equal."""

    value: object


@dataclass(frozen=True, slots=True)
class View:
    """The generated function of a pattern query."""

    key: ViewKey
    mode: Mode


@dataclass(frozen=True, slots=True)
class Recursive:
    """The function that returns all matches of a recursive pattern for values at the bound positions."""

    pattern: str
    bound: tuple[int, ...]


class ClosureQuestion(Enum):
    """The question that a closure function answers, from a source or (backward) from a target."""

    ALL = "all"
    """All nodes reached from a start."""
    HOLDS = "holds"
    """True if a source reaches a target."""
    PAIRS = "pairs"
    """All pairs of a source and a reached target."""
    SPREAD = "spread"
    """The nodes reached from a start, without those reached from earlier starts."""
    STEP = "step"
    """The nodes that one step leads to."""
    JOIN = "join"
    """True if at least one of several ends is reached."""
    ALIKE = "alike"
    """A value that depends on the start only through the set of reached nodes."""
    SIZE = "size"
    """The number of reached nodes."""


@dataclass(frozen=True, slots=True)
class Closed:
    """The function that answers a question about the closure of a binary pattern.

    `reflexive` is True for `*`, and `forward` is True if the search starts at the source.
    """

    step: str
    reflexive: bool
    question: ClosureQuestion
    forward: bool = True


def closed(closure: ClosureAtom, question: ClosureQuestion, forward: bool = True) -> Closed:
    """Return the symbol of the function that answers a question about the closure in a goal."""
    return Closed(closure.step, closure.closure is Closure.STAR, question, forward)


@dataclass(frozen=True, slots=True)
class Aggregated:
    """The computation of an aggregate from the set of nodes that a closure in a pattern reaches.

    Attributes:
        pattern, start, given, wanted: see `Ends` in `envgraph.match.plan._sharing`.
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
class Bounded:
    """A function that raises an error if a pattern has too many matches: see `at_most`."""

    pattern: str
    searched: bool = False


@dataclass(frozen=True, slots=True)
class Held:
    """A data structure or method of a view operator: its kind `what`, the operator's name, and row positions."""

    what: str
    name: str
    positions: tuple[int, ...] = ()


Symbol = (
    Bounded | Builtin | ClassTable | Closed | Column | Held | Literal | Recursive | Aggregated | Valued | View
)


@dataclass(frozen=True, slots=True)
class Source:
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
        return printed((self.build,)).text
