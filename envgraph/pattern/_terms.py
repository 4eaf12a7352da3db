"""Variables, literals and expressions: the parts that queries, rules and behaviours share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Final

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Value

if TYPE_CHECKING:
    from envgraph.pattern._functions import DeclaredFunction

_CHAINS: Final = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "&&": 3, "||": 4}
"""The operators of one number follow each other without brackets: `a - b + c`."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable, parameter or object name.

    `_` is a different variable at every place; a name that starts with `_` is meant to be used once.
    """

    name: str
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def anonymous(self) -> bool:
        """Whether this is `_`."""
        return self.name == "_"


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, truth value or string; None is `none`, the absence of a value."""

    value: Value | None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class EnumLiteral:
    """`Enum::literal`, or `::literal` (enum None) where the type follows from the place."""

    enum: str | None
    literal: str
    span: Span | None = field(default=None, compare=False, repr=False)
    enum_span: Span | None = field(default=None, compare=False, repr=False)
    literal_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Navigation:
    """`object.feature`: the value of an attribute, or the target of a single-valued reference."""

    object: Expression
    feature: str
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Unary:
    """`-x` or `!x`."""

    operator: str
    operand: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Binary:
    """`left operator right`; operators: `+ - * / % == != < <= > >= && ||`.

    A long sum is thousands of these, each the left side of the next: what is asked of one goes down its left sides in
    a loop, because recursion would exhaust the stack.
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
        first, links = self._down()
        return hash((first, *((link.operator, link.right) for link in links)))

    def __repr__(self) -> str:
        first, links = self._down()
        opening = "".join(f"Binary(operator={link.operator!r}, left=" for link in reversed(links))
        return opening + repr(first) + "".join(f", right={link.right!r})" for link in links)

    def _down(self) -> tuple[Expression, list[Binary]]:
        """The leftmost operand of all, and the nodes above it, innermost first."""
        links = [self]
        while isinstance(links[-1].left, Binary):
            links.append(links[-1].left)
        return links[-1].left, links[::-1]

    def chain(self) -> tuple[Expression, list[Binary]]:
        """Return the start of `a + b - c`, and the nodes for `+ b` and `- c`; without precedence and brackets no more.

        Comparisons are no chains: of those, there is one node.
        """
        links, kind = [self], _CHAINS.get(self.operator)
        while kind is not None and isinstance(links[-1].left, Binary):
            if _CHAINS.get(links[-1].left.operator) != kind:
                break
            links.append(links[-1].left)
        return links[-1].left, links[::-1]


@dataclass(frozen=True, slots=True)
class Conditional:
    """`test ? then : otherwise`; only the chosen branch is evaluated."""

    test: Expression
    then: Expression
    otherwise: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class FunctionCall:
    """`function(arguments)`, of the standard library of expressions, or of a function that is declared.

    Attributes:
        owner: the class of Java that stands before it, where the library has no such function.
        declared: functions of the engine that the call was added to, by name; put there by `Library.resolved`.
    """

    function: str
    arguments: tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    function_span: Span | None = field(default=None, compare=False, repr=False)
    owner: str | None = field(default=None, compare=False, repr=False)
    declared: Mapping[str, Any] | None = field(default=None, compare=False, repr=False)

    @property
    def declaration(self) -> DeclaredFunction | None:
        """What it calls, unless that is a function of the standard library, or unknown."""
        return None if self.declared is None else self.declared.get(self.function)


Expression = Variable | Constant | EnumLiteral | Navigation | Unary | Binary | Conditional | FunctionCall
