"""Pictures: text, pixels and SVG of grids and graphs."""

from __future__ import annotations

import re
import string
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from math import dist
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from envgraph.draw import (
    INK,
    LINE_COLOUR,
    PAPER,
    contrast,
    format_colour,
    ink_on,
    parse_colour,
)
from envgraph.draw._diagram_data import (
    MARK,
)
from envgraph.env import (
    Draw,
    DrawGraph,
    DrawGrid,
    DrawnLink,
    Edge,
    GraphScene,
    GridScene,
    Mark,
    Painter,
    Token,
    legend,
    scene_of,
    scene_rgb,
    scene_svg,
    scene_text,
)
from envgraph.env.scene._font import text_pixels
from envgraph.env.scene._graph_layout import STYLE, label_position, layout_graph, point_between
from envgraph.env.scene._scene import EMPTY
from envgraph.env.scene._text import (
    scene_title,
)
from envgraph.errors import InvalidArgument, ResolutionError
from envgraph.graph import Model
from envgraph.lang import open_workspace
from envgraph.metamodel import Annotation, Attribute, Class, EnumType, Glyph, Metamodel, Reference, Scalar
from envgraph.pattern import Navigation, Parameter, Variable
from tests.unit.env import forest

ROWS = ["SVB", "WRG"]
DRAW = forest.behaviour().draw
assert isinstance(DRAW, DrawGrid)


def at(variable: str) -> Navigation:
    return Navigation(Variable(variable), "at")


def net() -> Model:
    node = Class("City", features=(Attribute("name", Scalar.STRING),), key=("name",))
    road = Class("Road", features=(Reference("start", "City"), Reference("end", "City"), Attribute("km", Scalar.INT)))
    bus = Class("Bus", features=(Reference("at", "City"), Reference("towards", "City")))
    ferry = Class("Ferry", features=(Reference("at", "City", 0),), glyph=Glyph("~", "#0000ff"))
    model = Model(Metamodel("roads", (node, road, bus, ferry)))
    rome, bern, oslo = (model.create("City", name=name) for name in ("Rome", "Bern", "Oslo"))
    for start, end in ((rome, bern), (bern, rome), (oslo, bern), (oslo, oslo)):
        model.create("Road", start=start, end=end)
    model.create("Bus", object_name="bus", at=rome, towards=oslo)
    model.create("Ferry", object_name="f1", at=oslo)
    model.create("Ferry", object_name="f2", at=oslo)
    model.create("Ferry", object_name="f3")
    return model


NET_DRAW = DrawGraph("City", "name", (Token("bus", at("bus")), Token("ferry", at("ferry"), "Ferry")))


def colour(picture: NDArray[np.uint8], x: float, y: float, cell: int = 32) -> str:
    return "#" + "".join(f"{int(part):02x}" for part in picture[int(y * cell), int(x * cell)])


def text(model: Model, draw: Draw, parameters: Sequence[Parameter] = ()) -> str:
    return scene_text(scene_of(model, draw, parameters))


def pixels(model: Model, draw: Draw, cell: int = 32) -> NDArray[np.uint8]:
    return scene_rgb(scene_of(model, draw), cell)


def markup(model: Model, draw: Draw, cell: int = 32) -> str:
    return scene_svg(scene_of(model, draw), cell)


# --- grids


def test_grid_is_drawn_as_text() -> None:
    assert text(forest.model(ROWS), DRAW) == "(F) V  B\n W  R  G"


def test_token_object_is_found_by_name_or_by_parameter() -> None:
    model = forest.model(ROWS)
    model.graph.set_object_name(model.graph.find_object("truck") or 0, "engine")
    with pytest.raises(ResolutionError, match="the model has no object `truck`"):
        text(model, DRAW)
    assert text(model, DRAW, forest.behaviour().parameters).startswith("(F)")


