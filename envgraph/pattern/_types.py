"""Static types: their names, their compatibility, and hints about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from envgraph.errors import SHOWN, Diagnostic, did_you_mean, name_hint, quote_with_article
from envgraph.metamodel import EnumType, Metamodel, Scalar, Value, simple_name, type_name
from envgraph.pattern._expression_data import Constant, Expression
from envgraph.pattern._goals import ObjectType, StaticType

NUMBERS = (Scalar.INT, Scalar.FLOAT)

_FOREIGN_NAMES: Final = {
    Scalar.INT: ("int", "integer", "integerobject", "long", "short", "byte", "biginteger"),
    Scalar.FLOAT: ("float", "double", "doubleobject", "real", "number", "bigdecimal"),
    Scalar.BOOL: ("bool", "boolean", "booleanobject"),
    Scalar.STRING: ("string", "str", "char", "character", "text"),
}
"""Names of the data types in other languages, in lower case and without the prefix `E` of EMF."""

_VALUE_HINTS: Final = {
    Scalar.INT: "write a whole number, such as `3`",
    Scalar.FLOAT: "write a number, such as `1.5`",
    Scalar.BOOL: "write `true` or `false`",
    Scalar.STRING: 'write a string, such as `"a"`',
}


def static_type(name: str | None, metamodel: Metamodel) -> StaticType | None:
    """Return the type with a name: a class, an enum or a scalar. None without a name, or if the name is unknown.

    >>> static_type("int", Metamodel("m", ()))
    <Scalar.INT: 'int'>
    """
    if name is None:
        return None
    if name in metamodel.classes:
        return ObjectType(name)
    if name in metamodel.enums:
        return metamodel.enums[name]
    return next((scalar for scalar in Scalar if scalar.value == name), None)


def type_names(metamodel: Metamodel) -> list[str]:
    """Return every name that `static_type` knows."""
    return [*metamodel.classes, *metamodel.enums, *(scalar.value for scalar in Scalar)]


def type_hint(name: str, metamodel: Metamodel) -> str | None:
    """Return a hint for an unknown type name: a similar name, or the equivalent of a Java or EMF type, or None.

    >>> type_hint("EInt", Metamodel("m", ())), type_hint("Integer", Metamodel("m", ()))
    ('write `int`', 'write `int`')
    """
    if name == "EObject" and metamodel.class_list:
        return _any_object_hint(metamodel)
    if metamodel.full_names(simple_name(name)):
        return metamodel.suggest_class(name)
    near = did_you_mean(name, type_names(metamodel)) or data_type_hint(name)
    return near or name_hint(name, metamodel.classes or type_names(metamodel))


def data_type_hint(name: str) -> str | None:
    """Return a hint with the name of the data type that corresponds to a type of Java or EMF, or None for other names.

    >>> data_type_hint("double"), data_type_hint("EInt"), data_type_hint("Date")
    ('write `float`', 'write `int`', None)
    """
    short_name = name.removeprefix("E").lower()
    return next((f"write `{scalar}`" for scalar, names in _FOREIGN_NAMES.items() if short_name in names), None)


def _any_object_hint(metamodel: Metamodel) -> str:
    """Return a hint for the type name `EObject`, Ecore's superclass of all classes, which does not exist here."""
    tops = [cls.name for cls in metamodel.class_list if not cls.supertypes]
    if len(tops) == 1:
        return f"write `{tops[0]}`: all classes extend it"
    bodies = " or ".join(f"{{ {name}(x); }}" for name in tops[:2])
    more = " or ..." if len(tops) > 2 else ""
    return f"write the class that is meant, or a body for each class: `{bodies}{more}`"


def type_text(type_: StaticType) -> str:
    """Return the name of a type as it is written in files."""
    return type_.cls if isinstance(type_, ObjectType) else type_name(type_)


def value_hint(type_: StaticType, found: StaticType | None = None) -> str:
    """Return a hint about how to write a value of a type.

    Args:
        type_: the type.
        found: the type of the present expression, if the hint should propose to convert it; else None.

    >>> value_hint(Scalar.BOOL), value_hint(EnumType("Way", ("east", "west")))
    ('write `true` or `false`', 'write `Way::east` or `Way::west`')
    >>> value_hint(Scalar.FLOAT, Scalar.BOOL)
    'write a number, such as `1.5`; `.. ? 1 : 0` converts a bool'
    """
    if isinstance(type_, ObjectType):
        return f"write a variable that stands for {quote_with_article(type_.cls)}"
    if isinstance(type_, EnumType):
        shown = [f"`{type_.name}::{literal}`" for literal in type_.literals[: SHOWN.literals]]
        if len(type_.literals) > SHOWN.literals:
            return f"write a literal, such as {shown[0]}"
        return "write " + " or ".join(filter(None, (", ".join(shown[:-1]), *shown[-1:])))
    if isinstance(found, ObjectType):
        return f"use an attribute of `{found.cls}`"
    if type_ is Scalar.STRING and found is not None:
        return f"{_VALUE_HINTS[type_]}; `toString(..)` converts other values"
    if type_ is Scalar.BOOL and found is not None:
        return "compare it: `.. == ..`"
    if type_ in NUMBERS and found is Scalar.BOOL:
        return f"{_VALUE_HINTS[type_]}; `.. ? 1 : 0` converts a bool"
    return _VALUE_HINTS[type_]


