"""Nodes of the syntax tree of generated code. Nodes are equal if they have equal types and fields, except origins."""

from __future__ import annotations

from dataclasses import field
from typing import Literal, TypeAlias

from envgraph.code._data_classes import dataclass

# --- expressions


@dataclass(frozen=True, slots=True)
class Name:
    """A reference to a value of the namespace, or to another function defined with this one."""

    name: str


@dataclass(frozen=True, slots=True)
class Local:
    """A local variable of the generated function.

    Attributes:
        name: differs from the name of every `Name`.
        type: "object", "bool", "int", "float" or "string"; "" for collections and all other values.
    """

    name: str
    type: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Constant:
    """A literal number, bool or None. Strings and other objects must be values of the namespace (`Name`)."""

    value: int | float | bool | None

    def __eq__(self, other: object) -> bool:
        """Compare type and value, so that `Constant(1)` differs from `Constant(True)`."""
        return isinstance(other, Constant) and (type(self.value), self.value) == (
            type(other.value),
            other.value,
        )

    def __hash__(self) -> int:
        return hash(self.value)


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function with positional arguments."""

    function: Expression
    arguments: tuple[Expression, ...] = ()


@dataclass(frozen=True, slots=True)
class Subscript:
    """A subscript expression, `collection[key]`."""

    collection: Expression
    key: Expression


@dataclass(frozen=True, slots=True)
class AttributeAccess:
    """An attribute access, `object.name`; methods are called through it."""

    object: Expression
    name: str


@dataclass(frozen=True, slots=True)
class Tuple:
    """A tuple expression, `(a, b)`."""

    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Operation:
    """A Python operator with its operands: one for `not`, one or more for `-`, two or more for all others."""

    operator: str
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class ConditionalExpression:
    """A conditional expression, `then if test else otherwise`."""

    test: Expression
    then: Expression
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class AssignmentExpression:
    """An assignment expression, `(local := value)`."""

    local: Local
    value: Expression


@dataclass(frozen=True, slots=True)
class DictExpression:
    """A dict expression, `{key: value, ..}`."""

    items: tuple[tuple[Expression, Expression], ...]


@dataclass(frozen=True, slots=True)
class Comprehension:
    """A list comprehension with an optional filter, or a generator expression if `is_lazy` is True (evaluated
    lazily).
    """

    value: Expression
    target: Local
    elements: Expression
    test: Expression | None = None
    is_lazy: bool = False


@dataclass(frozen=True, slots=True)
class Lambda:
    """A lambda expression."""

    parameters: tuple[Local, ...]
    value: Expression


@dataclass(frozen=True, slots=True)
class PythonText:
    """Python source text of an expression, put into the code as it is; never text from users.

    Attributes:
        text: an atomic expression, or one in parentheses.
        reads, writes: the local variables that the text reads and assigns.
    """

    text: str
    reads: tuple[Local, ...] = ()
    writes: tuple[Local, ...] = ()


Expression: TypeAlias = (
    "Name | Local | Constant | Call | Subscript | AttributeAccess | Tuple | Operation | "
    "ConditionalExpression | AssignmentExpression "
    "| DictExpression | Comprehension | Lambda | PythonText"
)

# --- statements


@dataclass(frozen=True, slots=True)
class Assign:
    """An assignment statement, also augmented (`+=`); a `Tuple` as the target unpacks the value."""

    target: Local | Name | Subscript | AttributeAccess | Tuple
    value: Expression
    operator: Literal["=", "+=", "-=", "|="] = "="
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ExpressionStatement:
    """An expression statement: the value is computed for its side effect and discarded."""

    value: Expression
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class If:
    """An `if` statement with an optional `else`."""

    test: Expression
    then: Body
    otherwise: Body = ()
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class For:
    """A `for` loop."""

    target: Local | Tuple
    iterable: Expression
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class While:
    """A `while` loop."""

    test: Expression
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class BreakOrContinue:
    """A `break` or `continue` statement."""

    keyword: Literal["break", "continue"]
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Return:
    """A `return` statement, with or without a value."""

    value: Expression | None = None
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Yield:
    """A `yield` statement, or `yield from` if `is_from` is True."""

    value: Expression
    is_from: bool = False
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Raise:
    """A `raise` statement; without a value the exception being handled is raised again."""

    value: Expression | None = None
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ExceptClause:
    """An `except` clause of a `Try`; `name` is the variable of the exception, or None."""

    error: Name
    name: Local | None
    body: Body


@dataclass(frozen=True, slots=True)
class Try:
    """A `try` statement with its `except` clauses, in order."""

    body: Body
    handlers: tuple[ExceptClause, ...]
    origin: object = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Function:
    """A `def` statement that defines a function."""

    name: str
    parameters: tuple[Local | Name, ...]
    body: Body
    origin: object = field(default=None, compare=False, repr=False)


Statement: TypeAlias = (
    "Assign | ExpressionStatement | If | For | While | BreakOrContinue | Return | Yield | Raise | Try | Function"
)
Body: TypeAlias = tuple[Statement, ...]
