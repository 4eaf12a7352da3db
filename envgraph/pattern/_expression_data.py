"""Variables, literals and expressions: the parts that queries, rules and behaviours share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Final

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Value

if TYPE_CHECKING:
    from envgraph.pattern._declared_functions import DeclaredFunction

_CHAIN_LEVELS: Final = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "&&": 3, "||": 4}
"""Operators with the same number form a chain without brackets: `a - b + c`."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable, parameter or object name.

    `_` is a different variable at every occurrence. A name that starts with `_` is for a variable used once.
    """

    name: str
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def is_anonymous(self) -> bool:
        """Return True if the name is `_`."""
        return self.name == "_"


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, truth value or string. The value None is `none`, the absence of a value."""

    value: Value | None
    span: Span | None = field(default=None, compare=False, repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Constant) and (type(self.value), self.value) == (type(other.value), other.value)

    def __hash__(self) -> int:
        return hash(self.value)


@dataclass(frozen=True, slots=True)
class EnumLiteral:
    """A literal `Enum::literal`, or `::literal` (enum None), whose enum follows from the context."""

    enum: str | None
    literal: str
    span: Span | None = field(default=None, compare=False, repr=False)
    enum_span: Span | None = field(default=None, compare=False, repr=False)
    literal_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Navigation:
    """A path step `object.feature`: the value of an attribute, or the target of a single-valued reference."""

    object: Expression
    feature: str
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Unary:
    """An expression `-x` or `!x`."""

    operator: str
    operand: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Binary:
    """An expression `left operator right`; operators: `+ - * / % == != < <= > >= && ||`.

    A long sum is thousands of these expressions, each the left side of the next. Methods visit left sides in a loop,
    because recursion would exhaust the stack.
    """

    operator: str
    left: Expression
    right: Expression
    span: Span | None = field(default=None, compare=False, repr=False)

    def __eq__(self, other: object) -> bool:
        one: object = self
        while isinstance(one, Binary) and isinstance(other, Binary):
            if one is other:
                return True
            if one.operator != other.operator or one.right != other.right:
                return False
            one, other = one.left, other.left
        return one == other if one is not self else NotImplemented

    def __hash__(self) -> int:
        first, links = self._left_spine()
        return hash((first, *((link.operator, link.right) for link in links)))

    def __repr__(self) -> str:
        first, links = self._left_spine()
        opening = "".join(f"Binary(operator={link.operator!r}, left=" for link in reversed(links))
        return opening + repr(first) + "".join(f", right={link.right!r})" for link in links)

    def _left_spine(self) -> tuple[Expression, list[Binary]]:
        """Return the leftmost operand of nested left sides, and the expressions from the innermost to this one."""
        links = [self]
        while isinstance(links[-1].left, Binary):
            links.append(links[-1].left)
        return links[-1].left, links[::-1]

    def chain(self) -> tuple[Expression, list[Binary]]:
        """Return the first operand of a chain such as `a + b - c`, and the expressions that end with `+ b` and `- c`.

        A chain consists of operators of equal precedence without brackets. A comparison is a chain of one expression.
        """
        links, kind = [self], _CHAIN_LEVELS.get(self.operator)
        while kind is not None and isinstance(links[-1].left, Binary):
            if _CHAIN_LEVELS.get(links[-1].left.operator) != kind:
                break
            links.append(links[-1].left)
        return links[-1].left, links[::-1]


@dataclass(frozen=True, slots=True)
class Conditional:
    """An expression `test ? then : otherwise`. Only the chosen branch is evaluated."""

    test: Expression
    then: Expression
    otherwise: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class FunctionCall:
    """A call `function(arguments)` of a built-in or declared function.

    Attributes:
        owner: the Java class before the function, as in `Math.abs(x)`, if the function is not built in; else None.
        declared: the declared functions of the engine by name, set by `Library.resolved`; None before.
    """

    function: str
    arguments: tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    function_span: Span | None = field(default=None, compare=False, repr=False)
    owner: str | None = field(default=None, compare=False, repr=False)
    declared: Mapping[str, Any] | None = field(default=None, compare=False, repr=False)

    @property
    def declaration(self) -> DeclaredFunction | None:
        """Return the declared function that is called. None for a built-in or unknown function."""
        return None if self.declared is None else self.declared.get(self.function)


Expression = Variable | Constant | EnumLiteral | Navigation | Unary | Binary | Conditional | FunctionCall
