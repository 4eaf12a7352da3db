"""Bodies with many paths to the same ends: against the naive matcher, and the same plans that drop none."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from random import Random

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher
from envgraph.match.generate import _duplicate_filter_code, _sources
from envgraph.pattern import Constraint, Library, Pattern
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.test_closures_on_demand import PLACES, places
from tests.oracle.test_matchers_agree import QUESTIONS, agrees, assert_rows
from tests.thresholds import set_thresholds
from tests.unit.match.writing import equal, find, fold, is_a, neg, path, pattern, unequal

LINKS = ("to", "near", "up")
NAMES = "abcdefgh"


@pytest.fixture(params=[12, 2], ids=["one function", "many functions"], scope="module")
def limits(request: pytest.FixtureRequest) -> Iterator[None]:
    """Sieves even where little is expected of them, and plans that are split between them."""
    with pytest.MonkeyPatch.context() as patch:
        set_thresholds(patch, {"few partial matches": 0.0, "most loops of a function": request.param})
        yield


def body(dice: Random, size: int) -> list[Constraint]:
    """Links between a few variables, most of them in a chain, some with a condition."""
    found: list[Constraint] = []
    for number in range(size):
        near = NAMES[number] if dice.random() < 0.8 else dice.choice(NAMES[: number + 1])
        far = NAMES[number + 1]
        source, target = (near, far) if dice.random() < 0.8 else (far, near)
        closure = dice.choice(["", "", "", "", "", "+", "*"])
        found.append(path(f"Place.{dice.choice(LINKS)}{closure}", source, target))
    for _ in range(dice.randint(0, 2)):
        one, other = dice.sample(NAMES[: size + 1], 2)
        found.append(
            dice.choice(
                [
                    unequal(one, other),
                    is_a("Red", one),
                    path("Place.n", one, dice.randint(0, 1)),
                    path("Place.to", one, other),
                    neg(path("Place.up", one, other)),
                ]
            )
        )
    return found


def patterns(dice: Random) -> list[Pattern]:
    """Such bodies with some of their variables as parameters, and patterns that ask for them."""
    size = dice.randint(2, 5)
    links = body(dice, size)
    a, b = dice.sample(NAMES[: size + 1], 2)
    both, one = pattern(f"both({a} : Place, {b} : Place)", links), pattern(f"one({a} : Place)", links)
    return [
        both,
        one,
        pattern("reach(a : Place, b : Place)", [find("both+", "a", "b")]),
        pattern("no(a : Place)", [is_a("Place", "a"), neg(find("one", "a"))]),
        pattern(
            "ends(a : Place, n : int)",
            [is_a("Place", "a"), equal("n", fold("count", find("both", "a", "_")))],
        ),
        pattern(
            "twice(a : Place, c : Place)",
            [find("both", "a", "b"), find("both", "b", "c"), path("Place.to", "c", "d")],
        ),
    ]


def answers(model: Model, library: Library, questions: list[tuple[str, tuple[object, ...]]]) -> list[object]:
    """Rows of each question, in order."""
    compiled = CompiledMatcher(model, library)
    return [compiled.rows(name, arguments) for name, arguments in questions]


@pytest.mark.usefixtures("limits")
@settings(max_examples=int(0.15 * settings().max_examples), suppress_health_check=list(HealthCheck), deadline=None)
@given(seed=st.integers(0, 2**32))
@example(seed=5)
def test_matchers_with_distinct_sets_give_the_same_rows_in_the_same_order(seed: int) -> None:
    dice = Random(seed)
    model, library = places(dice, 6), Library(PLACES)
    asked = patterns(dice)
    library.add(*asked)
    compiled, naive = CompiledMatcher(model, library), NaiveMatcher(model, library)
    questions: list[tuple[str, tuple[object, ...]]] = []
    for each in asked:
        size = len(each.parameters)
        expected = list(naive.rows(each.name, (FREE,) * size))
        nodes = list(model.graph.extent("Place"))
        for mask in dice.sample(list(product((False, True), repeat=size)), 2):
            given_ = dice.choice(expected) if expected and dice.random() < 0.7 else None
            arguments = tuple(
                (given_[place] if given_ else dice.choice(nodes) if type_ != "int" else 1) if bound else FREE
                for place, (bound, type_) in enumerate(zip(mask, (p.type for p in each.parameters), strict=True))
            )
            rows = [row for row in expected if agrees(row, arguments)]
            assert_rows(compiled, each.name, arguments, rows)
            dice.choice(QUESTIONS)(compiled, each.name, arguments, rows)
            questions.append((each.name, arguments))
    with_sets = answers(model, library, questions)
    with pytest.MonkeyPatch.context() as patch:
        for module in (_duplicate_filter_code, _sources):
            patch.setattr(module, "place_duplicate_filters", lambda *_: {})
        assert answers(model, library, questions) == with_sets


def test_generated_code_contains_distinct_sets() -> None:
    library = Library(PLACES)
    library.add(pattern("far(a : Place, b : Place)", [path("Place.to.near.to.near", "a", "b")]))
    assert CompiledMatcher(Model(PLACES), library).source("far", (0,)).count(" not in ") == 3
