"""Which data types of Ecore, of XML Schema and of Java hold which of our values."""

from __future__ import annotations

import re
from collections.abc import Mapping

from envgraph.code import dataclass
from envgraph.metamodel import LARGEST_INT, EnumType, Scalar, Value, parse_value

ECORE = "http://www.eclipse.org/emf/2002/Ecore"
EXTENDED = "http:///org/eclipse/emf/ecore/util/ExtendedMetaData"
XML_TYPES = "http://www.eclipse.org/emf/2003/XMLType"


@dataclass(frozen=True, slots=True)
class DataType:
    """What an attribute of a data type holds.

    Attributes:
        type: what its values are read as.
        nullable: whether a fresh object has no value, where Ecore names no default.
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
A_MAP = "it is a feature map, and was left out of the metamodel"
"""The reason why the metamodel leaves a feature map out."""

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


def _types(words: Mapping[Scalar, str], nullable: bool) -> dict[str, DataType]:
    return {name: DataType(type_, nullable) for type_, names in words.items() for name in names.split()}


ECORE_TYPES: Mapping[str, DataType] = _types(_WORDS, False) | _types(_NULLABLE, True)
"""The data types of Ecore itself that can be read."""

_XML_SCHEMA = {
    name: DataType(type_, type_ is Scalar.STRING) for type_, names in _XML.items() for name in names.split()
}
_XML_SCHEMA.update(
    {f"{name}Object": DataType(one.type, True) for name, one in _XML_SCHEMA.items() if not one.nullable}
)
_OF_JAVA = {name: type_ for type_, names in _JAVA.items() for name in names.split()}
_SOURCES = (
    (ECORE, "org.eclipse.emf.ecore/model/Ecore.ecore", ECORE_TYPES),
    (XML_TYPES, "org.eclipse.emf.ecore/model/XMLType.ecore", _XML_SCHEMA),
)


def library_types(document: str) -> Mapping[str, DataType] | None:
    """The data types of a document that every tool knows, by its URI; None for other documents."""
    for uri, path, types in _SOURCES if document else ():
        if document == uri or document.endswith(f"/{path}"):
            return types
    return None


def java_type(name: str) -> DataType:
    """Return what values of a Java class or primitive are read as; those of an unknown one as strings."""
    found = _OF_JAVA.get(name, Scalar.STRING)
    return DataType(found, "." in name or found is Scalar.STRING)


_INT = re.compile("[+-]?[0-9]+")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_INFINITE = {
    **{"INF": "inf", "+INF": "inf", "-INF": "-inf"},  # of XML Schema
    **{"Infinity": "inf", "-Infinity": "-inf"},  # of Java
}


def value_of(text: str, type_: Scalar | EnumType) -> Value | None:
    """The value that is written so in XML, or None; a literal by its text, its name or its number.

    Numbers of more than 64 bits are None, too.

    >>> value_of("*", Scalar.INT)  # an upper bound in UML
    -1
    """
    if type_ is Scalar.STRING:
        return text
    if isinstance(type_, EnumType):
        return literal_of(text, type_)
    if type_ is Scalar.INT and text == "*":
        return -1
    if type_ is Scalar.BOOL:  # `TRUE` as EMF reads it, `1` as XML Schema does
        return {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
    return parse_value(_INFINITE.get(text, text) if type_ is Scalar.FLOAT else text, type_)


def why_unfit(text: str, type_: Scalar | EnumType) -> str | None:
    """Return a hint for a number that is too large for its type, or is `NaN`; else None."""
    if type_ is Scalar.FLOAT and text == "NaN":
        return "`NaN` does not equal itself, so no query could find it"
    if type_ is Scalar.INT and _INT.fullmatch(text):
        return f"an int has 64 bits: it is {LARGEST_INT} at most"
    if type_ is Scalar.FLOAT and _FLOAT.fullmatch(text):
        return "a float has 64 bits: it is 1.8e308 at most"
    return None


def literal_of(text: str, type_: EnumType) -> str | None:
    """The literal that is written so, or None."""
    for names in (type_.labels, type_.literals, tuple(map(str, type_.numbers or range(len(type_.literals))))):
        if text in names:
            return type_.literals[names.index(text)]
    return None
