"""What the names in generated source stand for."""

from __future__ import annotations

from enum import Enum, StrEnum

from envgraph.code import Function, dataclass, printed
from envgraph.match.plan._plan import ViewKey


class Mode(StrEnum):
    """What a generated function returns."""

    ROWS = "rows"
    """A list of full tuples of parameters."""
    VALUES = "values"
    """A list of the wanted values: bare ones if one position is wanted, else tuples."""
    EXISTS = "exists"
    """Whether there is a match."""
    COUNT = "count"
    """The number of matches."""
    FIRST = "first"
    """The first of `ROWS`, or None."""
    EACH = "each"
    """An iterator over `ROWS` that looks for the next one when it is asked for."""


@dataclass(frozen=True, slots=True)
class Classes:
    """The column of class indices."""


@dataclass(frozen=True, slots=True)
class ClassTable:
    """For each class index whether it is the class or one of its subclasses."""

    cls: str


@dataclass(frozen=True, slots=True)
class Members:
    """The extent of exactly this class (by index)."""

    index: int


@dataclass(frozen=True, slots=True)
class Values:
    """The column of an attribute (by index); of one with many values, those that differ."""

    index: int


@dataclass(frozen=True, slots=True)
class Forward:
    """The column of targets of a reference (by index)."""

    index: int


@dataclass(frozen=True, slots=True)
class Backward:
    """The column of sources of a reference (by index)."""

    index: int


@dataclass(frozen=True, slots=True)
class Valued:
    """The objects of some classes with given values in some attributes (all by index)."""

    classes: tuple[int, ...]
    attributes: tuple[int, ...]


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
    """What is asked of a closure."""

    FORWARD = "forward"
    """Everything that a source reaches."""
    BACKWARD = "backward"
    """Everything that reaches a target."""
    HOLDS = "holds"
    """Whether a source reaches a target."""
    PAIRS = "pairs"
    """All pairs."""
    SPREAD = "spread"
    """Everything that a source reaches and no source before it."""
    SPREAD_BACK = "spread back"
    """Everything that reaches a target and no target before it."""
    STEP = "step"
    """Where one step leads."""
    STEP_BACK = "step back"
    """Where one step comes from."""
    JOIN = "join"
    """Whether a source reaches one of several targets."""
    JOIN_BACK = "join back"
    """Whether a target is reached by one of several sources."""
    ALIKE = "alike"
    """A value that depends on what a source reaches, and on nothing else about it."""
    ALIKE_BACK = "alike back"
    """A value that depends on what reaches a target, and on nothing else about it."""
    SIZE = "size"
    """How much a source reaches."""
    SIZE_BACK = "size back"
    """How much reaches a target."""


@dataclass(frozen=True, slots=True)
class Closed:
    """A closure of a binary pattern; `reflexive` for `*`."""

    step: str
    reflexive: bool
    question: ClosureQuestion


@dataclass(frozen=True, slots=True)
class Tallied:
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
    Bounded
    | Classes
    | ClassTable
    | Members
    | Values
    | Forward
    | Backward
    | Valued
    | Literal
    | View
    | Recursive
    | Closed
    | Tallied
    | Builtin
    | Held
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
