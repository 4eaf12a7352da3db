"""Operators that change features of existing objects: links, containers and attribute values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Final

from envgraph.metamodel import Attribute, EnumType, Feature, Reference, Scalar
from envgraph.pattern import (
    Binary,
    Check,
    Constant,
    Constraint,
    EnumLiteral,
    Expression,
    FunctionCall,
    Negation,
    PathConstraint,
    SetAction,
    Unary,
    Variable,
)
from envgraph.rewrite.derive._reference_ends import ReferenceEnd, Schema
from envgraph.rewrite.derive._rule_builder import RuleBuilder

_LINK_TEMPLATES: Final = {
    "add.{}": ("+ source target", "Add a target of `{}`."),
    "remove.{}": ("- source target", "Remove a target of `{}`."),
    "change.{}.source": (
        "- source target + other target",
        "Move a target of `{}` to another `{holder}`.",
    ),
    "change.{}.target": (
        "- source target + source other",
        "Replace a target of `{}` by another object.",
    ),
    "swap.{}": (
        "- source target - source2 target2 + source target2 + source2 target",
        "Exchange a target of `{}` between two objects.",
    ),
}
"""Operators on a reference, by name: the links that are removed (-) and added (+), and the documentation."""

_SYMMETRIC_TEMPLATES: Final = {
    name: _LINK_TEMPLATES[name] for name in _LINK_TEMPLATES if name != "change.{}.source"
} | {
    "swap.{}.joining": (
        "+ source target - source source - target target",
        "Link two objects to each other by `{}`, instead of each to itself.",
    ),
    "swap.{}.parting": (
        "- source target + source source + target target",
        "Link two objects each to itself by `{}`, instead of to each other.",
    ),
}
"""Operators on a reference that is its own opposite, where objects may be linked to themselves."""

_SWAP_TEMPLATE: Final = "- container part - container2 part2 + container2 part + container part2"

Setting = tuple[str, str, list[Constraint], Expression]
"""A way to set an attribute: suffix of the rule name, end of the documentation, conditions, and new value."""

_OBJECT, _VALUE = Variable("object"), Variable("value")


# --- links


def link_operators(schema: Schema, group: str, cls: str) -> Iterator[RuleBuilder]:
    """Yield the operators that add, remove, change and swap non-containment links of a class and its subclasses.

    Frozen references, and operators that would change a fixed number of links, are left out.
    """
    for end, feature in _changeable_ends(schema, cls):
        holder = schema.holder(cls, feature)
        feature_name = f"{holder}.{end.name}"
        for name, (links, doc) in (_SYMMETRIC_TEMPLATES if end.is_symmetric else _LINK_TEMPLATES).items():
            text = doc.format(feature_name, holder=holder)
            builder = RuleBuilder(schema, group, name.format(feature_name), text)
            _apply_template(builder, end, holder, end.far_class, links)
            if all(place.is_flexible for place, _ in builder.balances):
                yield builder


def container_operators(schema: Schema, group: str, cls: str) -> Iterator[RuleBuilder]:
    """Yield the operators that move an object of a class to another container, or swap two contained objects."""
    for end in schema.ends:
        child = next(
            (one for one, other in ((cls, end.far_class), (end.far_class, cls)) if schema.is_a(one, other)),
            None,
        )
        if not end.is_container or child is None or end.is_frozen:
            continue
        if end.is_flexible:
            doc = f"Move a `{child}` to another container by `{end.reference}`."
            builder = RuleBuilder(schema, group, f"move.{cls}.{end.name}", doc)
            part = builder.add_node(child, "part")
            builder.move_object(end, builder.add_node(end.near_class, "container"), part)
            yield builder
        doc = f"Exchange a `{child}` of `{end.reference}` between two containers."
        builder = RuleBuilder(schema, group, f"swap.{cls}.{end.name}", doc)
        _apply_template(builder, end, end.near_class, child, _SWAP_TEMPLATE)
        yield builder


def _changeable_ends(schema: Schema, cls: str) -> Iterator[tuple[ReferenceEnd, Feature]]:
    seen: list[Reference] = []
    ends = [end for end in schema.ends if not (end.is_frozen or end.reference.containment)]
    for feature in schema.features(cls):
        for end in ends:
            if feature == end.feature and end.reference not in seen:
                seen.append(end.reference)
                yield end, feature


def _apply_template(builder: RuleBuilder, end: ReferenceEnd, near: str, far: str, links: str) -> None:
    """Add objects and link changes to a rule by a template `links`, such as `- source target + source other`.

    Sources have the class `near` and targets the class `far`.
    """
    words = links.split()
    changes = list(zip(words[::3], words[1::3], words[2::3], strict=True))
    types: dict[str, str] = {}
    for _, source, target in changes:
        types.setdefault(source, near)
        types.setdefault(target, far)
    for name, cls in types.items():
        builder.add_node(cls, name)
    sources = {source for _, source, _ in changes}
    for one, other in combinations(types, 2):
        # A symmetric link from an object to itself would change the number of its links differently.
        if (one in sources) == (other in sources) or (end.is_symmetric and len(changes) > 2):
            builder.require_different(one, other)
    for sign, source, target in changes:
        (builder.add_link if sign == "+" else builder.remove_link)(end, source, target)


# --- values


def value_operators(schema: Schema, group: str, cls: str) -> Iterator[RuleBuilder]:
    """Yield the operators that flip bools, set enums and step numbers with a range, except keys and frozen features."""
    for feature in schema.features(cls):
        if (
            not isinstance(feature, Attribute)
            or schema.is_left_unchanged(feature)
            or any(feature.name in schema.metamodel.key(sub) for sub in schema.metamodel.concrete_classes(cls))
        ):
            continue
        holder = schema.holder(cls, feature)
        for suffix, doc, asked, value in _attribute_settings(feature):
            name = f"{holder}.{feature.name}"
            builder = RuleBuilder(schema, group, f"set.{name}{suffix}", f"`{name}` {doc}")
            builder.forbid_frozen(builder.add_node(holder, "object"))
            builder.add_constraints(asked)
            builder.add_actions(SetAction(_OBJECT, feature.name, "=", value))
            yield builder


def _attribute_settings(attribute: Attribute) -> Iterator[Setting]:
    """Yield the ways to set an attribute that is a bool, an enum or a number with a range, and nothing for others."""
    old = PathConstraint(attribute.owner, (attribute.name,), _OBJECT, _VALUE)
    if isinstance(attribute.type, EnumType):
        for literal in attribute.type.literals:
            value = EnumLiteral(attribute.type.name, literal)
            yield f".{literal}", f"becomes `{literal}`.", [Negation(replace(old, target=value))], value
    elif attribute.type is Scalar.BOOL:
        yield "", "becomes the opposite.", [old], Unary("!", _VALUE)
    elif attribute.type in (Scalar.INT, Scalar.FLOAT):
        yield from _range_steps(attribute, old)


def _range_steps(attribute: Attribute, old: Constraint) -> Iterator[Setting]:
    """Yield the steps up and down of a number within its range; nothing for a number without a range."""
    if attribute.range is None:
        return
    lowest, highest, step = attribute.range
    for word, limit, compare, sign, choose, most in (
        ("up", highest, "<", "+", "min", "most"),
        ("down", lowest, ">", "-", "max", "least"),
    ):
        moved = FunctionCall(choose, (Binary(sign, _VALUE, Constant(step)), Constant(limit)))
        doc = f"goes {word} by {step}, to {limit} at {most}."
        yield f".{word}", doc, [old, Check(Binary(compare, _VALUE, Constant(limit)))], moved
