"""Operators on attributes."""

from __future__ import annotations

from collections.abc import Iterator

from envgraph.metamodel import Attribute, EnumType, Scalar
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
        elif feature.type in (Scalar.INT, Scalar.FLOAT) and feature.range is not None:
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
    bounds = attribute.range
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
