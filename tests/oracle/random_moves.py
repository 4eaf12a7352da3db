"""Random rules that nearly always do something: they set, link, create, move, retype and delete."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Scalar
from tests.oracle.worlds import Dice

NEXT = {Scalar.INT: "(x.{0} + 1) % 3", Scalar.BOOL: "!x.{0}"}
"""What follows a value; strings do not change in compiled environments."""


def random_moves(dice: Dice, model: Model, count: int) -> Sequence[str]:
    """The texts of some rules about objects that there are; most take none."""
    known = [one for one in _moves(dice, model.metamodel) if model.graph.extent(one[0])]
    return [
        _rule(dice, f"move{number}", *one)
        for number, one in enumerate(dice.one(known) for _ in range(count if known else 0))
    ]


def _rule(dice: Dice, name: str, cls: str, left: str, changes: str) -> str:
    """A rule about `x`, which it takes as an argument or looks for."""
    semantics = "@semantics(spo) " if dice.chance(50) else ""
    if dice.chance(30):
        return f"{semantics}rule {name}(x : {cls}) {{ lhs {{ {left} }} modify {{ {changes} }} }}"
    return f"{semantics}rule {name} {{ lhs {{ x : {cls}; {left} }} modify {{ {changes} }} }}"


def _moves(dice: Dice, metamodel: Metamodel) -> Iterator[tuple[str, str, str]]:
    """What can be done: the class of `x`, further conditions, and the changes."""
    for attribute in metamodel.attributes:
        if attribute.lower == 1 and not attribute.many and attribute.type is not Scalar.STRING:
            yield attribute.owner, "", f"set x.{attribute.name} = {_next(dice, attribute)};"
    for one in metamodel.references:
        yield from _links(one)
        if not metamodel.classes[one.target].abstract and one.opposite is None:
            few = f"n == count {one.target}(_); check n < 5;"
            yield one.owner, few, f"create x -{one.name}-> y : {one.target};"
    concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
    for cls in concrete:
        yield cls, "", f"retype x : {dice.one(concrete)};"
        yield cls, f"n == count {cls}(_); check n > 1;", "delete x;"


def _next(dice: Dice, attribute: Attribute) -> str:
    """Another value."""
    if isinstance(attribute.type, EnumType):
        name, (first, second) = attribute.type.name, attribute.type.literals
        return f"x.{attribute.name} == {name}::{first} ? {name}::{second} : {name}::{first}"
    if attribute.type is Scalar.FLOAT:
        return dice.one([f"1.0 - x.{attribute.name}", f"x.{attribute.name} * -0.7 + 0.3"])
    return NEXT[attribute.type].format(attribute.name)  # type: ignore[index]


def _links(one: Reference) -> Iterator[tuple[str, str, str]]:
    """Changes of the links of a reference, some of which the model may refuse."""
    if one.containment:
        yield one.owner, f"y : {one.target};", f"move y to x.{one.name};"
    elif one.many:
        yield one.owner, f"y : {one.target}; neg {one.owner}.{one.name}(x, y);", f"create x -{one.name}-> y;"
        yield one.owner, f"x -{one.name}-> y : {one.target};", f"delete x -{one.name}-> y;"
    else:
        yield one.owner, f"y : {one.target};", f"set x.{one.name} = y;"
        yield one.owner, f"y : {one.target};", f"set x.{one.name} = y;"
        if one.lower == 0:
            yield one.owner, f"x -{one.name}-> y : {one.target};", f"set x.{one.name} = none;"
