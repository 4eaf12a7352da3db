"""Static types: what their names mean, and when two of them fit together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from envgraph.errors import Diagnostic, did_you_mean, name_hint, with_article
from envgraph.metamodel import EnumType, Metamodel, Scalar, Value, simple_name, type_name
from envgraph.pattern._lowered import ObjectType, StaticType
from envgraph.pattern._terms import Constant, Expression

NUMBERS = (Scalar.INT, Scalar.FLOAT)

_ELSEWHERE: Final = {
    Scalar.INT: ("int", "integer", "integerobject", "long", "short", "byte", "biginteger"),
    Scalar.FLOAT: ("float", "double", "doubleobject", "real", "number", "bigdecimal"),
    Scalar.BOOL: ("bool", "boolean", "booleanobject"),
    Scalar.STRING: ("string", "str", "char", "character", "text"),
}
"""What other languages call the data types, without the `E` of EMF."""

_EXAMPLES: Final = {
    Scalar.INT: "write a whole number, such as `3`",
    Scalar.FLOAT: "write a number, such as `1.5`",
    Scalar.BOOL: "write `true` or `false`",
    Scalar.STRING: 'write a string, such as `"a"`',
}
_LITERALS = 4
"""Of an enum with more literals only one is shown."""


def static_type(name: str | None, metamodel: Metamodel) -> StaticType | None:
    """The type that a name stands for: a class, an enum or a scalar; None without a name, or if it stands for none.

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
    """Every name that `static_type` understands."""
    return [*metamodel.classes, *metamodel.enums, *(scalar.value for scalar in Scalar)]


def type_hint(name: str, metamodel: Metamodel) -> str | None:
    """Return what an unknown type may have been meant to be: one of a similar name, or our name for one of Java or EMF.

    >>> type_hint("EInt", Metamodel("m", ())), type_hint("Integer", Metamodel("m", ()))
    ('write `int`', 'write `int`')
    """
    if name == "EObject" and metamodel.class_list:
        return _any_object_hint(metamodel)
    if metamodel.named(simple_name(name)):
        return metamodel.likely(name)
    near = did_you_mean(name, type_names(metamodel)) or data_type_hint(name)
    return near or name_hint(name, metamodel.classes or type_names(metamodel))


def data_type_hint(name: str) -> str | None:
    """Return what to write for a data type by its name in Java or EMF; None if it is none.

    >>> data_type_hint("double"), data_type_hint("EInt"), data_type_hint("Date")
    ('write `float`', 'write `int`', None)
    """
    plain = name.removeprefix("E").lower()
    return next((f"write `{scalar}`" for scalar, names in _ELSEWHERE.items() if plain in names), None)


def _any_object_hint(metamodel: Metamodel) -> str:
    """Return what to write for Ecore's class of all objects, which is none of ours."""
    tops = [cls.name for cls in metamodel.class_list if not cls.supertypes]
    if len(tops) == 1:
        return f"write `{tops[0]}`: all classes extend it"
    bodies = " or ".join(f"{{ {name}(x); }}" for name in tops[:2])
    more = " or ..." if len(tops) > 2 else ""
    return f"no class is above all others: write the one that is meant, or a body for each, `{bodies}{more}`"


def type_text(type_: StaticType) -> str:
    """Return how a type is written in a file."""
    return type_.cls if isinstance(type_, ObjectType) else type_name(type_)


def value_hint(type_: StaticType, found: StaticType | None = None) -> str:
    """Return what to write where a value of a type stands, in the words of a hint.

    Args:
        type_: the type.
        found: of what type the expression there is now, if something can be made of that.

    >>> value_hint(Scalar.BOOL), value_hint(EnumType("Way", ("east", "west")))
    ('write `true` or `false`', 'write `Way::east` or `Way::west`')
    >>> value_hint(Scalar.FLOAT, Scalar.BOOL)
    'write a number, such as `1.5`; `.. ? 1 : 0` makes one of a bool'
    """
    if isinstance(type_, ObjectType):
        return f"write a variable that stands for {with_article(type_.cls)}"
    if isinstance(type_, EnumType):
        shown = [f"`{type_.name}::{literal}`" for literal in type_.literals[:_LITERALS]]
        if len(type_.literals) > _LITERALS:
            return f"write a literal, such as {shown[0]}"
        return "write " + " or ".join(filter(None, (", ".join(shown[:-1]), *shown[-1:])))
    if isinstance(found, ObjectType):
        return f"use an attribute of `{found.cls}`"
    if type_ is Scalar.STRING and found is not None:
        return f"{_EXAMPLES[type_]}; `toString(..)` makes one"
    if type_ is Scalar.BOOL and found is not None:
        return "compare it: `.. == ..`"
    if type_ in NUMBERS and found is Scalar.BOOL:
        return f"{_EXAMPLES[type_]}; `.. ? 1 : 0` makes one of a bool"
    return _EXAMPLES[type_]


