"""`.model` files: what they mean. What is said about mistakes: tests/golden/model."""

from typing import Any

import pytest

from envgraph.graph import Model
from envgraph.lang import ModelText, TextFiles, bundled_domain, conformance_warnings, load_workspace
from envgraph.metamodel import Metamodel
from tests.reading import read_metamodel_text, read_model_text

METAMODEL = """
metamodel m
enum Colour { red, green }
class Box {
    int i  float f  bool b  string s  Colour c
    contains Box[0..*] parts
    refers Box[0..1] next opposite previous
    refers Box[0..1] previous opposite next
    refers Box[0..*] links
    contains Cell[0..*] cells
}
abstract class Cell {
    int x  int y
    refers Cell[0..1] right opposite left
    refers Cell[0..1] left opposite right
    refers Cell[0..1] down
    contains Box[0..1] item
}
@glyph("#") class Wall extends Cell
@glyph(".") class Floor extends Cell
"""


@pytest.fixture(scope="module")
def metamodel() -> Metamodel:
    found = read_metamodel_text(METAMODEL).metamodel
    assert found is not None
    return found


def file(text: str, metamodel: Metamodel | None) -> Any:
    return read_model_text(text, metamodel)


def text_of(body: str, metamodel: Metamodel) -> ModelText:
    result = file(f"model a : m {{ {body} }}", metamodel)
    assert not result.diagnostics, result.diagnostics[0]
    return result.models[0]


def model(body: str, metamodel: Metamodel) -> Model:
    found = text_of(body, metamodel).model
    assert found is not None
    found.check_integrity()
    return found


def rows(found: Model) -> list[list[str | None]]:
    """The classes of the cells of a grid, row by row."""
    cells = {(node.x, node.y): node for node in found.nodes("Cell")}
    height = max(y for _, y in cells) + 1
    width = max(x for x, _ in cells) + 1
    return [[cells[x, y].cls if (x, y) in cells else None for x in range(width)] for y in range(height)]


def test_attributes_take_literals(metamodel: Metamodel) -> None:
    found = model(
        'a : Box { i = -3 f = 2 b = true s = "x" c = ::green } b : Box { c = Colour::green f = -1.5; }',
        metamodel,
    )
    box = found["a"]
    assert (box.i, box.f, box.b, box.s, box.c) == (-3, 2.0, True, "x", "green")
    assert type(box.f) is float
    assert (found["b"].f, found["b"].c) == (-1.5, "green")


def test_attributes_not_named_keep_their_defaults_and_none_clears(metamodel: Metamodel) -> None:
    found = model("a : Box { i = none }", metamodel)
    assert (found["a"].i, found["a"].f, found["a"].c) == (None, 0.0, "red")


def test_objects_are_created_in_the_order_of_the_text(metamodel: Metamodel) -> None:
    found = model("a : Box { parts = [b : Box { parts = c : Box }, Box { i = 1 }] } d : Box", metamodel)
    assert [node.object_name for node in found.nodes()] == ["a", "b", "c", None, "d"]
    assert [node.i for node in found["a"].parts] == [0, 1]


def test_names_can_be_used_before_their_objects(metamodel: Metamodel) -> None:
    found = model("a : Box { next = b links = [c, b] } b : Box { parts = c : Box }", metamodel)
    assert found["a"].next == found["b"]
    assert found["b"].previous == found["a"]
    assert list(found["a"].links) == [found["c"], found["b"]]


def test_both_ends_of_an_opposite_pair_may_be_given(metamodel: Metamodel) -> None:
    found = model("a : Box { next = b } b : Box { previous = a }", metamodel)
    assert found["a"].next == found["b"]


