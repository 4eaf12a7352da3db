"""Patterns that call themselves and each other, at random, against the naive matcher: for each way to give values."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from envgraph.errors import EnvgraphError
from envgraph.graph import Model
from envgraph.match import CompiledMatcher
from envgraph.pattern import Constraint, Library, Pattern, PatternCall, Variable
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.test_closures_on_demand import PLACES, assert_all, change, places
from tests.thresholds import set_thresholds
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern, unequal

HEADS = {"p": "ab", "q": "ab", "r": "a", "t": "abc"}


def constraint(dice: Random, names: str) -> Constraint:
    """Something about a few variables; every third time a call of a recursive pattern."""
    x, y, z = (dice.choice(names) for _ in range(3))
    if dice.random() < 0.4:
        called = dice.choice("ppqqrt")
        arguments = [x, y, z][: len(HEADS[called])]
        if dice.random() < 0.15:
            arguments[-1] = "_"
        return find(called, *arguments)
    return dice.choice(
        [
            path("Place.to", x, y),
            path("Place.to", x, y),
            path("Place.up", x, y),
            path("Place.near", x, y),
            path("Place.up+", x, y),
            is_a("Red", x),
            unequal(x, y),
            neg(path("Place.up", x, "_")),
            equal("n", fold("count", path("Place.near", x, "_"))),
            equal(x, y),
        ]
    )


def usual(dice: Random, name: str) -> list[Constraint]:
    """Recursion as people write it: calls at the beginning, at the end, or both."""
    link, other = dice.choice(["Place.to", "Place.up", "Place.near"]), dice.choice("pq")
    return dice.choice(
        [
            [find(name, "a", "x"), path(link, "x", "b")],
            [find(other, "a", "x"), path(link, "x", "b")],
            [path(link, "a", "x"), find(other, "x", "b")],
            [find(name, "a", "x"), find(other, "x", "b")],
            [path(link, "x", "a"), find(other, "x", "y"), path(link, "y", "b")],
        ]
    )


def definitions(dice: Random) -> list[Pattern]:
    """Four patterns; about every body that is not the first calls some of them."""
    found = []
    for name, parameters in HEADS.items():
        bodies = []
        for number in range(dice.randint(1, 3)):
            names = parameters + "xy"[: dice.randint(0, 2)]
            body = [constraint(dice, names) for _ in range(dice.randint(1, 3))]
            if name in "pq" and dice.random() < 0.4:
                body, names = usual(dice, name), "abxy"
            if number == 0:
                body = [c for c in body if not isinstance(c, PatternCall)]
            # Every variable must be bound somewhere; where something else does it, this is dropped again.
            bodies.append(
                [
                    *(body or [path("Place.to", parameters[0], parameters[-1])]),
                    *(is_a("Place", n) for n in names),
                ]
            )
        found.append(pattern(f"{name}({', '.join(f'{p} : Place' for p in parameters)})", *bodies))
    end = Variable("_")
    found += [
        pattern("none(a : Place)", [is_a("Place", "a"), neg(PatternCall("p", (Variable("a"), end)))]),
        pattern("apart(a : Place, b : Place)", [path("Place.near", "a", "b"), neg(find("p", "a", "b"))]),
        pattern("size(a : Place, n : int)", [is_a("Place", "a"), equal("n", fold("count", find("q", "_", "a")))]),
        pattern("closed(a : Place, b : Place)", [find("q+", "a", "b"), find("p*", "b", "a")]),
    ]
    return found


def random_model_and_library(dice: Random) -> tuple[Model, Library] | None:
    """A model and patterns; None for patterns that mean nothing."""
    library = Library(PLACES)
    try:
        library.add(*definitions(dice))
    except EnvgraphError:
        return None
    return places(dice, 4), library


@pytest.fixture(
    params=[{}, {"few rows of questions": 0, "few questions": 1}, {"most rows kept": 5}],
    ids=["few questions", "many questions", "little room"],
    scope="module",
)
def limits(request: pytest.FixtureRequest) -> Iterator[None]:
    """From when on all rows with a value are computed."""
    with pytest.MonkeyPatch.context() as patch:
        set_thresholds(patch, request.param)
        yield


@pytest.mark.usefixtures("limits")
@settings(max_examples=int(0.3 * settings().max_examples), suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32))
def test_recursive_patterns_have_the_rows_of_the_naive_matcher(seed: int) -> None:
    compare_matchers(Random(seed))


def compare_matchers(dice: Random) -> bool:
    """Compare the matchers on one world; False if there is nothing to compare."""
    made = random_model_and_library(dice)
    if made is None:
        return False
    model, library = made
    compiled, naive = CompiledMatcher(model, library), NaiveMatcher(model, library)
    for _ in range(2):
        for definition in dice.sample(library.patterns, 4):
            assert_all(compiled, naive, definition.name, len(definition.parameters), dice)
        change(dice, model)
    return True
