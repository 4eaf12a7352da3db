"""Class diagrams, and pictures as DOT and SVG; Graphviz is a stand-in here, so that it need not be installed."""

import shutil
import sys
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings, strategies as st

from envgraph.draw import Picture, PictureEdge, PictureNode, format_value
from envgraph.errors import InvalidArgument, escape_unprintable
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar

SVG = "{http://www.w3.org/2000/svg}"
COLOUR = EnumType("Colour", ("red", "green"))
HOUSE = Metamodel(
    "house",
    [
        Class(
            "Thing",
            abstract=True,
            features=(Attribute("label", Scalar.STRING, "a\n<b>"), Attribute("colour", COLOUR, "green")),
        ),
        Class(
            "Room",
            supertypes=("Thing",),
            features=(
                Reference("house", "House", 1, 1, opposite="rooms"),
                Reference("next", "Room", 0, None, opposite="next"),
                Reference("door", "Door", 0, 1, opposite="room"),
            ),
        ),
        Class("House", features=(Reference("rooms", "Room", 0, None, True, "house"),)),
        Class(
            "Door",
            features=(Reference("room", "Room", 1, 1, opposite="door"), Attribute("wide", Scalar.BOOL)),
        ),
    ],
    [COLOUR],
)


def picture(count=2, **options):
    """Boxes in a row."""
    nodes = tuple(PictureNode(f"n{number}", f"box {number}", ("x = 1",)) for number in range(count))
    edges = tuple(PictureEdge(f"n{number}", f"n{number + 1}", "next") for number in range(count - 1))
    return Picture("row", nodes, edges, **options)


def lines(text, start):
    """The statements that begin like this."""
    return [line.strip() for line in text.splitlines() if line.strip().startswith(start)]


def boxes(svg):
    """Left, top, right and bottom of each box of our own SVG; the first rectangle is the paper."""
    found = []
    for rect in list(ElementTree.fromstring(svg).iter(f"{SVG}rect"))[1:]:
        x, y, width, height = (float(rect.get(key)) for key in ("x", "y", "width", "height"))
        found.append((x, y, x + width, y + height))
    return found


def overlapping(found):
    """Pairs of boxes with a point in common."""
    return [
        (one, other)
        for number, one in enumerate(found)
        for other in found[number + 1 :]
        if one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
    ]


@pytest.fixture
def fake_dot(tmp_path, monkeypatch):
    """Puts a program called `dot` on the PATH, the only one there."""
    monkeypatch.setenv("PATH", str(tmp_path))

    def make(code, mode=0o755):
        program = tmp_path / "dot"
        program.write_text(f"#!{sys.executable} -IS\nimport sys\ntext = sys.stdin.read()\n{code}\n")
        program.chmod(mode)
        return tmp_path

    return make


# --- class diagrams


def test_a_reference_and_its_opposite_are_drawn_as_one_edge():
    edges = lines(HOUSE.to_dot(), '"House"') + lines(HOUSE.to_dot(), '"Room" ->')
    assert '"House" -> "Room" [label="rooms [0..*] / house [1]", ' in edges[1]
    assert 'arrowtail="diamond", arrowhead="vee"' in edges[1]
    assert [edge.split(", dir")[0] for edge in edges[2:]] == [
        '"Room" -> "Room" [label="next [0..*]"',
        '"Room" -> "Door" [label="door [0..1] / room [1]"',
    ]


def test_generalizations_are_drawn_as_edges_with_a_triangle():
    (edge,) = lines(HOUSE.to_dot(), '"Thing" ->')
    assert edge == '"Thing" -> "Room" [dir="both", arrowtail="onormal", arrowhead="none", color="#212529"];'


def test_classes_and_enums_show_their_content():
    (thing,) = lines(HOUSE.to_dot(), '"Thing" [')
    assert "«abstract»" in thing and "<i><b>Thing</b></i>" in thing
    assert "label : string = &quot;a\\\\n&lt;b&gt;&quot;" in thing and "colour : Colour = green" in thing
    (enum,) = lines(HOUSE.to_dot(), '"enum Colour"')
    assert 'red<br align="left"/>green' in enum


