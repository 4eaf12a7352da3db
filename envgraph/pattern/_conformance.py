"""Conformance as queries: each match is a violation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph.metamodel import Annotation, Attribute, Class, Feature, Metamodel
from envgraph.pattern._queries import (
    Aggregate,
    Body,
    Check,
    Comparison,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    TypeConstraint,
)
from envgraph.pattern._terms import Binary, Constant, Variable

_PREFIX = "conformance"
"""Part of the names, and no package: a call of `size` never means `conformance.Box.size`."""
_OBJECT = "object"


def conformance_patterns(metamodel: Metamodel) -> tuple[Pattern, ...]:
    """Patterns whose matches are the objects that a metamodel does not allow in a finished model.

    A reference with too few targets, an attribute without a value. Upper bounds, types and containment are refused by
    the model at once and need no query. The pattern of feature `f` of class `C` is `conformance.C.f`.
    """
    return tuple(
        _pattern(cls, feature)
        for cls in metamodel.class_list
        if metamodel.concrete(cls.name)
        for feature in cls.features
        if feature.lower > 0
    )


def key_patterns(metamodel: Metamodel, classes: Iterable[str]) -> tuple[Pattern, ...]:
    """Patterns that match where two objects of a class have one key, or one lacks its own; they have no parameters.

    They are kept current: few changes touch keys, and then nothing has to be looked at. That of class `C`, which has a
    key, is `conformance.C`.
    """
    return tuple(
        Pattern(f"{_PREFIX}.{cls}", (), tuple(_wrong_keys(cls, key)), strategy="incremental")
        for cls in classes
        if (key := metamodel.key(cls))
    )


def _wrong_keys(cls: str, key: Sequence[str]) -> Iterator[Body]:
    one, other = Variable("one"), Variable("other")
    for name in key:
        missing = Negation(PathConstraint(cls, (name,), one, Variable("_")))
        yield Body((TypeConstraint(cls, one), missing))
    values = {name: Variable(f"{name}_") for name in key}
    same = (PathConstraint(cls, (name,), each, values[name]) for name in key for each in (one, other))
    yield Body((*same, Comparison("!=", one, other)))


def _pattern(cls: Class, feature: Feature) -> Pattern:
    what = "value" if isinstance(feature, Attribute) else "target"
    if feature.lower == 1:
        message = f"`{feature.name}` of $object$ has no {what}"
    else:
        message = f"`{feature.name}` of $object$ has fewer than {feature.lower} {what}s"
    annotation = Annotation("Constraint", (), (("key", _OBJECT), ("severity", "error"), ("message", message)))
    return Pattern(
        f"{_PREFIX}.{cls.name}.{feature.name}",
        (Parameter(_OBJECT, cls.name),),
        (Body(tuple(_missing(cls, feature))),),
        annotations=(annotation,),
    )


def _missing(cls: Class, feature: Feature) -> Iterator[Negation | Comparison | Check]:
    path = PathConstraint(cls.name, (feature.name,), Variable(_OBJECT), Variable("_"))
    if feature.lower > 1:
        yield Comparison("==", Variable("n"), Aggregate("count", path))
        yield Check(Binary("<", Variable("n"), Constant(feature.lower)))
    else:
        yield Negation(path)
