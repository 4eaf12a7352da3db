"""Chains of links with many paths and few ends: the work is that of the links, not that of the paths."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library
from tests.unit.match.counting import CountingMatcher
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern

STOPS = Metamodel(
    "stops",
    (
        Class(
            "Stop",
            features=(
                Attribute("n", Scalar.INT),
                Reference("to", "Stop", 0, None),
                Reference("hub", "Stop", 0, 1),
                Reference("parts", "Stop", 0, None, containment=True),
            ),
        ),
    ),
)
SIZE, FANOUT = 40, 8
LONG = ".".join(["Stop", *["to"] * 15])
FAR = pattern("far(a : Stop, b : Stop)", [path(LONG, "a", "b")])


def crowded() -> Model:
    """Each stop has links to the eight next ones."""
    model, to = Model(STOPS), STOPS.feature("Stop", "to")
    assert isinstance(to, Reference)
    with model.loading():
        for _ in range(SIZE):
            model.graph.new("Stop")
        for stop in range(SIZE):
            for step in range(1, FANOUT + 1):
                model.graph.link(stop, to, (stop + step) % SIZE)
    return model


def library(*patterns: object) -> Library:
    found = Library(STOPS)
    found.add(*patterns)  # type: ignore[arg-type]
    return found


QUESTIONS: dict[str, Callable[[CompiledMatcher], object]] = {
    "rows": lambda matcher: len(matcher.rows("far", (0, FREE))) == SIZE,
    "count": lambda matcher: matcher.count("far", (0, FREE)) == SIZE,
    "exists": lambda matcher: matcher.exists("far", (0, 5)),
    "first": lambda matcher: matcher.first("far", (0, FREE)) is not None,
    "all": lambda matcher: matcher.count("far", (FREE, FREE)) == SIZE * SIZE,
    "local variables": lambda matcher: matcher.count("seven", (FREE,)) == 0,
    "negation": lambda matcher: matcher.count("none", (FREE,)) == SIZE,
    "aggregate": lambda matcher: matcher.rows("ends", (0, FREE)) == [(0, SIZE)],
    "why not": lambda matcher: matcher.why_not("seven", {0: 0}).match is None,
    "explain": lambda matcher: "actually 320" in matcher.explain("far", (0,), (0,)),
}


@pytest.mark.parametrize("question", QUESTIONS.values(), ids=QUESTIONS)
def test_chains_of_links_are_searched_with_distinct_ends(
    question: Callable[[CompiledMatcher], object],
) -> None:
    patterns = library(
        FAR,
        pattern("seven(a : Stop)", [path(LONG, "a", "b"), path("Stop.n", "b", 7)]),
        pattern("none(a : Stop)", [is_a("Stop", "a"), neg(find("seven", "a"))]),
        pattern("ends(a : Stop, n : int)", [is_a("Stop", "a"), equal("n", fold("count", find("far", "a", "_")))]),
    )
    matcher = CountingMatcher(crowded(), patterns)
    assert question(matcher)
    assert 0 < matcher.looks <= 15 * SIZE * (SIZE + FANOUT)


def test_distinct_ends_are_ordered_by_their_first_path() -> None:
    model = crowded()
    matcher = CompiledMatcher(model, library(pattern("far(a : Stop, b : Stop)", [path("Stop.to.to.to", "a", "b")])))
    targets = model.graph.store.forward[0]
    paths = [c for a in targets[3] for b in targets[a] for c in targets[b]]
    assert matcher.rows("far", (3, FREE)) == [(3, end) for end in dict.fromkeys(paths)]


def test_closures_visit_the_links_of_each_hub_once() -> None:
    model = crowded()
    hub = STOPS.feature("Stop", "hub")
    assert isinstance(hub, Reference)
    with model.loading():
        for stop in range(SIZE):
            model.graph.set_target(stop, hub, stop % 2)
    matcher = CountingMatcher(
        model,
        library(
            pattern("step(a : Stop, b : Stop)", [path("Stop.hub.to", "a", "b")]),
            pattern("reach(a : Stop, b : Stop)", [find("step+", "a", "b")]),
        ),
    )
    assert matcher.count("reach", (0, FREE)) == 9
    assert matcher.looks == 12  # ten stops have a hub, and two hubs have links


def test_functional_steps_need_no_distinct_set() -> None:
    tree = pattern("below(a : Stop, b : Stop)", [path("Stop.parts.parts.parts.parts", "a", "b")])
    assert " not in " not in CompiledMatcher(Model(STOPS), library(tree)).source("below", (0,))
