"""Short ways to write patterns as data."""

from __future__ import annotations

from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Constant,
    Constraint,
    Evaluation,
    Expression,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
    Variable,
)


def v(name: str) -> Variable:
    """A variable."""
    return Variable(name)


def term(value: object) -> Term:
    """A variable by its name, `#`, or a constant."""
    if isinstance(value, str):
        return ColumnMark() if value == "#" else Variable(value)
    return Constant(value) if isinstance(value, int | float) else value  # type: ignore[return-value]


def path(text: str, source: str, target: object) -> PathConstraint:
    """`Type.f.g(source, target)`, with `+` or `*` at the end for a closure."""
    cls, *features = text.rstrip("+*").split(".")
    closure = Closure(text[-1]) if text[-1] in "+*" else Closure.ONCE
    return PathConstraint(cls, tuple(features), v(source), term(target), closure)


def find(name: str, *arguments: object) -> PatternCall:
    """`find name(arguments)`, with `+` or `*` at the end of the name for a closure."""
    closure = Closure(name[-1]) if name[-1] in "+*" else Closure.ONCE
    return PatternCall(name.rstrip("+*"), tuple(map(term, arguments)), closure)


def is_a(cls: str, variable: str, exact: bool = False) -> TypeConstraint:
    """`Type(variable)`."""
    return TypeConstraint(cls, v(variable), exact)


def neg(relation: Relation) -> Negation:
    """`neg relation`."""
    return Negation(relation)


def equal(left: object, right: object) -> Comparison:
    """`left == right`."""
    return Comparison("==", term(left), term(right))


def unequal(left: object, right: object) -> Comparison:
    """`left != right`."""
    return Comparison("!=", term(left), term(right))


def fold(function: str, over: Relation) -> Aggregate:
    """`count find p(..)` and its kin."""
    return Aggregate(function, over)  # type: ignore[arg-type]


def op(left: object, operator: str, right: object) -> Binary:
    """`left operator right`; strings are variables."""
    return Binary(operator, _operand(left), _operand(right))


def _operand(value: object) -> Expression:
    if isinstance(value, str):
        return Variable(value)
    return Constant(value) if value is None or isinstance(value, int | float) else value  # type: ignore[return-value]


def check(left: object, operator: str, right: object) -> Check:
    """`check(left operator right)`."""
    return Check(op(left, operator, right))


def value(expression: Expression) -> Evaluation:
    """`eval(expression)`."""
    return Evaluation(expression)


def pattern(head: str, *bodies: list[Constraint], package: str = "", private: bool = False) -> Pattern:
    """`name(x : Type, in y : int, z)` with bodies."""
    name, _, rest = head.rstrip(")").partition("(")
    parameters = []
    for part in filter(None, map(str.strip, rest.split(","))):
        parameter, _, type_ = map(str.strip, part.partition(":"))
        direction, _, parameter = parameter.rpartition(" ")
        parameters.append(Parameter(parameter, type_ or None, direction or None))  # type: ignore[arg-type]
    return Pattern(name, tuple(parameters), tuple(Body(tuple(b)) for b in bodies), package, private)
