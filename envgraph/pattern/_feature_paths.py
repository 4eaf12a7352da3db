"""Resolve feature paths (`Type.f1.f2`) step by step."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Severity, Span
from envgraph.metamodel import Attribute, Feature, Metamodel, Reference, type_name
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._query_data import Closure
from envgraph.pattern._types import least_common_supertypes


@dataclass(frozen=True, slots=True)
class ResolvedPath:
    """A path whose class and features exist. All steps but the last are references."""

    cls: str
    steps: tuple[Feature, ...]

    @property
    def source(self) -> StaticType:
        """Return the type that the path requires of its source."""
        return ObjectType(self.cls)

    @property
    def target(self) -> StaticType:
        """Return the type of the values or objects at the end of the path."""
        return target_type(self.steps[-1])

    def __str__(self) -> str:
        return ".".join([self.cls, *(step.name for step in self.steps)])


@dataclass(frozen=True, slots=True)
class InvalidPath:
    """An error in a path: class `cls` lacks the feature at `position`, or the feature before it is an `attribute`."""

    position: int
    cls: str
    attribute: Attribute | None = None


def target_type(feature: Feature) -> StaticType:
    """Return the type of the values or targets of a feature."""
    return ObjectType(feature.target) if isinstance(feature, Reference) else feature.type


def resolve_path(cls: str, features: tuple[str, ...], metamodel: Metamodel) -> ResolvedPath | InvalidPath:
    """Look up every step of a path that starts at a known class. Return a `InvalidPath` at the first step with an
    error.

    Features are looked up on the static type. A feature of a subclass has to be written on the subclass.
    """
    steps: list[Feature] = []
    current = cls
    for position, name in enumerate(features):
        if steps and isinstance(steps[-1], Attribute):
            return InvalidPath(position, current, steps[-1])
        feature = metamodel.feature(current, name)
        if feature is None:
            return InvalidPath(position, current)
        steps.append(feature)
        if isinstance(feature, Reference):
            current = feature.target
    return ResolvedPath(cls, tuple(steps))


def is_derived(feature: Feature) -> bool:
    """Return True if the metamodel marks the feature as computed (`@derived`)."""
    return any(annotation.name == "derived" for annotation in feature.annotations)


def derived_feature_warning(feature: Feature, span: Span | None) -> Diagnostic:
    """Return the warning that a query reads a derived feature that no query defines."""
    message = f"`{feature.name}` is derived, but no query computes it: only stored values are read"
    value = type_name(feature.type) if isinstance(feature, Attribute) else feature.target
    pattern = f"pattern {feature.name}(this : {feature.owner}, value : {value}) {{ .. }}"
    hint = f"define it: `@QueryBasedFeature {pattern}`"
    return Diagnostic("derived-feature", message, span, hint, Severity.WARNING)


def closure_target_type(
    source: StaticType, target: StaticType, closure: Closure, metamodel: Metamodel
) -> StaticType | None:
    """Return the type of the targets of a closure whose steps lead from `source` to `target`.

    It is `target`, except for `*`, which also relates an object to itself. Then it is a common supertype of both types,
    or None if no common supertype exists.
    """
    if closure is not Closure.STAR:
        return target
    return next(iter(least_common_supertypes((source, target), metamodel)), None)
