"""Models as pictures: which objects and links are drawn, and what they say."""

import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Glyph, Metamodel, Reference, Scalar
from tests.unit.graph.domain import PEOPLE, forest, people


def titles(model, **options):
    """What is drawn, in order."""
    return [node.title for node in model.picture(**options).nodes]


def links(model, **options):
    """The lines, as `source label target`."""
    return [f"{edge.source} {edge.label} {edge.target}" for edge in model.picture(**options).edges]


def ends(model, **options):
    """What the first line begins and ends with."""
    edge = model.picture(**options).edges[0]
    return edge.tail, edge.head


def test_an_object_shows_name_class_and_values():
    model, (ann,) = people("ann")
    model.create("Stone")
    ann.nick = 'the "b<i>g"'
    ann.mood = None
    first, second = model.picture().nodes
    assert (first.title, second.title) == ("ann : Person", "Stone#1")
    assert first.lines == ("height = 1.0", 'nick = "the \\"b<i>g\\""', "adult = false", "id = 0")
    assert second.lines == ()


def test_a_pair_of_opposites_is_drawn_once():
    model = forest(2)
    assert [link for link in links(model) if "left" in link] == ["n1 right / left n2", "n3 right / left n4"]
    assert ends(model, references=["right", "left"]) == ("arrow", "arrow")


def test_one_reference_of_an_opposite_pair_can_be_drawn():
    model = forest(2)
    assert links(model, references=["Tile.left"]) == ["n2 left n1", "n4 left n3"]
    assert ends(model, references=["left"]) == ("none", "arrow")


def test_containment_lines_have_diamonds_and_start_at_the_container():
    model, (ann,) = people("ann")
    rex = model.create("Dog", object_name="rex", owner=ann)
    group = model.create("Group", parts=[model.create("Group")])
    assert links(model) == [
        f"n{group.id} parts / whole n{group.parts[0].id}",
        f"n{ann.id} animals / owner n{rex.id}",
    ]
    assert ends(model) == ("diamond", "arrow")
    assert (ends(model, references=["owner"]), links(model, references=["owner"])) == (
        ("none", "diamond"), [f"n{rex.id} owner n{ann.id}"],
    )  # fmt: skip


def test_a_reference_that_is_its_own_opposite_is_drawn_once():
    model, (ann, ben, eve) = people("ann", "ben", "eve")
    ben.friends = [ann, ben]
    ann.spouse = eve
    assert links(model) == ["n0 spouse n2", "n0 friends n1", "n1 friends n1"]
    assert ends(model) == ("arrow", "arrow")


def test_several_links_between_two_objects_are_several_lines():
    model, (ann, ben) = people("ann", "ben")
    ann.likes, ben.likes, ann.friends = [ben], [ann], [ben]
    assert links(model) == ["n0 friends n1", "n0 likes n1", "n1 likes n0"]


