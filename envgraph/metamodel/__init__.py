"""Metamodels: classes with inheritance, attributes, references, enums and multiplicities."""

from envgraph.metamodel._features import (
    Annotation,
    Attribute,
    AttributeType,
    Class,
    EnumType,
    Feature,
    Glyph,
    Places,
    Reference,
    Scalar,
    Value,
    accepts,
    default_of,
    place,
    type_name,
)
from envgraph.metamodel._metamodel import Metamodel

__all__ = [
    "Annotation",
    "Attribute",
    "AttributeType",
    "Class",
    "EnumType",
    "Feature",
    "Glyph",
    "Metamodel",
    "Places",
    "Reference",
    "Scalar",
    "Value",
    "accepts",
    "default_of",
    "place",
    "type_name",
]
