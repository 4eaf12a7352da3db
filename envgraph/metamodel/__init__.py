"""Metamodels: classes with inheritance, attributes, references, enums and multiplicities."""

from envgraph.errors import LARGEST_INT, shorten
from envgraph.metamodel._check import check_classes
from envgraph.metamodel._diagram import class_colours
from envgraph.metamodel._ecore import metamodel_to_ecore, plain_parts, xml_text, xml_value
from envgraph.metamodel._features import (
    SUPPRESS,
    Annotation,
    Attribute,
    AttributeType,
    Class,
    EnumType,
    Feature,
    Glyph,
    Package,
    Places,
    Reference,
    Scalar,
    Value,
    Values,
    accepts,
    default_of,
    parse_value,
    place,
    simple_name,
    type_name,
)
from envgraph.metamodel._metamodel import Metamodel
from envgraph.metamodel._walks import components, reached, shortest_way

__all__ = [
    "LARGEST_INT",
    "SUPPRESS",
    "Annotation",
    "Attribute",
    "AttributeType",
    "Class",
    "EnumType",
    "Feature",
    "Glyph",
    "Metamodel",
    "Package",
    "Places",
    "Reference",
    "Scalar",
    "Value",
    "Values",
    "accepts",
    "check_classes",
    "class_colours",
    "components",
    "default_of",
    "metamodel_to_ecore",
    "parse_value",
    "place",
    "plain_parts",
    "reached",
    "shortest_way",
    "simple_name",
    "type_name",
    "xml_text",
    "xml_value",
]

shorten(globals(), __all__)
