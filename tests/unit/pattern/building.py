"""Short spellings for patterns built from data, and the metamodel that the tests of this folder share."""

from __future__ import annotations

from envgraph.errors import Diagnostic, Severity
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    Library,
    Navigation,
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

COLOUR = EnumType("Colour", ("red", "green", "blue"))
WAY = EnumType("Way", ("west", "east"))

METAMODEL = Metamodel(
    "grid",
    (
        Class(
            "World",
            features=(Reference("cells", "Cell", 1, None, containment=True), Reference("hero", "Hero")),
        ),
        Class("Planet", supertypes=("World",)),
        Class(
            "Cell",
            abstract=True,
            features=(
                Attribute("x", Scalar.INT),
                Attribute("y", Scalar.INT),
                Reference("right", "Cell", 0, 1, opposite="left"),
                Reference("left", "Cell", 0, 1, opposite="right"),
                Reference("items", "Key", 0, None, containment=True),
            ),
        ),
        Class("Floor", supertypes=("Cell",)),
        Class("Wall", supertypes=("Cell",)),
        Class(
            "Door",
            supertypes=("Floor", "Coloured"),
            features=(Attribute("open", Scalar.BOOL), Attribute("weight", Scalar.FLOAT)),
        ),
        Class("Coloured", abstract=True, features=(Attribute("colour", COLOUR),)),
        Class("Key", supertypes=("Coloured",), features=(Attribute("label", Scalar.STRING),)),
        Class("Hero", features=(Reference("at", "Cell"), Reference("keys", "Key", 2, 5))),
        # Amphibian things: no one class covers what is both.
        Class("Swims", abstract=True),
        Class("Walks", abstract=True),
        Class("Frog", supertypes=("Swims", "Walks")),
        Class("Newt", supertypes=("Swims", "Walks")),
    ),
    (COLOUR, WAY),
)

Written = Term | str | int | float | bool


def term(written: Written) -> Term:
    """`x` a variable, `#` a hash, `Enum::x` and `::x` literals, other values constants."""
    if isinstance(written, str):
        if written == "#":
            return ColumnMark()
        if "::" in written:
            enum, literal = written.split("::")
            return EnumLiteral(enum or None, literal)
        return Variable(written)
    return Constant(written) if isinstance(written, int | float) else written


def text(value: str) -> Constant:
    return Constant(value)


NONE = Constant(None)


def path(features: str, source: Written, target: Written, closure: str = "") -> PathConstraint:
    cls, *steps = features.split(".")
    return PathConstraint(cls, tuple(steps), term(source), term(target), Closure(closure))


def isa(type_: str, variable: Written, exact: bool = False) -> TypeConstraint:
    return TypeConstraint(type_, term(variable), exact)


def find(name: str, *arguments: Written, closure: str = "") -> PatternCall:
    return PatternCall(name, tuple(term(argument) for argument in arguments), Closure(closure))


def neg(relation: Relation) -> Negation:
    return Negation(relation)


def eq(left: Written, right: Written) -> Comparison:
    return Comparison("==", term(left), term(right))


def ne(left: Written, right: Written) -> Comparison:
    return Comparison("!=", term(left), term(right))


def agg(function: str, over: Relation) -> Aggregate:
    return Aggregate(function, over)  # type: ignore[arg-type]


def expr(written: Expression | str | int | float | bool) -> Expression:
    """As `term`, and `x.f.g` as a path."""
    if isinstance(written, str) and "." in written:
        base, *features = written.split(".")
        node: Expression = Variable(base)
        for feature in features:
            node = Navigation(node, feature)
        return node
    made = term(written)  # type: ignore[arg-type]
    assert not isinstance(made, Evaluation | Aggregate | ColumnMark)
    return made


def op(left: object, operator: str, right: object) -> Binary:
    return Binary(operator, expr(left), expr(right))  # type: ignore[arg-type]


def cond(test: object, then: object, otherwise: object) -> Conditional:
    return Conditional(expr(test), expr(then), expr(otherwise))  # type: ignore[arg-type]


def check(expression: object) -> Check:
    return Check(expr(expression))  # type: ignore[arg-type]


def ev(expression: object) -> Evaluation:
    return Evaluation(expr(expression))  # type: ignore[arg-type]


def pattern(name: str, parameters: str, *bodies: list[Constraint], **features: object) -> Pattern:
    """`parameters` is written as in a file: `a, b : Cell, in n : int`."""
    made = []
    for written in filter(None, (part.strip() for part in parameters.split(","))):
        left, _, type_ = written.partition(":")
        *direction, parameter = left.split()
        made.append(Parameter(parameter, type_.strip() or None, direction[0] if direction else None))  # type: ignore[arg-type]
    return Pattern(name, tuple(made), tuple(Body(tuple(body)) for body in bodies), **features)  # type: ignore[arg-type]


def library(*patterns: Pattern) -> Library:
    made = Library(METAMODEL)
    made.add(*patterns)
    return made


def diagnostics(*patterns: Pattern) -> list[Diagnostic]:
    return Library(METAMODEL).check(*patterns)


def codes(*patterns: Pattern) -> list[str]:
    """Codes of all diagnostics, warnings marked with `W:`."""
    return [("W:" if d.severity is Severity.WARNING else "") + d.code for d in diagnostics(*patterns)]


def hints(*patterns: Pattern) -> str:
    return "\n".join(d.hint or "" for d in diagnostics(*patterns))
