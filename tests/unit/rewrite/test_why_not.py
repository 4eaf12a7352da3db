"""What `why_not` says of rules, units and groups: the witness of a `not`, the step that fails, and its place."""

from __future__ import annotations

import sys

import pytest

from envgraph.cli import main
from envgraph.lang import TextFiles, bundled_domain, load_workspace, open as open_engine
from envgraph.match import BodyFailure, WhyNot
from envgraph.rewrite import Engine

HALL = bundled_domain("warehouse")
FILES = (str(HALL / "small_hall.model"), str(HALL / "warehouse.rules"))


def hall() -> Engine:
    return open_engine(*FILES)


def hall_with(name: str, text: str) -> Engine:
    files = {path.name: path.read_text() for path in HALL.glob("*.*") if path.suffix != ".toml"}
    files[name] = text
    return load_workspace(["small_hall.model", name], files=TextFiles(files)).engine()


def only(why: WhyNot) -> BodyFailure:
    (failure,) = why.failures
    return failure


def test_a_not_block_names_the_object_and_the_link_in_the_way() -> None:
    engine = hall()
    left, right = (engine.model.graph.find_object(name) or 0 for name in ("left", "right"))
    engine.model.node(left).at = engine.model.node(5)  # beside the other robot
    why = engine.why_not("drive", robot=left, way="east")
    failure = only(why)
    assert failure.constraint == "the `not` block"
    assert failure.span is not None and failure.span.line == 10
    assert failure.witness is not None
    assert failure.witness.found == {"robot": left, "there": 6, "other": right}
    assert failure.witness.links == ((right, "at", 6),)
    assert str(why).splitlines()[1:] == [
        "  body 1: finds robot = `left`, way = 'east', here = `cell[4, 0]`, there = `cell[5, 0]`; "
        "then fails the `not` block (warehouse.rules:10:5)",
        "    which finds other = `right`; `right` -at-> `cell[5, 0]`",
    ]


def test_of_several_not_blocks_the_one_that_fails_is_named() -> None:
    engine = hall()
    left = engine.model.graph.find_object("left") or 0
    engine.model.node(left).at = engine.model.node(7)
    failure = only(engine.why_not("drive", robot=left, way="east"))
    assert failure.span is not None and failure.span.line == 9
    assert failure.witness is not None and failure.witness.found == {"there": 8}


def test_why_not_names_the_existing_match_of_a_neg_find() -> None:
    engine = hall()
    failure = only(engine.why_not("stranded"))
    assert failure.constraint == "neg find fetchable(parcel, _)"
    assert failure.span is not None and failure.span.text == "neg find fetchable(parcel, _)"
    assert failure.witness is not None
    parcel, dock = failure.witness.found["parcel"], failure.witness.found["dock"]
    assert engine.exists("fetchable", parcel=parcel, dock=dock)


def test_why_not_names_the_object_of_a_negated_class() -> None:
    engine = hall()
    failure = only(engine.why_not("drivable", bound={"from": 7, "to": 8}))
    assert failure.constraint == "neg Shelf(to)"
    assert failure.witness is not None and failure.witness.found == {"to": 8}


CORNERS = """
import "warehouse.metamodel"
pattern walled(cell : Cell) { Cell.west(cell, side); Shelf(side); }
pattern clear(cell : Cell) { neg Shelf(cell); }
pattern corner(cell : Cell) {
    find walled(cell);
    Cell.north.north(cell, _);
}
pattern between(cell : Cell) { Cell.west(cell, left); find clear(left); Cell.east(cell, right); Shelf(right); }
"""


def test_why_not_shows_inlined_patterns_as_written() -> None:
    engine = hall_with("corners.query", CORNERS)
    lines = str(engine.why_not("corner", cell=5)).splitlines()
    assert lines[1].endswith("then fails find walled(cell) (corners.query:6:5)")
    assert lines[2].startswith("    `walled` for cell = ") and lines[2].endswith("has no match")
    assert lines[3].endswith("then fails Shelf(side) (corners.query:3:54)")
    for shelf in engine.model.nodes("Shelf"):
        shelf.retype("Aisle")
    engine.model.node(4).retype("Shelf")
    assert only(engine.why_not("corner", cell=5)).constraint == "Cell.north.north(cell, _)"
    failure = only(engine.why_not("between", cell=5))
    assert failure.constraint == "find clear(left)"
    assert failure.inner is not None and only(failure.inner).constraint == "neg Shelf(cell)"


