"""Views of a reference that is its own opposite: one link comes and goes in both directions at once."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.graph import Model
from envgraph.match import FREE
from envgraph.metamodel import Class, Metamodel, Reference
from envgraph.pattern import Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.kinds import watched
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern, unequal

PLACES = Metamodel("places", (Class("Place", features=(Reference("beside", "Place", 0, None, opposite="beside"),)),))
BESIDE = PLACES.references[0]


def beside(a: str, b: str) -> object:
    """`Place.beside(a, b)`."""
    return path("Place.beside", a, b)


def degree(variable: str, place: str, forward: bool = True) -> object:
    """`variable == count Place.beside(place, _)`, or the other way round."""
    return equal(variable, fold("count", path("Place.beside", *((place, "_") if forward else ("_", place)))))


PATTERNS: tuple[Pattern, ...] = tuple(
    pattern(head, body)  # type: ignore[arg-type]
    for head, body in (
        ("pair(a : Place, b : Place)", [beside("a", "b")]),
        ("back(a : Place, b : Place)", [beside("a", "b"), beside("b", "a")]),
        ("next(a : Place, c : Place)", [beside("a", "b"), beside("b", "c"), unequal("a", "c")]),
        ("triple(a : Place, b : Place, c : Place)", [beside("a", "b"), beside("b", "c"), beside("c", "a")]),
        ("loose(a : Place)", [is_a("Place", "a"), neg(beside("a", "_"))]),
        ("unlooped(a : Place, b : Place)", [beside("a", "b"), neg(beside("a", "a")), neg(beside("b", "b"))]),
        ("apart(a : Place, c : Place)", [beside("a", "b"), beside("b", "c"), neg(beside("a", "c"))]),
        ("both(a : Place, n : int)", [is_a("Place", "a"), degree("n", "a"), degree("n", "a", forward=False)]),
        ("equal(a : Place, b : Place)", [beside("a", "b"), degree("n", "a"), degree("n", "b")]),
        ("towards(a : Place, b : Place, n : int)", [beside("a", "b"), degree("n", "b", forward=False)]),
        (
            "none(a : Place)",
            [is_a("Place", "a"), degree("n", "a", forward=False), equal("n", 0), neg(beside("a", "_"))],
        ),
        (
            "other(a : Place, n : int)",
            [
                is_a("Place", "a"),
                degree("n", "a", forward=False),
                neg(find("pair", "a", "a")),
                degree("n", "a"),
            ],
        ),
        ("reached(a : Place, b : Place)", [beside("a", "c"), find("pair+", "c", "b"), neg(beside("a", "b"))]),
    )
)


@pytest.mark.parametrize("alone", PATTERNS, ids=lambda each: each.name)
def test_symmetric_links_change_in_both_directions_at_once(alone: Pattern) -> None:
    for seed in range(4):
        random = Random(seed)
        model, library = Model(PLACES), Library(PLACES)
        library.add(*dict.fromkeys((PATTERNS[0], alone)))
        places = [model.graph.new("Place") for _ in range(3)]
        views, naive = watched(model, library), NaiveMatcher(model, library)
        free = (FREE,) * len(alone.parameters)
        for _ in range(40):
            one, other = random.choice(places), random.choice(places)
            if not model.graph.unlink(one, BESIDE, other):
                model.graph.link(one, BESIDE, other)
            if random.random() < 0.7:
                assert sorted(views.rows(alone.name, free)) == naive.rows(alone.name, free)
                views.check_integrity()
