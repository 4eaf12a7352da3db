"""Questions about watched patterns with some values given: they read the view where a search is expensive."""

from __future__ import annotations

from itertools import product
from random import Random

import pytest

from envgraph.graph import Model
from envgraph.match import FREE, CompiledMatcher, Row, ViewMatcher
from envgraph.metamodel import Reference
from envgraph.pattern import Library
from tests.oracle.naive._naive import NaiveMatcher
from tests.thresholds import set_thresholds
from tests.unit.match.people import METAMODEL
from tests.unit.match.writing import equal, find, fold, is_a, path, pattern, unequal

PATTERNS = (
    pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")]),
    pattern("reaches(a : Person, b : Person)", [find("knows+", "a", "b"), unequal("a", "b")]),
    pattern(
        "circle(a : Person, n : int)",
        [is_a("Person", "a"), equal("n", fold("count", find("reaches", "a", "_")))],
    ),
    pattern("equals(a : Person, b : Person, n : int)", [find("circle", "a", "n"), find("circle", "b", "n")]),
    pattern(
        "within(a : Person, b : Person)",
        [find("knows", "a", "b")],
        [find("within", "a", "m"), find("knows", "m", "b")],
    ),
)
WATCHED = ("reaches", "circle", "equals", "within")
KNOWS = METAMODEL.feature("Person", "knows")


def library() -> Library:
    found = Library(METAMODEL)
    found.add(*PATTERNS)
    return found


def watching(number: int) -> ViewMatcher:
    """Views of people who know a few others, which some of them follow."""
    model, dice = Model(METAMODEL), Random(3)
    assert isinstance(KNOWS, Reference)
    with model.loading():
        people = [model.graph.new("Person") for _ in range(number)]
        for one in people:
            for other in dice.sample(people, 2):
                if other > one and other < one + 20:
                    model.graph.link(one, KNOWS, other)
    views = ViewMatcher(model, library())
    views.watch(*WATCHED)
    return views


def change(model: Model, dice: Random) -> None:
    """Add or take away a link."""
    assert isinstance(KNOWS, Reference)
    people = list(model.graph.extent("Person"))
    one, other = dice.choice(people), dice.choice(people)
    if other in model.graph.targets(one, KNOWS):
        model.graph.unlink(one, KNOWS, other)
    else:
        model.graph.link(one, KNOWS, other)


def size(views: ViewMatcher, name: str) -> int:
    """Number of parameters."""
    return len(views.library.parameter_types(name))


def agrees(row: Row, arguments: tuple[object, ...]) -> bool:
    """Whether a row has the given values."""
    return all(argument is FREE or argument == value for argument, value in zip(arguments, row, strict=True))


def questions(views: ViewMatcher) -> list[tuple[str, tuple[object, ...]]]:
    """Each pattern with values that some row has, at each set of positions, and with others."""
    found: list[tuple[str, tuple[object, ...]]] = []
    for name in WATCHED:
        rows = views.rows(name, (FREE,) * size(views, name))
        for chosen in [*rows[::7], tuple(1 for _ in rows[0])]:
            for mask in product((False, True), repeat=len(chosen)):
                found.append((name, tuple(v if bound else FREE for v, bound in zip(chosen, mask, strict=True))))
    return found


WAYS = {
    "rows": (0.0, 0.0),
    "index": (0.0, 20.0),
    "search": (0.0, 1e9),
    "some": (400.0, 2.0),
    "none": (1e9, 2.0),
}


