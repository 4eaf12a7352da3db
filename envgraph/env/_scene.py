"""What a picture of a model shows, as data: a grid of cells or a graph, with tokens on it.

A scene holds no model: it can be kept for every state of an environment, and drawn as text, pixels or SVG.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from envgraph.env._behaviour import DrawGraph, DrawGrid, Token
from envgraph.env._binding import Reader, bind_parameter, follow, reader
from envgraph.env._keys import ordered_objects
from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Glyph, Metamodel, Reference
from envgraph.pattern import Parameter

Draw = DrawGrid | DrawGraph

EMPTY = 255
"""In `GridScene.cells`: nothing is there."""

MOST_CELLS = 1_000_000

_PLAIN_NODE = Glyph("", "#a5d8ff")

_TOKEN_COLOURS = ("#1c3d6e", "#9c36b5", "#0b7285", "#c2255c")


@dataclass(frozen=True, slots=True)
class Mark:
    """A token: what it is called, its letter and colour, and where it stands.

    Attributes:
        place: (column, row) of a grid scene, counted from its upper left corner; (node number, 0) of a graph scene.
    """

    name: str
    letter: str
    colour: str
    place: tuple[int, int]


@dataclass(frozen=True, slots=True)
class GridScene:
    """Cells by class, and tokens on them.

    Attributes:
        width, height: size in cells.
        glyphs: how a cell of each kind is shown.
        cells: row by row, for each cell its place in `glyphs`, or `EMPTY`.
        marks: in the order of the behaviour; later ones are drawn above earlier ones.
    """

    width: int
    height: int
    glyphs: tuple[Glyph, ...]
    cells: bytes
    marks: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class GraphScene:
    """Nodes with a glyph and a label, directed edges between them (by node number), and tokens."""

    labels: tuple[str, ...]
    glyphs: tuple[Glyph, ...]
    edges: tuple[tuple[int, int], ...]
    marks: tuple[Mark, ...]


Scene = GridScene | GraphScene


def scene_of(model: Model, draw: Draw, parameters: Iterable[Parameter] = ()) -> Scene:
    """What a `draw` clause shows of a model.

    Args:
        model: any model of the behaviour's metamodel.
        draw: the clause, checked against that metamodel.
        parameters: those of the behaviour; a token that is none of them is the object of that name.

    Raises:
        EvaluationError: a token's parameter cannot be bound.
        InvalidArgument: the grid is too large to be drawn.
    """
    return Painter(model, draw, parameters).scene()


class Painter:
    """Makes scenes of the states of one model; what does not change between states is looked up once."""

    def __init__(self, model: Model, draw: Draw, parameters: Iterable[Parameter] = ()) -> None:
        self._model = model
        self._read: Reader = reader(model)
        self._tokens = list(_bound_tokens(model, draw.tokens, {p.name: p for p in parameters}))
        self._scene: Callable[[], Scene]
        if isinstance(draw, DrawGrid):
            self._grid = _Grid(model, draw)
            self._scene = self._grid_scene
        else:
            self._graph = draw
            self._scene = self._graph_scene

    def scene(self) -> Scene:
        """The scene of the model as it is now."""
        return self._scene()

    def _grid_scene(self) -> GridScene:
        grid = self._grid
        width, height, cells, place_of = grid.cells()
        marks = tuple(
            Mark(name, glyph.letter, glyph.colour, place_of[at])
            for name, glyph, at in self._marks()
            if at in place_of
        )
        return GridScene(width, height, grid.glyphs, cells, marks)

    def _graph_scene(self) -> GraphScene:
        model, draw = self._model, self._graph
        nodes = ordered_objects(model, draw.cls)
        number = {node: position for position, node in enumerate(nodes)}
        marks = tuple(
            Mark(name, glyph.letter, glyph.colour, (number[at], 0))
            for name, glyph, at in self._marks()
            if at in number
        )
        labels = tuple(_label(model, node, draw.label, self._read) for node in nodes)
        classes = model.metamodel.classes
        glyphs = tuple(classes[model.class_of(node)].glyph or _PLAIN_NODE for node in nodes)
        edges = tuple(_edges(model, draw.cls, number, self._token_classes()))
        return GraphScene(labels, glyphs, edges, marks)

    def _token_classes(self) -> list[str]:
        model = self._model
        bound = (model.class_of(node) for _, node in self._tokens if node is not None and model.alive(node))
        return [*(token.cls for token, _ in self._tokens if token.cls), *bound]

    def _marks(self) -> Iterator[tuple[str, Glyph, int]]:
        """Name, glyph and the object below, of every token that is somewhere."""
        model = self._model
        for position, (token, bound) in enumerate(self._tokens):
            nodes = ordered_objects(model, token.cls) if bound is None and token.cls else [bound]
            for node in nodes:
                if node is None or not model.alive(node):
                    continue
                at = follow(token.path, {token.variable: node}, self._read)
                if type(at) is int:
                    name = token.variable if bound is not None else _label(model, node, None, self._read)
                    yield name, _token_glyph(model, node, position), at


def _bound_tokens(
    model: Model, tokens: Sequence[Token], parameters: Mapping[str, Parameter]
) -> Iterator[tuple[Token, int | None]]:
    for token in tokens:
        if token.cls is not None:
            yield token, None
        else:
            yield token, bind_parameter(model, parameters.get(token.variable) or Parameter(token.variable))


def glyph_of(metamodel: Metamodel, cls: str) -> Glyph:
    """The glyph of a class: the declared one, or the initial of its name in grey."""
    return metamodel.classes[cls].glyph or Glyph(cls[0].upper())


def _token_glyph(model: Model, node: int, position: int) -> Glyph:
    cls = model.class_of(node)
    declared = model.metamodel.classes[cls].glyph
    return declared or Glyph(cls[0].upper(), _TOKEN_COLOURS[position % len(_TOKEN_COLOURS)])


def _label(model: Model, node: int, attribute: str | None, read: Reader) -> str:
    names = (attribute,) if attribute else model.metamodel.key(model.class_of(node))
    values = [read(node, name) for name in names]
    if values and all(value is not None for value in values):
        return ", ".join(str(value) for value in values)
    return model.object_name(node) or f"{model.class_of(node)} {node}"


class _Grid:
    """The cells of a grid: reads class, column and row of each."""

    def __init__(self, model: Model, draw: DrawGrid) -> None:
        mm = model.metamodel
        kinds = mm.concrete(draw.cls)
        if len(kinds) >= EMPTY:
            raise InvalidArgument(f"`{draw.cls}` has {len(kinds)} classes of cells, {EMPTY - 1} can be drawn")
        column, row = mm.feature(draw.cls, draw.column), mm.feature(draw.cls, draw.row)
        assert isinstance(column, Attribute)
        assert isinstance(row, Attribute)
        self.glyphs = tuple(glyph_of(mm, kind) for kind in kinds)
        self._model = model
        self._cls, self._column, self._row = draw.cls, column, row
        self._kind = {kind: number for number, kind in enumerate(kinds)}

    def cells(self) -> tuple[int, int, bytes, dict[int, tuple[int, int]]]:
        """Width, height, the kind of every cell, and the place of every object."""
        model = self._model
        at: dict[int, tuple[int, int]] = {}
        for node in sorted(model.extent(self._cls)):  # of two on one place the younger is seen
            x, y = model.value(node, self._column), model.value(node, self._row)
            if type(x) is int and type(y) is int:
                at[node] = x, y
        if not at:
            return 0, 0, b"", {}
        left, top = min(x for x, _ in at.values()), min(y for _, y in at.values())
        width = max(x for x, _ in at.values()) - left + 1
        height = max(y for _, y in at.values()) - top + 1
        if width * height > MOST_CELLS:
            raise InvalidArgument(f"a grid of {width} x {height} cells is too large to be drawn")
        cells = bytearray([EMPTY]) * (width * height)
        places = {node: (x - left, y - top) for node, (x, y) in at.items()}
        for node, (x, y) in places.items():
            cells[y * width + x] = self._kind[model.class_of(node)]
        return width, height, bytes(cells), places


def _edges(
    model: Model, cls: str, number: Mapping[int, int], tokens: Sequence[str]
) -> Iterator[tuple[int, int]]:
    """Edges between the drawn nodes: references among them, and objects with two single references to them.

    Tokens are no edges, whatever they refer to.
    """
    mm = model.metamodel
    for reference in mm.references:
        if mm.overlap(reference.owner, cls) and mm.overlap(reference.target, cls):
            for node, place in number.items():
                if mm.is_a(model.class_of(node), reference.owner):
                    yield from ((place, number[to]) for to in model.targets(node, reference) if to in number)
    for between in mm.class_list:
        if not between.abstract and not any(mm.is_a(between.name, other) for other in (cls, *tokens)):
            ends = _ends(mm, between.name, cls)
            for node in sorted(model.exact_extent(between.name)) if ends else ():
                source, target = model.target(node, ends[0]), model.target(node, ends[1])
                if source is not None and target is not None and source in number and target in number:
                    yield number[source], number[target]


def _ends(metamodel: Metamodel, cls: str, end: str) -> tuple[Reference, ...]:
    """The first two single references to nodes, of a class whose objects are drawn as edges; else ()."""
    found = tuple(
        feature
        for feature in metamodel.features(cls).values()
        if isinstance(feature, Reference) and not feature.many and metamodel.is_a(feature.target, end)
    )
    return found[:2] if len(found) > 1 else ()
