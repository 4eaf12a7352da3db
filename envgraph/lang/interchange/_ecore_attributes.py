"""Read single attributes and annotations of the elements of an `.ecore` file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from types import MappingProxyType
from typing import Any

from envgraph.errors import did_you_mean, name_hint
from envgraph.lang.interchange._ecore_document import (
    details_of,
    ecore_metamodel_document,
    extended_metadata,
    is_computed,
)
from envgraph.lang.interchange._ecore_name_resolution import EcoreNameResolver, EcoreTarget, children_named
from envgraph.lang.read._ecore_types import (
    ECORE_TYPES,
    DataType,
    java_data_type,
    number_range_hint,
    parse_xml_value,
)
from envgraph.lang.read._metamodel_reader import ClassMarks
from envgraph.lang.syntax._xml_parser import XmlElement
from envgraph.metamodel import Annotation, Attribute, EnumType, Feature, Glyph, Scalar, Value, type_name
from envgraph.pattern import value_hint

_OWN_SOURCE = "envgraph"
_GENMODEL = "http://www.eclipse.org/emf/2002/GenModel"
_OF_MEMBERS = ("derived", "transient", "upperBound", "volatile")
_NAMING = ("xmlns", "name", "eType", "eSuperTypes", "eOpposite", "eKeys")


def marks_of(names: EcoreNameResolver, element: XmlElement, features: Sequence[Feature]) -> ClassMarks:
    """Return the key, glyph and `frozen` mark of a class from envgraph's own annotations.

    If these state no key, the `iD` attributes among the class's own features are the key.
    """
    marks = ClassMarks()
    for one, name, value in details_of(element, _OWN_SOURCE):
        match name:
            case "key":
                marks.key = tuple(value.split())
                marks.places += tuple(
                    (f"key {part}", names.places.attribute_span(one.byte, "value", part)) for part in marks.key
                )
            case "glyph":
                letter, colour = value[:1], value[2:]
                marks.glyph = Glyph(letter, colour) if colour else Glyph(letter)
                span = names.attribute_span(one, "value")
                marks.places += (("letter", span), ("colour", span))
            case "frozen":
                marks.frozen = True
    identifiers = tuple(one.name for one in features if isinstance(one, Attribute) and one.identifier)
    marks.key = marks.key or identifiers
    return marks


def annotations_of(names: EcoreNameResolver, element: XmlElement) -> tuple[Annotation, ...]:
    """Return the annotations of an element that `metamodel_to_ecore` stored, and those of other tools.

    A computed feature is annotated with `@derived`, too.
    """
    found = [Annotation("derived")] if is_computed(element) else []
    for one, name, value in details_of(element, _OWN_SOURCE):
        values: tuple[Value, ...] = tuple(value.split())
        named: tuple[tuple[str, Value], ...] = ()
        if name == "glyph":
            values = (value[:1], *value[2:].split())
        elif name == "range":
            words = [word.partition("=") for word in value.split()]
            values = tuple(_parse_number(first) for first, mark, _ in words if not mark)
            named = tuple((key, _parse_number(text)) for key, mark, text in words if mark)
        found.append(Annotation(name, values, named, span=names.attribute_span(one, "key")))
    return (*found, *foreign_annotations_of(names, element))


def foreign_annotations_of(
    names: EcoreNameResolver, element: XmlElement, *, with_doc: bool = False
) -> Iterator[Annotation]:
    """Yield the annotations of other tools as `@annotation("source", key = "value")`; documentation only if `with_doc`.

    Their contents other than details are recorded as not preserved.
    """
    for one in children_named(element, "eAnnotations"):
        source = one.get("source")
        if "references" in one.attributes:
            names.record_dropped("attribute", "`references` in annotations", one)
        for part in (child for child in one.children if child.name != "details"):
            names.record_dropped("tag", f"`{part.name}` in annotations", part)
        found = [(detail.get("key"), detail.get("value")) for detail in children_named(one, "details")]
        pairs = [pair for pair in found if with_doc or source != _GENMODEL or pair[0] != "documentation"]
        if source != _OWN_SOURCE and (pairs or not found):
            is_simple = all(key.isidentifier() for key, _ in pairs)
            words = () if is_simple else tuple(word for pair in pairs for word in pair)
            yield Annotation("annotation", (source, *words), tuple(pairs) if is_simple else ())


def preserved_attributes_of(
    element: XmlElement,
    written: Mapping[str, str | None],
    named: Mapping[str, str | None] = MappingProxyType({}),
) -> tuple[Annotation, ...]:
    """Return an `@ecore(..)` annotation with the XML attributes that only other tools use; () if there are none.

    Attributes with their default value and attributes in `written` are omitted. Feature maps are not preserved, so
    members of a feature map are treated as ordinary features.

    Args:
        element: a classifier or a feature.
        written: the XML attributes that the metamodel implies, so that they are written anyway.
        named: the XML attributes that refer to other parts of the file, as `@ecore` states them.
    """
    attributes, usual = element.attributes, _ecore_defaults()
    is_member = attributes.get("derived") == "true" and not is_computed(element)
    is_member = is_member and extended_metadata(element).get("kind") != "attribute"
    found = {key: text for key, text in named.items() if text and text != written.get(key)}
    for key, text in attributes.items():
        if text == written.get(key) or key in _NAMING or ":" in key or (is_member and key in _OF_MEMBERS):
            continue
        if written.get(key) or key not in usual or text != usual[key][1]:
            found[key] = text
    for key, is_default in written.items():
        if is_default and key not in attributes and key in usual and is_default != usual[key][1]:
            found[key] = usual[key][1]
    return (Annotation("ecore", named=tuple(sorted(found.items()))),) if found else ()


def _parse_number(text: str) -> Value:
    for read in (int, float):
        with suppress(ValueError):
            return read(text)
    return text


def doc_of(element: XmlElement) -> str | None:
    """Return the documentation in an element's GenModel annotation, or None."""
    docs = (one for one, key, _ in details_of(element, _GENMODEL) if key == "documentation")
    return next((one.attributes.get("value") for one in docs), None)


