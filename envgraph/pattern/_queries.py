"""Graph queries as frozen data: patterns, bodies, constraints.

Names of classes, features and patterns are plain strings; `check_pattern` says which of them mean nothing.
"""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern._terms import Constant, EnumLiteral, Expression, Variable

Strategy = Literal["incremental", "search"]


class Closure(StrEnum):
    """How often a binary relation is followed: once, at least once, or any number of times."""

    ONCE = ""
    PLUS = "+"
    STAR = "*"


@dataclass(frozen=True, slots=True)
class Hash:
    """`#` or `#name`: the column that sum, min, max and avg aggregate; the name only tells the reader what it is."""

    span: Span | None = field(default=None, compare=False, repr=False)
    name: str | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """`eval(expression)`, standing where a variable may stand."""

    expression: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Aggregate:
    """`count find p(..)`, `sum Type.f(_, #)` ..., standing where a variable may stand."""

    function: Literal["count", "sum", "min", "max", "avg"]
    over: Relation
    span: Span | None = field(default=None, compare=False, repr=False)


Term = Variable | Constant | EnumLiteral | Evaluation | Aggregate | Hash


@dataclass(frozen=True, slots=True)
class TypeConstraint:
    """`Type(term)`: the term is an instance of a class, subclasses included, or of an enum.

    `exact` leaves subclasses out; no text spells it, derived rules use it.
    """

    type: str
    term: Term
    exact: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class PathConstraint:
    """`Type.f1.f2(source, target)`, with `+` or `*` as closure.

    Attributes:
        type: class that the source is an instance of; "" stands for the static type of the source (an arrow
            `a -ref-> b` of a rule).
        features: one name a step; all but the last are references.
    """

    type: str
    features: tuple[str, ...]
    source: Term
    target: Term
    closure: Closure = Closure.ONCE
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)
    feature_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class PatternCall:
    """`find p(arguments)`, with `+` or `*` as closure; `pattern` is a simple or a qualified name."""

    pattern: str
    arguments: tuple[Term, ...]
    closure: Closure = Closure.ONCE
    span: Span | None = field(default=None, compare=False, repr=False)
    pattern_span: Span | None = field(default=None, compare=False, repr=False)


Relation = TypeConstraint | PathConstraint | PatternCall


@dataclass(frozen=True, slots=True)
class Negation:
    """`neg find p(..)`, `neg Type(x)`, `neg Type.f(x, y)`."""

    relation: Relation
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Comparison:
    """`left == right` or `left != right`."""

    operator: Literal["==", "!="]
    left: Term
    right: Term
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Check:
    """`check(expression)`."""

    expression: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


Constraint = TypeConstraint | PathConstraint | PatternCall | Negation | Comparison | Check


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter; `type` is the name of a class, an enum or a scalar (`int`), or None."""

    name: str
    type: str | None = None
    direction: Literal["in", "out"] | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Body:
    """A conjunction of constraints."""

    constraints: tuple[Constraint, ...]
    name: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


class InPackage:
    """A definition that may be in a package; "" is none."""

    __slots__ = ()

    name: str
    package: str

    @property
    def qualified_name(self) -> str:
        """`package.name`, or the name alone."""
        return f"{self.package}.{self.name}" if self.package else self.name


@dataclass(frozen=True, slots=True)
class Pattern(InPackage):
    """A query: the set of parameter tuples for which one of the bodies holds.

    Attributes:
        package: qualifies the name; "" for none.
        private: visible in its own file (Python: its own package) only.
        strategy: "incremental" keeps it current, "search" looks when asked; None leaves it to the engine.
        unknown: variables of which a mistake elsewhere leaves unknown what they are.
        mended: whether its text has mistakes that were mended: what it seems to lack may stand there.
    """

    name: str
    parameters: tuple[Parameter, ...]
    bodies: tuple[Body, ...]
    package: str = ""
    private: bool = False
    strategy: Strategy | None = None
    annotations: tuple[Annotation, ...] = ()
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    mended: bool = field(default=False, compare=False, repr=False)
    unknown: frozenset[str] = field(default=frozenset(), compare=False, repr=False)
