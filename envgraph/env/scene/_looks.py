"""How an object looks: the glyph of its class, and what `@colour` and `@glyph` before attributes make of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

from envgraph.code import dataclass
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Glyph, Metamodel, Scalar

_NAMED: Final[Mapping[str, str]] = MappingProxyType(
    {
        "red": "#e03131",
        "orange": "#f76707",
        "yellow": "#fcc419",
        "green": "#2f9e44",
        "cyan": "#22b8cf",
        "blue": "#1971c2",
        "purple": "#9c36b5",
        "pink": "#f06595",
        "brown": "#8d5b2d",
        "black": "#212529",
        "grey": "#868e96",
        "gray": "#868e96",
        "white": "#f8f9fa",
    }
)

_Marked = tuple[Attribute, tuple[str, ...]]
"""An attribute that changes how objects look, and what its `@glyph` says; () of a `@colour` and of an int."""

_IN_TURN = ("#1c3d6e", "#9c36b5", "#0b7285", "#c2255c", "#5c940d", "#d9480f")


@dataclass(frozen=True, slots=True)
class Look:
    """How an object is shown.

    Attributes:
        glyph: letter and colour.
        states: what its attributes add: `("red", "open")`.
        unusual: a `bool` with a glyph is not as it is declared.
    """

    glyph: Glyph
    states: tuple[str, ...] = ()
    unusual: bool = False


class Looks:
    """The looks of the objects of a model; what its metamodel says is looked up once a class."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._marked: dict[str, tuple[_Marked, ...]] = {}

    def of(self, node: int, plain: Glyph) -> Look:
        """The look of an object that has the glyph `plain` if its attributes say nothing."""
        model = self._model
        letter, colour, states, unusual = plain.letter, plain.colour, list[str](), False
        for attribute, letters in self._marks_of(model.graph.class_of(node)):
            value = model.graph.value(node, attribute)
            if value is None:
                continue
            if isinstance(attribute.type, EnumType):
                if letters:
                    letter = letters[attribute.type.literals.index(str(value))]
                else:
                    colour = _colour_of(attribute.type, str(value))
                states.append(str(value))
            elif attribute.type is Scalar.INT:
                letter = _digit(int(value))
                states.append(f"{attribute.name} {value}")
            elif letters and value != attribute.initial:
                letter, unusual = letters[0], True
                colour = (*letters[1:], colour)[0]
                states.append(attribute.name if value else f"not {attribute.name}")
        return Look(Glyph(letter, colour), tuple(dict.fromkeys(states)), unusual)

    def vary(self, cls: str) -> bool:
        """Whether attributes change how the objects of a class look."""
        return bool(self._marks_of(cls))

    def _marks_of(self, cls: str) -> tuple[_Marked, ...]:
        if cls not in self._marked:
            self._marked[cls] = tuple(_marked(self._model.metamodel, cls))
        return self._marked[cls]


def token_colour(position: int) -> str:
    """The colour of the tokens at a place of a `draw` clause, where their class has no glyph."""
    return _IN_TURN[position % len(_IN_TURN)]


def glyph_of(metamodel: Metamodel, cls: str) -> Glyph:
    """The glyph of a class: the declared one, or the initial of its name in grey."""
    return metamodel.classes[cls].glyph or Glyph(cls[:1].upper())


def _marked(metamodel: Metamodel, cls: str) -> Iterator[_Marked]:
    """The attributes that change how objects look: first colours, then glyphs, which may bring other colours."""
    features = [one for one in metamodel.features(cls).values() if isinstance(one, Attribute)]
    for wanted in ("colour", "glyph"):
        for one in features:
            for mark in one.annotations:
                if mark.name == wanted:
                    yield one, tuple(map(str, mark.arguments))


def _digit(value: int) -> str:
    """A whole number as one letter."""
    return str(value) if 0 <= value <= 9 else "-" if value < 0 else "+"


def _colour_of(enum: EnumType, literal: str) -> str:
    """That which the literal names, else one by its place."""
    return _NAMED.get(literal.lower()) or token_colour(enum.literals.index(literal))