def test_a_grid_may_begin_anywhere_and_have_gaps() -> None:
    model = Model(forest.metamodel())
    model.create("RoadTile", x=-2, y=5)
    model.create("WaterTile", x=1, y=6)
    model.create("FireTruck", object_name="truck")
    scene = scene_of(model, DRAW)
    assert isinstance(scene, GridScene)
    assert (scene.width, scene.height, len(scene.marks)) == (4, 2, 0)
    assert scene_text(scene) == " R\n          W"


def test_an_empty_grid_is_a_picture_without_cells() -> None:
    model = Model(forest.metamodel())
    model.create("FireTruck", object_name="truck")
    assert text(model, DRAW) == ""
    assert pixels(model, DRAW).shape == (1, 1, 3)
    ElementTree.fromstring(markup(model, DRAW))


def test_a_grid_that_is_too_large_is_refused() -> None:
    model = Model(forest.metamodel())
    model.create("RoadTile", x=0, y=0)
    model.create("RoadTile", x=2_000, y=2_000)
    model.create("FireTruck", object_name="truck")
    with pytest.raises(InvalidArgument, match="2001 x 2001 cells is too large"):
        scene_of(model, DRAW)


def test_cells_have_the_colours_of_their_glyphs() -> None:
    picture = pixels(forest.model(ROWS), DRAW)
    assert (picture.shape, picture.dtype) == ((64, 96, 3), np.uint8)
    corners = [[colour(picture, x + 0.15, y + 0.15) for x in range(3)] for y in range(2)]
    wanted = [[next(g.colour for g in forest.GLYPHS.values() if g.letter == letter) for letter in row] for row in ROWS]
    assert corners == wanted


