"""What random metamodels seldom have by chance, and environments observe: places in a grid, ranges, looks, keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import islice
from string import ascii_lowercase

from envgraph.behaviour import Action, Behaviour, DrawGrid, KeyIndex, ObserveAround, Token, expand_action
from envgraph.metamodel import Annotation, Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import Navigation, ObjectType, PatternCall, StaticType, Variable
from envgraph.rewrite import Engine
from tests.oracle.worlds import Dice

Features = tuple[Attribute | Reference, ...]

MARKS: Mapping[object, tuple[Annotation, ...]] = {
    Scalar.INT: tuple(Annotation("range", ends) for ends in ((0, 1), (-1, 2), (1, 4))),
    Scalar.FLOAT: tuple(Annotation("range", ends) for ends in ((0.0, 0.75), (-2.5, 1.0), (0.1, 1e200))),
    Scalar.BOOL: (Annotation("glyph", ("$", "#868e96")),),
    Scalar.STRING: (),
}
"""Annotations of attributes by their type."""
ENUM_MARKS = (Annotation("glyph", ("r", "g")), Annotation("colour"))


def with_places(dice: Dice, metamodel: Metamodel) -> Metamodel:
    """The metamodel with cells that have a place, and objects that are on a cell and have a charge."""
    names = list(metamodel.classes)
    more: dict[str, Features] = {names[0]: (Reference("at", dice.one(names), 0, 1), Attribute("charge", Scalar.FLOAT))}
    cell = more[names[0]][0].target  # type: ignore[union-attr]
    more[cell] = (*more.get(cell, ()), Attribute("x", Scalar.INT), Attribute("y", Scalar.INT))
    return _changed(metamodel, lambda cls: (*cls.features, *more.get(cls.name, ())))


def with_marks(dice: Dice, metamodel: Metamodel) -> Metamodel:
    """The metamodel, with `@range` before many numbers, and `@glyph` or `@colour` before many bools and enums."""

    def marked(feature: Attribute | Reference) -> Attribute | Reference:
        if isinstance(feature, Reference) or feature.many or dice.chance(40):
            return feature
        marks = ENUM_MARKS if isinstance(feature.type, EnumType) else MARKS[feature.type]
        return replace(feature, annotations=(dice.one(marks),)) if marks else feature

    return _changed(metamodel, lambda cls: tuple(map(marked, cls.features)))


def _changed(metamodel: Metamodel, features: Callable[[Class], Features]) -> Metamodel:
    classes = [replace(cls, features=features(cls)) for cls in metamodel.class_list]
    return Metamodel(metamodel.name, tuple(classes), tuple(metamodel.enums.values()))


def random_grid(dice: Dice, metamodel: Metamodel) -> DrawGrid | None:
    """A grid of objects with ints, on which objects are drawn that have a reference to one; None without ints."""
    ints = [one for one in metamodel.attributes if one.type is Scalar.INT and not one.many]
    if not ints:
        return None
    cell = dice.one([one for one in ints if one.name == "x"] or ints)
    axes = [one.name for one in metamodel.features(cell.owner).values() if one in ints]
    column, row = ("x", "y") if cell.name == "x" and dice.chance(80) else (dice.one(axes), dice.one(axes))
    ways = [one for one in metamodel.references if not one.many and metamodel.may_overlap(one.target, cell.owner)]
    tokens = [Token("it", Navigation(Variable("it"), one.name), one.owner) for one in ways if dice.chance(70)]
    return DrawGrid(cell.owner, column, row, tuple(tokens))


def random_window(
    dice: Dice, engine: Engine, draw: DrawGrid, name: str, scope: Mapping[str, StaticType]
) -> ObserveAround:
    """A window around an object, often with a condition on its cells."""
    window = ObserveAround(Variable(name), *dice.one([(3, 3), (1, 5), (3, 1), (1, 1)]))
    return replace(window, visible=random_sight(dice, engine, "cell", draw.cls, scope) if dice.chance(50) else None)


def random_sight(
    dice: Dice, engine: Engine, name: str, cls: str, scope: Mapping[str, StaticType]
) -> PatternCall | None:
    """A condition on an object, which a name stands for; None if no pattern takes one of its class."""
    overlap = engine.model.metamodel.may_overlap
    places = [
        (pattern, types, place)
        for pattern in engine.patterns
        if not engine.library.inputs(pattern) and "#" not in pattern
        for types in [engine.library.parameter_types(pattern)]
        for place, type_ in enumerate(types)
        if isinstance(type_, ObjectType) and overlap(type_.cls, cls)
    ]
    if not places:
        return None
    pattern, types, place = dice.one(places)
    terms = [Variable("_")] * len(types)
    for number, type_ in enumerate(types):
        if isinstance(type_, ObjectType) and dice.chance(40):
            known = [one for one, own in scope.items() if isinstance(own, ObjectType) and overlap(own.cls, type_.cls)]
            terms[number] = Variable(dice.one([*known, "_"]))
    terms[place] = Variable(name)
    return PatternCall(pattern, tuple(terms))


def with_keys_of_keyboard(dice: Dice, behaviour: Behaviour, keys: KeyIndex, metamodel: Metamodel) -> Behaviour:
    """The behaviour, half of whose actions have a letter for each of their combinations, as long as there are some."""
    letters = iter(ascii_lowercase)

    def keyed(action: Action) -> Action:
        count = len(list(islice(expand_action(action, keys, metamodel), len(ascii_lowercase) + 1)))
        taken = tuple(islice(letters, count)) if dice.chance(50) else ()
        return replace(action, keys=taken if len(taken) == count else ())

    return replace(
        behaviour,
        actions=tuple(map(keyed, behaviour.actions)),
        agents=tuple(replace(one, actions=tuple(map(keyed, one.actions))) for one in behaviour.agents),
    )
