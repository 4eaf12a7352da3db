"""Write metamodels as `.ecore` files, which Eclipse's tools and pyecore read."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType

from envgraph.errors import escape_unprintable
from envgraph.metamodel._features import (
    Annotation,
    Attribute,
    Class,
    EnumType,
    Feature,
    Package,
    Reference,
    Scalar,
    Value,
    simple_name,
)
from envgraph.metamodel._metamodel import Metamodel

ECORE = "http://www.eclipse.org/emf/2002/Ecore"
_ROOT_ATTRIBUTES = {
    "xmi:version": "2.0",
    "xmlns:xmi": "http://www.omg.org/XMI",
    "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
    "xmlns:ecore": ECORE,
}
_TYPES: Mapping[Scalar, str] = {
    Scalar.INT: "ELong",  # of 64 bits, as in envgraph
    Scalar.FLOAT: "EDouble",
    Scalar.BOOL: "EBoolean",
    Scalar.STRING: "EString",
}
_NEVER_EMPTY = ("EInt", "ELong", "EShort", "EByte", "EDouble", "EFloat", "EBoolean")
"""Ecore types whose attributes always have a value, whatever their lower bound."""
_GENMODEL = "http://www.eclipse.org/emf/2002/GenModel"
_NAMELESS = {code: escape_unprintable(chr(code)) for code in (*range(32), 0xFFFE, 0xFFFF)}
_ESCAPES = _NAMELESS | str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)
_ESCAPED = re.compile('[&<>"\0-\x1f\ufffe\uffff]')
"""Characters to escape; searching for them first takes a fifth of the time of translating."""

XmlAttributes = Mapping[str, str | None]


def metamodel_to_ecore(metamodel: Metamodel) -> str:
    """Return the text of an `.ecore` file; equal metamodels give equal texts.

    `envgraph.open` and `load_workspace` read it back. An attribute of type `int` becomes an `ELong`, and `float` an
    `EDouble`, unless `@ecore(eType = "EInt")` names another type. Annotations that Ecore lacks (`@key`, `@glyph`,
    `@frozen`) are written with the source "envgraph", which other tools ignore. A metamodel without a URI gets its name
    as nsURI. The classes of Ecore itself are not written, but references to them are.

    >>> text = metamodel_to_ecore(Metamodel("house", [Class("Room")], uri="http://house"))
    >>> print(text.splitlines()[2])
      <eClassifiers xsi:type="ecore:EClass" name="Room"/>
    """
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        *_EcoreWriter(metamodel).format_package(metamodel.packages[0]),
    ]
    return "\n".join(lines) + "\n"


class _EcoreWriter:
    """A writer of the XML tags of one metamodel, as lists of lines without the indentation of enclosing tags."""

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._ecore = [one.path for one in metamodel.packages if one.uri == ECORE]
        self._packages: dict[str, list[Package]] = defaultdict(list)
        self._classifiers: dict[str, list[str]] = defaultdict(list)
        for inner in metamodel.packages[1:]:
            self._packages[inner.path.rpartition(".")[0]].append(inner)
        for cls in metamodel.class_list:
            self._classifiers[cls.package] += self._format_class(cls)
        for enum in metamodel.enum_types:
            self._classifiers[enum.package] += self._format_enum(enum)

    def format_package(self, package: Package) -> list[str]:
        name = package.path.rpartition(".")[2] or self._metamodel.name
        parts = {"name": name, "nsURI": package.uri, "nsPrefix": package.prefix}
        notes = package.annotations
        starts = [place for place, one in enumerate(notes) if one.name == "datatype"] + [len(notes)]
        inside = [*_format_annotations(None, notes[: starts[0]]), *self._classifiers[package.path]]
        for start, end in pairwise(starts):
            inside += self._format_data_type(notes[start:end])
        for inner in self._packages[package.path]:
            inside += self.format_package(inner) if inner.uri != ECORE else []
        if package.path:
            return _format_tag("eSubpackages", parts, inside)
        return _format_tag("ecore:EPackage", {**_ROOT_ATTRIBUTES, **parts}, inside)

    def _format_data_type(self, notes: Sequence[Annotation]) -> list[str]:
        parts = {
            "xsi:type": "ecore:EDataType",
            "name": str(notes[0].arguments[0]),
            **_named_xml_attributes(notes),
        }
        return _format_tag("eClassifiers", parts, _format_annotations(None, notes))

    def _format_enum(self, enum: EnumType) -> list[str]:
        labels, numbers = enum.labels or enum.literals, enum.numbers or range(len(enum.literals))
        inside = _format_annotations(enum.doc, enum.annotations)
        for literal, label, number in zip(enum.literals, labels, numbers, strict=True):
            parts = {
                "name": literal,
                "value": str(number) if number else None,
                "literal": None if label == literal else label,
            }
            inside += _format_tag("eLiterals", parts)
        parts = {
            "xsi:type": "ecore:EEnum",
            "name": simple_name(enum.name),
            **_named_xml_attributes(enum.annotations),
        }
        return _format_tag("eClassifiers", parts, inside)

    def _format_class(self, cls: Class) -> list[str]:
        parts = {
            "xsi:type": "ecore:EClass",
            "name": simple_name(cls.name),
            "abstract": "true" if cls.abstract else None,
            "eSuperTypes": " ".join(map(self._element_path, cls.supertypes)) or None,
            **_named_xml_attributes(cls.annotations),
        }
        marks = _envgraph_annotation_details(cls.annotations)
        identifiers = tuple(f.name for f in cls.features if isinstance(f, Attribute) and f.identifier)
        if cls.key and cls.key != identifiers:
            marks["key"] = " ".join(cls.key)
        if cls.glyph:
            marks["glyph"] = f"{cls.glyph.letter} {cls.glyph.colour}"
        if cls.frozen:
            marks["frozen"] = ""
        inside = _format_annotations(cls.doc, cls.annotations, marks)
        for feature in cls.features:
            inside += self._format_feature(feature)
        return _format_tag("eClassifiers", parts, inside)

    def _format_feature(self, feature: Feature) -> list[str]:
        named = _named_xml_attributes(feature.annotations)
        parts = {
            "xsi:type": f"ecore:E{type(feature).__name__}",
            "name": feature.name,
            **simple_xml_attributes(feature, named.get("eType")),
            **named,
        }
        if isinstance(feature, Reference):
            parts.update(self._reference_attributes(feature, named))
        else:
            enum = self._element_path(feature.type.name) if isinstance(feature.type, EnumType) else ""
            found = parts["eType"] or enum
            found = found if "#" in found else f"{ECORE}#//{found}"
            parts["eType"] = found if found.startswith("#") else f"ecore:EDataType {found}"
        notes = _format_annotations(feature.doc, feature.annotations, _envgraph_annotation_details(feature.annotations))
        return _format_tag("eStructuralFeatures", parts, notes)

    def _reference_attributes(self, reference: Reference, named: XmlAttributes) -> XmlAttributes:
        """Return the XML attributes of a reference that refer to other elements: target, opposite and keys."""
        features, target = self._metamodel.features(reference.target), self._element_path(reference.target)
        keys = [features[name] for name in (named.get("eKeys") or "").split() if name in features]
        opposite = self._metamodel.opposite(reference) or features.get(named.get("eOpposite") or "")
        return {
            "eType": target if target.startswith("#") else f"ecore:EClass {target}",
            "eOpposite": f"{self._element_path(opposite.owner)}/{opposite.name}" if opposite else None,
            "eKeys": " ".join(f"{self._element_path(one.owner)}/{one.name}" for one in keys) or None,
        }

    def _element_path(self, name: str) -> str:
        found = self._metamodel.classes.get(name) or self._metamodel.enums[name]
        simple = simple_name(name)
        if found.package in self._ecore and found.package:
            return f"{ECORE}#//{simple}"
        return f"#//{found.package.replace('.', '/')}/{simple}" if found.package else f"#//{simple}"


def _envgraph_annotation_details(annotations: Iterable[Annotation]) -> dict[str, str]:
    """Return the annotations for which Ecore has no syntax, as keys and values of one annotation of Ecore."""
    return {
        one.name: " ".join([*map(str, one.arguments), *(f"{key}={value}" for key, value in one.named)])
        for one in annotations
        if one.name not in ("ecore", "annotation", "derived")
    }


def _format_annotations(
    doc: str | None, annotations: Iterable[Annotation], marks: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """Return the lines of annotation tags: documentation, annotations of other tools, and envgraph's own (`marks`)."""
    found = [(str(one.arguments[0]), one.details) for one in annotations if one.name == "annotation"]
    if doc:
        place = next((place for place, (source, _) in enumerate(found) if source == _GENMODEL), None)
        others = [] if place is None else found.pop(place)[1]
        found.insert(place or 0, (_GENMODEL, [("documentation", doc), *others]))
    if marks:
        found.append(("envgraph", [*marks.items()]))
    lines = []
    for source, details in found:
        inside = [line for key, value in details for line in _format_tag("details", {"key": key, "value": value})]
        lines += _format_tag("eAnnotations", {"source": source}, inside)
    return lines


