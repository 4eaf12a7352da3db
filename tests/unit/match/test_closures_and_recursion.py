"""Closures and recursion on models where a wrong method would be slow, large or endless."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterable
from itertools import pairwise
from random import Random

import pytest

from envgraph.errors import MAX_NESTING, EvaluationError
from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, ViewMatcher
from envgraph.match._aggregate_values import aggregate
from envgraph.match._match_costs import DemandCosts
from envgraph.match.demand import (
    _compiled_functions as compiled,
)
from envgraph.match.demand._closure_aggregates import ClosureAggregate
from envgraph.match.demand._condensation import Condensation
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Aggregate, Check, Constraint, Library, Pattern
from tests.unit.match.kinds import Kind, assert_sound, every_kind
from tests.unit.match.writing import equal, find, fold, is_a, neg, op, path, pattern, unequal, value

CELLS = Metamodel(
    "cells",
    (
        Class(
            "Cell",
            features=(
                Attribute("n", Scalar.INT),
                Reference("east", "Cell", 0, 1, opposite="west"),
                Reference("west", "Cell", 0, 1, opposite="east"),
                Reference("south", "Cell", 0, 1, opposite="north"),
                Reference("north", "Cell", 0, 1, opposite="south"),
                Reference("to", "Cell", 0, None),
            ),
        ),
    ),
)

STEP = pattern(
    "step(a : Cell, b : Cell)",
    *([path(f"Cell.{way}", "a", "b")] for way in ("east", "west", "south", "north")),
)
REACHES = pattern("reaches(a : Cell, b : Cell)", [find("step+", "a", "b")])


def library(*patterns: object) -> Library:
    found = Library(CELLS)
    found.add(*patterns)  # type: ignore[arg-type]
    return found


def grid(width: int, height: int) -> Model:
    model = Model(CELLS)
    east, south = (model.metamodel.feature("Cell", way) for way in ("east", "south"))
    with model.loading():
        for number in range(width * height):
            model.graph.new("Cell")
            if number % width:
                model.graph.link(number - 1, east, number)  # type: ignore[arg-type]
            if number >= width:
                model.graph.link(number - width, south, number)  # type: ignore[arg-type]
    return model


def chain(length: int) -> Model:
    return grid(length, 1)


def test_a_dense_grid_does_not_materialise_its_pairs() -> None:
    model = grid(100, 100)
    matcher = CompiledMatcher(model, library(STEP, REACHES))
    tracemalloc.start()
    assert matcher.exists("reaches", (0, 9_999))
    assert matcher.count("reaches", (5_050, FREE)) == 10_000
    assert matcher.exists("reaches", (FREE, FREE))
    assert all(matcher.exists("reaches", (corner, 5_000)) for corner in (0, 99, 9_900, 9_999) for _ in range(2))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000


def test_the_cache_of_reached_objects_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DemandCosts, "most_reached", 50)
    model = grid(5, 5)
    matcher = CompiledMatcher(model, library(STEP, REACHES))
    for _ in range(3):
        assert all(matcher.exists("reaches", (a, b)) for a in range(25) for b in range(25))
    (view,) = matcher._program._closures.values()
    assert sum(len(reached) for reached in view._reached.values() if reached) <= 50


CORNER = pattern("corner(a : Cell)", [path("Cell.n", "a", 1)])
SHARED = {
    "one target": pattern("asked(a : Cell)", [is_a("Cell", "a"), find("corner", "c"), neg(find("reaches", "a", "c"))]),
    "one source": pattern("asked(a : Cell)", [is_a("Cell", "a"), find("corner", "c"), neg(find("reaches", "c", "a"))]),
    "many pairs": pattern("asked(a : Cell, b : Cell)", [path("Cell.to", "a", "b"), find("reaches", "a", "b")]),
    "one of several": pattern("asked(a : Cell)", [is_a("Cell", "a"), neg(find("corners", "a", "_"))]),
    "nothing at all": pattern("asked(a : Cell)", [is_a("Cell", "a"), neg(find("reaches", "_", "a"))]),
    "from any of several": pattern("asked(b : Cell)", [path("Cell.to", "a", "_"), find("reaches", "a", "b")]),
    "counted": pattern(
        "asked(a : Cell, n : int)", [is_a("Cell", "a"), equal("n", fold("count", find("reaches", "a", "_")))]
    ),
    "counted with a condition": pattern(
        "asked(a : Cell, n : int)", [is_a("Cell", "a"), equal("n", fold("count", find("corners", "a", "_")))]
    ),
}


def counted_searches(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """The arguments of every search along the steps of a closure from now on."""
    searches: list[tuple[object, ...]] = []
    original = compiled.StepSearches.search

    def search(steps: compiled.StepSearches, forward: bool, question: object) -> object:
        found = original(steps, forward, question)

        def counted(*arguments: object) -> object:
            searches.append(arguments)
            return found(*arguments)

        return counted

    monkeypatch.setattr(compiled.StepSearches, "search", search)
    return searches


@pytest.mark.parametrize("asked", SHARED.values(), ids=SHARED)
def test_many_closure_queries_share_one_search(asked: Pattern, monkeypatch: pytest.MonkeyPatch) -> None:
    model, to = grid(40, 40), CELLS.feature("Cell", "to")
    with model.loading():
        model.graph.set_value(1_599, CELLS.attributes[0], 1)
        for cell in range(1_600):
            model.graph.link(cell, to, 7 * cell % 1_600)  # type: ignore[arg-type]
    corners = pattern("corners(a : Cell, b : Cell)", [find("step+", "a", "b"), find("corner", "b")])
    matcher = CompiledMatcher(model, library(STEP, REACHES, CORNER, corners, asked))
    searches = counted_searches(monkeypatch)
    matcher.count("asked", (FREE,) * len(asked.parameters))
    most = 1_600 if asked is SHARED["from any of several"] else 20  # searches that find nothing more
    assert len(searches) <= most


ACYCLIC = {
    "counted": (fold("count", find("corners", "a", "_")), lambda numbers: numbers.count(1)),
    "added": (fold("sum", find("numbers", "a", "_", "#")), sum),
    "the largest": (fold("max", find("numbers", "a", "_", "#")), max),
    "different ones": (fold("count", find("different", "a", "_")), lambda numbers: len(set(numbers))),
}


@pytest.mark.parametrize(("asked", "expected"), ACYCLIC.values(), ids=ACYCLIC)
def test_aggregates_over_acyclic_closures_share_work(
    asked: Aggregate, expected: Callable[[list[int]], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = grid(30, 30)
    with model.loading():
        for cell in range(900):
            model.graph.set_value(cell, CELLS.attributes[0], 1 + cell % 7)
    matcher = CompiledMatcher(
        model,
        library(
            pattern(
                "step(a : Cell, b : Cell)",
                [path("Cell.east", "a", "b")],
                [path("Cell.south", "a", "b")],
            ),
            CORNER,
            pattern("corners(a : Cell, b : Cell)", [find("step+", "a", "b"), find("corner", "b")]),
            pattern("numbers(a : Cell, b : Cell, n : int)", [find("step+", "a", "b"), path("Cell.n", "b", "n")]),
            pattern("different(a : Cell, n : int)", [find("step+", "a", "b"), path("Cell.n", "b", "n")]),
            pattern("asked(a : Cell, n : int)", [is_a("Cell", "a"), equal("n", asked)]),
        ),
    )
    searches = counted_searches(monkeypatch)
    rows = dict(matcher.rows("asked", (FREE, FREE)))
    assert len(searches) <= 200  # those that reach little are searched for
    for cell in (0, 450, 451, 800):
        below = [c for c in range(cell + 1, 900) if c % 30 >= cell % 30]
        assert rows[cell] == expected([1 + c % 7 for c in below])


def test_separate_counts_of_a_closure_share_work(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = pattern("corners(a : Cell, b : Cell)", [find("step+", "a", "b"), find("corner", "b")])
    model = grid(30, 30)
    with model.loading():
        for cell in range(0, 900, 3):
            model.graph.set_value(cell, CELLS.attributes[0], 1)
    south_east = pattern("step(a : Cell, b : Cell)", [path("Cell.east", "a", "b")], [path("Cell.south", "a", "b")])
    matcher = CompiledMatcher(model, library(south_east, CORNER, corners))
    searches = counted_searches(monkeypatch)
    for cell in range(900):
        below = [c for c in range(cell + 1, 900) if c % 30 >= cell % 30]
        assert matcher.count("corners", (cell, FREE)) == sum(c % 3 == 0 for c in below)
    assert len(searches) <= 200


def test_reached_objects_come_nearest_first() -> None:
    matcher = CompiledMatcher(
        chain(6), library(REACHES, pattern("step(a : Cell, b : Cell)", [path("Cell.east", "a", "b")]))
    )
    assert matcher.rows("reaches", (2, FREE)) == [(2, 3), (2, 4), (2, 5)]
    assert matcher.rows("reaches", (FREE, 3)) == [(2, 3), (1, 3), (0, 3)]


def test_the_closure_of_an_empty_pattern_is_empty() -> None:
    nowhere = pattern(
        "step(a : Cell, b : Cell)",
        [path("Cell.east", "a", "b"), equal("n", 1), equal("n", 2), path("Cell.n", "a", "n")],
    )
    matcher = CompiledMatcher(chain(3), library(nowhere, REACHES))
    assert matcher.rows("reaches", (FREE, FREE)) == []
    assert not matcher.exists("reaches", (0, 1))


RIGHT = pattern(
    "right(a : Cell, b : Cell)",
    [path("Cell.east", "a", "b")],
    [path("Cell.east", "a", "c"), find("right", "c", "b")],
)


def test_deep_recursion_does_not_exhaust_the_stack() -> None:
    matcher = CompiledMatcher(chain(2_000), library(RIGHT))
    assert matcher.exists("right", (0, 1_999))
    assert not matcher.exists("right", (1_999, 0))
    assert matcher.count("right", (1_990, FREE)) == 9


def test_the_order_of_recursive_rows_does_not_depend_on_earlier_queries() -> None:
    model = chain(8)
    one, other = (CompiledMatcher(model, library(RIGHT)) for _ in range(2))
    for start in (5, 0, 3):
        other.rows("right", (start, FREE))
    assert (
        one.rows("right", (FREE, FREE)) == other.rows("right", (FREE, FREE)) == sorted(one.rows("right", (FREE, FREE)))
    )


def test_results_of_recursive_patterns_are_copies() -> None:
    matcher = CompiledMatcher(chain(3), library(RIGHT))
    matcher.rows("right", (FREE, FREE)).clear()
    matcher.prepare("right", ())().clear()
    assert len(matcher.rows("right", (FREE, FREE))) == 3


def test_the_cache_of_recursive_patterns_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DemandCosts, "most_rows", 10)
    matcher = CompiledMatcher(chain(8), library(RIGHT))
    for start in range(8):
        assert matcher.count("right", (start, FREE)) == 7 - start
        assert matcher._program._recursion._kept <= 10 + 2 * 8  # what one question takes comes on top


DISTANCE = pattern(
    "distance(a : Cell, b : Cell, n : int)",
    [path("Cell.east", "a", "b"), equal("n", 1)],
    [find("distance", "a", "c", "m"), path("Cell.east", "c", "b"), equal("n", value(op("m", "+", 1)))],
)


@every_kind
def test_recursion_may_compute_values(kind: Kind) -> None:
    matcher = kind(chain(5), library(DISTANCE))
    assert matcher.rows("distance", (0, 3, FREE)) == [(0, 3, 3)]
    assert sorted(matcher.rows("distance", (FREE, 2, FREE))) == [(0, 2, 2), (1, 2, 1)]


def test_recursion_with_endlessly_many_values_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    model = chain(3)
    model.node(2).east = model.node(0)
    matcher = CompiledMatcher(model, library(DISTANCE))
    with pytest.raises(EvaluationError, match="recursive pattern `distance` has more than 1,000 "):
        matcher.rows("distance", (FREE, FREE, FREE))
    model.node(2).east = None
    assert matcher.count("distance", (FREE, FREE, FREE)) == 3


def test_recursion_terminates_on_large_cycles() -> None:
    model = grid(6, 6)
    transitive = pattern(
        "all(a : Cell, b : Cell)", [find("step", "a", "b")], [find("all", "a", "c"), find("all", "c", "b")]
    )
    matcher = CompiledMatcher(model, library(STEP, transitive))
    assert matcher.count("all", (FREE, FREE)) == 36 * 36
    assert matcher.count("all", (7, FREE)) == 36


NESTED = {
    "closures of closures": lambda below: [[find(f"{below}+", "a", "b")]],
    "closures of several bodies": lambda below: [
        [find(f"{below}+", "a", "c"), path("Cell.east", "c", "b")],
        [find(f"{below}*", "b", "a")],
    ],
    "negations of negations": lambda below: [
        [path("Cell.east*", "a", "b"), neg(find(below, "a", "_")), neg(find(below, "_", "b"))]
    ],
    "recursion on recursion": lambda below: [
        [find(below, "a", "b")],
        [find(below, "a", "c"), path("Cell.east", "c", "b")],
    ],
}


@pytest.mark.parametrize("bodies", NESTED.values(), ids=NESTED)
def test_nested_calls_do_not_double_the_work_at_each_level(
    bodies: Callable[[str], list[list[Constraint]]],
) -> None:
    levels = 30
    patterns = [pattern("p0(a : Cell, b : Cell)", [path("Cell.east", "a", "b")])]
    patterns += [pattern(f"p{level}(a : Cell, b : Cell)", *bodies(f"p{level - 1}")) for level in range(1, levels)]
    model = chain(3)
    matcher = CompiledMatcher(model, library(*patterns))
    rows = matcher.rows(f"p{levels - 1}", (FREE, FREE))
    asked = [matcher.rows(f"p{levels - 1}", (cell, FREE)) for cell in range(3)]
    assert sorted(rows) == sorted(row for each in asked for row in each)
    model.graph.set_target(0, model.metamodel.feature("Cell", "east"), None)  # type: ignore[arg-type]
    anew = CompiledMatcher(model, library(*patterns)).rows(f"p{levels - 1}", (FREE, FREE))
    assert sorted(matcher.rows(f"p{levels - 1}", (FREE, FREE))) == sorted(anew) != sorted(rows)


def test_unreachable_pairs_are_found_with_one_search_for_each_source() -> None:
    apart = pattern(
        "apart(a : Cell, b : Cell)",
        [is_a("Cell", "a"), is_a("Cell", "b"), unequal("a", "b"), neg(find("reaches", "a", "b"))],
    )
    model = grid(8, 8)
    for number in range(64):
        model.graph.set_target(number, model.metamodel.feature("Cell", "south"), None)  # type: ignore[arg-type]
    matcher = CompiledMatcher(model, library(STEP, REACHES, apart))
    assert matcher.count("apart", (FREE, FREE)) == 64 * 56


@every_kind
def test_closures_of_arrows_continue_at_objects_of_other_classes(
    kind: Kind,
) -> None:
    metamodel = Metamodel(
        "road",
        (
            Class("Place", abstract=True, features=(Reference("next", "Place", 0, 1),)),
            Class("Start", supertypes=("Place",)),
            Class("Road", supertypes=("Place",)),
        ),
    )
    model = Model(metamodel)
    places = [model.graph.new("Start"), *(model.graph.new("Road") for _ in range(3))]
    for one, other in pairwise(places):
        model.graph.set_target(one, metamodel.references[0], other)
    library = Library(metamodel)
    library.add(pattern("ahead(a : Start, b : Place)", [path(".next+", "a", "b")]))
    assert sorted(kind(model, library).rows("ahead", (FREE, FREE))) == [(0, 1), (0, 2), (0, 3)]


@every_kind
def test_checks_with_constants_of_different_types_are_distinct(
    kind: Kind,
) -> None:
    model = Model(CELLS)
    model.graph.new("Cell")
    library = Library(CELLS)
    exact, whole = (Check(op(0, "<", op(one, "/", 2))) for one in (1.0, 1))  # 0 < 0.5, and 0 < 0
    library.add(pattern("both(a : Cell)", [is_a("Cell", "a"), exact, whole]))
    assert not kind(model, library).exists("both", (FREE,))


def nested(levels: int, kind: str) -> list[Pattern]:
    """Closures or recursive patterns inside each other."""
    found = [pattern("p0(a : Cell, b : Cell)", [path("Cell.east", "a", "b")])]
    for level in range(levels):
        below, own = f"p{level}", f"p{level + 1}"
        bodies: list[list[Constraint]] = [[find(f"{below}+", "a", "b")]]
        if kind == "recursive patterns":
            bodies = [[find(below, "a", "b")], [find(own, "a", "c"), find(below, "c", "b")]]
        found.append(pattern(f"{own}(a : Cell, b : Cell)", *bodies))
    return found


@pytest.mark.parametrize("kind", ["closures", "recursive patterns"])
def test_too_deep_nesting_of_calls_is_an_error(kind: str) -> None:
    model, patterns = chain(4), library(*nested(MAX_NESTING + 1, kind))
    matcher, views = CompiledMatcher(model, patterns), ViewMatcher(model, patterns)
    deepest, too_deep = f"p{MAX_NESTING}", f"p{MAX_NESTING + 1}"
    assert matcher.rows(deepest, (0, FREE)) == [(0, 1), (0, 2), (0, 3)]
    assert matcher.count(deepest, (FREE, FREE)) == 6
    message = f"`{too_deep}` cannot be evaluated: it nests 101 closures and recursive patterns inside each other"
    for question in (
        lambda: matcher.rows(too_deep, (0, FREE)),
        lambda: matcher.exists(too_deep, (FREE, FREE)),
        lambda: matcher.prepare(too_deep, (0,)),
        lambda: matcher.why_not(too_deep, {0: 0}),
        lambda: views.watch(too_deep),
        lambda: views.count(too_deep, (FREE, FREE)),
    ):
        with pytest.raises(EvaluationError, match=message):
            question()
    views.watch_later(too_deep, deepest)
    assert views.watched == (deepest,)
    assert views.count(deepest, (FREE, FREE)) == 6


def test_querying_a_recursive_pattern_with_a_version_in_use_changes_nothing() -> None:
    model = grid(3, 3)
    step = pattern("step(a : Cell, b : Cell)", *([path(f"Cell.{way}", "a", "b")] for way in ("east", "south")))
    far = pattern(
        "far(a : Cell, b : Cell)",
        [find("step", "a", "b")],
        [find("far", "a", "c"), find("step", "c", "b"), find("many", "c", "_")],
    )
    many = pattern("many(a : Cell, n : int)", [is_a("Cell", "a"), equal("n", fold("count", find("step", "a", "_")))])
    version = model.commit()
    matcher = CompiledMatcher(model, library(step, many, far))
    assert matcher.count("far", (FREE, FREE)) == 27
    assert not model.graph.store.journal
    model.checkout(version)
    assert matcher.count("far", (FREE, FREE)) == 27


@every_kind
@pytest.mark.parametrize(
    "body",
    [
        [find("rows", "a", "m"), path("Cell.to", "m", "b")],
        [path("Cell.to", "a", "m"), find("rows", "m", "b")],
        [find("rows", "a", "m"), find("rows", "m", "b")],
    ],
    ids=["left", "right", "double"],
)
def test_a_recursive_pattern_without_base_rows_is_empty(kind: Kind, body: list[Constraint]) -> None:
    zero = path("Cell.n", "a", 0)
    patterns = library(
        pattern("rows(a : Cell, b : Cell)", body),
        pattern("from(a : Cell, b : Cell)", [zero, find("rows", "a", "b")]),
        pattern("without(a : Cell, b : Cell)", [zero, path("Cell.to", "a", "b"), neg(find("rows", "a", "b"))]),
    )
    model = Model(CELLS)
    n, to = (model.metamodel.feature("Cell", name) for name in ("n", "to"))
    matcher = kind(model, patterns)
    first, second = model.graph.new("Cell"), model.graph.new("Cell")
    model.graph.set_value(second, n, 1)  # type: ignore[arg-type]
    for near, far in ((first, second), (second, first)):
        model.graph.link(near, to, far)  # type: ignore[arg-type]
    assert matcher.count("from", (FREE, FREE)) == 0
    assert list(matcher.rows("without", (FREE, FREE))) == [(first, second)]
    assert_sound(matcher)


# --- aggregates over sets of reached objects, against the aggregates of the tuples one by one

Rows = list[tuple[int, ...] | tuple[int, int, float]]


OTHERS = [("by object", kind) for kind in ("several each", "shared", "floats")]
"""Where an object may have several values, or a tuple several objects, objects are not looked at one by one."""


def rows_of(kind: str, dice: Random) -> Rows:
    """Rows of an end, what else is in the tuple, and a value."""
    ends = range(0, 60, 2)
    rows: dict[tuple[int, int | float, int | float], None] = {}
    for _ in range(60):
        end, value = dice.choice(ends), dice.randint(-3, 3) if kind != "floats" else dice.random()
        other = {"one each": end, "several each": dice.randint(0, 9) + 100 * end}.get(kind, dice.randint(0, 9))
        rows[end, other, 5 if kind == "one each" else value] = None
    return list(rows)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["one each", "several each", "shared", "floats"])
@pytest.mark.parametrize("function", ["count", "sum", "avg", "min", "max"])
@pytest.mark.parametrize("way", ["by class", "by object", "whatever is less work"])
def test_a_closure_aggregate_agrees_with_the_aggregate_of_the_tuples(
    function: str, kind: str, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice = Random(f"{function} {kind}")
    rows = rows_of(kind, dice)
    if way == "by class":
        monkeypatch.setattr(DemandCosts, "class_cost", 0)
    elif way == "by object":
        monkeypatch.setattr(DemandCosts, "most_classes", 0)
        monkeypatch.setattr(DemandCosts, "dense", 1_000)
    column = 0 if function == "count" else 2
    closure = ClosureAggregate(function, column, rows)
    nodes: list[int] = []
    for node in dice.sample(range(60), 60):
        nodes.append(node)
        closure.assign_bits(nodes)
        reached = [each for each in nodes if dice.random() < 0.5]
        found = closure.value(sum(1 << nodes.index(each) for each in reached))
        tuples = dict.fromkeys(row[1:] for row in rows if row[0] in reached)
        expected = aggregate(function, [row[-1] for row in tuples])
        if found is not None:
            assert found == (expected,)
        elif reached:
            assert way == "whatever is less work" or (way, kind) in OTHERS


def test_a_sum_beyond_64_bits_has_no_value() -> None:
    closure = ClosureAggregate("sum", 1, [(1, 2**62), (2, 2**62 + 1), (3, -2)])
    closure.assign_bits([1, 2, 3])
    assert (closure.sum_up(0b011), closure.sum_up(0b111), closure.sum_up(0)) == (None, 2**63 - 1, 0)


# --- reachability of many pairs, after exceptions

LINKS = {1: [2], 2: [3], 3: [1, 4], 4: [5], 5: [4, 6], 6: []}
REACHED_BY = {1: 6, 2: 6, 3: 6, 4: 3, 5: 3, 6: 0}


@pytest.mark.parametrize("found", range(3))
def test_an_interrupted_condensation_is_computed_anew(found: int) -> None:
    left = found

    class Bits(dict[int, int]):
        """Raises when components have become known so often."""

        def update(self, items: object) -> None:
            nonlocal left
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
            super().update(items)  # type: ignore[call-overload]

    reached = Condensation(LINKS.__getitem__)
    reached._bits = Bits()
    with pytest.raises(KeyboardInterrupt):
        reached.size(1)
    left = 100
    assert {node: reached.size(node) for node in (6, 4, 1, 2, 3, 5)} == REACHED_BY
    pairs: Iterable[tuple[int, int]] = ((a, b) for a in LINKS for b in LINKS)
    assert sum(reached.reaches(*pair) for pair in pairs) == sum(REACHED_BY.values())
