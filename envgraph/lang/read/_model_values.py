"""Parse attribute values in `.model` files."""

from __future__ import annotations

from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, did_you_mean, quote_with_article
from envgraph.lang.read._file_reading import FileReading
from envgraph.lang.read._object_features import check_values, report_unknown_literal
from envgraph.lang.syntax._parser import select_tokens, select_trees, signed_number_of
from envgraph.metamodel import Attribute, EnumType, Scalar, Value, accepts, type_name
from envgraph.pattern import value_hint

NO_VALUE = "write `none`, or leave the feature out"


@dataclass(slots=True)
class ModelReading(FileReading):
    """The state of reading one model, where an error of the same code at the same span is reported only once.

    A line of a legend or the head of a table describes many objects, so its errors would otherwise repeat.
    """

    _reported: set[tuple[str, int, int]] = field(default_factory=set)

    def add(self, diagnostic: Diagnostic) -> None:
        """Record a diagnostic, unless one of the same code at the same span was recorded before."""
        span = diagnostic.span
        assert span is not None
        if (diagnostic.code, span.start, span.end) not in self._reported:
            self._reported.add((diagnostic.code, span.start, span.end))
            self.diagnostics.append(diagnostic)


def parse_attribute_values(tree: Tree[Token], attribute: Attribute, reports: ModelReading) -> list[Value]:
    """Parse the values of an attribute with many values; report and leave out invalid, repeated and surplus values."""
    found = (
        (value, reports.span(item))
        for item in (select_trees(tree.children) if tree.data == "list" else [tree])
        if (value := parse_attribute_value(item, attribute, reports)) is not None
    )
    return check_values(attribute, found, reports.error, setting="`@nonunique` on the attribute")


def parse_attribute_value(tree: Tree[Token], attribute: Attribute, reports: ModelReading) -> Value | None:
    """Parse one value of an attribute; report an invalid value and return None."""
    parts = select_tokens(tree.children)
    type_ = attribute.type
    if tree.data == "enum_literal":
        return _parse_enum_literal(tree, attribute, reports)
    value: Value | None = None
    match tree.data:
        case "true" | "false":
            value = tree.data == "true"
        case "number":
            value = signed_number_of(tree)
        case "string" if not isinstance(type_, EnumType):
            value = str(parts[0])
    if value is not None and accepts(type_, value):
        return value
    wanted = f"a literal of `{type_.name}`" if isinstance(type_, EnumType) else f"`{type_name(type_)}`"
    message = f"`{attribute}` takes {wanted}, not {describe_value(tree)}"
    reports.error("wrong-type", message, tree, _type_hint(tree, attribute) or value_hint(type_))
    return None


def _parse_enum_literal(tree: Tree[Token], attribute: Attribute, reports: ModelReading) -> Value | None:
    *enum, literal = select_tokens(tree.children)
    type_ = attribute.type
    if not isinstance(type_, EnumType):
        reports.error(
            "wrong-type",
            f"`{attribute}` takes `{type_name(type_)}`, not an enum literal",
            tree,
            value_hint(type_),
        )
    elif enum and enum[0] != type_.name:
        hint = f"write `{type_.name}::` or `::`"
        reports.error(
            "wrong-type",
            f"`{attribute}` must be {quote_with_article(type_.name)}, not {quote_with_article(enum[0])}",
            enum[0],
            hint,
        )
    elif literal not in type_.literals:
        report_unknown_literal(type_, literal, type_.literals, reports.error, reports.span(literal))
    else:
        return str(literal)
    return None


def describe_value(tree: Tree[Token]) -> str:
    """Return a phrase for the kind of a value, for error messages, such as "a string"."""
    match tree.data:
        case "true" | "false":
            return "a boolean"
        case "number":
            return "a decimal number" if select_tokens(tree.children)[-1].type == "FLOAT" else "a whole number"
        case "string":
            return "a string"
        case "enum_literal":
            return "an enum literal"
        case "name":
            return f"the object `{select_tokens(tree.children)[0]}`"
        case "list" | "grid" | "table":
            return f"a {tree.data}"
    return "an object"


def _type_hint(tree: Tree[Token], attribute: Attribute) -> str | None:
    """Return a hint with the value that was probably meant by a name or string; None if no value is similar."""
    if tree.data not in {"name", "string"}:
        return None
    word = str(select_tokens(tree.children)[0])
    if word == "null":
        return NO_VALUE
    if isinstance(attribute.type, EnumType):
        if word in attribute.type.literals:
            return f"write `::{word}` for the literal"
        return did_you_mean(word, attribute.type.literals)
    if attribute.type is Scalar.STRING:
        return f'write `"{word}"` for a string'
    if attribute.type is Scalar.BOOL:
        return did_you_mean(word, ("true", "false"))
    return None
