"""Closures that many questions share, against the naive matcher: under negation, aggregates and existence."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.test_matchers_agree import agrees, assert_count, assert_exists, assert_first, assert_rows
from tests.profile import NIGHTLY
from tests.thresholds import set_thresholds
from tests.unit.match.writing import equal, find, fold, is_a, neg, op, path, pattern, value

PLACES = Metamodel(
    "places",
    (
        Class(
            "Place",
            features=(
                Attribute("n", Scalar.INT),
                Attribute("w", Scalar.FLOAT),
                Reference("to", "Place", 0, None),
                Reference("up", "Place", 0, 1),
                Reference("near", "Place", 0, None, opposite="near"),
            ),
        ),
        Class("Red", supertypes=("Place",)),
        Class("Inn", supertypes=("Place",)),
    ),
)

PATTERNS = (
    pattern("step(a : Place, b : Place)", [path("Place.to", "a", "b")], [path("Place.up", "a", "b")]),
    pattern("next(a : Place, n : int)", [path("Place.to", "a", "b"), path("Place.n", "b", "n")]),
    pattern("reach(a : Place, b : Place)", [find("step+", "a", "b")]),
    pattern("within(a : Place, b : Place)", [find("step*", "a", "b")]),
    pattern("above(a : Place, b : Red)", [path("Place.up*", "a", "b")]),
    pattern("red(a : Place, b : Place)", [find("step+", "a", "b"), is_a("Red", "b")]),
    pattern(
        "redOrInn(a : Place, b : Place)",
        [find("step*", "a", "b"), is_a("Red", "b")],
        [find("step*", "a", "b"), is_a("Inn", "b")],
    ),
    pattern("valued(a : Place, b : Place, n : int)", [find("step*", "a", "b"), path("Place.n", "b", "n")]),
    pattern("beside(a : Place, c : Place, b : Place)", [find("step+", "a", "b"), path("Place.near", "c", "b")]),
    pattern("both(a : Place, b : Place)", [find("reach", "a", "c"), path("Place.near+", "c", "b")]),
    # Steps that are easy in one direction alone, steps between numbers, and steps that are closures themselves.
    pattern(
        "higher(a : Place, b : Place)",
        [path("Place.n", "a", "n"), equal("m", value(op("n", "+", 1))), path("Place.n", "b", "m")],
    ),
    pattern(
        "number(n : int, m : int)",
        [path("Place.to", "a", "b"), path("Place.n", "a", "n"), path("Place.n", "b", "m")],
    ),
    pattern("far2(a : Place, b : Place)", [find("step+", "a", "c"), path("Place.near", "c", "b")]),
    pattern("low(a : Place, b : Place)", [path("Place.near", "a", "b"), neg(find("climbs", "a", "b"))]),
    pattern("climbs(a : Place, b : Place)", [find("higher+", "a", "b")]),
    pattern("top(a : Place, n : int)", [is_a("Place", "a"), equal("n", fold("count", find("climbs", "_", "a")))]),
    pattern("numbers(n : int, m : int)", [find("number+", "n", "m")]),
    pattern("unequalTo(n : int, m : int)", [find("number", "n", "m"), neg(find("numbers", "m", "n"))]),
    pattern("farther(a : Place, b : Place)", [path("Place.up", "a", "b"), neg(find("far3", "b", "a"))]),
    pattern("far3(a : Place, b : Place)", [find("far2*", "a", "b"), is_a("Red", "a")]),
    # Whether one end reaches the other.
    pattern("apart(a : Place, b : Place)", [is_a("Place", "a"), is_a("Red", "b"), neg(find("reach", "a", "b"))]),
    pattern("outside(a : Place, b : Place)", [path("Place.to", "a", "b"), neg(find("within", "b", "a"))]),
    pattern("circle(a : Place)", [find("step+", "a", "a")]),
    pattern("back(a : Place, b : Place)", [path("Place.near", "a", "b"), find("step+", "b", "a")]),
    # Whether anything is reached at all.
    pattern("ends(a : Place)", [is_a("Place", "a"), neg(find("reach", "a", "_"))]),
    pattern("begins(b : Place)", [is_a("Place", "b"), neg(find("reach", "_", "b")), neg(find("far3", "_", "b"))]),
    pattern("linked(a : Place)", [path("Place.near", "a", "b"), find("reach", "b", "_"), find("within", "_", "a")]),
    pattern("any(a : Red)", [is_a("Red", "a"), find("reach", "_", "_")]),
    # Whether an end reaches any of several.
    pattern("none(a : Place)", [is_a("Place", "a"), neg(find("red", "a", "_"))]),
    pattern("neither(a : Place)", [is_a("Place", "a"), neg(find("redOrInn", "a", "_"))]),
    pattern("some(a : Place)", [is_a("Place", "a"), find("red", "a", "_")]),
    pattern("unvisited(b : Place)", [is_a("Place", "b"), neg(find("red", "_", "b"))]),
    pattern("lonely(a : Place, c : Place)", [path("Place.to", "c", "a"), neg(find("beside", "a", "c", "_"))]),
    # What is reached from any of several.
    pattern("visited(b : Place)", [is_a("Red", "a"), find("step+", "a", "b")]),
    pattern("found(b : Place)", [is_a("Inn", "a"), find("step*", "a", "b")]),
    pattern("around(c : Place, b : Place)", [path("Place.near", "c", "a"), find("step+", "a", "b")]),
    pattern(
        "far(c : Place, b : Place)",
        [path("Place.near+", "c", "a"), find("step*", "a", "d"), path("Place.up+", "d", "b")],
    ),
    # Values of what is reached.
    pattern("size(a : Place, n : int)", [is_a("Place", "a"), equal("n", fold("count", find("reach", "a", "_")))]),
    pattern("all(a : Place, n : int)", [is_a("Place", "a"), equal("n", fold("count", find("within", "a", "_")))]),
    pattern(
        "sources(b : Place, n : int)",
        [is_a("Place", "b"), equal("n", fold("count", find("within", "_", "b")))],
    ),
    pattern(
        "reds(a : Place, n : int)",
        [is_a("Place", "a"), equal("n", fold("count", find("redOrInn", "a", "_")))],
    ),
    pattern("upper(a : Place, n : int)", [is_a("Place", "a"), equal("n", fold("count", find("above", "a", "_")))]),
    pattern(
        "sum(a : Place, n : int)",
        [is_a("Place", "a"), equal("n", fold("sum", find("valued", "a", "_", "#")))],
    ),
    *(
        pattern(
            f"{name}(a : Place, n : {type_})",
            [is_a("Place", "a"), equal("n", fold(function, find(*called)))],
        )
        for name, type_, function, called in (
            ("lowest", "int", "min", ("valued", "a", "_", "#")),
            ("highest", "int", "max", ("valued", "a", "_", "#")),
            ("mean", "float", "avg", ("valued", "a", "_", "#")),
            ("weight", "float", "sum", ("weighed", "a", "_", "#")),
            ("heaviest", "float", "max", ("weighed", "a", "_", "#")),
            ("differentNumbers", "int", "count", ("numbered", "a", "_")),
            ("sumOfNumbers", "int", "sum", ("numbered", "a", "#")),
            ("lightest", "float", "min", ("light", "a", "#")),
            ("differentWeights", "float", "sum", ("light", "a", "#")),
            ("besides", "int", "count", ("beside", "a", "_", "_")),
            ("besidesOnce", "int", "count", ("besideAny", "a", "_")),
        )
    ),
    pattern("weighed(a : Place, b : Place, w : float)", [find("step+", "a", "b"), path("Place.w", "b", "w")]),
    pattern("numbered(a : Place, n : int)", [find("step*", "a", "b"), path("Place.n", "b", "n")]),
    pattern(
        "light(a : Place, w : float)",
        [find("step*", "a", "b"), is_a("Red", "b"), path("Place.w", "b", "w")],
        [find("step*", "a", "b"), is_a("Inn", "b"), path("Place.w", "b", "w")],
    ),
    pattern("besideAny(a : Place, c : Place)", [find("step*", "a", "b"), path("Place.near", "c", "b")]),
    pattern(
        "least(c : Place, n : int)",
        [is_a("Place", "c"), equal("n", fold("count", find("beside", "_", "c", "_")))],
    ),
    pattern(
        "most(a : Place, c : Place, n : int)",
        [path("Place.near", "a", "c"), equal("n", fold("count", find("beside", "a", "c", "_")))],
    ),
)


def places(dice: Random, most: int = 7) -> Model:
    """A few places, thinly linked or crowded."""
    model = Model(PLACES)
    nodes = [model.graph.new(dice.choice(["Place", "Place", "Red", "Inn"])) for _ in range(dice.randint(1, most))]
    n = PLACES.attributes[0]
    for node in nodes:
        if dice.random() < 0.8:
            model.graph.set_value(node, n, dice.randint(0, 2))
            model.graph.set_value(node, PLACES.attributes[1], dice.choice([0.1, 0.2, 0.7]))
    for _ in range(dice.randint(0, 3 * len(nodes))):
        change(dice, model)
    return model


def change(dice: Random, model: Model) -> None:
    """Add or take away a link."""
    nodes = list(model.graph.extent("Place"))
    source, target = dice.choice(nodes), dice.choice(nodes)
    reference = dice.choice([r for r in PLACES.references for _ in range(1 if r.name == "near" else 2)])
    if target in model.graph.targets(source, reference):
        model.graph.unlink(source, reference, target)
    elif reference.many:
        model.graph.link(source, reference, target)
    else:
        model.graph.set_target(source, reference, target)


MANY = {"few nodes visited": 0, "times all nodes visited": 0}


@pytest.fixture(
    params=[
        {},
        MANY,
        {"few nodes visited": 4, "times all nodes visited": 1, "largest condensation": 0},
        {
            **MANY,
            "few nodes reached": 0,
            "cost of a class": 0,
            "most classes": 10**6,
        },
        {
            **MANY,
            "few nodes reached": 0,
            "most classes": 0,
            "dense set": 10**6,
        },
        {"few nodes visited": 10, "times all nodes visited": 1, "most reached nodes kept": 6},
    ],
    ids=[
        "few questions",
        "many questions",
        "too large to condense",
        "class by class",
        "object by object",
        "little room",
    ],
    scope="module",
)
def limits(request: pytest.FixtureRequest) -> Iterator[None]:
    """From when on questions are answered for all places at once."""
    with pytest.MonkeyPatch.context() as patch:
        set_thresholds(patch, request.param)
        yield


@pytest.mark.usefixtures("limits")
@settings(max_examples=700 if NIGHTLY else 1, suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32))
def test_compiled_closure_queries_equal_the_naive_matcher(seed: int) -> None:
    dice = Random(seed)
    model, library = places(dice), Library(PLACES)
    library.add(*PATTERNS)
    compiled, naive = CompiledMatcher(model, library), NaiveMatcher(model, library)
    for _ in range(2):
        for definition in dice.sample(PATTERNS, 14):
            assert_all(compiled, naive, definition.name, len(definition.parameters), dice)
        change(dice, model)


def assert_all(compiled: CompiledMatcher, naive: NaiveMatcher, name: str, size: int, dice: Random) -> None:
    """One question after the other, for each way to give values, has the answer that it should have."""
    expected = list(naive.rows(name, (FREE,) * size))
    assert_rows(compiled, name, (FREE,) * size, expected)
    types = compiled.library.parameter_types(name)
    nodes = list(compiled.model.graph.extent("Place"))
    for mask in product((False, True), repeat=size):
        for _ in range(3):
            arguments = tuple(
                FREE if not given else dice.randint(0, 3) if type_ is Scalar.INT else dice.choice(nodes)
                for given, type_ in zip(mask, types, strict=True)
            )
            rows = [row for row in expected if agrees(row, arguments)]
            dice.choice((assert_rows, assert_exists, assert_count, assert_first))(compiled, name, arguments, rows)
