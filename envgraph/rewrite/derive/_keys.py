"""Keys of the objects that operators create."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import product
from math import prod
from typing import Final

from envgraph.metamodel import Attribute, EnumType, Scalar, Value, type_name
from envgraph.pattern import (
    Aggregate,
    Assignment,
    Binary,
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

DIGITS: Final = 18
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
    features = map(schema.metamodel.features(owner).__getitem__, schema.metamodel.key(owner))
    attributes = [feature for feature in features if isinstance(feature, Attribute)]
    siblings = {place: one for place, one in enumerate(classes) if schema.is_a(one, owner)}
    rank = 1 + sum(place < position for place in siblings)
    found: list[Assignment] = []
    for attribute in attributes:
        if attribute.type is Scalar.STRING:
            number = _largest(builder, owner, attribute, list(dict.fromkeys(siblings.values())))
            builder.ask([Check(Binary("<", number, Constant(10**DIGITS - rank)))])
            value: Expression = Binary("+", Constant(cls), Binary("+", number, Constant(rank)))
            found.append(Assignment(attribute.name, value))
        elif attribute.type in (Scalar.INT, Scalar.FLOAT):
            number, value = _largest(builder, owner, attribute), Variable(builder.fresh("number"))
            # Not in the assignment: a number that does not fit is no match, instead of an error.
            builder.ask([Comparison("==", value, Evaluation(Binary("+", number, Constant(rank))))])
            if attribute.type is Scalar.FLOAT:
                builder.ask([Check(Binary("<", number, Constant(_LARGEST_FLOAT)))])
            found.append(Assignment(attribute.name, value))
    return found or _choice(builder, owner, attributes)


# --- numbers


def _largest(builder: RuleBuilder, owner: str, attribute: Attribute, classes: Sequence[str] = ()) -> Variable:
    """The largest number in use, once for all objects that are created together: of strings, behind these classes."""
    suffix = ".".join((f"#key.{owner}.{attribute.name}", *classes))
    if suffix not in builder.largest:
        number, default = Variable("number"), attribute.initial
        below: int | float = 0
        bodies = [list(_number(owner, attribute, cls)) for cls in classes]
        if not classes:
            assert isinstance(default, int | float)
            bodies = [[PathConstraint(owner, (attribute.name,), Variable("_"), number)]]
            below = max(default - 1, -(2**63)) if isinstance(default, int) else default - 1
        type_ = Scalar.INT if classes else attribute.type
        bodies.append([Comparison("==", number, Constant(below))])
        # The engine chooses how it is matched: it is about all objects of a class, and the same for all matches.
        pattern = builder.pattern(suffix, {"number": type_name(type_)}, bodies, strategy=None)
        largest = builder.largest[suffix] = Variable(builder.fresh("largest"))
        builder.ask([Comparison("==", largest, Aggregate("max", PatternCall(pattern, (Hash(),))))])
    return builder.largest[suffix]


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


def _three(digits: Expression, start: int) -> Expression:
    """Return what three digits are worth."""
    worth: list[Expression] = []
    for place in range(start, start + 3):
        digit = _call("substring", digits, Constant(place), Constant(place + 1))
        value = _call("indexOf", Constant("0123456789"), digit)
        worth.append(Binary("*", value, Constant(10 ** (DIGITS - 1 - place))))
    return reduce(lambda left, right: Binary("+", left, right), worth)


def _call(function: str, *arguments: Expression) -> FunctionCall:
    return FunctionCall(function, arguments)


# --- literals and truth values


def _choice(builder: RuleBuilder, owner: str, attributes: Sequence[Attribute]) -> list[Assignment]:
    """One of the keys that no object has, and no other one that is created; of too many, that of the defaults."""
    one, columns = Variable("object"), [Variable(attribute.name) for attribute in attributes]
    types = {attribute.name: type_name(attribute.type) for attribute in attributes}
    relations = [
        PathConstraint(owner, (a.name,), one, column) for a, column in zip(attributes, columns, strict=True)
    ]
    many = prod(len(_range(attribute)) for attribute in attributes) > MOST_KEYS
    ranges = [[_value(a, a.initial)] if many else [_value(a, one) for one in _range(a)] for a in attributes]
    taken = PatternCall(builder.pattern(f"#taken.{owner}", types, [relations]), tuple(columns))
    bodies = [
        [Comparison("==", column, value) for column, value in zip(columns, values, strict=True)]
        + [Negation(taken)]
        for values in product(*ranges)
    ]
    free = builder.pattern(f"#free.{owner}", types, bodies)
    key = tuple(Variable(builder.fresh(attribute.name)) for attribute in attributes)
    builder.ask([PatternCall(free, key)])
    for other in builder.keys.setdefault(owner, []):
        differing = [Binary("!=", mine, theirs) for mine, theirs in zip(key, other, strict=True)]
        builder.ask([Check(reduce(lambda left, right: Binary("||", left, right), differing))])
    builder.keys[owner].append(key)
    return [Assignment(attribute.name, value) for attribute, value in zip(attributes, key, strict=True)]


def _range(attribute: Attribute) -> Sequence[Value]:
    """The values of an attribute that has few."""
    return (False, True) if isinstance(attribute.type, Scalar) else attribute.type.literals


def _value(attribute: Attribute, value: object) -> Constant | EnumLiteral:
    if isinstance(attribute.type, EnumType):
        return EnumLiteral(attribute.type.name, str(value))
    return Constant(value)  # type: ignore[arg-type]