def test_grids_create_row_by_row_and_link_neighbours(metamodel: Metamodel) -> None:
    found = model(
        'a : Box { cells = grid cell { column x next right row y next down rows """\n  #.#\n  ...\n""" } links = [] }',
        metamodel,
    )
    assert rows(found) == [["Wall", "Floor", "Wall"], ["Floor", "Floor", "Floor"]]
    assert [(node.x, node.y) for node in found["a"].cells] == [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    first = found["a"].cells[0]
    assert (first.right.x, first.right.y, first.down.x, first.down.y) == (1, 0, 0, 1)
    assert first.right.left == first
    assert found["a"].cells[2].right is None


def test_legends_map_letters_to_objects_with_features_or_to_none(metamodel: Metamodel) -> None:
    legend = 'k = Floor { item = Box { i = 7 } }, "#" = Wall, " " = none, "-" = none'
    letters = '"""\n    #k \n     k#\n    - k\n  """'
    found = model(
        f"a : Box {{ cells = grid g {{ legend {legend} column x next right row y next down rows {letters} }} }}",
        metamodel,
    )
    assert rows(found) == [["Wall", "Floor", None], [None, "Floor", "Wall"], [None, None, "Floor"]]
    assert [node.item.i for node in found.nodes("Floor")] == [7, 7, 7]
    assert len({node.item.id for node in found.nodes("Floor")}) == 3
    wall = found.nodes("Wall")[0]
    assert wall.down is None


def test_cells_are_named_by_column_and_row(metamodel: Metamodel) -> None:
    found = model('a : Box { cells = grid g { column x row y rows "#.#" } }  b : Floor { right = g[2, 0] }', metamodel)
    assert (found["b"].right.x, found["b"].right.y) == (2, 0)


def test_tables_create_an_object_for_each_line(metamodel: Metamodel) -> None:
    found = model(
        'a : Box { parts = table Box (i, s, next) { b : 1, "x", c; 2, "y", none; c : 3, "z", Box { i = 4 }; } }',
        metamodel,
    )
    assert [(node.i, node.s) for node in found["a"].parts] == [(1, "x"), (2, "y"), (3, "z")]
    assert found["b"].next == found["c"]
    assert found["c"].next.i == 4


def test_values_of_several_references_can_be_mixed_in_lists(metamodel: Metamodel) -> None:
    found = model("a : Box { parts = [table Box (i) { 1; 2; }, Box { i = 3 }, [b]] } b : Box { i = 4 }", metamodel)
    assert [node.i for node in found["a"].parts] == [1, 2, 3, 4]


def test_every_object_has_a_span(metamodel: Metamodel) -> None:
    text = text_of(
        'a : Box { cells = grid g { column x row y rows "#." } parts = [Box { }, table Box (i) { 5; t : 6; }] }',
        metamodel,
    )
    assert text.model is not None
    assert [text.spans[node.id].text for node in text.model.nodes()] == ["a", "Box", "5", "t", "#", "."]


def test_indentation_and_line_ends_of_rows_do_not_count(metamodel: Metamodel) -> None:
    plain = 'a : Box { cells = grid g { column x row y rows """\n#.\n..\n""" } }'
    indented = 'a : Box { cells = grid g { column x row y rows """\r\n\t  #.  \r\n\t  ..\r\n\r\n  """ } }'
    assert rows(model(plain, metamodel)) == rows(model(indented, metamodel))


def test_a_loaded_model_can_be_committed_changed_and_checked_out(metamodel: Metamodel) -> None:
    found = model("a : Box { next = b } b : Box", metamodel)
    version = found.commit()
    found["a"].next = None
    found.checkout(version, discard=True)
    assert found["a"].next == found["b"]


def test_without_a_metamodel_only_the_syntax_is_checked() -> None:
    result = file("model a : m { x : Nope { y = z } }", None)
    assert [text.model for text in result.models] == [None]
    assert not result.diagnostics
    assert len(file("model a : m { x : }", None).diagnostics) == 1


def test_missing_imports_are_reported_at_their_position() -> None:
    files = TextFiles({"a.model": 'import "m.metamodel"\nimport "n.metamodel";'})
    found = load_workspace(["a.model"], files=files).diagnostics
    places = [
        (one.span.text, one.span.line, one.span.column) for one in found if one.span and one.code == "missing-file"
    ]
    assert places == [('"m.metamodel"', 1, 8), ('"n.metamodel"', 2, 8)]


def test_a_file_may_hold_several_models(metamodel: Metamodel) -> None:
    result = file("model a : m { } model b : m { x : Box }", metamodel)
    assert [(text.name, text.model and len(text.model)) for text in result.models] == [("a", 0), ("b", 1)]


def test_conformance_is_reported_at_the_objects(metamodel: Metamodel) -> None:
    problems = conformance_warnings(text_of("a : Box { i = none }", metamodel))
    assert [(one.code, str(one.severity), one.span and one.span.text) for one in problems] == [
        ("conformance", "warning", "a")
    ]


def test_the_bundled_models_have_the_tiles_of_the_paper() -> None:
    directory = bundled_domain("burning_forest")
    metamodel = read_metamodel_text((directory / "burning_forest.metamodel").read_text()).metamodel
    text = (directory / "target_8x8.model").read_text()
    found = file(text, metamodel).models[0].model
    assert found is not None
    letters = {one.name: one.glyph.letter for one in found.metamodel.class_list if one.glyph}
    tiles = {(node.x, node.y): letters[node.cls] for node in found.nodes("Tile")}
    drawn = ["".join(tiles[x, y] for x in range(8)) for y in range(8)]
    assert drawn == [line.strip() for line in text.split('"""')[1].split()]
    truck = found["truck"]
    assert (truck.currentState.x, truck.currentState.y, truck.currentState.cls) == (0, 0, "StartTile")
