"""Unique keys for the objects that operators create."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import product
from math import prod
from typing import Final

from envgraph.errors import LIMITS
from envgraph.metamodel import Attribute, EnumType, Scalar, Value, type_name
from envgraph.pattern import (
    Aggregate,
    Assignment,
    Binary,
    Check,
    ColumnMark,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Negation,
    PathConstraint,
    PatternCall,
    Variable,
)
from envgraph.rewrite.derive._reference_ends import Schema
from envgraph.rewrite.derive._rule_builder import RuleBuilder

_LARGEST_FLOAT: Final = float(2**52)
"""Above this number, adding 1 does not always result in another float."""

DIGITS: Final = 18
"""Maximal number of digits of a number in a string: a multiple of three, such that 64 bits suffice."""


def key_owner(schema: Schema, cls: str) -> str | None:
    """Return the class that declares the key of a class: itself or a supertype; None if there is no key."""
    classes = schema.metamodel.classes
    return next((above for above in schema.metamodel.supertypes(cls) if classes[above].key), None)


def choose_key(builder: RuleBuilder, classes: Sequence[str], position: int) -> list[Assignment]:
    """Return assignments that give a created object a key that no other object has. Add their conditions to the rule.

    Numbers, and numbers at the end of strings (after the class name), become larger than all in use. A key of only enum
    literals and truth values becomes any unused combination. If there are too many combinations, only the
    default values are tried.

    Args:
        builder: the rule.
        classes: the classes of all objects that are created together.
        position: index of this object in `classes`.
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
            number = _largest_number(builder, owner, attribute, list(dict.fromkeys(siblings.values())))
            builder.add_constraints([Check(Binary("<", number, Constant(10**DIGITS - rank)))])
            value: Expression = Binary("+", Constant(cls), Binary("+", number, Constant(rank)))
            found.append(Assignment(attribute.name, value))
        elif attribute.type in (Scalar.INT, Scalar.FLOAT):
            number, value = (
                _largest_number(builder, owner, attribute),
                Variable(builder.reserve_name("number")),
            )
            # Computed in the LHS: if the number overflows, the rule does not match, whereas an assignment would raise.
            builder.add_constraints([Comparison("==", value, Evaluation(Binary("+", number, Constant(rank))))])
            if attribute.type is Scalar.FLOAT:
                builder.add_constraints([Check(Binary("<", number, Constant(_LARGEST_FLOAT)))])
            found.append(Assignment(attribute.name, value))
    return found or _choose_unused_key(builder, owner, attributes)


# --- numbers


def _largest_number(builder: RuleBuilder, owner: str, attribute: Attribute, classes: Sequence[str] = ()) -> Variable:
    """Return an LHS variable for the largest number in use, for strings the largest one after a name of `classes`.

    The first call adds the pattern of the numbers and the constraint to the rule. Later calls return the same variable.
    """
    suffix = ".".join((f"#key.{owner}.{attribute.name}", *classes))
    if suffix not in builder.largest:
        number, default = Variable("number"), attribute.initial
        below: int | float = 0
        bodies = [list(_number_constraints(owner, attribute, cls)) for cls in classes]
        if not classes:
            assert isinstance(default, int | float)
            bodies = [[PathConstraint(owner, (attribute.name,), Variable("_"), number)]]
            below = max(default - 1, -(2**63)) if isinstance(default, int) else default - 1
        type_ = Scalar.INT if classes else attribute.type
        bodies.append([Comparison("==", number, Constant(below))])
        # Let the engine choose the strategy: the pattern is about all objects of a class, equal for all matches.
        pattern = builder.add_pattern(suffix, {"number": type_name(type_)}, bodies, strategy=None)
        largest = builder.largest[suffix] = Variable(builder.reserve_name("largest"))
        builder.add_constraints([Comparison("==", largest, Aggregate("max", PatternCall(pattern, (ColumnMark(),))))])
    return builder.largest[suffix]


