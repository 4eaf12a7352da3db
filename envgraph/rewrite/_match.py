"""Matches and applications as people see them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Unpack

from envgraph.code import dataclass, short_repr
from envgraph.draw import Picture, markup
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.graph import Model, Node, PictureOptions
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType, StaticType

Row = tuple[Value, ...]
"""One match as the matcher returns it: objects as ids."""


_SHOWN = 3
"""Matches in a repr."""

_LONGEST = 160
_ROWS = 100
"""Matches that a notebook shows."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What the matches of one pattern or rule have in common: its name, its variables and their types."""

    definition: str
    names: tuple[str, ...]
    types: tuple[StaticType, ...]

    def position(self, name: str) -> int:
        """Place of a variable in the tuple.

        Raises:
            InvalidArgument: there is no such variable.
        """
        if name in self.names:
            return self.names.index(name)
        known = ", ".join(f"`{known}`" for known in self.names) or "none"
        hint = did_you_mean(name, self.names) or f"its variables are {known}"
        raise InvalidArgument(f"`{self.definition}` has no variable `{name}`", hint)

    def is_object(self, position: int) -> bool:
        """Return whether the variable at this place stands for an object."""
        return isinstance(self.types[position], ObjectType)


@short_repr
class Match(Mapping[str, "Node | Value"]):
    """One match of a pattern or of the left side of a rule: an immutable mapping from variables to what they stand for.

    `match["tile"]` and `match.tile` give a `Node`, or a data value; a variable that is called like a method or
    attribute of this class (`row`, `names`, `values` ...) has only the first form. `names` and `row` are two tuples of
    equal length; `row` holds ids instead of nodes. Equal matches are those of one model, one definition and equal
    rows; a match stays what it is when the model changes.
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
        """Qualified name of the pattern or rule."""
        return self._shape.definition

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables, parameters first."""
        return self._shape.names

    def __getitem__(self, name: str) -> Node | Value:
        if name not in self.names:
            raise KeyError(name)
        position = self.names.index(name)
        value = self.row[position]
        if self._shape.is_object(position):
            assert isinstance(value, int)
            return Node(self.model, value)  # it may be gone by now: listeners are notified of such matches
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
        """The same, as for the nodes in it."""
        return self

    def __reduce__(self) -> tuple[type[Match], tuple[Model, Shape, Row]]:
        """With its model, as a node."""
        return Match, (self.model, self._shape, self.row)

    def picture(self, **options: Unpack[PictureOptions]) -> Picture:
        """The matched objects, highlighted, and those one link away; `options` are those of `Model.picture`."""
        wanted: PictureOptions = {"highlight": self, "around": self, **options}
        return self.model.picture(**wanted)

    def to_dot(self, **options: Unpack[PictureOptions]) -> str:
        """The picture as DOT, the text that Graphviz draws."""
        return self.picture(**options).to_dot()

    def to_svg(self, **options: Unpack[PictureOptions]) -> str:
        """The picture as an `<svg>` element; see `Picture.to_svg`."""
        return self.picture(**options).to_svg()

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={self._text(position)}" for position, name in enumerate(self.names))
        return f"{self.definition}({inside})"

    def cells(self) -> list[str]:
        """The values as cells of a table in HTML."""
        return [f"<td>{markup(self._text(position))}</td>" for position in range(len(self.names))]

    def _repr_html_(self) -> str:
        return Matches([self])._repr_html_()

    def _text(self, position: int) -> str:
        value = self.row[position]
        if not self._shape.is_object(position):
            return repr(value)
        assert isinstance(value, int)
        return repr(self.model.node(value)) if self.model.graph.alive(value) else f"<deleted #{value}>"


@short_repr
class Matches(list[Match]):
    """All matches of a pattern or rule: a list, which a notebook shows as a table."""

    def __repr__(self) -> str:
        shown = ", ".join(map(repr, self[:_SHOWN]))
        more = f" and {len(self) - _SHOWN:,} more" if len(self) > _SHOWN else ""
        return (
            f"[{shown}{more}]"
            if len(shown) < _LONGEST
            else f"<{len(self):,} matches of {self[0].definition}>"
        )

    def _repr_html_(self) -> str:
        if not self:
            return "no matches"
        head = "".join(f"<th>{markup(name)}</th>" for name in self[0].names)
        rows = "".join(f"<tr>{''.join(one.cells())}</tr>" for one in self[:_ROWS])
        more = f"<p>and {len(self) - _ROWS:,} more</p>" if len(self) > _ROWS else ""
        return f"<table><caption>{markup(self[0].definition)}</caption><tr>{head}</tr>{rows}</table>{more}"


@short_repr
class Firing(NamedTuple):
    """One application as a trace records it: a rule and the match it was applied at. Plain data, ready for JSON."""

    rule: str
    values: Row


@dataclass(frozen=True, slots=True)
class Application:
    """What applying a rule did.

    Attributes:
        match: where the rule was applied.
        created: the new objects, by the name that the rule gives them.
        outputs: values of the `out` parameters.
    """

    rule: str
    match: Match
    created: Mapping[str, Node]
    outputs: Mapping[str, Node | Value]

    @property
    def firing(self) -> Firing:
        """The application as a trace records it."""
        return Firing(self.rule, self.match.row)
