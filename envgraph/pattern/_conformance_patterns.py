"""Generate patterns whose matches are violations of a metamodel's lower bounds and keys."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from envgraph.metamodel import Annotation, Attribute, Class, Feature, Metamodel
from envgraph.pattern._expression_data import Binary, Constant, Variable
from envgraph.pattern._query_data import (
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

_NAME_PREFIX = "conformance"
"""A prefix of names, not a package, so that a call of `size` never means `conformance.Box.size`."""
_OBJECT_PARAMETER = "object"


def conformance_patterns(metamodel: Metamodel) -> tuple[Pattern, ...]:
    """Return patterns whose matches are objects that a metamodel does not allow in a finished model.

    The matches are objects with too few targets of a reference, or without a value of an attribute. Upper bounds, types
    and containment need no pattern, because the model refuses violations. The pattern of feature `f` of class `C` is
    `conformance.C.f`.
    """
    return tuple(
        _multiplicity_pattern(cls, feature)
        for cls in metamodel.class_list
        if metamodel.concrete_classes(cls.name)
        for feature in cls.features
        if feature.lower > 0
    )


def key_patterns(metamodel: Metamodel, classes: Iterable[str]) -> tuple[Pattern, ...]:
    """Return a pattern without parameters for each class that has a key; it matches if a key is violated.

    A key is violated if two objects have the same key, or if an object lacks a value of it. The patterns are views,
    because changes of keys are rare. The pattern of class `C` is `conformance.C`.
    """
    return tuple(
        Pattern(f"{_NAME_PREFIX}.{cls}", (), tuple(_key_violations(cls, key)), strategy="incremental")
        for cls in classes
        if (key := metamodel.key(cls))
    )


def _key_violations(cls: str, key: Sequence[str]) -> Iterator[Body]:
    one, other = Variable("one"), Variable("other")
    for name in key:
        missing = Negation(PathConstraint(cls, (name,), one, Variable("_")))
        yield Body((TypeConstraint(cls, one), missing))
    values = {name: Variable(f"{name}_") for name in key}
    same = (PathConstraint(cls, (name,), each, values[name]) for name in key for each in (one, other))
    yield Body((*same, Comparison("!=", one, other)))


def _multiplicity_pattern(cls: Class, feature: Feature) -> Pattern:
    what = "value" if isinstance(feature, Attribute) else "target"
    if feature.lower == 1:
        message = f"`{feature.name}` of $object$ has no {what}"
    else:
        message = f"`{feature.name}` of $object$ has fewer than {feature.lower} {what}s"
    annotation = Annotation("Constraint", (), (("key", _OBJECT_PARAMETER), ("severity", "error"), ("message", message)))
    return Pattern(
        f"{_NAME_PREFIX}.{cls.name}.{feature.name}",
        (Parameter(_OBJECT_PARAMETER, cls.name),),
        (Body(tuple(_violation_constraints(cls, feature))),),
        annotations=(annotation,),
    )


def _violation_constraints(cls: Class, feature: Feature) -> Iterator[Negation | Comparison | Check]:
    path = PathConstraint(cls.name, (feature.name,), Variable(_OBJECT_PARAMETER), Variable("_"))
    if feature.lower > 1:
        yield Comparison("==", Variable("n"), Aggregate("count", path))
        yield Check(Binary("<", Variable("n"), Constant(feature.lower)))
    else:
        yield Negation(path)