def test_a_metamodel_can_be_shown_in_a_notebook(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert overlapping(boxes(HOUSE._repr_svg_())) == []
    assert len(boxes(HOUSE.picture().to_svg(graphviz=False))) == 5


# --- text


def test_special_characters_are_escaped_in_dot():
    text = 'a"b\\N&amp;<i>{|}'
    made = Picture(text, (PictureNode("n", text, (text,)),), (PictureEdge("n", "n", text),), note=text)
    dot = made.to_dot()
    string = '"a\\"b\\\\N&amp;amp;<i>{|}"'
    markup = "a&quot;b\\\\N&amp;amp;&lt;i&gt;{|}"
    assert dot.startswith(f"digraph {string} {{\n")
    assert f"label={string}, labelloc" in dot
    assert f"[label={string}, dir" in dot
    assert f"<b>{markup}</b>" in dot
    assert f'{markup}<br align="left"/>' in dot


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a\nb", "a\\nb"), ("\x00", "\\x00"), ("\ud800", "\\ud800"), ("\u202e", "\\u202e"), ("ä 木", "ä 木")],
)
def test_unprintable_characters_are_shown_as_escapes(text, shown):
    assert escape_unprintable(text) == shown
    assert format_value(text) == f'"{shown}"'


def test_long_values_are_cut():
    assert format_value("x" * 1_000_000) == f'"{"x" * 39}…"'
    assert len(format_value(10**100)) == 40


@given(st.text(st.characters(exclude_categories=()), max_size=8))
def test_any_text_makes_a_well_formed_svg(text):
    shown = escape_unprintable(text)
    made = Picture(shown, (PictureNode("n", shown, (format_value(text),)),), (PictureEdge("n", "n", shown),))
    root = ElementTree.fromstring(made.to_svg(graphviz=False))
    seen = [element for element in root.iter(f"{SVG}text") if element.get("aria-hidden") is None]
    texts = ["".join(element.itertext()) for element in seen]
    assert texts == ([shown] if shown else []) + [shown, format_value(text)]
    assert made.to_dot().encode()


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
@settings(max_examples=20)
@given(st.text(st.sampled_from("\\NGL&;#x3c<>\"'{|}/é木 \n\t\r\0\ud800ab"), max_size=12))
def test_graphviz_shows_the_text_as_it_is(text):
    shown = f"-{escape_unprintable(text)}-"
    made = Picture(shown, (PictureNode("n", shown, (shown,)),), (PictureEdge("n", "n", shown),), note=shown)
    root = ElementTree.fromstring(made.to_svg(graphviz=True))
    texts = ["".join(element.itertext()).replace("\xa0", " ") for element in root.iter(f"{SVG}text")]
    assert texts == [shown] * 4


# --- Graphviz and its absence


def test_graphviz_draws_where_it_is_installed(fake_dot):
    where = fake_dot(
        "print('<?xml version=\"1.0\"?>\\n<!DOCTYPE svg>')\n"
        "print('<svg>' + ' '.join(sys.argv[1:]) + text[:13] + '</svg>')"
    )
    assert shutil.which("dot") == str(where / "dot")
    assert picture().to_svg() == '<svg>-Tsvgdigraph "row"</svg>'
    assert picture()._repr_svg_() == picture().to_svg(graphviz=True)


@pytest.mark.parametrize(
    "code",
    [
        "sys.exit(1)",
        "print('<svg></svg>'); sys.exit(3)",
        "print('no picture')",
        "print('<svg> cut off')",
        "sys.stdout.buffer.write(b'\\xff\\xfe')",
        "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
    ],
)
def test_the_own_layout_is_used_if_graphviz_returns_no_picture(fake_dot, code):
    fake_dot(code)
    assert picture().to_svg() == picture().to_svg(graphviz=False)
    with pytest.raises(InvalidArgument, match="Graphviz did not draw"):
        picture().to_svg(graphviz=True)