def test_classes_references_and_attributes_can_be_chosen():
    model = forest(2)
    assert titles(model, classes=["Agent", "Forest"]) == ["forest : Forest", "truck : FireTruck"]
    assert links(model, classes=["Agent", "Forest"]) == ["n0 agent n5"]
    assert links(model, references=()) == []
    assert links(model, references=["agent", "Agent.currentState"]) == ["n0 agent n5", "n5 currentState n1"]
    assert links(model, references=["RoadTile.down"]) == ["n1 down n3", "n2 down n4"]
    assert links(model, references=["agent"], labels=False) == ["n0  n5"]
    assert model.picture(attributes=["y"]).nodes[3].lines == ("y = 1",)
    assert model.picture(attributes=()).nodes[3].lines == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"classes": ["Tyle"]}, "no class `Tyle`; did you mean `Tile`"),
        ({"references": ["rihgt"]}, "no reference `rihgt`; did you mean `right`"),
        ({"references": ["Tile.agent"]}, "no reference `Tile.agent`"),
        ({"references": ["Tyle.right"]}, "no reference `Tyle.right`; did you mean `Tile.right`"),
        ({"references": ["x"]}, "no reference `x`"),
        ({"attributes": ["z"]}, "no attribute `z`"),
        ({"attributes": "x"}, "`attributes` takes several names: write \\['x'\\]"),
        ({"layout": "neatto"}, "no layout 'neatto': did you mean `neato`"),
        ({"layout": "grid"}, "the layouts are dot, neato"),
        ({"limit": -1}, "`limit` is -1, but must be 0 or more"),
        ({"distance": -1}, "`distance` is -1, but must be 0 or more"),
        ({"position": ("x", "collected")}, "no numeric attribute `collected`"),
        ({"highlight": ["t00"]}, "`highlight` and `around` take nodes and matches, not 't00'"),
        ({"around": 3}, "`highlight` and `around` take nodes and matches, not 3"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(InvalidArgument, match=message):
        forest(2).to_dot(**options)


def test_nodes_of_another_model_and_deleted_ones_are_refused():
    model, other = forest(2), forest(2)
    with pytest.raises(InvalidArgument, match="an object of another model"):
        model.to_dot(highlight=other["t00"])
    truck = model["truck"]
    truck.delete(semantics="spo")
    with pytest.raises(InvalidArgument):
        model.to_dot(highlight=truck)


def test_highlighted_objects_are_marked_with_the_names_they_have():
    model = forest(2)
    first, second = model["t00"], model["t11"]
    assert [node.highlight_names for node in model.picture(highlight=first).nodes] == [
        None,
        (),
        None,
        None,
        None,
        None,
    ]
    marked = model.picture(highlight=[{"here": first, "n": 3, "to": second}, {"end": second, "to": second}, second])
    assert {node.title: node.highlight_names for node in marked.nodes if node.highlight_names} == {
        "t00 : RoadTile": ("here",),
        "t11 : RoadTile": ("to", "end"),
    }
    assert 'penwidth="3"' in marked.to_dot() and "<i>here</i><br/><b>t00 : RoadTile</b>" in marked.to_dot()


def test_around_draws_objects_within_the_distance():
    model = forest(3)
    assert titles(model, around=model["t00"], references=["right", "down"]) == [
        "t00 : RoadTile", "t10 : RoadTile", "t01 : RoadTile",
    ]  # fmt: skip
    assert titles(model, around=model["t00"], distance=0) == ["t00 : RoadTile"]
    assert len(titles(model, around={"a": model["t00"]}, distance=2, references=["Tile.left", "up"])) == 6
    assert titles(model, around=model["t00"], classes=["Agent", "Tile"], references=["currentState"]) == [
        "t00 : RoadTile", "truck : FireTruck",
    ]  # fmt: skip
    assert model.picture(around=model["t00"], limit=2).note == "2 of 5 objects are drawn"


def test_a_large_model_is_drawn_in_part_with_a_note():
    model = Model(PEOPLE)
    for _ in range(1_200):
        model.create("Stone")
    assert len(titles(model)) == 100
    assert model.picture().note == "100 of 1,200 objects are drawn"
    assert 'label="100 of 1,200 objects are drawn"' in model.to_dot()
    assert model.picture(limit=1_200).note == ""
    assert (titles(model, limit=0), Model(PEOPLE).picture().note) == ([], "no objects")


def test_the_limit_prefers_highlighted_objects_and_their_neighbours():
    model = forest(10)
    ways = ["right", "left", "down", "up"]
    assert titles(model, highlight=model["t55"], limit=5, references=ways) == [
        f"{name} : RoadTile" for name in ("t54", "t45", "t55", "t65", "t56")
    ]
    assert titles(model, highlight=model["t55"], limit=1) == ["t55 : RoadTile"]


def test_unconnected_objects_are_all_drawn():
    model = Model(PEOPLE)
    for _ in range(10):
        model.create("Stone")
    assert len(titles(model)) == 10
    assert titles(model, limit=3) == ["Stone#0", "Stone#1", "Stone#2"]


def test_positions_come_from_attributes():
    model = forest(2)
    made = model.picture(position=("x", "y"))
    assert [node.place for node in made.nodes] == [None, (0, 0), (1, 0), (0, 1), (1, 1), None]
    assert made.layout == "neato"
    assert model.picture(position=("x", "y"), layout="fdp").layout == "fdp"


def test_the_layout_is_in_layers_unless_an_object_has_many_links():
    assert forest(3).picture().layout == "dot"
    assert forest(4).picture().layout == "neato"
    assert forest(4).picture(references=["right"]).layout == forest(4).picture(layout="dot").layout == "dot"


def test_containers_of_many_objects_are_placed_apart():
    model = forest(6)
    assert model.to_dot().count('len="3.0"') == 37
    assert "len=" not in model.to_dot(layout="dot") + model.to_dot(references=["states"])


def test_a_glyph_gives_the_colour():
    metamodel = Metamodel("m", [Class("A", glyph=Glyph("a", "#343a40")), Class("B")])
    model = Model(metamodel)
    for cls in ("A", "B"):
        model.create(cls)
    assert [node.fill for node in model.picture().nodes] == ["#343a40", "#fff3bf"]
    assert 'fillcolor="#343a40", fontcolor="#ffffff"' in model.to_dot()


def test_names_in_pictures_may_have_any_characters():
    model = Model(Metamodel("m", [Class("A", features=(Attribute("s", Scalar.STRING),))]), 'say "hi"\n')
    model.create("A", object_name="<a>&\n\0" + "x" * 100, s="\ud800")
    (node,) = model.picture().nodes
    assert node.title == "<a>&\\n\\x00" + "x" * 29 + "… : A"
    assert node.lines == ('s = "\\ud800"',)
    assert model.to_dot().startswith('digraph "say \\"hi\\"\\\\n" {')


def test_the_same_state_gives_the_same_text():
    model = forest(3)
    before = model.to_dot()
    with pytest.raises(ZeroDivisionError), model.transaction():
        model["t11"].delete(semantics="spo")
        model["t00"].x = 7
        assert model.to_dot() != before
        raise ZeroDivisionError
    assert model.to_dot() == before == model.copy().to_dot()


def test_a_model_can_be_shown_in_a_notebook(monkeypatch):
    monkeypatch.setenv("PATH", "")
    model = forest(3)
    assert model._repr_svg_() == model.to_svg()
    assert model.to_svg().count("<rect") == 1 + 11  # the paper, and a box for each object


def test_links_to_objects_that_are_not_drawn_are_omitted():
    metamodel = Metamodel("m", [Class("A", features=(Reference("to", "A", 0, None),))])
    model = Model(metamodel)
    first = model.create("A")
    first.to = [model.create("A") for _ in range(3)]
    assert links(model, limit=2) == ["n0 to n1"]
