"""Keys of the objects that operators create."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import product
from math import prod
from typing import Final

from envgraph.metamodel import Attribute, Scalar, type_name
from envgraph.pattern import (
    Aggregate,
    Assignment,
    Binary,
    Body,
    Check,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Hash,
    Negation,
    Node,
    PathConstraint,
    PatternCall,
    Variable,
)
from envgraph.rewrite.derive._rule_builder import RuleBuilder
from envgraph.rewrite.derive._schema import Schema

MOST_KEYS: Final = 64
"""So many keys of literals and truth values are tried."""

_LARGEST_FLOAT: Final = float(2**52)
"""Above it adding 1 does not always make another number."""

DIGITS = 18
"""How many a number that is read from a string may have: a multiple of three, so that it fits 64 bits."""


def key_owner(schema: Schema, cls: str) -> str | None:
    """The class that says what the key of a class is."""
    classes = schema.metamodel.classes
    return next((above for above in schema.metamodel.supertypes(cls) if classes[above].key), None)


def new_key(builder: RuleBuilder, classes: Sequence[str], position: int) -> list[Assignment]:
    """Give an object that is created with others, before it and after it, a key that no object has.

    A number, and that behind the class in a string, are above all those in use. Of a key of literals and truth values
    alone each one that is free may be taken; where there are too many, that of the defaults, if it is free.

    Args:
        builder: the rule.
        classes: class of each object that is created.
        position: which of them.
    """
    schema, cls = builder.schema, classes[position]
    owner = key_owner(schema, cls)
    if owner is None:
        return []
    features = [schema.metamodel.features(owner)[name] for name in schema.metamodel.key(owner)]
    attributes = [feature for feature in features if isinstance(feature, Attribute)]
    siblings = [schema.is_a(other, owner) for other in classes]
    together = list(dict.fromkeys(c for c, same in zip(classes, siblings, strict=True) if same))
    rank = sum(siblings[:position])
    found: list[Assignment] = []
    for attribute in attributes:
        if attribute.type is Scalar.STRING:
            suffix, bodies = _numbers(owner, attribute, together)
            number = _largest(builder, suffix, bodies)
            builder.ask([Check(Binary("<", number, Constant(10**DIGITS - 1 - rank)))])
            name = Binary("+", Constant(cls), Binary("+", number, Constant(rank + 1)))
            found.append(Assignment(attribute.name, name))
        elif attribute.type in (Scalar.INT, Scalar.FLOAT):
            suffix, bodies = _values(owner, attribute)
            number = _largest(builder, suffix, bodies, attribute.type)
            value = Variable(builder.name("number"))
            # Not in the assignment: a number that does not fit is no match, instead of an error.
            builder.ask([Comparison("==", value, Evaluation(Binary("+", number, Constant(rank + 1))))])
            if attribute.type is Scalar.FLOAT:
                builder.ask([Check(Binary("<", number, Constant(_LARGEST_FLOAT)))])
            found.append(Assignment(attribute.name, value))
    if not found and prod(len(_range(attribute)) for attribute in attributes) <= MOST_KEYS:
        return _free(builder, owner, attributes)
    if not found:
        twin = builder.name("twin")
        builder.block("not", [Node(twin, owner)], [], list(_defaults(owner, attributes, twin)))
    return found


def _free(builder: RuleBuilder, owner: str, attributes: Sequence[Attribute]) -> list[Assignment]:
    """One of the keys that no object has, and no other one that is created."""
    columns = [Variable(attribute.name) for attribute in attributes]
    types = {attribute.name: type_name(attribute.type) for attribute in attributes}
    one = Variable("object")
    relations = [
        PathConstraint(owner, (a.name,), one, column) for a, column in zip(attributes, columns, strict=True)
    ]
    taken = builder.pattern(f"#taken.{owner}", types, [Body(tuple(relations))])
    bodies = [
        Body(
            (
                *(Comparison("==", column, value) for column, value in zip(columns, values, strict=True)),
                Negation(PatternCall(taken, tuple(columns))),
            )
        )
        for values in product(*map(_range, attributes))
    ]
    free = builder.pattern(f"#free.{owner}", types, bodies)
    key = tuple(Variable(builder.name(attribute.name)) for attribute in attributes)
    builder.ask([PatternCall(free, key)])
    for other in builder.keys.setdefault(owner, []):
        differing = [Binary("!=", mine, theirs) for mine, theirs in zip(key, other, strict=True)]
        builder.ask([Check(reduce(lambda left, right: Binary("||", left, right), differing))])
    builder.keys[owner].append(key)
    return [Assignment(attribute.name, value) for attribute, value in zip(attributes, key, strict=True)]


def _range(attribute: Attribute) -> Sequence[Constant | EnumLiteral]:
    """The values that an attribute of a key can have; of one that has any number of them, none."""
    if isinstance(attribute.type, Scalar):
        return (Constant(False), Constant(True)) if attribute.type is Scalar.BOOL else ()
    return tuple(EnumLiteral(attribute.type.name, literal) for literal in attribute.type.literals)


def _largest(
    builder: RuleBuilder, suffix: str, bodies: Sequence[Body], type_: Scalar = Scalar.INT
) -> Variable:
    """The largest of the numbers of a pattern, once for all objects that are created together."""
    if suffix not in builder.largest:
        # The engine chooses how it is matched: it is about all objects of a class, and the same for all matches.
        pattern = builder.pattern(suffix, {"number": type_.value}, bodies, strategy=None)
        number = builder.largest[suffix] = Variable(builder.name("largest"))
        builder.ask([Comparison("==", number, Aggregate("max", PatternCall(pattern, (Hash(),))))])
    return builder.largest[suffix]


def _values(owner: str, attribute: Attribute) -> tuple[str, list[Body]]:
    """The values in use, and the one below the default."""
    number, default = Variable("number"), attribute.initial
    assert isinstance(default, int | float)
    below = max(default - 1, -(2**63)) if isinstance(default, int) else default - 1
    bodies = [
        Body((PathConstraint(owner, (attribute.name,), Variable("_"), number),)),
        Body((Comparison("==", number, Constant(below)),)),
    ]
    return f"#key.{owner}.{attribute.name}", bodies


def _numbers(owner: str, attribute: Attribute, classes: Sequence[str]) -> tuple[str, list[Body]]:
    """The numbers behind the classes in the strings in use, and 0."""
    bodies = [Body(tuple(_number(owner, attribute, cls))) for cls in classes]
    bodies.append(Body((Comparison("==", Variable("number"), Constant(0)),)))
    return f"#key.{owner}.{attribute.name}.{'.'.join(classes)}", bodies


def _number(owner: str, attribute: Attribute, cls: str) -> Iterator[Constraint]:
    """The number that stands behind a class in a string.

    Nothing turns a string into a number, so the digits are added up, whatever they are, and the result is compared
    with the string.
    """
    name, rest, digits, number = map(Variable, ("name", "rest", "digits", "number"))
    yield PathConstraint(owner, (attribute.name,), Variable("_"), name)
    yield Comparison("==", rest, Evaluation(_call("substring", name, Constant(len(cls)))))
    padded = Binary("+", Constant("0" * DIGITS), rest)
    yield Comparison("==", digits, Evaluation(_call("substring", padded, _call("length", rest))))
    # Few strings have more than three digits: the rest of them is worked out only where there is one.
    total: Expression = _three(digits, 0)
    for start in range(3, DIGITS, 3):
        longer = Binary(">", _call("length", rest), Constant(DIGITS - start))
        total = Binary("+", _three(digits, start), Conditional(longer, total, Constant(0)))
    yield Comparison("==", number, Evaluation(total))
    yield Check(Binary("==", name, Binary("+", Constant(cls), number)))


def _three(digits: Expression, start: int) -> Binary:
    """Return what three digits are worth."""
    first, second, third = (_digit(digits, position) for position in range(start, start + 3))
    return Binary("+", Binary("+", first, second), third)


def _digit(digits: Expression, position: int) -> Expression:
    """Return what a digit is worth."""
    digit = _call("substring", digits, Constant(position), Constant(position + 1))
    value = _call("indexOf", Constant("0123456789"), digit)
    worth = 10 ** (DIGITS - 1 - position)
    return value if worth == 1 else Binary("*", value, Constant(worth))


def _call(function: str, *arguments: Expression) -> FunctionCall:
    return FunctionCall(function, arguments)


def _defaults(owner: str, attributes: Sequence[Attribute], twin: str) -> Iterator[Constraint]:
    """An object has the defaults of all these attributes."""
    for attribute in attributes:
        value = attribute.initial
        assert not isinstance(value, tuple), "a key has one value"
        literal = (
            Constant(value)
            if isinstance(attribute.type, Scalar)
            else EnumLiteral(attribute.type.name, str(value))
        )
        yield PathConstraint(owner, (attribute.name,), Variable(twin), literal)
