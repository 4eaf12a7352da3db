"""Symbols: what the names in generated source stand for."""

from __future__ import annotations

from enum import Enum, StrEnum
from typing import Literal as OneOf

from envgraph.code import Function, dataclass, printed
from envgraph.match.plan._plan import ViewKey
from envgraph.pattern import Closure, ClosureAtom


class Mode(StrEnum):
    """What a generated function returns."""

    ROWS = "rows"
    """A list of full tuples of parameters."""
    VALUES = "values"
    """A list of the wanted values: bare ones if one position is wanted, else tuples."""
    BAG = "bag"
    """A list of the value at the last wanted position of each match."""
    EXISTS = "exists"
    """Whether there is a match."""
    COUNT = "count"
    """The number of matches."""
    FIRST = "first"
    """The first of `ROWS`, or None."""
    EACH = "each"
    """An iterator over `ROWS` that looks for the next one when it is asked for."""


@dataclass(frozen=True, slots=True)
class Column:
    """A list of the store: class indices, or of one class or feature (by index) what there is of it.

    Values of an attribute with many are those that differ; extents are of exactly the class.
    """

    kind: OneOf["classes", "extents", "values", "forward", "backward"]
    index: int = 0


@dataclass(frozen=True, slots=True)
class ClassTable:
    """For each class index whether it is the class or one of its subclasses."""

    cls: str


@dataclass(frozen=True, slots=True)
class Valued:
    """An index of the objects of some classes by values: of attributes or, without attributes, of expressions.

    Classes and attributes are given by their indices.

    Attributes:
        operators, alone: see `ValueIndex`.
        number: distinguishes indexes by expressions.
    """

    classes: tuple[int, ...]
    attributes: tuple[int, ...] = ()
    operators: tuple[str, ...] = ()
    alone: bool = True
    number: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Literal:
    """A constant of the pattern, or a function that it calls. No two are equal: 1, 1.0 and True are different."""

    value: object


@dataclass(frozen=True, slots=True)
class View:
    """The generated function of a called pattern."""

    key: ViewKey
    mode: Mode


@dataclass(frozen=True, slots=True)
class Recursive:
    """Full rows of a pattern that calls itself, for values at the bound positions."""

    pattern: str
    bound: tuple[int, ...]


class ClosureQuestion(Enum):
    """What is asked of a closure: from a source, or, backward, from a target."""

    ALL = "all"
    """Everything that is reached."""
    HOLDS = "holds"
    """Whether a source reaches a target."""
    PAIRS = "pairs"
    """All pairs."""
    SPREAD = "spread"
    """Everything that is reached from here, and from no start before."""
    STEP = "step"
    """Where one step leads."""
    JOIN = "join"
    """Whether one of several ends is reached."""
    ALIKE = "alike"
    """A value that depends on what is reached, and on nothing else about the start."""
    SIZE = "size"
    """How much is reached."""


@dataclass(frozen=True, slots=True)
class Closed:
    """A question about the closure of a binary pattern; `reflexive` for `*`."""

    step: str
    reflexive: bool
    question: ClosureQuestion
    forward: bool = True


def closed(closure: ClosureAtom, question: ClosureQuestion, forward: bool = True) -> Closed:
    """A question about the closure of a goal."""
    return Closed(closure.step, closure.closure is Closure.STAR, question, forward)


@dataclass(frozen=True, slots=True)
class Aggregated:
    """How an aggregate is made of what a closure in a pattern reaches.

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
    """A function of this package, by name."""

    name: str


@dataclass(frozen=True, slots=True)
class Bounded:
    """A function that raises an error if it is given more than a pattern may have matches: see `at_most`."""

    pattern: str
    searched: bool = False


@dataclass(frozen=True, slots=True)
class Held:
    """Something that a view holds: `what` it is, of the view with this name, at these positions of its rows."""

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
        build: the function; the same plan always gives the same.
        symbols: what each parameter of `build` stands for.
    """

    build: Function
    symbols: tuple[tuple[str, Symbol], ...]

    @property
    def text(self) -> str:
        """The source as text."""
        return printed((self.build,)).text