def test_why_not_shows_require_blocks_as_blocks() -> None:
    text = "rule stay { lhs { robot : Robot -at-> here : Cell; } require { here : Shelf; } modify { } }"
    engine = hall_with("stay.rules", f'import "warehouse.metamodel" {text}')
    why = engine.why_not("stay", robot=engine.model.graph.find_object("left"))
    assert only(why).constraint == "the `require` block"
    assert "the `require` block for here = " in str(why) and "#require" not in str(why)


def test_why_not_gives_the_span_of_every_failing_constraint() -> None:
    engine = hall()
    for name, text in {
        "lift": "robot -at-> here",
        "ship": "robot -at-> dock : Dock",
        "empty": "Robot.battery(robot, 0);",
    }.items():
        failure = only(engine.why_not(name))
        assert failure.span is not None
        assert text in failure.span.source.line_text(failure.span.line), (name, failure)
        assert failure.witness is None


UNITS = """
import "warehouse.rules"
unit lift_and_ship(robot : Robot) {
    drive(robot, ::south);
    lift(robot);
}
unit turn { try { lift; } }
"""


def units() -> Engine:
    return hall_with("units.rules", UNITS)


def test_the_step_of_a_unit_that_fails_is_named_and_nothing_changes() -> None:
    engine = units()
    before = engine.model.state_hash()
    why = engine.why_not("lift_and_ship", robot=engine.model.graph.find_object("left"))
    assert (why.match, why.kind) == (None, "unit")
    failure = only(why)
    assert failure.span is not None and failure.span.text.startswith("lift(robot)")
    assert str(why).splitlines()[0].endswith("fails")
    assert engine.model.state_hash() == before
    assert str(engine.why_not("turn")) == "`turn` succeeds"


def test_why_not_of_a_group_covers_each_rule() -> None:
    engine = hall()
    for shelf in engine.model.nodes("Shelf"):
        shelf.retype("Aisle")
    assert engine.why_not("floor").match is not None  # an aisle can become a shelf
    for aisle in engine.model.nodes("Aisle"):
        aisle.retype("Dock")
    why = engine.why_not("floor")
    assert (why.match, why.kind) == (None, "group")
    assert [failure.inner and failure.inner.match for failure in why.failures] == [None, None]


@pytest.mark.parametrize("format", ["text", "json"])
def test_the_commands_print_reasons_and_plans(
    format: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", ["envgraph", *arguments, "--format", format])
        assert main() == 0
        return capsys.readouterr().out

    told = run("why-not", *FILES, "drive", "--where", "robot=left", "--where", "way=west")
    assert "Cell.west(from, to)" in told
    assert "warehouse.query:6:5" in told
    assert ('"kind": "rule"' in told) == (format == "json")
    assert "body 1: about" in run("explain", *FILES, "lift")


def test_a_wrong_name_is_an_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("why-not", "explain"):
        monkeypatch.setattr(sys, "argv", ["envgraph", command, *FILES, "lifft"])
        assert main() == 1
        assert "did you mean `lift`?" in capsys.readouterr().err


def test_a_declared_object_is_shown_with_its_class() -> None:
    text = """
        package hall
        import "warehouse.query"
        rule enter(robot : Robot) {
            lhs { robot -at-> here : Cell; find step(here, ::east, there); there : Shelf; }
            modify { set robot.at = there; }
        }
    """
    engine = hall_with("enter.rules", text)
    failures = engine.why_not("enter", robot=engine.model.graph.find_object("left")).failures
    assert [failure.constraint for failure in failures] == ["there : Shelf"]


def test_the_two_names_that_must_be_different_objects_are_explained() -> None:
    text = """package warehouse
        import "warehouse.metamodel"
        rule meet { lhs { robot : Robot -at-> here : Cell; robot -at-> there : Cell; } modify { delete robot; } }
        @match(homomorphic)
        rule apart { lhs { robot : Robot -at-> a : Cell; robot -at-> b : Cell; a != b; } modify { delete robot; } }
    """
    engine = hall_with("meet.rules", text)
    why = engine.why_not("meet")
    assert only(why).distinct == ("here", "there")
    assert str(why).splitlines()[-1].strip() == (
        "different names stand for different objects, unless the rule has `@hom(here, there)`"
    )
    assert only(engine.why_not("apart")).distinct is None, "this rule says so itself"
    assert "@hom" not in str(engine.why_not("apart"))
    assert hall_with("meet.rules", text.replace("rule meet", "@hom(here, there) rule meet")).exists("meet")