def value_type(value: Value) -> Scalar:
    """The type of a literal."""
    if isinstance(value, bool):
        return Scalar.BOOL
    if isinstance(value, int):
        return Scalar.INT
    return Scalar.FLOAT if isinstance(value, float) else Scalar.STRING


def is_subtype(type_: StaticType, above: StaticType, metamodel: Metamodel) -> bool:
    """Return whether every instance of one type is an instance of the other; an int is no float."""
    if isinstance(type_, ObjectType) and isinstance(above, ObjectType):
        return metamodel.is_a(type_.cls, above.cls)
    return type_ == above


def assignable(type_: StaticType, target: StaticType, metamodel: Metamodel) -> bool:
    """Return whether a value of one type may be stored where the other is expected; an int may stand for a float."""
    return is_subtype(type_, target, metamodel) or (type_ is Scalar.INT and target is Scalar.FLOAT)


def may_fit(type_: StaticType, target: StaticType, metamodel: Metamodel) -> bool:
    """Return whether some value of a type is assignable: an object of a superclass may be one of the class."""
    if isinstance(type_, ObjectType) and isinstance(target, ObjectType):
        return metamodel.overlap(type_.cls, target.cls)
    return assignable(type_, target, metamodel)


def compatible(one: StaticType, other: StaticType, metamodel: Metamodel) -> bool:
    """Return whether something can be an instance of both types."""
    return meet(one, other, metamodel) is not None


def comparable(one: StaticType, other: StaticType, metamodel: Metamodel) -> bool:
    """Return whether values of the two types can be equal: as `compatible`, and an int can equal a float."""
    return compatible(one, other, metamodel) or (one in NUMBERS and other in NUMBERS)


def meet(one: StaticType, other: StaticType, metamodel: Metamodel) -> StaticType | None:
    """The type of what is an instance of both, or None when nothing can be.

    Of two classes that are not sub- and superclass it is the one class that covers all their common instances; where
    several classes share them and none covers the others, the first type stands for the meet.
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
    """The concrete classes whose instances are instances of both classes."""
    return [name for name in metamodel.concrete(one) if metamodel.is_a(name, other)]


def joins(types: Sequence[StaticType], metamodel: Metamodel) -> list[StaticType]:
    """The least common supertypes: one in the ordinary case, none when there is no common supertype at all."""
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


def literal_fits(value: Value, type_: StaticType) -> bool:
    """Return whether a written constant (no enum literal) may stand where the type is expected."""
    own = value_type(value)
    return own == type_ or (own is Scalar.INT and type_ is Scalar.FLOAT)


def coerced(value: Value, type_: StaticType | None) -> Value:
    """The constant as it is stored: an int where a float is expected becomes one."""
    return float(value) if type_ is Scalar.FLOAT and isinstance(value, int) else value


def wrong_type(expression: Expression, type_: StaticType, expected: StaticType) -> Diagnostic:
    """The diagnostic for an expression of one type where another is expected."""
    hint = None
    if (
        isinstance(expected, EnumType)
        and isinstance(expression, Constant)
        and isinstance(expression.value, str)
    ):
        hint = enum_hint(expression.value, expected)
    elif expected is Scalar.INT and type_ is Scalar.FLOAT:
        hint = "`round`, `floor` or `toInt` make an int of it"
    hint = hint or value_hint(expected, None if isinstance(expression, Constant) else type_)
    message = f"expected `{type_text(expected)}`, found `{type_text(type_)}`"
    return Diagnostic("wrong-type", message, expression.span, hint)


def enum_hint(written: str, enum: EnumType) -> str | None:
    """Return how to write the literal of an enum that someone wrote as a string."""
    near = did_you_mean(written, enum.literals)
    return near.replace("`", f"`{enum.name}::", 1) if near else None


def common_number(*types: StaticType | None) -> StaticType | None:
    """The type of a number that is made of numbers of these types; None where one is unknown."""
    if None in types:
        return None
    return Scalar.FLOAT if Scalar.FLOAT in types else Scalar.INT