@pytest.mark.parametrize(("expensive", "read"), WAYS.values(), ids=WAYS)
def test_answers_are_those_of_the_naive_matcher_and_their_order_belongs_to_the_version(
    expensive: float, read: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    thresholds = {"expensive search for a question": expensive, "cost of reading a row": read}
    set_thresholds(monkeypatch, thresholds)
    views, dice = watching(12), Random(5)
    naive = NaiveMatcher(views.model, views.library)
    start = views.model.graph.history.savepoint()
    asked = questions(views)
    before = [list(views.rows(*question)) for question in asked]
    for _ in range(2):
        change(views.model, dice)
        everything = {name: naive.rows(name, (FREE,) * size(views, name)) for name in WATCHED}
        for name, arguments in dice.sample(questions(views), 40):
            expected = [row for row in everything[name] if agrees(row, arguments)]
            rows = views.rows(name, arguments)
            assert sorted(rows) == expected
            assert views.first(name, arguments) == (rows[0] if rows else None)
            assert views.count(name, arguments) == len(expected)
            assert views.exists(name, arguments) is bool(expected)
    views.model.graph.history.rollback(start)
    again = dict(zip(asked, before, strict=True))
    for question in [*asked[::-3], *asked]:
        assert list(views.rows(*question)) == again[question]


def test_an_expensive_pattern_is_searched_for_once_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    views = watching(60)
    expected = {n: views.demand.rows("circle", (FREE, n)) for n in range(20)}
    searched: list[str] = []
    original = CompiledMatcher._specialised

    def specialised(matcher: CompiledMatcher, pattern: str, *others: object) -> object:
        searched.append(pattern)
        return original(matcher, pattern, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(CompiledMatcher, "_specialised", specialised)
    for n in range(20):
        rows = views.rows("circle", (FREE, n))
        assert sorted(rows) == sorted(expected[n])
        assert views.first("circle", (FREE, n)) == next(iter(rows), None)
    assert views.rows("equals", (0, FREE, FREE)) and not searched


def test_partial_lookup_results_are_copies() -> None:
    views = watching(20)
    everything: list[Row] = list(views.rows("circle", (FREE, FREE)))
    for arguments in [(FREE, 0), (FREE, 0), (0, FREE)]:
        rows = views.rows("circle", arguments)
        assert isinstance(rows, list)
        rows.clear()
    assert [row for row in everything if row[1] == 0] == views.rows("circle", (FREE, 0))


def holding_an_index(number: int) -> ViewMatcher:
    """Views of `circle`, with an index by `n`."""
    views = watching(number)
    for _ in range(3):
        views.count("circle", (FREE, 1))
    assert list(views.watched_views.views["circle"].rows.indexes) == [(1,)]
    return views


def test_an_index_follows_changes_rollbacks_and_checkouts() -> None:
    views, dice = holding_an_index(40), Random(7)
    model, rows = views.model, views.watched_views.views["circle"].rows
    index = rows.indexes[1,]

    def compare() -> None:
        for n in range(6):
            expected = [row for row in views.rows("circle", (FREE, FREE)) if row[1] == n]
            assert views.rows("circle", (FREE, n)) == expected
            assert views.first("circle", (FREE, n)) == (expected[0] if expected else None)
        views.check_integrity()
        assert rows.indexes == {(1,): index}, "it is not made anew"

    versions = [model.commit()]
    for _ in range(4):
        savepoint = model.graph.history.savepoint()
        for _ in range(6):
            change(model, dice)
        compare()
        model.graph.history.rollback(savepoint)
        compare()
        for _ in range(30):
            change(model, dice)
        compare()
        versions.append(model.commit())
    for version in [*versions[::2], *versions[::-1]]:
        model.checkout(version)
        compare()


def test_an_index_does_not_outlive_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    views, dice = holding_an_index(20), Random(7)
    rows = views.watched_views.views["circle"].rows

    def interrupted(index: object, row: Row) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        (index,) = rows.indexes.values()
        patched.setattr(type(index), "insert", interrupted)
        for _ in range(20):
            change(views.model, dice)
            views.count("circle", (FREE, 1))
    assert not rows.indexes
    for n in range(4):
        assert views.count("circle", (FREE, n)) == len(views.demand.rows("circle", (FREE, n)))
    views.check_integrity()


def test_class_scans_are_answered_by_views_of_any_size() -> None:
    """The model is small, and so is an estimate of the search: in a large one it would be slow."""
    model, queries = Model(METAMODEL), Library(METAMODEL)
    queries.add(
        pattern("peers(a : Person, b : Person)", [path("Person.age", "a", "n"), path("Person.age", "b", "n")]),
        pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")]),
    )
    people = [model.graph.new("Person") for _ in range(8)]
    views = ViewMatcher(model, queries)
    views.watch("peers", "knows")
    assert views.demand.cost("peers", (0,)) == float("inf") and views.demand.cost("knows", (0,)) == 10
    prepared = views.prepare("peers", (0,))
    for one in people:
        model.node(one).age = one % 3
        assert prepared(one) == views.rows("peers", (one, FREE))
        assert sorted(prepared(one)) == sorted(views.demand.rows("peers", (one, FREE)))
    assert views.watched_views.views["peers"].rows.indexes and not views.watched_views.views["knows"].rows.indexes
