"""Watched calls of recursive patterns, some for only a few values, against the naive matcher while models change."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from envgraph.errors import EnvgraphError
from envgraph.graph import Model
from envgraph.match import FREE, ViewMatcher
from envgraph.pattern import Constraint, Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.test_closures_on_demand import PLACES, change, places
from tests.oracle.test_recursion_on_demand import definitions
from tests.unit.match.kinds import watchable
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern, unequal

TO, UP, NEAR = (path(f"Place.{name}", "a", "b") for name in ("to", "up", "near"))


def into(name: str) -> Constraint:
    """A link from the first variable to one in between."""
    return path(f"Place.{name}", "a", "m")


def out(name: str) -> Constraint:
    """A link from a variable in between to the last one."""
    return path(f"Place.{name}", "m", "b")


USUAL = (
    pattern("left(a : Place, b : Place)", [TO], [find("left", "a", "m"), out("to")]),
    pattern("right(a : Place, b : Place)", [UP], [into("to"), find("right", "m", "b")]),
    pattern("twice(a : Place, b : Place)", [TO], [find("twice", "a", "m"), find("twice", "m", "b")]),
    pattern(
        "other(a : Place, b : Place)",
        [UP],
        [find("left", "a", "m"), out("near")],
        [find("other", "a", "m"), find("left", "m", "b"), unequal("a", "b")],
    ),
    pattern("round(a : Place, b : Place)", [NEAR], [find("square", "a", "m"), out("up")]),
    pattern("square(a : Place, b : Place)", [find("round", "a", "m"), out("to")]),
    pattern(
        "same(a : Place, b : Place)",
        [into("up"), path("Place.up", "b", "m")],
        [path("Place.to", "x", "a"), find("same", "x", "y"), path("Place.to", "y", "b")],
    ),
    pattern(
        "via(a : Place, k : Place, b : Red)",
        [TO, path("Place.near", "b", "k")],
        [into("up"), find("via", "m", "k", "b")],
    ),
)


def callers(names: str, called: list[str]) -> list[Pattern]:
    """Patterns that call two recursive ones for values that something else restricts."""
    p, q = called
    zero = path("Place.n", "a", 0)
    size = equal("n", fold("count", find(p, "a", "_")))
    return [
        pattern(f"{names}0(b : Place)", [zero, find(p, "a", "b")]),
        pattern(f"{names}1(a : Place)", [path("Place.n", "b", 1), find(p, "a", "b")]),
        pattern(f"{names}2(a : Red, b : Place)", [path("Place.n", "b", 1), find(p, "a", "b")]),
        pattern(f"{names}3(a : Place, b : Place)", [find(q, "m", "b"), zero, find(p, "a", "m")]),
        pattern(f"{names}4(a : Inn, b : Place)", [UP, neg(find(p, "a", "b"))]),
        pattern(f"{names}5(a : Inn, n : int)", [path("Place.n", "a", 2), size]),
        pattern(f"{names}6(a : Place)", [is_a("Inn", "a"), find(p, "a", "a")]),
        pattern(f"{names}7(a : Red, b : Place)", [find(p, "a", "m"), zero, path("Place.to+", "m", "b")]),
        pattern(f"{names}8(a : Red, b : Place)", [find(p, "a", "b"), find(q, "b", "a")], [NEAR, find(q, "a", "b")]),
    ]


def random_model_and_library(dice: Random) -> tuple[Model, Library] | None:
    """A model and patterns; None for patterns that mean nothing."""
    library = Library(PLACES)
    try:
        if dice.random() < 0.6:
            names = ["left", "right", "twice", "other", "round", "square", "same"]
            library.add(*USUAL, *callers("c", dice.sample(names, 2)), *callers("d", dice.sample(names, 2)))
            library.add(pattern("via0(k : Place, b : Red)", [path("Place.n", "a", 0), find("via", "a", "k", "b")]))
            library.add(pattern("via1(a : Place, b : Red)", [path("Place.n", "k", 0), find("via", "a", "k", "b")]))
        else:
            library.add(*definitions(dice), *callers("c", ["p", "q"]), *callers("d", ["q", "p"]))
            library.add(pattern("t0(a : Place, c : Place)", [path("Place.n", "b", 0), find("t", "a", "b", "c")]))
    except EnvgraphError:
        return None
    return places(dice, 6), library


def edit(dice: Random, model: Model) -> None:
    """Change a link, a value or a class."""
    node = dice.choice(list(model.graph.extent("Place")))
    match dice.randrange(5):
        case 0:
            model.graph.set_value(node, PLACES.attributes[0], dice.choice([0, 1, 2, None]))
        case 1:
            model.graph.retype(node, dice.choice(["Place", "Red", "Inn"]))
        case _:
            change(dice, model)


def walk(dice: Random) -> bool:
    """Compare the matchers after each change, and the order of rows after a rollback; False if there is nothing."""
    made = random_model_and_library(dice)
    if made is None:
        return False
    model, library = made
    names = dice.sample(watchable(library), dice.randint(1, 6))
    views, naive = ViewMatcher(model, library), NaiveMatcher(model, library)
    views.watch(*names)
    free = {each.qualified_name: (FREE,) * len(each.parameters) for each in library.patterns}

    def listed() -> dict[str, list[tuple[object, ...]]]:
        return {name: list(views.rows(name, free[name])) for name in names}

    def compare() -> None:
        for name, rows in listed().items():
            assert sorted(rows) == sorted(naive.rows(name, free[name])), name
        views.check_integrity()

    compare()
    for _ in range(dice.randint(2, 5)):
        before, savepoint = listed(), model.graph.history.savepoint()
        for _ in range(dice.randint(1, 3)):
            for _ in range(dice.choice([1, 1, 4])):
                edit(dice, model)
            compare()
        if dice.random() < 0.5:
            model.graph.history.rollback(savepoint)
            assert listed() == before
            compare()
        else:
            model.graph.history.release(savepoint)
    return True


@settings(max_examples=int(0.3 * settings().max_examples), suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32))
def test_watched_recursive_patterns_have_the_rows_of_the_naive_matcher(seed: int) -> None:
    walk(Random(seed))


@pytest.mark.parametrize("called", ["left", "twice", "chained"])
@pytest.mark.parametrize("known", ["a", "b"])
def test_watched_recursive_call_with_a_bound_value_stores_at_most_one_row_per_node(called: str, known: str) -> None:
    model, library = Model(PLACES), Library(PLACES)
    chain = [model.graph.new("Place") for _ in range(100)]
    for near, far in pairwise(chain):
        model.graph.link(near, PLACES.feature("Place", "to"), far)  # type: ignore[arg-type]
    model.graph.set_value(chain[50], PLACES.attributes[0], 7)
    chained = pattern("chained(a : Place, b : Place)", [TO], [into("to"), find("chained", "m", "b")])
    asking = pattern("asking(a : Place, b : Place)", [path("Place.n", known, 7), find(called, "a", "b")])
    library.add(*USUAL, chained, asking)
    views = ViewMatcher(model, library)
    views.watch("asking")
    expected = [(chain[50], place) if known == "a" else (place, chain[50]) for place in chain]
    expected = expected[51:] if known == "a" else expected[:50]
    assert sorted(views.rows("asking", (FREE, FREE))) == expected
    assert max(each.size() for each in views.watched_views.network.operators.values()) <= 100
    model.graph.unlink(chain[60], PLACES.feature("Place", "to"), chain[61])  # type: ignore[arg-type]
    assert views.count("asking", (FREE, FREE)) == (10 if known == "a" else 50)
    model.graph.set_value(chain[70], PLACES.attributes[0], 7)
    assert views.count("asking", (FREE, FREE)) == (10 + 29 if known == "a" else 50 + 9)
    views.check_integrity()
