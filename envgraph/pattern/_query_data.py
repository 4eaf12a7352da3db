"""Graph queries as frozen data: patterns, bodies, constraints.

Names of classes, features and patterns are strings; `check_patterns` reports unknown names.
"""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern._expression_data import Constant, EnumLiteral, Expression, Variable

Strategy = Literal["incremental", "search"]


class Closure(StrEnum):
    """The repetition of a binary relation: once, at least once, or any number of times."""

    ONCE = ""
    PLUS = "+"
    STAR = "*"


@dataclass(frozen=True, slots=True)
class ColumnMark:
    """The mark `#` or `#name` of the column that sum, min, max and avg aggregate. The name is only for readers."""

    span: Span | None = field(default=None, compare=False, repr=False)
    name: str | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A term `eval(expression)`, in the place of a variable."""

    expression: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


AggregateFunction = Literal["count", "sum", "min", "max", "avg"]


@dataclass(frozen=True, slots=True)
class Aggregate:
    """A term such as `count find p(..)` or `sum Type.f(_, #)`, in the place of a variable."""

    function: AggregateFunction
    over: Relation
    span: Span | None = field(default=None, compare=False, repr=False)


Term = Variable | Constant | EnumLiteral | Evaluation | Aggregate | ColumnMark


@dataclass(frozen=True, slots=True)
class TypeConstraint:
    """A constraint `Type(term)`: the term is an instance of a class or a subclass, or a value of a data type or enum.

    `exact` excludes subclasses. It has no syntax in texts; derived rules use it.
    """

    type: str
    term: Term
    exact: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class PathConstraint:
    """A constraint `Type.f1.f2(source, target)`, with `+` or `*` as closure.

    Attributes:
        type: the class of the source; "" means the static type of the source (an arrow `a -ref-> b` of a rule).
        features: one name for each step; all but the last are references.
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
    """A constraint `find p(arguments)`, with `+` or `*` as closure. `pattern` is a simple or a qualified name."""

    pattern: str
    arguments: tuple[Term, ...]
    closure: Closure = Closure.ONCE
    span: Span | None = field(default=None, compare=False, repr=False)
    pattern_span: Span | None = field(default=None, compare=False, repr=False)


Relation = TypeConstraint | PathConstraint | PatternCall


@dataclass(frozen=True, slots=True)
class Negation:
    """A constraint `neg find p(..)`, `neg Type(x)` or `neg Type.f(x, y)`: the relation has no matching tuple."""

    relation: Relation
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Comparison:
    """A constraint `left == right` or `left != right`."""

    operator: Literal["==", "!="]
    left: Term
    right: Term
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Check:
    """A constraint `check(expression)`: the expression is true."""

    expression: Expression
    span: Span | None = field(default=None, compare=False, repr=False)


Constraint = TypeConstraint | PathConstraint | PatternCall | Negation | Comparison | Check


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a pattern, rule, unit or function. `type` names a class, an enum or a scalar, or is None."""

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
    """A definition that may belong to a package. The package "" means none."""

    __slots__ = ()

    name: str
    package: str

    @property
    def qualified_name(self) -> str:
        """Return `package.name`, or the name alone without a package."""
        return f"{self.package}.{self.name}" if self.package else self.name


@dataclass(frozen=True, slots=True)
class Pattern(InPackage):
    """A query: the set of parameter tuples for which one of the bodies holds.

    Attributes:
        package: the qualifier of the name; "" for none.
        private: True if only its own file (in Python: its own package) may call it.
        strategy: "incremental" makes it a view, "search" searches on request; None lets the engine choose.
        unknown: variables whose types are unknown because of an error elsewhere.
        mended: True if its text has errors that the parser repaired, so that parts may be missing.
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
