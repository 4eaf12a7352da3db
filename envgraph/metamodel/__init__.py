"""Metamodels: classes with inheritance, attributes, references, enums and multiplicities."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.errors import LARGEST_INT as LARGEST_INT
    from envgraph.metamodel._class_check import check_classes as check_classes
    from envgraph.metamodel._class_diagram import class_colours as class_colours, gives_direction as gives_direction
    from envgraph.metamodel._ecore_writer import (
        escape_xml as escape_xml,
        format_xml_value as format_xml_value,
        metamodel_to_ecore as metamodel_to_ecore,
        simple_xml_attributes as simple_xml_attributes,
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
        PartSpans as PartSpans,
        Reference as Reference,
        Scalar as Scalar,
        Value as Value,
        Values as Values,
        accepts as accepts,
        default_value as default_value,
        parse_value as parse_value,
        simple_name as simple_name,
        type_name as type_name,
    )
    from envgraph.metamodel._metamodel import Metamodel as Metamodel
    from envgraph.metamodel._reachability import (
        reachable_nodes as reachable_nodes,
        shortest_path as shortest_path,
        strong_components as strong_components,
    )

export_lazily(globals())
