"""Variables, literals and expressions: the parts that queries, rules and behaviours share."""

from __future__ import annotations

from dataclasses import dataclass, field

from envgraph.errors import Span
from envgraph.metamodel import Value


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
    """`left operator right`; operators: `+ - * / % == != < <= > >= && ||`."""

    operator: str
    left: Expression
    right: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Conditional:
    """`test ? then : otherwise`; only the chosen branch is evaluated."""

    test: Expression
    then: Expression
    otherwise: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class FunctionCall:
    """`function(arguments)`, of the standard library of expressions."""

    function: str
    arguments: tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    function_span: Span | None = field(default=None, compare=False, repr=False)


Expression = Variable | Constant | EnumLiteral | Navigation | Unary | Binary | Conditional | FunctionCall
