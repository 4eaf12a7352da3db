"""Objects that are found by the values of their attributes."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
from envgraph.pattern import Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.writing import equal, find, fold, is_a, neg, op, path, pattern, unequal, value

POINTS = Metamodel(
    "points",
    (
        Class(
            "Point",
            features=(
                Attribute("x", Scalar.INT),
                Attribute("y", Scalar.INT),
                Attribute("name", Scalar.STRING),
            ),
        ),
        Class("Inn", supertypes=("Point",)),
        Class("Well", supertypes=("Point",)),
    ),
)
X, Y, NAME = POINTS.attributes
AT = pattern("at(a : Point, x : int, y : int)", [path("Point.x", "a", "x"), path("Point.y", "a", "y")])
JOINS = {
    "one value": pattern(
        "q(a : Point, b : Point)", [path("Point.x", "a", "x"), path("Point.x", "b", "x"), unequal("a", "b")]
    ),
    "two values": pattern("q(a : Inn, b : Well)", [find("at", "a", "x", "y"), find("at", "b", "x", "y")]),
    "one value of two attributes": pattern(
        "q(a : Point, b : Point)",
        [path("Point.x", "a", "x"), path("Point.x", "b", "x"), path("Point.y", "b", "x")],
    ),
    "two values of one attribute": pattern(
        "q(a : Point, b : Point)",
        [
            path("Point.x", "a", "x"),
            path("Point.y", "a", "y"),
            path("Point.x", "b", "x"),
            path("Point.x", "b", "y"),
        ],
    ),
    "a value and a constant": pattern(
        "q(a : Point, b : Point)",
        [path("Point.x", "a", "x"), path("Point.x", "b", "x"), path("Point.y", "b", 1)],
    ),
    "a value that is worked out": pattern(
        "q(a : Point, b : Point)",
        [find("at", "a", "x", "y"), equal("u", value(op("x", "+", 1))), find("at", "b", "u", "y")],
    ),
    "none with a value": pattern(
        "q(a : Point)",
        [find("at", "a", "x", "y"), equal("u", value(op("x", "+", 1))), neg(find("at", "_", "u", "y"))],
    ),
    "number with a value": pattern(
        "q(a : Point, n : int)",
        [
            path("Point.x", "a", "x"),
            path("Point.y", "a", "y"),
            equal("n", fold("count", find("at", "_", "y", "x"))),
        ],
    ),
    "exactly one class": pattern(
        "q(a : Inn, b : Point)",
        [path("Point.name", "a", "n"), path("Point.name", "b", "n"), is_a("Point", "b", True)],
    ),
    "steps of a closure": pattern("q(a : Point, b : Point)", [find("right+", "a", "b")]),
}
RIGHT = pattern(
    "right(a : Point, b : Point)",
    [find("at", "a", "x", "y"), equal("u", value(op("x", "+", 1))), find("at", "b", "u", "y")],
)


def queries(join: Pattern) -> Library:
    found = Library(POINTS)
    found.add(AT, RIGHT, join)
    return found


def edit(dice: Random, model: Model) -> None:
    """A new point, or another value; some have none."""
    points = list(model.graph.extent("Point"))
    if dice.random() < 0.3 or not points:
        points.append(model.graph.new(dice.choice(["Point", "Inn", "Well"])))
    attribute = dice.choice([X, Y, NAME])
    model.graph.set_value(
        points[-1],
        attribute,
        None if dice.random() < 0.2 else dice.choice("ab") if attribute is NAME else dice.randint(0, 2),
    )
    node = dice.choice(points)
    if dice.random() < 0.1:
        model.graph.delete(node, "spo")
    else:
        model.graph.set_value(node, dice.choice([X, Y]), dice.randint(0, 2))


@pytest.mark.parametrize("join", JOINS.values(), ids=JOINS)
def test_equal_values_are_found_after_every_edit_and_rollback(join: Pattern) -> None:
    dice, model = Random(join.name + str(len(join.bodies[0].constraints))), Model(POINTS)
    library = queries(join)
    compiled, naive = CompiledMatcher(model, library), NaiveMatcher(model, library)
    free = (FREE,) * len(join.parameters)
    for _ in range(25):
        savepoint = model.graph.history.savepoint()
        for _ in range(dice.randint(1, 4)):
            edit(dice, model)
        found = compiled.rows("q", free)
        assert sorted(found) == naive.rows("q", free)
        for row in found[:2]:
            assert compiled.rows("q", (row[0], *free[1:])) == [each for each in found if each[0] == row[0]]
        if dice.random() < 0.3:
            model.graph.history.rollback(savepoint)
            assert sorted(compiled.rows("q", free)) == naive.rows("q", free)


@pytest.mark.parametrize("join", JOINS.values(), ids=JOINS)
def test_value_joins_do_not_visit_all_pairs(join: Pattern) -> None:
    text = CompiledMatcher(Model(POINTS), queries(join)).source("q")
    assert "i0" in text or join in (JOINS["steps of a closure"], JOINS["number with a value"])
