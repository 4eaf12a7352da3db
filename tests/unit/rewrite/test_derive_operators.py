"""What `derive name = operators for Class;` gives, by example."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from envgraph.graph import Model, check_conformance
from envgraph.lang import TextFiles, load_workspace
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation
from envgraph.rewrite import Engine, derived_rules
from tests.reading import read_metamodel_text
from tests.unit.rewrite.domains import domain
from tests.unit.test_docs import GARDEN

PAGE = Path(__file__).parents[3] / "docs" / "languages" / "derived.md"


def metamodel(text: str) -> Metamodel:
    found = read_metamodel_text(f"metamodel m\n{text}")
    assert found.metamodel is not None, [str(diagnostic) for diagnostic in found.diagnostics]
    return found.metamodel


def names(text: str, *classes: str) -> list[str]:
    return [rule.name for rule in derived_rules(Derivation("d", "operators", classes), metamodel(text))]


def engine(text: str, *classes: str) -> Engine:
    """An engine on an empty model with the operators of some classes as group `d`."""
    made = Engine(Model(metamodel(text)))
    made.add(Derivation("d", "operators", classes))
    return made


# --- which there are


def test_operators_for_too_many_classes_are_refused_before_they_are_searched_for() -> None:
    classes = "".join(f"class A{n} extends A0 {{ refers A{n * 7 % 50}[1..2] r{n} }}\n" for n in range(1, 50))
    texts = {
        "h.metamodel": f"metamodel h abstract class A0 {{ refers A0[1..3] r contains A0[0..4] c }} {classes}",
        "h.rules": 'package h\nimport "h.metamodel"\nderive d = operators for A0;',
    }
    (found,) = load_workspace(["h.rules"], files=TextFiles(texts)).diagnostics
    assert (found.code, found.message) == ("too-many-rules", "`d` would derive more than 10,000 rules")
    assert str(found.span) == "h.rules:3:8"
    assert found.hint is not None and "@weight(retype = 0)" in found.hint


def test_the_page_lists_the_operators_of_its_example() -> None:
    garden = load_workspace(["garden.rules"], files=TextFiles(GARDEN)).engine()
    shown = re.findall(r"`(hoses\.[\w.]+)`", PAGE.read_text(encoding="utf-8"))
    assert [f"garden.{name}" for name in shown] == sorted(garden.group("hoses"), key=lambda n: shown.index(n[7:]))


def test_operators_of_a_network() -> None:
    made = domain("network", "backbone")
    counts = {name.removeprefix("network.wiring."): made.count(name) for name in made.group("wiring")}
    assert counts == {
        "create.Link.links": 25,
        "delete.Link": 9,
        "change.Link.from.target": 36,
        "change.Link.to.target": 36,
        "swap.Link.from": 62,
        "swap.Link.to": 64,
        "swap.Link.links": 0,
        "move.Link.links": 0,
        "set.Link.up": 9,
    }


def test_references_with_exact_bounds_have_only_swap_operators() -> None:
    text = "class A { refers B[2] e opposite f } class B { refers A[2] f opposite e }"
    assert names(text, "A") == [
        "d.create.A.with.B.B.A",
        "d.delete.A",
        "d.delete.A.with.B.B.A",
        "d.swap.A.e",
    ]


def test_opposites_in_one_class_have_operators_once() -> None:
    text = "class T { refers T[0..1] left opposite right refers T[0..1] right opposite left }"
    assert [name for name in names(text, "T") if "create" not in name and "delete" not in name] == [
        "d.add.T.left",
        "d.remove.T.left",
        "d.change.T.left.source",
        "d.change.T.left.target",
        "d.swap.T.left",
    ]


def test_kinds_share_their_weight_and_may_be_left_out() -> None:
    text = "class A { bool b bool c refers A[0..*] e }"
    rules = Engine(Model(metamodel(text)))
    rules.add(Derivation("d", "operators", ("A",), weight=2.0))
    assert rules.prepare("d.set.A.b").weight == 1.0
    assert rules.prepare("d.add.A.e").weight == 2.0


def test_the_same_text_gives_the_same_rules() -> None:
    text = "class A { contains B[1..3] parts refers B[1] first } class B extends A"
    one, two = (derived_rules(Derivation("d", "operators", ("A", "B")), metamodel(text)) for _ in range(2))
    assert one == two


def test_helper_patterns_of_operators_are_hidden() -> None:
    text = """
    class Maze { contains Cell[1..*] cells contains Hero[1] hero }
    abstract class Cell { contains Key[0..1] item }
    class Wall extends Cell class Floor extends Cell class Key class Hero { refers Cell[1] at }
    """
    made = Engine(Model(metamodel(text)))
    for cls in made.model.metamodel.classes:
        assert made.check(Derivation("d", "operators", (cls,))) == []
    made.add(Derivation("d", "operators", ("Maze",)))
    assert made.patterns == ()


# --- what they do


def test_mutually_required_objects_are_created_and_deleted_together() -> None:
    made = engine("class A { refers B[1] b opposite a } class B { refers A[1] a opposite b }", "A")
    made.apply("d.create.A.with.B")
    assert [(node.cls, len(made.model)) for node in made.model.nodes("A")] == [("A", 2)]
    assert not made.exists("d.delete.A")
    made.apply("d.delete.A.with.B")
    assert len(made.model) == 0


def test_created_objects_take_spare_targets_and_deletion_returns_them() -> None:
    text = "class A { refers B[1..*] b opposite a } class B { refers A[1] a opposite b }"
    made = engine(text, "A", "B")
    made.apply("d.create.A.with.B")
    assert not made.exists("d.create.A.stealing.b")
    made.apply("d.create.B")
    made.apply("d.create.A.stealing.b")
    assert [len(node.b) for node in made.model.nodes("A")] == [1, 1]
    made.apply("d.delete.A.spreading.b")
    assert [len(node.b) for node in made.model.nodes("A")] == [2]


def test_rehoming_sends_everything_to_one_other_object() -> None:
    made = engine("class Hub class Spoke { refers Hub[1] hub }", "Hub", "Spoke")
    one, two = made.model.create("Hub"), made.model.create("Hub")
    spokes = [made.model.create("Spoke", hub=one) for _ in range(3)]
    assert made.matches("d.delete.Hub") == made.matches("d.delete.Hub", hub=two)
    made.apply("d.delete.Hub.rehoming", hub=one)
    assert [spoke.hub for spoke in spokes] == [two] * 3
    assert not made.exists("d.delete.Hub.rehoming")


def test_an_object_that_contains_something_is_not_rehomed() -> None:
    text = "class Box { contains Ball[0..*] balls } class Ball class Tag { refers Box[1] box }"
    made = engine(text, "Box")
    one, two = made.model.create("Box"), made.model.create("Box")
    made.model.create("Tag", box=one)
    ball = made.model.create("Ball")
    one.balls.append(ball)
    assert not made.exists("d.delete.Box.rehoming", box=one)
    two.balls.append(ball)
    assert made.exists("d.delete.Box.rehoming", box=one)


def test_contents_are_deleted_unless_required_outside() -> None:
    text = """
    class Box { contains Ball[1..*] balls }
    class Ball { }
    class Dog { refers Ball[1] toy }
    """
    made = engine(text, "Box")
    ball = made.model.create("Ball")
    made.model.create("Box", balls=[ball])
    dog = made.model.create("Dog", toy=ball)
    assert not made.exists("d.delete.Box")
    other = made.model.create("Ball")
    made.model.create("Box", balls=[other])
    dog.toy = other
    made.apply("d.delete.Box")
    assert len(made.model) == 3 and dog.toy == other


def test_required_parts_are_not_all_deleted_together() -> None:
    text = "class Box { contains Ball[0..*] balls } class Ball class Dog { refers Ball[1..*] toys }"
    made = engine(text, "Box")
    balls = [made.model.create("Ball") for _ in range(2)]
    made.model.create("Box", balls=balls)
    made.model.create("Dog", toys=balls)
    assert not made.exists("d.delete.Box")


@pytest.mark.parametrize("name", ["Part", "Far", "Lost", "All", "Needy"])
def test_a_class_may_be_called_like_a_variable_of_the_operators(name: str) -> None:
    text = f"class {name} {{ contains Bolt[0..*] bolts }} class Bolt class Dog {{ refers Bolt[1..*] toys }}"
    made = engine(text, name)
    bolts = [made.model.create("Bolt") for _ in range(2)]
    whole, other = made.model.create(name, bolts=bolts), made.model.create(name)
    made.model.create("Dog", toys=bolts)
    assert [match.row for match in made.matches(f"d.delete.{name}")] == [(other.id,)]
    made.model.graph.delete(other.id)
    assert whole.bolts and not made.exists(f"d.delete.{name}")


def test_objects_do_not_move_into_what_they_contain() -> None:
    made = engine("class Folder { contains Folder[0..*] inside }", "Folder")
    top, middle, leaf = (made.model.create("Folder") for _ in range(3))
    top.inside.append(middle)
    middle.inside.append(leaf)
    moves = [(match.part, match.container) for match in made.matches("d.move.Folder.inside")]
    assert moves == [(leaf, top)]


def created(made: Engine, cls: str, times: int) -> list[object]:
    """The keys of all objects of a class after some more were created."""
    for _ in range(times):
        made.apply(f"d.create.{cls}")
    [key] = made.model.metamodel.key(cls)
    return [getattr(node, key) for node in made.model.nodes(cls)]


def test_new_keys_are_above_those_in_use() -> None:
    made = engine("@key(name) class R { string name } @key(x) class S { int x = 4 }", "R", "S")
    assert created(made, "R", 3) == ["R1", "R2", "R3"]
    assert created(made, "S", 3) == [4, 5, 6]
    for cls in ("R", "S"):
        made.model.graph.delete(made.model.nodes(cls)[0].id)
    assert sorted(map(str, created(made, "R", 9))) == sorted(f"R{n}" for n in range(2, 13))
    assert sorted(map(int, map(str, created(made, "S", 2)))) == [5, 6, 7, 8]
    made.model.create("S", x=2**63 - 1)
    assert not made.exists("d.create.S"), "no number is above this one"


@pytest.mark.parametrize(
    ("name", "new"),
    [
        ("R1", "R2"),
        ("R0", "R1"),
        ("R9", "R10"),
        ("R1999", "R2000"),
        ("R20305999", "R20306000"),
        ("R20261121123456", "R20261121123457"),
        ("R999999999999999998", "R999999999999999999"),
        ("R999999999999999999", None),
        ("R1000000000000000000", "R1"),
        ("R12345678901234567890123", "R1"),
        ("R007", "R1"),
        ("R-7", "R1"),
        ("R 7", "R1"),
        ("R1x", "R1"),
        ("R²", "R1"),
        ("R", "R1"),
        ("", "R1"),
        ("7", "R1"),
        ("S7", "R1"),
    ],
)
def test_numbers_are_read_from_strings(name: str, new: str | None) -> None:
    made = engine("@key(name) class R { string name }", "R")
    made.model.create("R", name=name)
    assert made.exists("d.create.R") is (new is not None)
    if new is not None:
        assert created(made, "R", 1) == [name, new]


def test_objects_created_together_get_different_keys() -> None:
    """The largest number is that of all their classes: `A1` with 2 and `A` with 12 are one string."""
    text = "@key(k) abstract class K { string k } class A extends K { contains A1[2] e } class A1 extends K"
    made = engine(text, "A")
    made.model.create("A1", k="A10")
    for _ in range(2):
        made.apply("d.create.A.with.A1.A1")
    keys = [node.k for node in sorted(made.model.nodes("K"), key=lambda node: node.id)]
    assert keys == ["A10", "A11", "A112", "A113", "A114", "A1115", "A1116"]


def test_numbers_step_within_their_range() -> None:
    made = engine("class A { @range(0, 5, step = 2) int n @range(0, 1) float x int free }", "A")
    node = made.model.create("A", n=3)
    made.apply("d.set.A.n.up")
    assert node.n == 5 and not made.exists("d.set.A.n.up")
    for expected in (3, 1, 0):
        made.apply("d.set.A.n.down")
        assert node.n == expected
    for _ in range(10):
        made.apply("d.set.A.x.up")
    assert node.x == pytest.approx(1.0)
    assert [name for name in made.rules if "free" in name] == []


def test_frozen_parts_are_not_changed() -> None:
    text = """
    class Tile { @frozen refers Tile[0..1] east @frozen bool fixed bool free refers Pond[0..*] ponds opposite tiles }
    @frozen class Pond { refers Tile[0..*] tiles opposite ponds }
    class Dry extends Tile
    """
    assert [name for name in names(text, "Tile") if "Dry" not in name] == [
        "d.create.Tile",
        "d.delete.Tile",
        "d.set.Tile.free",
    ]
    made = engine(text, "Tile")
    one, two = made.model.create("Tile"), made.model.create("Tile")
    assert made.count("d.delete.Tile") == 2
    one.east = two
    assert not made.exists("d.delete.Tile")


def test_retyping_fills_what_the_new_class_needs() -> None:
    text = "abstract class Cell class Floor extends Cell class Door extends Cell { refers Key[1] key } class Key"
    made = engine(text, "Cell")
    floor = made.model.create("Floor")
    assert not made.exists("d.retype.Floor.Door")
    key = made.model.create("Key")
    made.apply("d.retype.Floor.Door")
    assert (floor.cls, floor.key) == ("Door", key)
    made.apply("d.retype.Door.Floor")
    assert floor.cls == "Floor" and check_conformance(made.model) == []


# --- as rules like others


def test_runs_of_operators_replay() -> None:
    made = domain("network", "backbone")
    start = made.model.copy()
    with made.recording() as trace:
        for _ in range(30):
            made.apply("wiring")
    assert check_conformance(made.model) == []
    again = domain("network", "backbone")
    assert again.model.state_hash() == start.state_hash()
    again.replay(trace)
    assert again.model.state_hash() == made.model.state_hash()


def test_the_cap_bounds_the_ways_of_creation() -> None:
    garden = load_workspace(["garden.rules"], files=TextFiles(GARDEN)).engine()
    created = [name for name in garden.group("orchard") if ".create." in name]
    assert len(created) == 2
    assert not [name for name in garden.group("orchard") if ".delete." in name]
    assert sum(garden.prepare(name).weight for name in created) == 2.0
