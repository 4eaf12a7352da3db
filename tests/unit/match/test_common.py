"""Bodies whose links make circles, around hubs: the ends that two objects share are looked for among the fewer."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph.graph import IndexedSet, Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.match.demand._intersections import intersect_ends
from envgraph.metamodel import Class, Metamodel, Reference
from envgraph.pattern import Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.counting import CountingMatcher
from tests.unit.match.writing import path, pattern

PEOPLE = Metamodel("people", (Class("One", features=(Reference("knows", "One", 0, None),)),))
SIZE = 100

CIRCLES = {
    "triangle": pattern(
        "found(x : One, y : One, z : One)",
        [path("One.knows", "x", "y"), path("One.knows", "y", "z"), path("One.knows", "x", "z")],
    ),
    "circle of three": pattern(
        "found(x : One, y : One, z : One)",
        [path("One.knows", "x", "y"), path("One.knows", "y", "z"), path("One.knows", "z", "x")],
    ),
    "clique of four": pattern(
        "found(w : One, x : One, y : One, z : One)",
        [
            path("One.knows", one, other)
            for one, other in ("wx", "xy", "wy", "yz", "wz", "xz")
        ],
    ),
}  # fmt: skip


def crowd() -> Model:
    """Everybody knows the next one and one that is far away; all know the first, who knows all."""
    model, knows = Model(PEOPLE), PEOPLE.references[0]
    with model.loading():
        for _ in range(SIZE):
            model.graph.new("One")
        for one in range(1, SIZE):
            model.graph.link(one, knows, 0)
            model.graph.link(one, knows, one % (SIZE - 1) + 1)
            model.graph.link(one, knows, (7 * one + 30) % (SIZE - 1) + 1)
        for one in range(SIZE - 1, 0, -1):
            model.graph.link(0, knows, one)
    return model


def library(asked: Pattern) -> Library:
    found = Library(PEOPLE)
    found.add(asked)
    return found


@pytest.mark.parametrize("circle", CIRCLES.values(), ids=CIRCLES)
def test_cycles_through_a_hub_are_found_in_link_order(circle: Pattern) -> None:
    model = crowd()
    size = len(circle.parameters)
    rows = CompiledMatcher(model, library(circle)).rows("found", (FREE,) * size)
    assert sorted(rows) == NaiveMatcher(model, library(circle)).rows("found", (FREE,) * size)
    place = {one: {other: n for n, other in enumerate(model.graph.store.forward[0][one])} for one in range(SIZE)}
    ordered = sorted(rows, key=lambda row: (row[0], *(place[a][b] for a, b in pairwise(row))))
    assert rows == ordered


@pytest.mark.parametrize("name", ["triangle", "circle of three"])
def test_triangle_search_intersects_adjacencies_of_a_hub(name: str) -> None:
    matcher = CountingMatcher(crowd(), library(CIRCLES[name]), ends=True)
    assert matcher.exists("found", (FREE, FREE, FREE))
    matcher.looks = 0
    matcher.count("found", (FREE, FREE, FREE))
    assert SIZE <= matcher.looks <= 20 * SIZE


def test_common_ends_come_in_the_order_of_the_first() -> None:
    many = IndexedSet(tuple(range(64, 0, -1)))
    assert intersect_ends(many, (3, 9, 500)) == [9, 3]
    assert intersect_ends(many, IndexedSet((3, 9, 500)), (9,)) == [9]
    assert intersect_ends(many, IndexedSet(tuple(range(60, 2000)))) == [64, 63, 62, 61, 60]
    assert intersect_ends(many, (), many) == []