def value_type(value: Value) -> Scalar:
    """Return the type of a literal value."""
    if isinstance(value, bool):
        return Scalar.BOOL
    if isinstance(value, int):
        return Scalar.INT
    return Scalar.FLOAT if isinstance(value, float) else Scalar.STRING


def is_subtype(type_: StaticType, above: StaticType, metamodel: Metamodel) -> bool:
    """Return True if every instance of `type_` is an instance of `above`. An int is not a float."""
    if isinstance(type_, ObjectType) and isinstance(above, ObjectType):
        return metamodel.is_a(type_.cls, above.cls)
    return type_ == above


def is_assignable(type_: StaticType, target: StaticType, metamodel: Metamodel) -> bool:
    """Return True if a value of `type_` may be stored where `target` is expected. An int may be stored as a float."""
    return is_subtype(type_, target, metamodel) or (type_ is Scalar.INT and target is Scalar.FLOAT)


def may_be_assignable(type_: StaticType, target: StaticType, metamodel: Metamodel) -> bool:
    """Return True if at least one value of `type_` may be stored where `target` is expected.

    For two classes this is the case if they have common instances.
    """
    if isinstance(type_, ObjectType) and isinstance(target, ObjectType):
        return metamodel.may_overlap(type_.cls, target.cls)
    return is_assignable(type_, target, metamodel)


def have_common_instances(one: StaticType, other: StaticType, metamodel: Metamodel) -> bool:
    """Return True if a value can be an instance of both types."""
    return meet(one, other, metamodel) is not None


def are_comparable(one: StaticType, other: StaticType, metamodel: Metamodel) -> bool:
    """Return True if values of the two types can be equal: compatible types, or an int and a float."""
    return have_common_instances(one, other, metamodel) or (one in NUMBERS and other in NUMBERS)


def meet(one: StaticType, other: StaticType, metamodel: Metamodel) -> StaticType | None:
    """Return the type of the common instances of two types, or None if no common instance is possible.

    For two classes, neither a subclass of the other, the result is the class that covers all their common instances.
    If no single class covers them, the result is the first type.
    """
    if is_subtype(one, other, metamodel):
        return one
    if is_subtype(other, one, metamodel):
        return other
    if not (isinstance(one, ObjectType) and isinstance(other, ObjectType)):
        return None
    common = common_subclasses(one.cls, other.cls, metamodel)
    if not common:
        return None
    covering = [
        cls.name
        for cls in metamodel.class_list
        if metamodel.is_a(cls.name, one.cls)
        and metamodel.is_a(cls.name, other.cls)
        and all(metamodel.is_a(sub, cls.name) for sub in common)
    ]
    return ObjectType(covering[0]) if covering else one


def common_subclasses(one: str, other: str, metamodel: Metamodel) -> list[str]:
    """Return the names of the concrete classes whose objects are instances of both classes."""
    return [name for name in metamodel.concrete_classes(one) if metamodel.is_a(name, other)]


def least_common_supertypes(types: Sequence[StaticType], metamodel: Metamodel) -> list[StaticType]:
    """Return the least common supertypes of types: usually one, several after multiple inheritance, [] if none."""
    first = types[0]
    if not isinstance(first, ObjectType):
        return [first] if all(type_ == first for type_ in types) else []
    common = [
        name
        for name in metamodel.supertypes(first.cls)
        if all(isinstance(type_, ObjectType) and metamodel.is_a(type_.cls, name) for type_ in types)
    ]
    return [
        ObjectType(name)
        for name in common
        if not any(other != name and metamodel.is_a(other, name) for other in common)
    ]


def is_literal_assignable(value: Value, type_: StaticType) -> bool:
    """Return True if a literal (not of an enum) may be written where the type is expected."""
    own = value_type(value)
    return own == type_ or (own is Scalar.INT and type_ is Scalar.FLOAT)


def coerce(value: Value, type_: StaticType | None) -> Value:
    """Return a value as it is stored in a place of a type: an int is converted to a float if the type is float."""
    return float(value) if type_ is Scalar.FLOAT and isinstance(value, int) else value


def wrong_type_error(expression: Expression, type_: StaticType, expected: StaticType) -> Diagnostic:
    """Return the diagnostic for an expression of one type where another is expected."""
    hint = None
    if isinstance(expected, EnumType) and isinstance(expression, Constant) and isinstance(expression.value, str):
        hint = enum_hint(expression.value, expected)
    elif expected is Scalar.INT and type_ is Scalar.FLOAT:
        hint = "convert it with `round`, `floor` or `toInt`"
    hint = hint or value_hint(expected, None if isinstance(expression, Constant) else type_)
    message = f"expected `{type_text(expected)}`, found `{type_text(type_)}`"
    return Diagnostic("wrong-type", message, expression.span, hint)


def enum_hint(written: str, enum: EnumType) -> str | None:
    """Return a hint to write the enum literal whose name is similar to `written`, or None if no name is similar."""
    near = did_you_mean(written, enum.literals)
    return near.replace("`", f"`{enum.name}::", 1) if near else None


def common_number(*types: StaticType | None) -> StaticType | None:
    """Return the type of arithmetic on numbers of these types: float if any is float, else int. None if any is None."""
    if None in types:
        return None
    return Scalar.FLOAT if Scalar.FLOAT in types else Scalar.INT
