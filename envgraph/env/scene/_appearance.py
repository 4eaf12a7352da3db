"""Compute how objects are drawn: from the glyph of their class, and the `@colour` and `@glyph` of their attributes."""

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
"""An attribute that changes the appearance of objects, and the arguments of its `@glyph`; () for `@colour` and ints."""

_TOKEN_COLOURS = ("#1c3d6e", "#9c36b5", "#0b7285", "#c2255c", "#5c940d", "#d9480f")


@dataclass(frozen=True, slots=True)
class Appearance:
    """The appearance of an object.

    Attributes:
        glyph: letter and colour.
        states: the attribute values that change the appearance: `("red", "open")`.
        is_unusual: True if a `bool` attribute with a glyph differs from its declared value.
    """

    glyph: Glyph
    states: tuple[str, ...] = ()
    is_unusual: bool = False


class Appearances:
    """The appearances of the objects of a model. The annotations of a class are read once."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._marked: dict[str, tuple[_Marked, ...]] = {}

    def appearance_of(self, node: int, default: Glyph) -> Appearance:
        """Return the appearance of an object, whose glyph is `default` if no attribute changes it."""
        model = self._model
        letter, colour, states, unusual = default.letter, default.colour, list[str](), False
        for attribute, letters in self.annotated_of(model.graph.class_of(node)):
            value = model.graph.value(node, attribute)
            if value is None:
                continue
            if isinstance(attribute.type, EnumType):
                if letters:
                    letter = letters[attribute.type.literals.index(str(value))]
                else:
                    position = attribute.type.literals.index(str(value))
                    colour = _NAMED.get(str(value).lower()) or token_colour(position)
                states.append(str(value))
            elif attribute.type is Scalar.INT:
                letter = str(value) if 0 <= int(value) <= 9 else "-" if int(value) < 0 else "+"
                states.append(f"{attribute.name} {value}")
            elif letters and value != attribute.initial:
                letter, unusual = letters[0], True
                colour = (*letters[1:], colour)[0]
                states.append(attribute.name if value else f"not {attribute.name}")
        return Appearance(Glyph(letter, colour), tuple(dict.fromkeys(states)), unusual)

    def annotated_of(self, cls: str) -> tuple[_Marked, ...]:
        """Return the attributes that can change the appearance of objects of a class, with their annotations."""
        if cls not in self._marked:
            self._marked[cls] = tuple(_annotated_attributes(self._model.metamodel, cls))
        return self._marked[cls]


def token_colour(position: int) -> str:
    """Return the colour of tokens without a glyph of their own, by their position in the `draw` clause."""
    return _TOKEN_COLOURS[position % len(_TOKEN_COLOURS)]


def glyph_of(metamodel: Metamodel, cls: str) -> Glyph:
    """Return the glyph of a class: the declared one, or the initial of its name in grey."""
    return metamodel.classes[cls].glyph or Glyph(cls[:1].upper())


def _annotated_attributes(metamodel: Metamodel, cls: str) -> Iterator[_Marked]:
    """Yield each attribute that changes appearances, with its annotation's arguments: colours before glyphs."""
    features = [one for one in metamodel.features(cls).values() if isinstance(one, Attribute)]
    for wanted in ("colour", "glyph"):
        for one in features:
            for mark in one.annotations:
                if mark.name == wanted:
                    yield one, tuple(map(str, mark.arguments))