def simple_xml_attributes(feature: Feature, type_name: str | None = None) -> dict[str, str | None]:
    """Return the XML attributes of a feature that refer to no other element; `type_name` is its type in `@ecore`."""
    parts = {
        "lowerBound": str(feature.lower) if feature.lower else None,
        "upperBound": None if feature.upper == 1 else str(feature.upper or -1),
        "derived": "true" if any(one.name == "derived" for one in feature.annotations) else None,
    }
    if isinstance(feature, Reference):
        return parts | {"containment": "true" if feature.containment else None}
    boxed = feature.optional and not feature.many and feature.type is not Scalar.STRING
    own = None if isinstance(feature.type, EnumType) else _TYPES[feature.type] + "Object" * boxed
    if not feature.many and (feature.default is not None or (type_name or own) in (None, *_NEVER_EMPTY)):
        parts["lowerBound"] = None
    return parts | {
        "unique": "false" if feature.many and not feature.unique else None,
        "eType": own,
        "defaultValueLiteral": None if feature.default is None else format_xml_value(feature, feature.default),
        "iD": "true" if feature.identifier else None,
    }


def _named_xml_attributes(annotations: Iterable[Annotation]) -> dict[str, str | None]:
    """Return the XML attributes that the annotations `@ecore` and `@datatype` contain."""
    known = (one.named for one in annotations if one.name in ("ecore", "datatype"))
    return {key: str(value) for named in known for key, value in named}


