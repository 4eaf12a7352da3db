"""Metamodels as `.ecore` files, which Eclipse's tools and pyecore read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from envgraph.errors import visible
from envgraph.metamodel._features import (
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

_HEAD = (
    'xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    'xmlns:ecore="http://www.eclipse.org/emf/2002/Ecore"'
)
ECORE = "http://www.eclipse.org/emf/2002/Ecore"
_TYPES: Mapping[Scalar, str] = {
    Scalar.INT: "ELong",  # of 64 bits, as ours
    Scalar.FLOAT: "EDouble",
    Scalar.BOOL: "EBoolean",
    Scalar.STRING: "EString",
}
_NAMELESS = {code: visible(chr(code)) for code in (*range(32), 0xFFFE, 0xFFFF)}
_ESCAPES = _NAMELESS | str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)

Parts = Mapping[str, str | None]


def metamodel_to_ecore(metamodel: Metamodel) -> str:
    """The text of an `.ecore` file, the same for the same metamodel.

    `envgraph.open` and `load_workspace` read it back. An attribute of type `int` becomes an `ELong`, and `float` an
    `EDouble`. What Ecore has no word for (`@key`, `@glyph`, `@frozen`) stands in annotations with the source
    "envgraph", which other tools skip. A metamodel without a uri gets its name for one. The classes of Ecore itself
    are named, and not written.

    >>> text = metamodel_to_ecore(Metamodel("house", [Class("Room")], uri="http://house"))
    >>> print(text.splitlines()[2])
      <eClassifiers xsi:type="ecore:EClass" name="Room"/>
    """
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines.extend(_package(metamodel, metamodel.packages[0], ""))
    return "\n".join(lines) + "\n"


def _package(metamodel: Metamodel, package: Package, indent: str) -> Iterator[str]:
    name = package.path.rpartition(".")[2] or metamodel.name
    parts = _written({"name": name, "nsURI": package.uri, "nsPrefix": package.prefix})
    tag = "eSubpackages" if package.path else "ecore:EPackage"
    yield f"{indent}<{tag} {parts}>" if package.path else f"<{tag} {_HEAD} {parts}>"
    for cls in metamodel.class_list:
        if cls.package == package.path:
            yield from _class(metamodel, cls, indent + "  ")
    for enum in metamodel.enum_types:
        if enum.package == package.path:
            yield from _enum(enum, indent + "  ")
    for inner in metamodel.packages[1:]:
        if inner.path.rpartition(".")[0] == package.path and inner.uri != ECORE:
            yield from _package(metamodel, inner, indent + "  ")
    yield f"{indent}</{tag}>"


def _enum(enum: EnumType, indent: str) -> Iterator[str]:
    labels, numbers = enum.labels or enum.literals, enum.numbers or range(len(enum.literals))
    inside = [*_documented(enum.doc, indent + "  ")]
    for literal, label, number in zip(enum.literals, labels, numbers, strict=True):
        parts = {
            "name": literal,
            "value": str(number) if number else None,
            "literal": None if label == literal else label,
        }
        inside.append(f"{indent}  <eLiterals {_written(parts)}/>")
    yield from _tag(
        "eClassifiers", {"xsi:type": "ecore:EEnum", "name": simple_name(enum.name)}, inside, indent
    )


def _class(metamodel: Metamodel, cls: Class, indent: str) -> Iterator[str]:
    parts = {
        "xsi:type": "ecore:EClass",
        "name": simple_name(cls.name),
        "abstract": "true" if cls.abstract else None,
        "eSuperTypes": " ".join(_path(metamodel, above) for above in cls.supertypes) or None,
    }
    inside = [*_documented(cls.doc, indent + "  "), *_marks(cls, indent + "  ")]
    for feature in cls.features:
        inside.extend(_feature(metamodel, feature, indent + "  "))
    yield from _tag("eClassifiers", parts, inside, indent)


def _marks(owner: Class | Feature, indent: str) -> Iterator[str]:
    details = {one.name: " ".join(map(str, one.arguments)) for one in owner.annotations}
    if isinstance(owner, Class):
        identifiers = tuple(f.name for f in owner.features if isinstance(f, Attribute) and f.identifier)
        if owner.key and owner.key != identifiers:
            details["key"] = " ".join(owner.key)
        if owner.glyph:
            details["glyph"] = f"{owner.glyph.letter} {owner.glyph.colour}"
        if owner.frozen:
            details["frozen"] = ""
    if details:
        yield from _annotation("envgraph", details, indent)


def _documented(doc: str | None, indent: str) -> Iterator[str]:
    if doc:
        yield from _annotation("http://www.eclipse.org/emf/2002/GenModel", {"documentation": doc}, indent)


def _annotation(source: str, details: Mapping[str, str], indent: str) -> Iterator[str]:
    inside = [
        f"{indent}  <details {_written({'key': key, 'value': value})}/>" for key, value in details.items()
    ]
    yield from _tag("eAnnotations", {"source": source}, inside, indent)


def _feature(metamodel: Metamodel, feature: Feature, indent: str) -> Iterator[str]:
    parts = (
        _attribute(metamodel, feature) if isinstance(feature, Attribute) else _reference(metamodel, feature)
    )
    inside = [*_documented(feature.doc, indent + "  "), *_marks(feature, indent + "  ")]
    yield from _tag("eStructuralFeatures", parts, inside, indent)


def _attribute(metamodel: Metamodel, attribute: Attribute) -> Parts:
    type_ = attribute.type
    if isinstance(type_, EnumType):
        shown = _path(metamodel, type_.name)
    else:
        shown = f"ecore:EDataType {ECORE}#//{_TYPES[type_]}"
        if attribute.optional and not attribute.many and type_ is not Scalar.STRING:
            shown = f"ecore:EDataType {ECORE}#//{_TYPES[type_]}Object"
    return {
        "xsi:type": "ecore:EAttribute",
        "name": attribute.name,
        "unique": "false" if attribute.many and not attribute.unique else None,
        "lowerBound": None if attribute.optional else str(attribute.lower),
        "upperBound": None if attribute.upper == 1 else str(attribute.upper or -1),
        "eType": shown,
        "defaultValueLiteral": None if attribute.default is None else xml_value(attribute, attribute.default),
        "iD": "true" if attribute.identifier else None,
    }


def _reference(metamodel: Metamodel, reference: Reference) -> Parts:
    opposite, target = metamodel.opposite(reference), _path(metamodel, reference.target)
    return {
        "xsi:type": "ecore:EReference",
        "name": reference.name,
        "lowerBound": str(reference.lower) if reference.lower else None,
        "upperBound": None if reference.upper == 1 else str(reference.upper or -1),
        "eType": target if target.startswith("#") else f"ecore:EClass {target}",
        "containment": "true" if reference.containment else None,
        "eOpposite": f"{_path(metamodel, opposite.owner)}/{opposite.name}" if opposite else None,
    }


def _path(metamodel: Metamodel, name: str) -> str:
    found = metamodel.classes.get(name) or metamodel.enums[name]
    inside = found.package.replace(".", "/")
    simple = simple_name(name)
    if inside and any(one.path == found.package and one.uri == ECORE for one in metamodel.packages):
        return f"{ECORE}#//{simple}"
    return f"#//{inside}/{simple}" if inside else f"#//{simple}"


def _tag(name: str, parts: Parts, inside: list[str], indent: str) -> Iterator[str]:
    if not inside:
        yield f"{indent}<{name} {_written(parts)}/>"
        return
    yield f"{indent}<{name} {_written(parts)}>"
    yield from inside
    yield f"{indent}</{name}>"


def _written(parts: Parts) -> str:
    return " ".join(f'{key}="{xml_text(value)}"' for key, value in parts.items() if value is not None)


def xml_text(text: str) -> str:
    """A text as XML has it, in a tag or between double quotes.

    Not by `xml.sax.saxutils`, which imports all that it takes to speak HTTP.

    >>> xml_text('a < "b"')
    'a &lt; &quot;b&quot;'
    """
    return text.translate(_ESCAPES)


def xml_value(attribute: Attribute, value: Value) -> str:
    """A value of an attribute as Ecore's tools write it.

    >>> xml_value(Attribute("a", Scalar.BOOL), True), xml_value(Attribute("a", Scalar.FLOAT), float("-inf"))
    ('true', '-Infinity')
    """
    type_ = attribute.type
    if isinstance(type_, EnumType):
        return type_.labels[type_.literals.index(str(value))] if type_.labels else str(value)
    if type_ is Scalar.BOOL:
        return "true" if value else "false"
    if type_ is Scalar.FLOAT:
        return repr(float(value)).replace("inf", "Infinity")
    return str(value)
