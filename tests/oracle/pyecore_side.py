"""Packages and objects of pyecore: read from text, written to text, and told in words that can be compared."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from pyecore.ecore import EAttribute, EClass, EEnum, EPackage, EReference
from pyecore.resources import ResourceSet
from pyecore.resources.resource import URI
from pyecore.resources.xmi import XMIResource

from envgraph.graph import Model
from envgraph.metamodel import Attribute, Metamodel


class Text(URI):
    """A text that pyecore takes for a file."""

    def __init__(self, name: str, text: str = "") -> None:
        super().__init__(name)
        self.written = io.BytesIO()
        self._text = text

    def create_instream(self) -> io.BytesIO:
        return io.BytesIO(self._text.encode())

    def create_outstream(self) -> io.BytesIO:
        return self.written

    def close_stream(self) -> None:
        return


def read_package(text: str) -> EPackage:
    resource = ResourceSet().get_resource(Text("m.ecore", text))
    return resource.contents[0]


def read_objects(text: str, package: EPackage) -> list[Any]:
    resources = ResourceSet()
    for one in (package, *package.eSubpackages):
        resources.metamodel_registry[one.nsURI] = one
    return list(resources.get_resource(Text("m.xmi", text)).contents)


def write(*contents: Any, ids: bool = False) -> str:
    """The text that pyecore makes of a package, or of objects."""
    resource = XMIResource(Text("out.xmi"), use_uuid=ids)
    for one in contents:
        resource.append(one)
    target = Text("out.xmi")
    resource.save(output=target)
    return target.written.getvalue().decode()


def package_in_words(package: EPackage) -> dict[str, object]:
    """Classes with their features, and enums, by name."""
    found: dict[str, object] = {}
    for one in package.eClassifiers:
        if isinstance(one, EClass):
            features = [_feature(feature) for feature in one.eStructuralFeatures]
            found[one.name] = (one.abstract, [above.name for above in one.eSuperTypes], features)
        elif isinstance(one, EEnum):
            found[one.name] = [(literal.name, literal.value) for literal in one.eLiterals]
    for inner in package.eSubpackages:
        found.update(package_in_words(inner))
    return found


def _feature(feature: EAttribute | EReference) -> tuple[object, ...]:
    if isinstance(feature, EReference):
        opposite = feature.eOpposite.name if feature.eOpposite else None
        bounds = feature.lowerBound, feature.upperBound
        return feature.name, feature.eType.name, *bounds, feature.containment, opposite
    if feature.many:
        return feature.name, feature.eType.name, feature.lowerBound, feature.upperBound, feature.unique
    return feature.name, feature.eType.name, feature.defaultValueLiteral


def metamodel_in_words(metamodel: Metamodel) -> dict[str, object]:
    """The same of one of our metamodels."""
    types = {"int": "ELong", "float": "EDouble", "bool": "EBoolean", "string": "EString"}
    found: dict[str, object] = {}
    for cls in metamodel.class_list:
        features: list[tuple[object, ...]] = []
        for one in cls.features:
            if isinstance(one, Attribute):
                name = types.get(str(one.type)) or getattr(one.type, "name", "")
                if one.many:
                    upper = -1 if one.upper is None else one.upper
                    features.append((one.name, name, one.lower, upper, one.unique))
                    continue
                name += "Object" * (one.optional and name in ("ELong", "EDouble", "EBoolean"))
                default = None if one.default is None else _text(one, one.default)
                features.append((one.name, name, default))
            else:
                upper = -1 if one.upper is None else one.upper
                features.append((one.name, one.target, one.lower, upper, one.containment, one.opposite))
        found[cls.name] = (cls.abstract, list(cls.supertypes), features)
    for enum in metamodel.enum_types:
        numbers = enum.numbers or range(len(enum.literals))
        found[enum.name] = list(zip(enum.literals, numbers, strict=True))
    return found


def _text(attribute: Attribute, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if str(attribute.type) == "float":
        return repr(float(value)).replace("inf", "Infinity")  # type: ignore[arg-type]
    return str(value)


def objects_in_words(roots: list[Any], metamodel: Metamodel) -> list[object]:
    """Every object in the order of the tree: its class, its values, and the numbers of its targets."""
    objects: list[Any] = []
    waiting = list(reversed(roots))
    while waiting:
        one = waiting.pop()
        objects.append(one)
        inside = [
            child
            for feature in metamodel.features(one.eClass.name).values()
            if not isinstance(feature, Attribute) and feature.containment
            for child in _targets(one, feature.name, feature.many)
        ]
        waiting.extend(reversed(inside))
    numbers = {id(one): number for number, one in enumerate(objects)}
    return [_in_words(one, metamodel, numbers) for one in objects]


def _in_words(one: Any, metamodel: Metamodel, numbers: Mapping[int, int]) -> object:
    values: dict[str, object] = {}
    for feature in metamodel.features(one.eClass.name).values():
        if isinstance(feature, Attribute):
            value = getattr(one, feature.name)
            values[feature.name] = tuple(map(_plain, value)) if feature.many else _plain(value)
        else:
            targets = [numbers[id(target)] for target in _targets(one, feature.name, feature.many)]
            # pyecore does not keep the order of a list whose opposite has been read before.
            values[feature.name] = sorted(targets) if feature.opposite else targets
    return one.eClass.name, values


def _plain(value: Any) -> object:
    return value if value is None or isinstance(value, (int, float, str)) else str(value)


def _targets(one: Any, name: str, many: bool) -> list[Any]:
    found = getattr(one, name)
    return list(found) if many else [] if found is None else [found]


def model_in_words(model: Model) -> list[object]:
    """The same of one of our models."""
    roots = [node for node in sorted(model.graph.store.nodes()) if model.graph.container(node) is None]
    order: list[int] = []
    waiting = list(reversed(roots))
    while waiting:
        node = waiting.pop()
        order.append(node)
        inside = [
            child
            for feature in model.metamodel.features(model.graph.class_of(node)).values()
            if not isinstance(feature, Attribute) and feature.containment
            for child in model.graph.targets(node, feature)
        ]
        waiting.extend(reversed(inside))
    numbers = {node: number for number, node in enumerate(order)}
    found: list[object] = []
    for node in order:
        values: dict[str, object] = {}
        for feature in model.metamodel.features(model.graph.class_of(node)).values():
            if isinstance(feature, Attribute):
                values[feature.name] = model.graph.value(node, feature)
            else:
                targets = [numbers[target] for target in model.graph.targets(node, feature)]
                values[feature.name] = sorted(targets) if feature.opposite else targets
        found.append((model.graph.class_of(node), values))
    return found
