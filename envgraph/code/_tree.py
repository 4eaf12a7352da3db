"""The nodes of generated code. Equal nodes do the same; where they come from makes no difference."""

from __future__ import annotations

from dataclasses import field
from typing import Literal, TypeAlias

from envgraph.code._records import dataclass

# --- expressions


@dataclass(frozen=True, slots=True)
class Name:
    """Something from outside: a value of the namespace, or a function beside this one."""

    name: str


@dataclass(frozen=True, slots=True)
class Local:
    """A variable of the function.

    Attributes:
        name: unlike that of any `Name`.
        type: "object", "bool", "int", "float" or "string"; "" for collections and the like.
    """

    name: str
    type: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Constant:
    """A number, a truth value, or None. Texts and the like are values of the namespace."""

    value: int | float | bool | None

    def __eq__(self, other: object) -> bool:
        """As for other nodes; 1 and True are different."""
        return isinstance(other, Constant) and (type(self.value), self.value) == (
            type(other.value),
            other.value,
        )

    def __hash__(self) -> int:
        return hash(self.value)


@dataclass(frozen=True, slots=True)
class Call:
    """A function with arguments."""

    function: Expression
    arguments: tuple[Expression, ...] = ()


@dataclass(frozen=True, slots=True)
class Index:
    """The entry of a collection at a place, or under a key."""

    collection: Expression
    key: Expression


@dataclass(frozen=True, slots=True)
class Member:
    """A method, or another member, of a value."""

    object: Expression
    name: str


@dataclass(frozen=True, slots=True)
class Tuple:
    """Several values as one."""

    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator of Python with its operands: one for `not`, one or more for `-`, else two or more."""

    operator: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """`then if test else otherwise`."""

    test: Expression
    then: Expression
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class Let:
    """A value, which a variable gets on the way."""

    local: Local
    value: Expression


@dataclass(frozen=True, slots=True)
class Mapping:
    """Values by key."""

    items: tuple[tuple[Expression, Expression], ...]


@dataclass(frozen=True, slots=True)
class Each:
    """A list of something for each element that passes a test; if `late`, an iterator that looks when it is asked."""

    value: Expression
    target: Local
    elements: Expression
    test: Expression | None = None
    late: bool = False


@dataclass(frozen=True, slots=True)
class Lambda:
    """A function without a name."""

    parameters: tuple[Local, ...]
    value: Expression


@dataclass(frozen=True, slots=True)
class Text:
    """What only Python needs to understand: a text for it, without parts of any other text.

    Attributes:
        text: as an expression it is atomic, or in parentheses.
        reads, writes: local variables.
    """

    text: str
    reads: tuple[Local, ...] = ()
    writes: tuple[Local, ...] = ()


Expression: TypeAlias = (
    "Name | Local | Constant | Call | Index | Member | Tuple | Operation | Choice | Let "
    "| Mapping | Each | Lambda | Text"
)

# --- statements


@dataclass(frozen=True, slots=True)
class Assign:
    """Gives a value to a variable, an entry, or, with a `Tuple` of them, the items of a value to several."""

    target: Local | Name | Index | Member | Tuple
    value: Expression
    operator: Literal["=", "+=", "-=", "|="] = "="
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Do:
    """Computes a value for what that does."""

    value: Expression
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class If:
    """One thing where a test holds, another where it does not."""

    test: Expression
    then: Body
    otherwise: Body = ()
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class For:
    """Something for each element."""

    target: Local | Tuple
    iterable: Expression
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class While:
    """Something as long as a test holds."""

    test: Expression
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Leave:
    """Goes on behind the innermost loop, or with its next round."""

    how: Literal["break", "continue"]
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Return:
    """Ends the function."""

    value: Expression | None = None
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Yield:
    """Hands out a value, or `each` item of it."""

    value: Expression
    each: bool = False
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Raise:
    """Raises an error; without a value the one that is being handled."""

    value: Expression | None = None
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Handler:
    """What is done about an error, which gets a name if that is used."""

    error: Name
    name: Local | None
    body: Body


@dataclass(frozen=True, slots=True)
class Try:
    """Something, and something else where that raises an error: what the first handler for it says."""

    body: Body
    handlers: tuple[Handler, ...]
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Function:
    """Defines a function."""

    name: str
    parameters: tuple[Local | Name, ...]
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


Statement: TypeAlias = "Assign | Do | If | For | While | Leave | Return | Yield | Raise | Try | Function"
Body: TypeAlias = tuple[Statement, ...]