def _format_tag(name: str, parts: XmlAttributes, inside: Iterable[str] = ()) -> list[str]:
    """Return the lines of a tag with its XML attributes, those that are None left out, and the lines `inside`."""
    head = " ".join([f"<{name}", *(f'{key}="{escape_xml(text)}"' for key, text in parts.items() if text is not None)])
    lines = [f"  {line}" for line in inside]
    return [f"{head}>", *lines, f"</{name}>"] if lines else [f"{head}/>"]


def escape_xml(text: str) -> str:
    """Return a text with the escapes that XML needs in tags and between double quotes.

    `xml.sax.saxutils` is not used because it imports the modules for HTTP.

    >>> escape_xml('a < "b"')
    'a &lt; &quot;b&quot;'
    """
    return text.translate(_ESCAPES) if _ESCAPED.search(text) else text


def format_xml_value(attribute: Attribute, value: Value) -> str:
    """Return an attribute's value as Ecore's tools write it.

    >>> format_xml_value(Attribute("a", Scalar.BOOL), True)
    'true'
    >>> format_xml_value(Attribute("a", Scalar.FLOAT), float("-inf"))
    '-Infinity'
    """
    type_ = attribute.type
    if isinstance(type_, EnumType):
        return type_.labels[type_.literals.index(str(value))] if type_.labels else str(value)
    if type_ is Scalar.BOOL:
        return "true" if value else "false"
    if type_ is Scalar.FLOAT:
        return repr(float(value)).replace("inf", "Infinity")
    return str(value)
