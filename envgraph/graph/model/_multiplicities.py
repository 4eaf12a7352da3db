"""Check the demands of a metamodel that writing does not enforce, such as lower bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

from envgraph.code import dataclass
from envgraph.graph.model._model import Model
from envgraph.metamodel import Attribute, Feature


@dataclass(frozen=True, slots=True)
class Violation:
    """An object with the wrong number of values or targets of a feature, or a value outside of its range.

    Attributes:
        kind: "missing-value", "too-few" or "too-many" targets or values, or "outside-range".
        node: id of the object.
        feature: the feature with the wrong values or number of targets.
        message: one line; objects by name, else by class and id.
    """

    kind: Literal["missing-value", "too-few", "too-many", "outside-range"]
    node: int
    feature: Feature
    message: str

    def __str__(self) -> str:
        return self.message


def check_conformance(model: Model) -> list[Violation]:
    """Return all violations of multiplicities (unset attributes, too few or too many values or targets) and `@range`s.

    A single-valued optional attribute (0..1) needs no value. An object without a container is a root, which is no
    violation. Types, containment, opposites and upper bounds are enforced by every write. Features defined by queries
    are not checked.

    Returns:
        The violations class by class, then by object in the order of the extents, then by feature; [] if the model
        conforms.
    """
    violations: list[Violation] = []
    for cls in model.metamodel.class_list:
        nodes = model.graph.exact_extent(cls.name)
        if not nodes:
            continue
        known = [one for one in model.metamodel.features(cls.name).values() if one not in model.graph.defined_features]
        pairs = [(one, one.range if isinstance(one, Attribute) else None) for one in known]
        pairs = [(one, range) for one, range in pairs if range or one.lower > 0 or (one.many and one.upper is not None)]
        for node in nodes:
            for feature, range in pairs:
                violations.extend(_violations(model, node, feature, range))
    return violations


def _violations(model: Model, node: int, feature: Feature, range: Sequence[float] | None) -> Iterator[Violation]:
    held = model.graph.values(node, feature) if isinstance(feature, Attribute) else model.graph.targets(node, feature)
    for value in held if range else ():
        if range and isinstance(value, int | float) and not range[0] <= value <= range[1]:
            text = f"{model.graph.describe(node)} has {value} as `{feature.name}`, outside of its range"
            yield Violation("outside-range", node, feature, f"{text} from {range[0]:g} to {range[1]:g}")
    count = len(held)
    if isinstance(feature, Attribute) and not feature.many and count < feature.lower:
        text = f"{model.graph.describe(node)} has no value of `{feature.name}`"
        yield Violation("missing-value", node, feature, text)
    elif count < feature.lower:
        yield Violation("too-few", node, feature, _count_message(model, node, feature, count))
    if feature.upper is not None and count > feature.upper:
        yield Violation("too-many", node, feature, _count_message(model, node, feature, count))


def _count_message(model: Model, node: int, feature: Feature, count: int) -> str:
    what = "value" if isinstance(feature, Attribute) else "target"
    found = f"no {what}" if count == 0 else f"1 {what}" if count == 1 else f"{count} {what}s"
    return f"{model.graph.describe(node)} has {found} of `{feature.name}`, which needs {feature.multiplicity}"
