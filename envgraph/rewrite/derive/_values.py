"""Operators on attributes."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.errors import Diagnostic
from envgraph.metamodel import Annotation, Attribute, EnumType, Scalar, accepts
from envgraph.pattern import (
    Binary,
    Check,
    Constant,
    EnumLiteral,
    FunctionCall,
    Negation,
    PathConstraint,
    Set,
    Unary,
    Variable,
)
from envgraph.rewrite.derive._links import Operator
from envgraph.rewrite.derive._rule_builder import RuleBuilder
from envgraph.rewrite.derive._schema import Schema

RANGE = "range"
"""`@range(lowest, highest)`, and optionally `step`: between which values operators move a number."""


def value_operators(schema: Schema, group: str, cls: str) -> Iterator[Operator]:
    """The operators on the attributes of a class: truth values flip, enums change, numbers with a range step."""
    for feature in schema.features(cls):
        if not isinstance(feature, Attribute) or schema.left_alone(feature) or schema.keyed(cls, feature):
            continue
        holder = schema.holder(cls, feature)
        if isinstance(feature.type, EnumType):
            yield from _literals(schema, group, feature, feature.type, holder)
        elif feature.type is Scalar.BOOL:
            yield _flip(RuleBuilder(schema, group), feature, holder)
        elif feature.type in (Scalar.INT, Scalar.FLOAT) and range_of(feature) is not None:
            yield from _steps(schema, group, feature, holder)


def _object(builder: RuleBuilder, holder: str) -> str:
    name = builder.node("object", holder)
    builder.spared(name, holder)
    return name


def _path(attribute: Attribute, name: str, value: Variable | EnumLiteral) -> PathConstraint:
    return PathConstraint(attribute.owner, (attribute.name,), Variable(name), value)


def _flip(builder: RuleBuilder, attribute: Attribute, holder: str) -> Operator:
    name, value = _object(builder, holder), Variable(builder.name("value"))
    builder.ask([_path(attribute, name, value)])
    builder.act(Set(Variable(name), attribute.name, "=", Unary("!", value)))
    doc = f"`{holder}.{attribute.name}` becomes the opposite."
    return "set", f"set.{holder}.{attribute.name}", builder, doc, False


def _literals(
    schema: Schema, group: str, attribute: Attribute, enum: EnumType, holder: str
) -> Iterator[Operator]:
    for literal in enum.literals:
        builder, value = RuleBuilder(schema, group), EnumLiteral(enum.name, literal)
        name = _object(builder, holder)
        builder.ask([Negation(_path(attribute, name, value))])
        builder.act(Set(Variable(name), attribute.name, "=", value))
        doc = f"`{holder}.{attribute.name}` becomes `{literal}`."
        yield "set", f"set.{holder}.{attribute.name}.{literal}", builder, doc, False


def _steps(schema: Schema, group: str, attribute: Attribute, holder: str) -> Iterator[Operator]:
    bounds = range_of(attribute)
    assert bounds is not None
    lowest, highest, step = bounds
    for word, compare, sign, limit, choose in (
        ("up", "<", "+", highest, "min"),
        ("down", ">", "-", lowest, "max"),
    ):
        builder = RuleBuilder(schema, group)
        name, value = _object(builder, holder), Variable(builder.name("value"))
        builder.ask([_path(attribute, name, value), Check(Binary(compare, value, Constant(limit)))])
        moved = FunctionCall(choose, (Binary(sign, value, Constant(step)), Constant(limit)))
        builder.act(Set(Variable(name), attribute.name, "=", moved))
        doc = f"`{holder}.{attribute.name}` goes {word} by {step}, to {limit} at most."
        if word == "down":
            doc = f"`{holder}.{attribute.name}` goes down by {step}, to {limit} at least."
        yield "set", f"set.{holder}.{attribute.name}.{word}", builder, doc, False


# --- ranges


def range_of(attribute: Attribute) -> tuple[int | float, int | float, int | float] | None:
    """Lowest and highest value and step, if the attribute has a range without mistakes.

    The step is 1, or a tenth of the range of a float.
    """
    found = next((a for a in attribute.annotations if a.name == RANGE), None)
    if found is None or range_mistake(attribute, found):
        return None
    values: dict[str, int | float] = {
        str(key): value for key, value in found.named if isinstance(value, int | float)
    }
    lowest, highest = (float(v) if attribute.type is Scalar.FLOAT else v for v in found.arguments)
    assert isinstance(lowest, int | float) and isinstance(highest, int | float)
    return lowest, highest, values.get("step", 1 if attribute.type is Scalar.INT else (highest - lowest) / 10)


def range_mistake(attribute: Attribute, found: Annotation) -> str | None:
    """What is wrong with the range of an attribute, or None."""
    kind = attribute.type
    if kind is not Scalar.INT and kind is not Scalar.FLOAT:
        return "only `int` and `float` attributes have a range"
    step = dict(found.named).get("step", 1)
    if len(found.arguments) != 2 or set(dict(found.named)) - {"step"}:
        return "`@range` takes the lowest and the highest value, and perhaps a step"
    if not all(accepts(kind, value) for value in (*found.arguments, step)):
        return f"the values of a range of `{attribute}` are of type `{kind}`"
    lowest, highest = found.arguments
    assert isinstance(lowest, int | float) and isinstance(highest, int | float)
    if not lowest < highest or (isinstance(step, int | float) and step <= 0):
        return "the lowest value comes first, and a step is above 0"
    return None


def check_ranges(attributes: Iterator[Attribute]) -> Iterator[Diagnostic]:
    """What is wrong with the ranges of attributes."""
    for attribute in attributes:
        for annotation in attribute.annotations:
            mistake = range_mistake(attribute, annotation) if annotation.name == RANGE else None
            if mistake:
                hint = "write `@range(0, 10)` or `@range(0, 10, step = 2)`"
                yield Diagnostic("bad-annotation", mistake, annotation.span, hint)
