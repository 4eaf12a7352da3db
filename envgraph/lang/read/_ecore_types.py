"""Map the data types of Ecore, XML Schema and Java to scalar types, and parse values of these types."""

from __future__ import annotations

import re
from collections.abc import Mapping

from envgraph.code import dataclass
from envgraph.metamodel import LARGEST_INT, EnumType, Scalar, Value, parse_value

ECORE = "http://www.eclipse.org/emf/2002/Ecore"
EXTENDED_METADATA = "http:///org/eclipse/emf/ecore/util/ExtendedMetaData"
XML_TYPES = "http://www.eclipse.org/emf/2003/XMLType"


@dataclass(frozen=True, slots=True)
class DataType:
    """The scalar type or enum that represents a data type of Ecore, XML Schema or Java.

    Attributes:
        type: the type that values are parsed as.
        nullable: True if an attribute of this type has no value in a new object, unless Ecore names a default.
    """

    type: Scalar | EnumType
    nullable: bool = False


_WORDS: Mapping[Scalar, str] = {
    Scalar.INT: "EInt ELong EShort EByte",
    Scalar.FLOAT: "EDouble EFloat",
    Scalar.BOOL: "EBoolean",
}
_NULLABLE: Mapping[Scalar, str] = {
    Scalar.INT: "EIntegerObject ELongObject EShortObject EByteObject EBigInteger",
    Scalar.FLOAT: "EDoubleObject EFloatObject EBigDecimal",
    Scalar.BOOL: "EBooleanObject",
    Scalar.STRING: "EString EChar ECharacterObject EDate EByteArray EJavaClass EJavaObject EEList EMap ETreeIterator "
    "EResource EResourceSet EEnumerator EDiagnosticChain EInvocationTargetException",
}
FEATURE_MAP = "EFeatureMapEntry"
FEATURE_MAP_REASON = "it is a feature map, and was left out of the metamodel"
"""The reason for leaving a feature map out of the metamodel."""

_XML: Mapping[Scalar, str] = {
    Scalar.INT: "Int Integer Long Short Byte UnsignedInt UnsignedLong UnsignedShort UnsignedByte NonNegativeInteger "
    "NonPositiveInteger PositiveInteger NegativeInteger",
    Scalar.FLOAT: "Double Float Decimal",
    Scalar.BOOL: "Boolean",
    Scalar.STRING: "String NormalizedString Token NCName Name ID IDREF QName AnyURI Language NMTOKEN AnySimpleType "
    "Date DateTime Time Duration GDay GMonth GMonthDay GYear GYearMonth Base64Binary HexBinary ENTITY ENTITIES IDREFS "
    "NMTOKENS NOTATION",
}

_JAVA: Mapping[Scalar, str] = {
    Scalar.INT: "int long short byte java.lang.Integer java.lang.Long java.lang.Short java.lang.Byte "
    "java.math.BigInteger",
    Scalar.FLOAT: "double float java.lang.Double java.lang.Float java.math.BigDecimal",
    Scalar.BOOL: "boolean java.lang.Boolean",
    Scalar.STRING: "String java.lang.String char java.lang.Character",
}


def _data_types(words: Mapping[Scalar, str], nullable: bool) -> dict[str, DataType]:
    return {name: DataType(type_, nullable) for type_, names in words.items() for name in names.split()}


ECORE_TYPES: Mapping[str, DataType] = _data_types(_WORDS, False) | _data_types(_NULLABLE, True)
"""The supported data types of Ecore itself, by name."""

_XML_SCHEMA = {name: DataType(type_, type_ is Scalar.STRING) for type_, names in _XML.items() for name in names.split()}
_XML_SCHEMA.update({f"{name}Object": DataType(one.type, True) for name, one in _XML_SCHEMA.items() if not one.nullable})
_JAVA_SCALARS = {name: type_ for type_, names in _JAVA.items() for name in names.split()}
_SOURCES = (
    (ECORE, "org.eclipse.emf.ecore/model/Ecore.ecore", ECORE_TYPES),
    (XML_TYPES, "org.eclipse.emf.ecore/model/XMLType.ecore", _XML_SCHEMA),
)


def well_known_types(document: str) -> Mapping[str, DataType] | None:
    """Return the data types of Ecore or XML Schema by name, if `document` is the URI or file of one; otherwise None."""
    for uri, path, types in _SOURCES if document else ():
        if document == uri or document.endswith(f"/{path}"):
            return types
    return None


def java_data_type(name: str) -> DataType:
    """Return the data type of a Java class or primitive type; values of unknown classes are read as strings."""
    found = _JAVA_SCALARS.get(name, Scalar.STRING)
    return DataType(found, "." in name or found is Scalar.STRING)


_INT = re.compile("[+-]?[0-9]+")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INFINITE = {
    **{"INF": "inf", "+INF": "inf", "-INF": "-inf"},  # of XML Schema
    **{"Infinity": "inf", "-Infinity": "-inf"},  # of Java
}


def parse_xml_value(text: str, type_: Scalar | EnumType) -> Value | None:
    """Parse an attribute value as XML files write it; return None if it does not fit the type.

    A literal of an enum is written as its label, its name or its number. Numbers of more than 64 bits do not fit.

    >>> parse_xml_value("*", Scalar.INT)  # an upper bound in UML
    -1
    """
    if type_ is Scalar.STRING:
        return text
    if isinstance(type_, EnumType):
        return find_literal(text, type_)
    if type_ is Scalar.INT and text == "*":
        return -1
    if type_ is Scalar.BOOL:  # `TRUE` as EMF reads it, `1` as XML Schema does
        return {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
    return parse_value(_INFINITE.get(text, text) if type_ is Scalar.FLOAT else text, type_)


def number_range_hint(text: str, type_: Scalar | EnumType) -> str | None:
    """Return a hint if a text that `parse_xml_value` refuses is `NaN` or a number, which is then too large; otherwise
    None.
    """
    if type_ is Scalar.FLOAT and text == "NaN":
        return "write another value: `NaN` does not equal itself, so no query could find it"
    if type_ is Scalar.INT and _INT.fullmatch(text):
        return f"write a number of at most 64 bits, up to {LARGEST_INT}"
    if type_ is Scalar.FLOAT and _FLOAT.fullmatch(text):
        return "write a float of 64 bits, up to 1.8e308"
    return None


def find_literal(text: str, type_: EnumType) -> str | None:
    """Return the name of the literal whose label, name or number is `text`; None if the enum has no such literal."""
    for names in (type_.labels, type_.literals, tuple(map(str, type_.numbers or range(len(type_.literals))))):
        if text in names:
            return type_.literals[names.index(text)]
    return None
