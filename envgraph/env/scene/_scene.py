"""Compute scenes: the content of a picture of a model as data, a grid of cells or a graph, with tokens on it.

A scene holds no model: it can be stored for every state of an environment, and drawn as text, pixels or SVG.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from envgraph.behaviour import (
    DrawGraph,
    DrawGrid,
    FeatureReader,
    Token,
    bind_parameter,
    edge_ends,
    feature_reader,
    follow_path,
    ordered_objects,
)
from envgraph.code import dataclass, shorten_repr
from envgraph.draw import LINE_COLOUR
from envgraph.env.scene._appearance import Appearance, Appearances, glyph_of, token_colour
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Glyph, Scalar
from envgraph.pattern import Parameter, base_of

Draw = DrawGrid | DrawGraph

EMPTY = 255
"""The value in `GridScene.cells` for a position without a cell."""

DRAW_HINT = "write a clause such as `draw graph Class label name`"
"""The hint of errors about a behaviour that has no `draw` clause."""

_PLAIN_NODE = Glyph("", "#a5d8ff")


@dataclass(frozen=True, slots=True)
class Mark:
    """A token: an object that is drawn on a cell or node.

    Attributes:
        name: the name of the object, with the attribute values that change its appearance: "Door 24, red, open".
        place: (column, row) of a grid scene, counted from its upper left corner; (node number, 0) of a graph scene.
        kind: the class of the object, with the same values: "Door, red, open".
    """

    name: str
    letter: str
    colour: str
    place: tuple[int, int]
    kind: str = ""


@dataclass(frozen=True, slots=True)
class GridScene:
    """A grid of cells, each showing a class, and tokens on the cells.

    Attributes:
        width, height: the size in cells.
        glyphs: the glyph for each kind of cell.
        cells: row by row, for each cell its index in `glyphs`, or `EMPTY`.
        marks: the tokens in the order of the behaviour; later tokens are drawn above earlier ones.
        kinds: the class of each of `glyphs`.
        aside: tokens without a cell, in a row below the grid that all states have. None if every token always has
            a cell.
    """

    width: int
    height: int
    glyphs: tuple[Glyph, ...]
    cells: bytes
    marks: tuple[Mark, ...]
    kinds: tuple[str, ...] = ()
    aside: tuple[Mark, ...] | None = None


@dataclass(frozen=True, slots=True)
class Edge:
    """An arrow between two nodes, given by their numbers.

    Attributes:
        label: text beside the arrow; "" for none.
        kind: for an object that differs from its declaration in `bool` attributes with a glyph, its class and their
            values, such as "Link, not up"; the arrow is then dashed. Otherwise "".
    """

    source: int
    target: int
    label: str = ""
    colour: str = LINE_COLOUR
    kind: str = ""


@dataclass(frozen=True, slots=True)
class GraphScene:
    """A graph: nodes with a glyph and a label, directed edges between them, and tokens on the nodes.

    `kinds` are the classes of the nodes, with the attribute values that change their appearance: "Router, down".
    `aside` are tokens without a node, in a row below the graph; None if every token always has a node.
    """

    labels: tuple[str, ...]
    glyphs: tuple[Glyph, ...]
    edges: tuple[Edge, ...]
    marks: tuple[Mark, ...]
    kinds: tuple[str, ...] = ()
    aside: tuple[Mark, ...] | None = None


Scene = GridScene | GraphScene


@dataclass(frozen=True, slots=True)
class DrawnObjects:
    """The ids of the objects that the parts of a scene stand for, in the order of these parts.

    Attributes:
        cells: the objects of the cells of a grid, None for an empty position; or of the nodes of a graph.
        edges: the object of each edge of a graph, None if it is a reference.
        marks, aside: the object of each token.
    """

    cells: tuple[int | None, ...]
    edges: tuple[int | None, ...] = ()
    marks: tuple[int, ...] = ()
    aside: tuple[int, ...] = ()


@shorten_repr
class LegendEntry(NamedTuple):
    """An entry of the legend of pictures: a kind of object, and how it is drawn."""

    kind: str
    glyph: Glyph
    shape: Literal["tile", "disc", "line"]


def legend(scenes: Iterable[Scene]) -> tuple[LegendEntry, ...]:
    """Return a legend with each appearance in the scenes once: cells or nodes, then tokens, then dashed edges.

    Tokens that look alike share an entry.
    """
    below, above, between = dict[str, LegendEntry](), dict[str, LegendEntry](), dict[str, LegendEntry]()
    for scene in scenes:
        drawn = zip(scene.kinds, scene.glyphs, strict=False)
        shape: Literal["tile", "disc"] = "tile" if isinstance(scene, GridScene) else "disc"
        seen = range(len(scene.kinds)) if isinstance(scene, GraphScene) else sorted(set(scene.cells))
        found = [LegendEntry(kind, glyph, shape) for n, (kind, glyph) in enumerate(drawn) if n in seen]
        below.update((key.kind, key) for key in found)
        tokens = (*scene.marks, *(scene.aside or ()))
        marks = (LegendEntry(mark.kind or mark.name, Glyph(mark.letter, mark.colour), "disc") for mark in tokens)
        above.update((key.kind, key) for key in marks)
        if isinstance(scene, GraphScene):
            lines = (LegendEntry(edge.kind, Glyph("", edge.colour), "line") for edge in scene.edges if edge.kind)
            between.update((key.kind, key) for key in lines)
    alike: dict[Glyph, list[str]] = {}
    for kind in sorted(above):  # A box on the floor looks like a box on a goal.
        alike.setdefault(above[kind].glyph, []).append(kind)
    tokens_alike = (LegendEntry("; ".join(kinds), glyph, "disc") for glyph, kinds in alike.items())
    return (*below.values(), *tokens_alike, *between.values())


def scene_of(model: Model, draw: Draw, parameters: Iterable[Parameter] = ()) -> Scene:
    """Return the scene that a `draw` clause defines for a model.

    Args:
        model: any model of the behaviour's metamodel.
        draw: the clause, checked against that metamodel.
        parameters: the parameters of the behaviour; a token that is no parameter is the object of that name.

    Raises:
        EvaluationError: a token's parameter cannot be bound.
        InvalidArgument: the grid is too large to be drawn.
    """
    return Painter(model, draw, parameters).draw()


class Painter:
    """A producer of scenes for the states of one model; parameters are bound in the state at its creation."""

    def __init__(self, model: Model, draw: Draw, parameters: Iterable[Parameter] = ()) -> None:
        self._model = model
        self._read: FeatureReader = feature_reader(model)
        self._looks = Appearances(model)
        self._tokens = list(_bound_tokens(model, draw.tokens, {p.name: p for p in parameters}))
        features = {feature for token in draw.tokens for feature in base_of(token.path)[1]}
        self._may_lack_place = any(one.lower == 0 and one.name in features for one in model.metamodel.references)
        self._scene: Callable[[], tuple[Scene, DrawnObjects]]
        if isinstance(draw, DrawGrid):
            self._grid = _CellGrid(model, draw)
            self._scene = self._draw_grid
        else:
            self._graph = draw
            self._scene = self._draw_graph

    def draw(self) -> Scene:
        """Return the scene of the current state of the model."""
        return self._scene()[0]

    def draw_with_objects(self) -> tuple[Scene, DrawnObjects]:
        """Return the scene of the current state, and the objects that its parts stand for."""
        return self._scene()

    def grid_places(self) -> tuple[int, int, dict[int, tuple[int, int]]]:
        """Return the width and height of the grid in cells, and (column, row) of each cell and of each token on a cell.

        Tokens with a letter of their own are left out, because they only mark a cell for an object.
        """
        width, height, _, place_of = self._grid.cells()
        for number, node, at in self._token_placements():
            if at in place_of and self._tokens[number][0].letter is None:
                place_of = {**place_of, node: place_of[at]}
        return width, height, place_of

    def drawn_classes(self) -> list[str]:
        """Return the classes that the grid shows: those of cells, and of tokens in the current state."""
        return [self._grid.cls, *self._token_classes()]

    def _draw_grid(self) -> tuple[GridScene, DrawnObjects]:
        grid = self._grid
        width, height, cells, place_of = grid.cells()
        standing, aside = self._token_marks(place_of)
        marks = [*self._cell_marks(place_of), *standing]
        shown = {x + y * width: node for node, (x, y) in place_of.items()}
        scene = GridScene(width, height, grid.glyphs, cells, _marks_of(marks), grid.kinds, self._placeless_marks(aside))
        objects = DrawnObjects(tuple(map(shown.get, range(len(cells)))), (), _ids_of(marks), _ids_of(aside))
        return scene, objects

    def _placeless_marks(self, aside: Sequence[tuple[int, Mark]]) -> tuple[Mark, ...] | None:
        """Return the tokens that are on no cell or node; None if the metamodel allows no such token."""
        return _marks_of(aside) if self._may_lack_place else None

    def _draw_graph(self) -> tuple[GraphScene, DrawnObjects]:
        model, draw = self._model, self._graph
        nodes = ordered_objects(model, draw.cls)
        number = {node: position for position, node in enumerate(nodes)}
        marks, aside = self._token_marks({node: (place, 0) for node, place in number.items()})
        labels = tuple(_object_label(model, node, draw.label, self._read) for node in nodes)
        classes = [model.graph.class_of(node) for node in nodes]
        looks = [
            self._looks.appearance_of(node, model.metamodel.classes[cls].glyph or _PLAIN_NODE)
            for node, cls in zip(nodes, classes, strict=True)
        ]
        glyphs = tuple(look.glyph for look in looks)
        kinds = tuple(", ".join((cls, *look.states)) for cls, look in zip(classes, looks, strict=True))
        edges = [*self._edges(draw, number)]
        drawn = tuple(edge for _, edge in edges)
        scene = GraphScene(labels, glyphs, drawn, _marks_of(marks), kinds, self._placeless_marks(aside))
        return scene, DrawnObjects(tuple(nodes), tuple(node for node, _ in edges), _ids_of(marks), _ids_of(aside))

    def _token_classes(self) -> list[str]:
        model = self._model
        bound = (model.graph.class_of(node) for _, node in self._tokens if node is not None and model.graph.alive(node))
        return [*(token.cls for token, _ in self._tokens if token.cls), *bound]

    def _cell_marks(self, place_of: Mapping[int, tuple[int, int]]) -> Iterator[tuple[int, Mark]]:
        """Yield each cell whose appearance differs from its class, such as a spot with a box, and a token for it."""
        model = self._model
        varying = {cls for cls in self._grid.kinds if self._looks.annotated_of(cls)}
        for node in ordered_objects(model, self._grid.cls) if varying else ():
            cls = model.graph.class_of(node)
            if node in place_of and cls in varying:
                look = self._looks.appearance_of(node, class_glyph := glyph_of(model.metamodel, cls))
                if look.glyph != class_glyph:
                    yield node, self._make_mark(_object_label(model, node, None, self._read), cls, look, place_of[node])

    def _make_mark(self, name: str, cls: str, look: Appearance, place: tuple[int, int]) -> Mark:
        said = name.replace(",", "").split()  # do not repeat "red" for `Key red`
        name = ", ".join((name, *(state for state in look.states if state not in said)))
        kind = ", ".join((cls, *look.states))
        return Mark(name, look.glyph.letter, look.glyph.colour, place, kind)

    def _token_marks(
        self, place_of: Mapping[int, tuple[int, int]]
    ) -> tuple[list[tuple[int, Mark]], list[tuple[int, Mark]]]:
        """Return the objects and tokens on cells or nodes, and those without a place.

        `place_of` has the position of each object that is a cell or node.
        """
        standing, aside = list[tuple[int, Mark]](), list[tuple[int, Mark]]()
        for position, node, at in self._token_placements():
            if at is None:
                if self._may_lack_place:
                    aside.append((node, self._make_token_mark(position, node, (0, 0))))
            elif at in place_of and at != node:  # a token is not drawn on itself
                standing.append((node, self._make_token_mark(position, node, place_of[at])))
        return standing, aside

    def _make_token_mark(self, position: int, node: int, place: tuple[int, int]) -> Mark:
        model, (token, bound) = self._model, self._tokens[position]
        cls = model.graph.class_of(node)
        declared = model.metamodel.classes[cls].glyph
        look = self._looks.appearance_of(node, declared or Glyph(cls[:1].upper(), token_colour(position)))
        name = token.variable if bound is not None else _object_label(model, node, None, self._read)
        if token.letter is not None:
            way = " ".join(base_of(token.path)[1])
            look = Appearance(Glyph(token.letter, look.glyph.colour))
            name, cls = f"{name}, {way}", f"{cls}, {way}"
        return self._make_mark(name, cls, look, place)

    def _token_placements(self) -> Iterator[tuple[int, int, int | None]]:
        """Yield for every existing token its position in the `draw` clause, its object, and the one below or None."""
        model = self._model
        for position, (token, bound) in enumerate(self._tokens):
            nodes = ordered_objects(model, token.cls) if bound is None and token.cls else [bound]
            for node in nodes:
                if node is not None and model.graph.alive(node):
                    at = follow_path(token.path, {token.variable: node}, self._read)
                    yield position, node, at if type(at) is int else None

    def _edges(self, draw: DrawGraph, number: Mapping[int, int]) -> Iterator[tuple[int | None, Edge]]:
        """Yield the edges between drawn nodes: references, and objects with two single-valued references to nodes.

        The first item of a pair is the object, or None for a reference. Tokens are not drawn as edges.
        """
        model, mm, cls = self._model, self._model.metamodel, draw.cls
        for reference in mm.references:
            if mm.may_overlap(reference.owner, cls) and mm.may_overlap(reference.target, cls):
                for node, place in number.items():
                    if mm.is_a(model.graph.class_of(node), reference.owner):
                        targets = sorted(number[to] for to in model.graph.targets(node, reference) if to in number)
                        yield from ((None, Edge(place, target)) for target in targets)
        tokens = self._token_classes()
        for between in mm.class_list:
            if not between.abstract and not any(mm.is_a(between.name, other) for other in (cls, *tokens)):
                ends = edge_ends(mm, between.name, cls)
                for node in sorted(model.graph.exact_extent(between.name)) if ends else ():
                    source, target = (model.graph.target(node, end) for end in ends)
                    if source is not None and target is not None and source in number and target in number:
                        yield node, self._edge(draw, node, between, number[source], number[target])

    def _edge(self, draw: DrawGraph, node: int, cls: Class, source: int, target: int) -> Edge:
        """Return the edge that represents an object, with its label, colour and kind."""
        look = self._looks.appearance_of(node, cls.glyph or Glyph("", LINE_COLOUR))
        named = (link.label for link in draw.links if self._model.metamodel.is_a(cls.name, link.cls))
        value = next((self._read(node, label) for label in named if label), None)
        label = "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
        kind = ", ".join((cls.name, *look.states)) if look.is_unusual else ""
        return Edge(source, target, label, look.glyph.colour, kind)


def _marks_of(drawn: Iterable[tuple[int, Mark]]) -> tuple[Mark, ...]:
    return tuple(mark for _, mark in drawn)


def _ids_of(drawn: Iterable[tuple[int, Mark]]) -> tuple[int, ...]:
    return tuple(node for node, _ in drawn)


def _bound_tokens(
    model: Model, tokens: Sequence[Token], parameters: Mapping[str, Parameter]
) -> Iterator[tuple[Token, int | None]]:
    for token in tokens:
        if token.cls is not None:
            yield token, None
        else:
            yield token, bind_parameter(model, parameters.get(token.variable) or Parameter(token.variable))


def _object_label(model: Model, node: int, attribute: str | None, read: FeatureReader) -> str:
    cls = model.graph.class_of(node)
    names = (attribute,) if attribute else model.metamodel.key(cls)
    values = [read(node, name) for name in names]
    if values and all(value is not None for value in values):
        text = ", ".join(str(value) for value in values)
        features = model.metamodel.features(cls)
        is_attribute = attribute or all(getattr(features[name], "type", None) is Scalar.STRING for name in names)
        return text if is_attribute else f"{cls} {text}"
    return model.graph.object_name(node) or f"{model.graph.class_of(node)} {node}"


class _CellGrid:
    """The cells of a grid, computed from the class, column and row of each object."""

    def __init__(self, model: Model, draw: DrawGrid) -> None:
        mm = model.metamodel
        kinds = mm.concrete_classes(draw.cls)
        if len(kinds) >= EMPTY:
            raise InvalidArgument(f"`{draw.cls}` has {len(kinds)} subclasses, but at most {EMPTY - 1} can be drawn")
        column, row = mm.feature(draw.cls, draw.column), mm.feature(draw.cls, draw.row)
        assert isinstance(column, Attribute)
        assert isinstance(row, Attribute)
        self.kinds = tuple(kinds)
        self.glyphs = tuple(glyph_of(mm, kind) for kind in kinds)
        self._model = model
        self.cls, self._column, self._row = draw.cls, column, row
        self._kind = {kind: number for number, kind in enumerate(kinds)}

    def cells(self) -> tuple[int, int, bytes, dict[int, tuple[int, int]]]:
        """Return the width, the height, the kind of every cell, and the (column, row) of every object.

        Kinds are indices in `kinds`, row by row, or `EMPTY`. Raise InvalidArgument for more than a million cells.
        """
        model = self._model
        at: dict[int, tuple[int, int]] = {}
        for node in sorted(model.graph.extent(self.cls)):  # of two objects on one place the younger one is shown
            x, y = model.graph.value(node, self._column), model.graph.value(node, self._row)
            if type(x) is int and type(y) is int:
                at[node] = x, y
        if not at:
            return 0, 0, b"", {}
        left, top = min(x for x, _ in at.values()), min(y for _, y in at.values())
        width = max(x for x, _ in at.values()) - left + 1
        height = max(y for _, y in at.values()) - top + 1
        if width * height > LIMITS["drawn cells"]:
            raise InvalidArgument(
                f"a grid of {width} x {height} cells is too large: at most {LIMITS['drawn cells']:,} can be drawn"
            )
        cells = bytearray([EMPTY]) * (width * height)
        places = {node: (x - left, y - top) for node, (x, y) in at.items()}
        for node, (x, y) in places.items():
            cells[y * width + x] = self._kind[model.graph.class_of(node)]
        return width, height, bytes(cells), places