def _number_constraints(owner: str, attribute: Attribute, cls: str) -> Iterator[Constraint]:
    """Yield constraints that bind the number after the class name in a string.

    No function parses numbers. So each character after the name is read as a digit, and the name with the resulting
    number is compared with the string, which differs if a character is no digit.
    """
    name, rest, digits, number = map(Variable, ("name", "rest", "digits", "number"))
    yield PathConstraint(owner, (attribute.name,), Variable("_"), name)
    yield Comparison("==", rest, Evaluation(_make_call("substring", name, Constant(len(cls)))))
    padded = Binary("+", Constant("0" * DIGITS), rest)
    yield Comparison("==", digits, Evaluation(_make_call("substring", padded, _make_call("length", rest))))
    # Few strings have more than three digits, so further digits are computed only if they exist.
    total: Expression = _three_digits(digits, 0)
    for start in range(3, DIGITS, 3):
        longer = Binary(">", _make_call("length", rest), Constant(DIGITS - start))
        total = Binary("+", _three_digits(digits, start), Conditional(longer, total, Constant(0)))
    yield Comparison("==", number, Evaluation(total))
    yield Check(Binary("==", name, Binary("+", Constant(cls), number)))


def _three_digits(digits: Expression, start: int) -> Expression:
    """Return an expression for the value of three decimal digits, from the index `start` in a number of 18 digits."""
    worth: list[Expression] = []
    for place in range(start, start + 3):
        digit = _make_call("substring", digits, Constant(place), Constant(place + 1))
        value = _make_call("indexOf", Constant("0123456789"), digit)
        worth.append(Binary("*", value, Constant(10 ** (DIGITS - 1 - place))))
    return reduce(lambda left, right: Binary("+", left, right), worth)


def _make_call(function: str, *arguments: Expression) -> FunctionCall:
    return FunctionCall(function, arguments)


# --- literals and truth values


def _choose_unused_key(builder: RuleBuilder, owner: str, attributes: Sequence[Attribute]) -> list[Assignment]:
    """Return assignments of a combination of values as key. Add the conditions that no other object has the same key.

    If there are too many combinations, only the combination of default values is tried.
    """
    one, columns = Variable("object"), [Variable(attribute.name) for attribute in attributes]
    types = {attribute.name: type_name(attribute.type) for attribute in attributes}
    relations = [PathConstraint(owner, (a.name,), one, column) for a, column in zip(attributes, columns, strict=True)]
    many = prod(len(_all_values(attribute)) for attribute in attributes) > LIMITS["keys"]
    ranges = [
        [_make_literal(a, a.initial)] if many else [_make_literal(a, one) for one in _all_values(a)] for a in attributes
    ]
    taken = PatternCall(builder.add_pattern(f"#taken.{owner}", types, [relations]), tuple(columns))
    bodies = [
        [Comparison("==", column, value) for column, value in zip(columns, values, strict=True)] + [Negation(taken)]
        for values in product(*ranges)
    ]
    free = builder.add_pattern(f"#free.{owner}", types, bodies)
    key = tuple(Variable(builder.reserve_name(attribute.name)) for attribute in attributes)
    builder.add_constraints([PatternCall(free, key)])
    for other in builder.keys.setdefault(owner, []):
        differing = [Binary("!=", mine, theirs) for mine, theirs in zip(key, other, strict=True)]
        builder.add_constraints([Check(reduce(lambda left, right: Binary("||", left, right), differing))])
    builder.keys[owner].append(key)
    return [Assignment(attribute.name, value) for attribute, value in zip(attributes, key, strict=True)]


def _all_values(attribute: Attribute) -> Sequence[Value]:
    """Return all values of a bool or enum attribute."""
    return (False, True) if isinstance(attribute.type, Scalar) else attribute.type.literals


def _make_literal(attribute: Attribute, value: object) -> Constant | EnumLiteral:
    if isinstance(attribute.type, EnumType):
        return EnumLiteral(attribute.type.name, str(value))
    return Constant(value)  # type: ignore[arg-type]