def name_of(names: EcoreNameResolver, element: XmlElement, noun: str) -> str:
    """Return the name of an element; if it has none, report this with the noun `noun`, and return a generated name."""
    name = element.get("name")
    if not name:
        where = names.places.tag_span(element.byte)
        names.report_error("missing-name", f"the {noun} has no name", where, 'write `name="..."`')
        return f"unnamed_{element.byte}"
    return name


def metamodel_name_of(names: EcoreNameResolver, element: XmlElement, noun: str) -> str:
    """Return the metamodel's name for a class or enum, such as `Name` or `package::Name`.

    If the element has no name, this is reported, and the name is generated.
    """
    return name_of(names, element, noun) and (names.shared.names[element] or f"unnamed_{element.byte}")


@cache
def _ecore_defaults() -> Mapping[str, tuple[Scalar | EnumType, str, Value | None]]:
    """Return by name the bool and int attributes of Ecore's tags: type, default as text, and default as value."""
    found = {}
    for cls in ecore_metamodel_document().packages[0].children:
        for one in children_named(cls, "eStructuralFeatures"):
            data = ECORE_TYPES.get(one.get("eType").rpartition("/")[2])
            if data is not None and data.type in (Scalar.BOOL, Scalar.INT):
                usual = one.get("defaultValueLiteral") or ("false" if data.type is Scalar.BOOL else "0")
                found[one.get("name")] = data.type, usual, parse_xml_value(usual, data.type)
    return found


def typed_attribute_of(names: EcoreNameResolver, element: XmlElement, name: str) -> Any:
    """Return the value of a bool or int XML attribute; Ecore's default if it is missing, or wrong (then reported)."""
    type_, _, usual = _ecore_defaults()[name]
    text = element.attributes.get(name)
    if text is None:
        return usual
    if type_ is Scalar.BOOL and text.lower() not in ("true", "false"):
        hint = did_you_mean(text, ("true", "false")) or "write `true` or `false`"
        message = f"`{name}` must be true or false, not `{text}`"
        names.report_error("wrong-type", message, names.attribute_span(element, name), hint)
    elif type_ is Scalar.INT and not re.fullmatch(r"[+-]?[0-9]{1,10}", text):
        hint = "write `-1` for any number" if name == "upperBound" else "write a whole number from 0"
        message = f"`{name}` must be a number, not `{text}`"
        names.report_error("wrong-type", message, names.attribute_span(element, name), hint)
    else:
        return parse_xml_value(text, type_)
    return usual


def bounds_of(names: EcoreNameResolver, element: XmlElement) -> tuple[int, int | None]:
    """Return the lower bound of a feature (0 if a query can define it) and its upper bound (None if unlimited)."""
    lower, upper = typed_attribute_of(names, element, "lowerBound"), typed_attribute_of(names, element, "upperBound")
    if upper == -2:  # -2 is Ecore's "unspecified", used for elements of a document root
        upper = 1
    return 0 if is_computed(element) else lower, None if upper < 0 else upper


def default_of(names: EcoreNameResolver, element: XmlElement, name: str, type_: Scalar | EnumType) -> Value | None:
    """Return the default value of the attribute `name`; None if it has none, or a wrong one, which is reported."""
    text = element.attributes.get("defaultValueLiteral")
    if text is None:
        return None
    value = parse_xml_value(text, type_)
    if value is None:
        words = type_.labels or type_.literals if isinstance(type_, EnumType) else ("true", "false")
        numeric = type_ in (Scalar.INT, Scalar.FLOAT)
        hint = number_range_hint(text, type_) or value_hint(type_) if numeric else name_hint(text, words)
        message = f"default of `{name}` is not of type `{type_name(type_)}`"
        names.report_error("wrong-type", message, names.attribute_span(element, "defaultValueLiteral"), hint)
    return value


def data_type_of(names: EcoreNameResolver, target: EcoreTarget) -> DataType | None:
    """Return the data type or enum that an attribute's `eType` refers to; report any other target, and return None."""
    if target.data_type is not None:
        return target.data_type
    if target.element is None:
        return None
    kind = names.shared.kinds.get(target.element)
    if target.element is names.shared.any_object:  # a type parameter without a bound
        return ECORE_TYPES["EJavaObject"]
    if kind == "EEnum":
        return DataType(names.shared.enums[target.element])
    type_name = target.element.get("name")
    if kind == "EDataType":
        java = target.element.attributes
        return java_data_type(java.get("instanceTypeName", java.get("instanceClassName", "")))
    if kind == "EClass":
        hint = 'write `xsi:type="ecore:EReference"`'
        names.report_error("wrong-type", f"`{type_name}` is a class, not a data type", target.span, hint)
    elif kind is not None:
        hint = 'name a data type or an enum, such as `eType="ecore:EDataType http://www.eclipse.org/emf/2002/Ecore#//EInt"`'
        names.report_error("wrong-type", f"`{type_name}` is not a data type", target.span, hint)
    return None