def test_the_own_layout_is_used_if_graphviz_times_out(fake_dot):
    fake_dot("import time; time.sleep(600)")
    assert picture().to_svg(timeout=0.3) == picture().to_svg(graphviz=False)


def test_the_own_layout_is_used_if_graphviz_cannot_be_run(fake_dot):
    (fake_dot("") / "dot").write_text("#!/no/such/program\n")
    assert picture().to_svg() == picture().to_svg(graphviz=False)


def test_the_own_layout_is_used_without_graphviz(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert picture()._repr_svg_() == picture().to_svg(graphviz=False)


# --- our own drawing


@pytest.mark.parametrize("networkx", [True, False], ids=["networkx", "no networkx"])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 30])
def test_boxes_do_not_overlap(count, networkx, monkeypatch):
    if not networkx:
        monkeypatch.setitem(sys.modules, "networkx", None)
    found = boxes(picture(count).to_svg(graphviz=False))
    assert len(found) == count and overlapping(found) == []


def test_many_boxes_around_one_box_do_not_overlap():
    nodes = tuple(PictureNode(f"n{number}", f"a longer title {number}", ("x = 1",) * 3) for number in range(60))
    edges = tuple(PictureEdge("n0", f"n{number}", "contains", "diamond") for number in range(1, 60))
    assert overlapping(boxes(Picture("star", nodes, edges).to_svg(graphviz=False))) == []


def test_boxes_of_unconnected_parts_do_not_overlap():
    nodes = tuple(PictureNode(f"n{number}", "box") for number in range(100))
    edges = tuple(PictureEdge(f"n{number}", f"n{number + 1}") for number in range(0, 90, 2))
    assert overlapping(boxes(Picture("parts", nodes, edges).to_svg(graphviz=False))) == []


def test_drawing_a_picture_is_deterministic():
    assert picture(20).to_svg(graphviz=False) == picture(20).to_svg(graphviz=False)


def test_boxes_with_a_place_are_drawn_in_their_rows_and_columns():
    nodes = tuple(PictureNode(f"{x}{y}", f"{x} {y}", place=(x, y)) for y in range(2) for x in range(3))
    made = Picture("grid", (*nodes, PictureNode("robot", "robot")), (PictureEdge("robot", "11"),), layout="neato")
    found = boxes(made.to_svg(graphviz=False))
    assert overlapping(found) == []
    (top, *_), (below, *_) = found[0:3], found[3:6]
    assert top[0] == below[0] and top[3] < below[1]
    assert [box[1] for box in found[0:3]] == [found[0][1]] * 3 and found[0][2] < found[1][0] < found[2][0]
    pinned = [line for line in made.to_dot().splitlines() if '!", label' in line]
    assert len(pinned) == 7
    assert 'overlap="true"' in made.to_dot()


def test_several_edges_between_two_boxes_have_different_paths():
    nodes = picture().nodes
    edges = (
        PictureEdge("n0", "n1", "a"),
        PictureEdge("n1", "n0", "b"),
        PictureEdge("n0", "n0", "c"),
        PictureEdge("n0", "n0", "d"),
    )
    root = ElementTree.fromstring(Picture("ways", nodes, edges).to_svg(graphviz=False))
    assert len({path.get("d") for path in root.iter(f"{SVG}path")}) == 4
    places = {(text.get("x"), text.get("y")) for text in root.iter(f"{SVG}text")}
    assert len(places) == 4 + 2 * 2


def test_the_note_is_drawn_below_the_boxes():
    root = ElementTree.fromstring(picture(note="2 of 9 objects are drawn").to_svg(graphviz=False))
    *_, note = root.iter(f"{SVG}text")
    assert note.text == "2 of 9 objects are drawn"
    assert float(note.get("y")) > max(bottom for *_, bottom in boxes(picture().to_svg(graphviz=False)))
