"""Metamodels as `.ecore` files, which Eclipse's tools and pyecore read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise

from envgraph.errors import visible
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
_NEVER_EMPTY = ("EInt", "ELong", "EShort", "EByte", "EDouble", "EFloat", "EBoolean")
"""An attribute of these types has a value in Ecore, whatever its lower bound."""
_GENMODEL = "http://www.eclipse.org/emf/2002/GenModel"
_NAMELESS = {code: visible(chr(code)) for code in (*range(32), 0xFFFE, 0xFFFF)}
_ESCAPES = _NAMELESS | str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)

Parts = Mapping[str, str | None]


def metamodel_to_ecore(metamodel: Metamodel) -> str:
    """The text of an `.ecore` file, the same for the same metamodel.

    `envgraph.open` and `load_workspace` read it back. An attribute of type `int` becomes an `ELong`, and `float` an
    `EDouble`, unless `@ecore(eType = "EInt")` names another type. What Ecore has no word for (`@key`, `@glyph`,
    `@frozen`) is written as annotations with the source "envgraph", which other tools skip. A metamodel without a uri
    gets its name for one. The classes of Ecore itself are named, and not written.

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
    notes = package.annotations
    starts = [place for place, one in enumerate(notes) if one.name == "datatype"] + [len(notes)]
    yield from _annotations(None, notes[: starts[0]], indent + "  ")
    for cls in metamodel.class_list:
        if cls.package == package.path:
            yield from _class(metamodel, cls, indent + "  ")
    for enum in metamodel.enum_types:
        if enum.package == package.path:
            yield from _enum(enum, indent + "  ")
    for start, end in pairwise(starts):
        head = {
            "xsi:type": "ecore:EDataType",
            "name": str(notes[start].arguments[0]),
            **_named(notes[start:end]),
        }
        yield from _tag(
            "eClassifiers", head, [*_annotations(None, notes[start:end], indent + "    ")], indent + "  "
        )
    for inner in metamodel.packages[1:]:
        if inner.path.rpartition(".")[0] == package.path and inner.uri != ECORE:
            yield from _package(metamodel, inner, indent + "  ")
    yield f"{indent}</{tag}>"


def _enum(enum: EnumType, indent: str) -> Iterator[str]:
    labels, numbers = enum.labels or enum.literals, enum.numbers or range(len(enum.literals))
    inside = [*_annotations(enum.doc, enum.annotations, indent + "  ")]
    for literal, label, number in zip(enum.literals, labels, numbers, strict=True):
        parts = {
            "name": literal,
            "value": str(number) if number else None,
            "literal": None if label == literal else label,
        }
        inside.append(f"{indent}  <eLiterals {_written(parts)}/>")
    head = {"xsi:type": "ecore:EEnum", "name": simple_name(enum.name), **_named(enum.annotations)}
    yield from _tag("eClassifiers", head, inside, indent)


def _class(metamodel: Metamodel, cls: Class, indent: str) -> Iterator[str]:
    parts = {
        "xsi:type": "ecore:EClass",
        "name": simple_name(cls.name),
        "abstract": "true" if cls.abstract else None,
        "eSuperTypes": " ".join(_path(metamodel, above) for above in cls.supertypes) or None,
        **_named(cls.annotations),
    }
    inside = [*_annotations(cls.doc, cls.annotations, indent + "  "), *_marks(cls, indent + "  ")]
    for feature in cls.features:
        inside.extend(_feature(metamodel, feature, indent + "  "))
    yield from _tag("eClassifiers", parts, inside, indent)


def _marks(owner: Class | Feature, indent: str) -> Iterator[str]:
    details = {
        one.name: " ".join([*map(str, one.arguments), *(f"{key}={value}" for key, value in one.named)])
        for one in owner.annotations
        if one.name not in ("ecore", "annotation", "derived")
    }
    if isinstance(owner, Class):
        identifiers = tuple(f.name for f in owner.features if isinstance(f, Attribute) and f.identifier)
        if owner.key and owner.key != identifiers:
            details["key"] = " ".join(owner.key)
        if owner.glyph:
            details["glyph"] = f"{owner.glyph.letter} {owner.glyph.colour}"
        if owner.frozen:
            details["frozen"] = ""
    if details:
        yield from _annotation("envgraph", details.items(), indent)


def _annotations(doc: str | None, annotations: Iterable[Annotation], indent: str) -> Iterator[str]:
    """Write the documentation and the annotations that are meant for other tools."""
    documented = [("documentation", doc)] if doc else []
    for one in annotations:
        if one.name != "annotation":
            continue
        details = one.details
        if one.is_from(_GENMODEL):
            details, documented = [*documented, *details], []
        yield from _annotation(str(one.arguments[0]), details, indent)
    if documented:
        yield from _annotation(_GENMODEL, documented, indent)


def _annotation(source: str, details: Iterable[tuple[str, str]], indent: str) -> Iterator[str]:
    inside = [f"{indent}  <details {_written({'key': key, 'value': value})}/>" for key, value in details]
    yield from _tag("eAnnotations", {"source": source}, inside, indent)


def _feature(metamodel: Metamodel, feature: Feature, indent: str) -> Iterator[str]:
    named = _named(feature.annotations)
    parts = {"name": feature.name, **plain_parts(feature, named.get("eType")), **named}
    if isinstance(feature, Reference):
        parts = {
            "xsi:type": "ecore:EReference",
            **parts,
            **_references(metamodel, feature, named),
        }
    else:
        enum = _path(metamodel, feature.type.name) if isinstance(feature.type, EnumType) else ""
        found = parts["eType"] or enum
        found = found if "#" in found else f"{ECORE}#//{found}"
        parts["eType"] = found if found.startswith("#") else f"ecore:EDataType {found}"
        parts = {"xsi:type": "ecore:EAttribute", **parts}
    inside = [*_annotations(feature.doc, feature.annotations, indent + "  "), *_marks(feature, indent + "  ")]
    yield from _tag("eStructuralFeatures", parts, inside, indent)


def plain_parts(feature: Feature, type_name: str | None = None) -> dict[str, str | None]:
    """Return XML attributes of a feature, but not names of others; `type_name` is the data type that `@ecore` names."""
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
        "defaultValueLiteral": None if feature.default is None else xml_value(feature, feature.default),
        "iD": "true" if feature.identifier else None,
    }


def _named(annotations: Iterable[Annotation]) -> dict[str, str | None]:
    """Return the XML attributes that `@ecore` and `@datatype` name."""
    known = (one.named for one in annotations if one.name in ("ecore", "datatype"))
    return {key: str(value) for named in known for key, value in named}


def _references(metamodel: Metamodel, reference: Reference, named: Parts) -> Parts:
    features, target = metamodel.features(reference.target), _path(metamodel, reference.target)
    found = [features[name] for name in (named.get("eKeys") or "").split() if name in features]
    opposite = metamodel.opposite(reference) or features.get(named.get("eOpposite") or "")
    return {
        "eType": target if target.startswith("#") else f"ecore:EClass {target}",
        "eOpposite": f"{_path(metamodel, opposite.owner)}/{opposite.name}" if opposite else None,
        "eKeys": " ".join(f"{_path(metamodel, one.owner)}/{one.name}" for one in found) or None,
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
