"""Metamodels: classes with inheritance, attributes, references, enums and multiplicities."""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.errors import LARGEST_INT as LARGEST_INT
    from envgraph.metamodel._check import check_classes as check_classes
    from envgraph.metamodel._diagram import class_colours as class_colours
    from envgraph.metamodel._ecore import (
        metamodel_to_ecore as metamodel_to_ecore,
        plain_parts as plain_parts,
        xml_text as xml_text,
        xml_value as xml_value,
    )
    from envgraph.metamodel._features import (
        SUPPRESS as SUPPRESS,
        Annotation as Annotation,
        Attribute as Attribute,
        AttributeType as AttributeType,
        Class as Class,
        EnumType as EnumType,
        Feature as Feature,
        Glyph as Glyph,
        Package as Package,
        Places as Places,
        Reference as Reference,
        Scalar as Scalar,
        Value as Value,
        Values as Values,
        accepts as accepts,
        default_of as default_of,
        parse_value as parse_value,
        place as place,
        simple_name as simple_name,
        type_name as type_name,
    )
    from envgraph.metamodel._metamodel import Metamodel as Metamodel
    from envgraph.metamodel._walks import (
        components as components,
        reached as reached,
        shortest_way as shortest_way,
    )

later(globals())
