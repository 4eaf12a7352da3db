"""Matches and applications as the public API returns them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Unpack

from envgraph.code import dataclass, shorten_repr
from envgraph.draw import Picture, html_table
from envgraph.errors import SHOWN, InvalidArgument, did_you_mean
from envgraph.graph import Model, Node, PictureOptions
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType, StaticType

Row = tuple[Value, ...]
"""A match as the matcher returns it, with ids in place of objects."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The data that all matches of one pattern or rule share: its qualified name, its variables and their types."""

    definition: str
    names: tuple[str, ...]
    types: tuple[StaticType, ...]

    def position(self, name: str) -> int:
        """Return the index of a variable in the tuple `names`.

        Raises:
            InvalidArgument: the pattern or rule has no variable with this name.
        """
        if name in self.names:
            return self.names.index(name)
        known = ", ".join(f"`{known}`" for known in self.names) or "none"
        hint = did_you_mean(name, self.names) or f"its variables are {known}"
        raise InvalidArgument(f"`{self.definition}` has no variable `{name}`", hint)

    def is_object(self, position: int) -> bool:
        """Return True if the variable at this index is bound to objects, False if it is bound to data values."""
        return isinstance(self.types[position], ObjectType)


@shorten_repr
class Match(Mapping[str, "Node | Value"]):
    """A match of a pattern or of the LHS of a rule: an immutable mapping from variables to nodes or data values.

    `match["tile"]` and `match.tile` return a `Node` or a data value. If a variable has the name of a method or
    attribute of this class (`row`, `names`, `values` ..), only `match["name"]` returns its value. `names` and `row` are
    tuples of equal length; `row` contains ids instead of nodes. Two matches are equal if model, definition and row are
    equal. A match does not change when the model changes.
    """

    __slots__ = ("_shape", "model", "row")

    _shape: Shape
    model: Model
    row: Row

    def __init__(self, model: Model, shape: Shape, row: Row) -> None:
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "_shape", shape)
        object.__setattr__(self, "row", row)

    @property
    def definition(self) -> str:
        """Return the qualified name of the pattern or rule."""
        return self._shape.definition

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the variables, parameters first."""
        return self._shape.names

    def __getitem__(self, name: str) -> Node | Value:
        if name not in self.names:
            raise KeyError(name)
        position = self.names.index(name)
        value = self.row[position]
        if self._shape.is_object(position):
            assert isinstance(value, int)
            return Node(self.model, value)  # possibly deleted by now: listeners are notified of such matches
        return value

    def __getattr__(self, name: str) -> Node | Value:
        if name.startswith("__") or name not in self.names:
            hint = None if name.startswith("__") else did_you_mean(name, self.names)
            raise AttributeError(
                f"match of `{self.definition}` has no variable `{name}`" + (f": {hint}" if hint else "")
            )
        return self[name]

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a match is immutable")

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Match):
            return NotImplemented
        return self.model is other.model and self._shape == other._shape and self.row == other.row

    def __hash__(self) -> int:
        return hash((self.definition, self.row))

    def __copy__(self) -> Match:
        return self

    def __deepcopy__(self, _: object) -> Match:
        """Return this match itself, because `deepcopy` does not copy the objects of a model."""
        return self

    def __reduce__(self) -> tuple[type[Match], tuple[Model, Shape, Row]]:
        """Return constructor and arguments for pickle. The pickle contains the whole model, as a pickled node does."""
        return Match, (self.model, self._shape, self.row)

    def picture(self, **options: Unpack[PictureOptions]) -> Picture:
        """Return a picture of this match, highlighted, and its neighbours. `options` are options of `Model.picture`."""
        wanted: PictureOptions = {"highlight": self, "around": self, **options}
        return self.model.picture(**wanted)

    def to_dot(self, **options: Unpack[PictureOptions]) -> str:
        """Return the picture of the match as DOT text for Graphviz. `options` are those of `picture`."""
        return self.picture(**options).to_dot()

    def to_svg(self, **options: Unpack[PictureOptions]) -> str:
        """Return the picture of the match as an `<svg>` element; see `Picture.to_svg`."""
        return self.picture(**options).to_svg()

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={self._value_text(position)}" for position, name in enumerate(self.names))
        return f"{self.definition}({inside})"

    def cell_texts(self) -> list[str]:
        """Return the value of each variable as text."""
        return [self._value_text(position) for position in range(len(self.names))]

    def _repr_html_(self) -> str:
        return Matches([self])._repr_html_()

    def _value_text(self, position: int) -> str:
        value = self.row[position]
        if not self._shape.is_object(position):
            return repr(value)
        assert isinstance(value, int)
        return repr(self.model.node(value)) if self.model.graph.alive(value) else f"<deleted #{value}>"


@shorten_repr
class Matches(list[Match]):
    """A list of matches of one pattern or rule, which notebooks show as an HTML table."""

    def __repr__(self) -> str:
        shown = ", ".join(map(repr, self[: SHOWN.matches]))
        more = f" and {len(self) - SHOWN.matches:,} more" if len(self) > SHOWN.matches else ""
        return f"[{shown}{more}]" if len(shown) < 160 else f"<{len(self):,} matches of {self[0].definition}>"

    def _repr_html_(self) -> str:
        if not self:
            return "no matches"
        return html_table((one.cell_texts() for one in self), self[0].names, self[0].definition, len(self))


@shorten_repr
class Firing(NamedTuple):
    """An application as recorded in a trace: rule name and row of the match, as values that JSON can hold."""

    rule: str
    values: Row


@dataclass(frozen=True, slots=True)
class Application:
    """The result of applying a rule.

    Attributes:
        match: the match at which the rule was applied.
        created: the new objects, by their names in the rule.
        outputs: values of the `out` parameters, by name.
    """

    rule: str
    match: Match
    created: Mapping[str, Node]
    outputs: Mapping[str, Node | Value]

    @property
    def firing(self) -> Firing:
        """Return the rule name and the row of the match as a `Firing`, for a trace."""
        return Firing(self.rule, self.match.row)

    def _repr_html_(self) -> str:
        rows = [*zip(self.match.names, self.match.cell_texts(), strict=True), *self.created.items()]
        return html_table([*rows, *self.outputs.items()], caption=f"{self.rule} was applied")