def test_a_token_is_a_disc_with_a_light_ring() -> None:
    picture = pixels(forest.model(ROWS), DRAW)
    assert colour(picture, 0.25, 0.5) == "#1c3d6e"
    ring = picture[16, : 32 // 2].astype(int).sum(axis=1)
    assert ring.max() > 700
    without = pixels(forest.model(ROWS), DrawGrid("Tile", "x", "y"))
    assert (without[:32, :32] != picture[:32, :32]).any()
    assert (without[:, 32:] == picture[:, 32:]).all()


def test_letter_of_a_cell_has_the_pixels_of_the_font() -> None:
    picture = pixels(forest.model(["RS"], start=(1, 0)), DRAW, cell=16).astype(int).sum(axis=2)[:, :16]
    # The dark pixels inside the cell are those of the letter, in the middle.
    ink = picture[2:14, 2:14] < 500
    rows, columns = np.nonzero(ink)
    cropped = ink[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert (cropped == text_pixels("R")).all()


@pytest.mark.parametrize("cell", [1, 2, 7, 8, 11, 12, 16, 32, 33, 64, 100])
def test_every_size_of_cell_can_be_drawn(cell: int) -> None:
    assert pixels(forest.model(ROWS), DRAW, cell=cell).shape == (2 * cell, 3 * cell, 3)
    assert pixels(net(), NET_DRAW, cell=cell).ndim == 3


def test_sizes_out_of_bounds_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="`cell` is 0, but must be at least 1 pixel"):
        pixels(forest.model(ROWS), DRAW, cell=0)
    with pytest.raises(InvalidArgument, match="too large"):
        pixels(forest.model(ROWS), DRAW, cell=10_000)


def test_several_tokens_are_listed_and_drawn_beside_each_other() -> None:
    marks = (
        Mark("hero", "H", "#000000", (0, 0)),
        Mark("key", "K", "#9c36b5", (0, 0)),
        Mark("dog", "D", "#0b7285", (1, 0)),
    )
    scene = GridScene(2, 1, (Glyph(".", "#ffffff"),), bytes([0, 0]), marks)
    assert scene_text(scene) == "(K)(D)\nhero: column 0, row 0\nkey: column 0, row 0\ndog: column 1, row 0"
    picture = scene_rgb(scene, 64)
    colours = {tuple(pixel) for pixel in picture.reshape(-1, 3).tolist()}
    assert {(0, 0, 0), (0x9C, 0x36, 0xB5), (0x0B, 0x72, 0x85)} <= colours


def test_a_class_without_a_glyph_shows_its_initial() -> None:
    cell = Class("cell", features=(Attribute("x", Scalar.INT), Attribute("y", Scalar.INT)))
    model = Model(Metamodel("plain", (cell,)))
    model.create("cell")
    assert text(model, DrawGrid("cell", "x", "y")) == " C"


# --- graphs


def test_graph_is_drawn_as_text() -> None:
    # Objects with two references to cities are edges, unless they are tokens; nodes stand in the order of their key.
    assert text(net(), NET_DRAW).splitlines() == [
        " Bern  -> Rome",
        "(Oslo) -> Bern, Oslo",
        "(Rome) -> Bern",
        "bus: Rome",
        "f1: Oslo",
        "f2: Oslo",
        "f3: nowhere",
    ]


def test_references_between_nodes_are_edges() -> None:
    state = Class("State", features=(Reference("next", "State", 0, None),))
    model = Model(Metamodel("machine", (state,)))
    one, two = model.create("State", object_name="one"), model.create("State", object_name="two")
    one.next.append(two)
    scene = scene_of(model, DrawGraph("State"))
    assert isinstance(scene, GraphScene)
    assert (scene.labels, scene.edges) == (("one", "two"), (Edge(0, 1),))


def test_tokens_without_a_glyph_get_colours_in_turn() -> None:
    scene = scene_of(net(), NET_DRAW)
    assert [(mark.letter, mark.colour) for mark in scene.marks] == [("B", "#1c3d6e"), *[("~", "#0000ff")] * 2]


def test_a_graph_shows_nodes_on_a_circle_with_tokens() -> None:
    picture = pixels(net(), NET_DRAW)
    colours = {"#" + "".join(f"{part:02x}" for part in pixel) for pixel in picture.reshape(-1, 3).tolist()}
    assert {"#a5d8ff", "#1c3d6e", "#0000ff", "#ffffff"} <= colours


def test_graph_with_zero_or_one_node_can_be_drawn() -> None:
    model = Model(net().metamodel)
    draw = DrawGraph("City", "name")
    assert text(model, draw) == ""
    assert pixels(model, draw).ndim == 3
    model.create("City", name="Bern")
    assert text(model, draw) == " Bern"
    assert pixels(model, draw).ndim == 3
    ElementTree.fromstring(markup(model, draw))


# --- SVG


def test_svg_has_a_shape_for_every_cell_and_token() -> None:
    root = ElementTree.fromstring(markup(forest.model(ROWS), DRAW, cell=10))
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("30", "20", "0 0 3 2")
    tags = [re.sub(r"\{.*\}", "", element.tag) for element in root.iter()]
    assert (tags.count("rect"), tags.count("circle"), tags.count("text")) == (6, 1, 6)
    fills = [element.get("fill") for element in root.iter() if element.tag.endswith("rect")]
    assert fills == ["#b0b0b0", "#94d82d", "#e8590c", "#4dabf7", "#d0d0d0", "#2f9e44"]


def test_svg_letters_are_centred_in_their_cells() -> None:
    root = ElementTree.fromstring(markup(forest.model(ROWS), DRAW))
    assert "dominant-baseline" not in root.attrib
    letters = [part for part in root if part.tag.endswith("text")]
    assert letters and {float(letter.get("y", "")) % 1 for letter in letters} <= {0.675, 0.655}


def test_svg_escapes_what_comes_from_a_model() -> None:
    model = net()
    model.node(0).name = '<b> & "Rome"'
    text = scene_svg(scene_of(model, NET_DRAW))
    assert "<b>" not in text
    root = ElementTree.fromstring(text)
    assert '<b> & "Rome"' in [element.text for element in root.iter()]


def test_svg_of_a_graph_has_an_arrow_for_every_edge() -> None:
    root = ElementTree.fromstring(markup(net(), NET_DRAW))
    assert sum(element.tag.endswith("}g") for element in root) == 4


LINES = [
    *(Edge(0, 1, label) for label in ("a", "b", "c")),
    *(Edge(1, 0, label) for label in ("d", "e")),
    *(Edge(2, 2, label) for label in ("f", "g")),
    Edge(1, 2),
]


def lines() -> GraphScene:
    """Several edges between two nodes, there and back, and from a node to itself."""
    return GraphScene(("one", "two", "three"), (Glyph("N", "#a5d8ff"),) * 3, tuple(LINES), (), ("N",) * 3)


def test_text_shows_the_kinds_of_nodes_only_if_they_differ() -> None:
    scene = GraphScene(("a", "bc"), (Glyph("N", "#a5d8ff"),) * 2, (Edge(0, 1),), (), ("Hub", "Hub, down"))
    assert scene_text(scene) == " a   Hub       -> bc\n bc  Hub, down"
    assert scene_text(replace(scene, kinds=("Hub", "Hub"))) == " a   -> bc\n bc"


def test_kinds_that_look_alike_share_a_line_in_the_legend() -> None:
    marks = tuple(Mark(name, "$", "#e8590c", (x, 0), kind) for x, (name, kind) in enumerate(BOXES))
    keys = legend([GridScene(2, 1, (Glyph("."),), b"\0\0", marks, ("Floor",))])
    assert [key.kind for key in keys] == ["Floor", "Floor, box; Goal, box"]


BOXES = (("one", "Floor, box"), ("two", "Goal, box"))


def test_edges_between_the_same_nodes_lie_apart_and_loops_beside_their_node() -> None:
    layout = layout_graph(lines(), 0.2)
    assert len(layout.edges) == len(LINES)
    middles = [line[len(line) // 2] if len(line) > 2 else point_between(*line, 0.5) for _, line in layout.edges]
    assert all(dist(one, other) > 0.2 for one, other in combinations(middles, 2))
    for edge, line in layout.edges:
        for end, node in ((line[0], edge.source), (line[-1], edge.target)):
            assert STYLE.node_radius < dist(end, layout.nodes[node]) < STYLE.node_radius + 0.2
        assert all(dist(point, node) > STYLE.node_radius for point in line for node in layout.nodes)
        assert all(0 <= x <= layout.width and 0 <= y <= layout.height for x, y in line)
    places = [label_position(line) for edge, line in layout.edges if edge.label]
    assert all(dist(one, other) > 0.2 for one, other in combinations(places, 2))


def test_loops_and_edges_side_by_side_are_drawn() -> None:
    root = ElementTree.fromstring(scene_svg(lines()))
    assert sum(element.tag.endswith("}g") for element in root) == len(LINES)
    texts = [element for element in root if element.tag.endswith("text")]
    assert [one.text for one in texts if one.get("aria-hidden")] == list("abcdefg")  # white, below the letters
    assert [one.text for one in texts if not one.get("aria-hidden")][:7] == list("abcdefg")
    assert "paint-order" not in scene_svg(lines())
    with_loop, without = scene_rgb(lines()), scene_rgb(replace(lines(), edges=(*LINES[:-3], LINES[-1])))
    assert with_loop.shape == without.shape and (with_loop != without).any()


# --- the font


def test_font_letters_have_the_expected_pixels() -> None:
    lines = ["".join(".#"[int(pixel)] for pixel in row) for row in text_pixels("R.")]
    assert lines == [
        "####.......",
        "#...#......",
        "#...#......",
        "####.......",
        "#.#........",
        "#..#....##.",
        "#...#...##.",
    ]


def test_letters_differ_and_unknown_ones_are_boxes() -> None:
    letters = string.digits + string.ascii_letters + string.punctuation
    shapes = {text_pixels(letter).tobytes() for letter in letters}
    assert len(shapes) == len(letters)
    assert all(text_pixels(letter).any() for letter in letters)
    assert text_pixels("é").tobytes() == text_pixels("語").tobytes()
    assert text_pixels("é").tobytes() not in shapes
    assert not text_pixels(" ").any()
    assert text_pixels("").shape == (7, 0)


def test_letters_are_scaled_by_repeating_pixels() -> None:
    assert (text_pixels("ab", 3)[::3, ::3] == text_pixels("ab")).all()
    assert text_pixels("ab", 3).shape == (21, 33)


# --- what attributes show


def maze() -> tuple[Model, DrawGrid]:
    """A red door, a green key, and a hero."""
    colour = EnumType("Colour", ("red", "green", "plaid"))
    tinted = Attribute("colour", colour, annotations=(Annotation("colour"),))
    opened = Attribute("open", Scalar.BOOL, annotations=(Annotation("glyph", ("/",)),))
    cell = Class("Cell", features=(Attribute("x", Scalar.INT), Attribute("y", Scalar.INT)), glyph=Glyph("."))
    door = Class("Door", supertypes=("Cell",), features=(tinted, opened), glyph=Glyph("D", "#ced4da"))
    key = Class("Key", features=(tinted, Reference("at", "Cell")))
    model = Model(Metamodel("maze", (cell, door, key), (colour,)))
    start = model.create("Cell", object_name="start")
    model.create("Door", object_name="gate", x=1, colour="red")
    model.create("Key", object_name="k", at=start, colour="green")
    tokens = (Token("key", at("key"), "Key"),)
    return model, DrawGrid("Cell", "x", "y", tokens)


def test_tokens_have_the_colours_and_states_of_their_attributes() -> None:
    model, draw = maze()
    assert text(model, draw) == "(K)(D)\ngate, red: column 1, row 0\nk, green: column 0, row 0"
    scene = scene_of(model, draw)
    assert [(mark.colour, mark.kind) for mark in scene.marks] == [
        ("#e03131", "Door, red"),
        ("#2f9e44", "Key, green"),
    ]
    model.node(model.graph.find_object("gate") or 0).open = True
    assert text(model, draw).splitlines()[:2] == ["(K)(/)", "gate, red, open: column 1, row 0"]
    model.node(model.graph.find_object("gate") or 0).colour = "plaid"
    assert scene_of(model, draw).marks[0].colour == "#0b7285"  # no colour of that name: one by its place


def test_cell_gets_a_token_only_if_its_attributes_have_something_to_show() -> None:
    model, draw = maze()
    model.node(model.graph.find_object("gate") or 0).colour = None
    assert [mark.name for mark in scene_of(model, draw).marks] == ["k, green"]
    model.node(model.graph.find_object("gate") or 0).open = True
    assert [mark.name for mark in scene_of(model, draw).marks] == ["gate, open", "k, green"]


def test_legend_lists_each_drawn_kind_once() -> None:
    model, draw = maze()
    assert [(key.kind, key.glyph.letter, key.shape) for key in legend([scene_of(model, draw)] * 2)] == [
        ("Cell", ".", "tile"),
        ("Door", "D", "tile"),
        ("Door, red", "D", "disc"),
        ("Key, green", "K", "disc"),
    ]


def test_an_enum_has_a_letter_for_each_literal() -> None:
    ways = EnumType("Way", ("east", "west"))
    way = Attribute("facing", ways, annotations=(Annotation("glyph", (">", "<")),))
    cell = Class("Cell", features=(Attribute("x", Scalar.INT), Attribute("y", Scalar.INT)), glyph=Glyph("."))
    hero = Class("Hero", features=(way, Reference("at", "Cell")), glyph=Glyph("H", "#1971c2"))
    model = Model(Metamodel("cave", (cell, hero), (ways,)))
    model.create("Hero", object_name="hero", at=model.create("Cell"))
    draw = DrawGrid("Cell", "x", "y", (Token("hero", at("hero")),))
    assert text(model, draw) == "(>)"
    model.node(model.graph.find_object("hero") or 0).facing = "west"
    assert text(model, draw) == "(<)"
    assert scene_of(model, draw).marks == (Mark("hero, west", "<", "#1971c2", (0, 0), "Hero, west"),)


def test_int_attribute_with_a_glyph_is_drawn_as_its_digit() -> None:
    severity = Attribute("severity", Scalar.INT, annotations=(Annotation("glyph"),))
    cell = Class("Cell", features=(Attribute("x", Scalar.INT), Attribute("y", Scalar.INT)), glyph=Glyph("."))
    patient = Class("Patient", features=(severity, Reference("at", "Cell")), glyph=Glyph("p", "#1971c2"))
    model = Model(Metamodel("ward", (cell, patient)))
    one = model.create("Patient", object_name="ann", at=model.create("Cell"), severity=3)
    draw = DrawGrid("Cell", "x", "y", (Token("patient", at("patient"), "Patient"),))
    assert scene_of(model, draw).marks == (Mark("ann, severity 3", "3", "#1971c2", (0, 0), "Patient, severity 3"),)
    shown = {}
    for value in (0, 9, 10, -1):
        one.severity = value
        shown[value] = text(model, draw).splitlines()[0]
    assert shown == {0: "(0)", 9: "(9)", 10: "(+)", -1: "(-)"}


def test_tokens_without_a_place_are_drawn_in_a_reserved_row() -> None:
    model, draw = net(), NET_DRAW
    (aside,) = scene_of(model, draw).aside or ()
    assert (aside.name, aside.letter) == ("f3", "~") and "f3 nowhere" in scene_title(scene_of(model, draw))
    assert [key.kind for key in legend([scene_of(model, draw)])] == ["City", "Bus", "Ferry"]
    apart = pixels(model, draw)
    assert (apart[-32:, :32] != 255).any() and "<title>f3</title>" in markup(model, draw)
    ferry = model.node(model.graph.find_object("f3") or 0)
    ferry.at = model.nodes("City")[0]
    there = pixels(model, draw)
    assert there.shape == apart.shape and (there[-32:] == 255).all() and scene_of(model, draw).aside == ()
    ferry.delete(semantics="spo")
    assert scene_of(model, draw).aside == ()
    assert scene_of(forest.model(ROWS), DRAW).aside is None


def test_edges_show_their_label_and_attributes_that_differ_from_the_default() -> None:
    up = Attribute("up", Scalar.BOOL, True, annotations=(Annotation("glyph", ("x", "#c92a2a")),))
    ends = (Reference("start", "City"), Reference("end", "City"))
    link = Class("Link", features=(*ends, Attribute("km", Scalar.FLOAT), up))
    model = Model(Metamodel("roads", (Class("City"), link)))
    one, two = model.create("City", object_name="one"), model.create("City", object_name="two")
    model.create("Link", object_name="way", start=one, end=two, km=6.5)
    draw = DrawGraph("City", links=(DrawnLink("Link", "km"),))
    assert text(model, draw) == " one  -> two (6.5)\n two"
    assert "dasharray" not in markup(model, draw)
    model.node(model.graph.find_object("way") or 0).up = False
    assert text(model, draw) == " one  -> two (6.5, Link, not up)\n two"
    svg = markup(model, draw)
    assert "dasharray" in svg
    assert "one to two, 6.5, Link, not up" in svg
    assert colour_pixels(model, draw, "#c92a2a") > 10
    assert [key.kind for key in legend([scene_of(model, draw)])] == ["City", "Link, not up"]


def colour_pixels(model: Model, draw: DrawGraph, wanted: str) -> int:
    picture = pixels(model, draw).reshape(-1, 3)
    return int((picture == [int(wanted[at : at + 2], 16) for at in (1, 3, 5)]).all(axis=1).sum())


def test_labels_of_neighbouring_nodes_do_not_overlap() -> None:
    city = Class("City", features=(Attribute("name", Scalar.STRING),))
    model = Model(Metamodel("roads", (city,)))
    for number in range(7):
        model.create("City", name=f"Llanfairpwllgwyngyll {number} and on")
    scene = scene_of(model, DrawGraph("City", "name"))
    assert isinstance(scene, GraphScene)
    layout = layout_graph(scene, 0.2)
    boxes = [(x, y, len(name) * 0.2) for (x, y), name in zip(layout.labels, layout.names, strict=True)]
    for (x, y, width), (u, v, other) in combinations(boxes, 2):
        assert abs(x - u) > (width + other) / 2 or abs(y - v) > 0.3
    assert all(width / 2 <= x <= layout.width - width / 2 for x, _, width in boxes)


# --- who can read it


def test_svg_title_describes_the_picture_and_the_places_of_tokens() -> None:
    root = ElementTree.fromstring(markup(forest.model(ROWS), DRAW))
    title = "a grid of 3 by 2 cells; truck at column 0, row 0"
    assert (root.get("role"), root.get("aria-label"), root[0].text) == ("img", title, title)
    assert scene_title(scene_of(net(), NET_DRAW)).startswith("a graph of 3 nodes and 4 edges; bus at Rome; f1 ")


@pytest.mark.parametrize("strength", [0.3, 0.62, 1.0])
def test_text_can_be_read_on_every_colour(strength: float) -> None:
    greys = [(float(part),) * 3 for part in range(256)]
    mixed = [
        (float(r), float(g), float(b)) for r in range(0, 256, 51) for g in range(0, 256, 51) for b in (0, 128, 255)
    ]
    for background in (*greys, *mixed):
        ink = parse_colour(format_colour(ink_on(background, strength)))
        assert contrast(background, ink) >= 4.5


def test_lines_and_marks_can_be_seen_on_paper() -> None:
    for line in (LINE_COLOUR, MARK, format_colour(INK)):
        assert contrast(PAPER, parse_colour(line)) >= 4.5


def test_picture_of_a_graph_with_one_node_is_as_large_as_with_two() -> None:
    sizes = []
    for count in (1, 2):
        labels, glyphs = ("r",) * count, (Glyph("", "#a5d8ff"),) * count
        layout = layout_graph(GraphScene(labels, glyphs, (), ()), 0.2)
        sizes.append((layout.width, layout.height))
    assert sizes[0] == sizes[1]
    (node,) = layout_graph(GraphScene(("r",), (Glyph("", "#a5d8ff"),), (), ()), 0.2).nodes
    assert node == (sizes[0][0] / 2, sizes[0][1] / 2)


@pytest.mark.parametrize("domain", ["sokoban", "keydoor", "network", "taxi"])
def test_parts_of_a_picture_have_the_ids_of_the_objects_that_they_stand_for(domain: str) -> None:
    workspace = open_workspace(domain)
    behaviour, model = workspace.behaviours[0], workspace.model(workspace.models[0].name)
    assert behaviour.draw is not None
    scene, objects = Painter(model, behaviour.draw, behaviour.parameters).draw_with_objects()
    assert scene == scene_of(model, behaviour.draw, behaviour.parameters)
    for id, mark in zip(objects.marks, scene.marks, strict=True):
        assert mark.kind.partition(",")[0].split()[0] == model.graph.class_of(id)
    kinds = (
        [scene.kinds[kind] for kind in scene.cells if kind != EMPTY] if isinstance(scene, GridScene) else scene.kinds
    )
    shown = [id for id in objects.cells if id is not None]
    assert [kind.partition(",")[0] for kind in kinds] == [model.graph.class_of(id) for id in shown]
    if isinstance(scene, GraphScene):
        labels = {id: label for id, label in zip(shown, scene.labels, strict=True)}
        for id, edge in zip(objects.edges, scene.edges, strict=True):
            ends = {one.name for one in (model.node(id).to, model.node(id)["from"])} if id is not None else set()
            assert not ends or {labels[shown[edge.source]], labels[shown[edge.target]]} == ends
    svg = scene_svg(scene, objects=objects)
    assert [int(one) for one in re.findall(r'data-object="(\d+)"', svg)].count(shown[0]) == 1
    assert re.sub(r' data-object="\d+"', "", svg) == scene_svg(scene)
