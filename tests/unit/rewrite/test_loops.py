"""`alap` watches what it lists or searches for again and again, until it ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from envgraph.errors import EvaluationError, TransactionError
from envgraph.graph import Model
from envgraph.match import ViewMatcher
from envgraph.rewrite import Engine
from tests.thresholds import set_thresholds
from tests.unit.rewrite.graphs import chain, definitions, engine, snapshot

RULES = """
rule mark { lhs { a : Item; check a.done == false; } modify { set a.done = true; } }
rule clear { lhs { a : Item; check a.done == true; } modify { set a.done = false; } }
rule raise_(a : Item) { lhs { check a.n < 3; } modify { set a.n += 1; } }
rule open { lhs { a : Item; check a.label == ""; } modify { set a.label = "open"; } }
rule grow { lhs { a : Item; } modify { create b : Item; } }
rule drop { lhs { a : Item; } modify { delete a; } }
rule never { lhs { a : Item; check a.n > 1000; } modify { set a.n = 0; } }
rule apart { lhs { a : Item; b : Item; check a.done == false; } modify { set a.done = true; } }
rule far { lhs { a : Item; check a.done == false; } not { a -next+-> a; } modify { set a.done = true; } }

unit plain { alap { mark; } }
unit first_ { alap { first mark; } }
unit every { alap { all mark; } }
unit inner { alap { mark; } alap { clear; } }
unit nested { alap { open; try { inner; never; } alap { mark; } } }
unit choosing { alap { { mark; never; } | { open; } } }
unit calling { alap { one; } }
unit one { mark; }
unit endless { alap { grow; } }
unit twice { alap { mark; } alap { raise_(_); } }
unit loop_in_try { try { alap { mark; } never; } alap { open; } }
unit wide { alap { first apart; } }
unit closed { alap { first far; } }
"""
UNITS = (
    "plain",
    "first_",
    "every",
    "inner",
    "nested",
    "choosing",
    "calling",
    "twice",
    "loop_in_try",
    "wide",
    "closed",
)


def made(long: int | None, monkeypatch: pytest.MonkeyPatch, model: Model | None = None) -> Engine:
    """An engine whose loops watch when they have listed so many rows."""
    if long is not None:
        set_thresholds(monkeypatch, {"long loop": long})
    return engine(RULES, model=model or chain(12))


def views(one: Engine) -> ViewMatcher:
    assert isinstance(one.matcher, ViewMatcher)
    return one.matcher


MATCHER = views(engine(RULES, model=chain(2)))
KEPT_VIEWS, LOOPS = type(MATCHER.watched_views), type(MATCHER.loops)


def assert_left(one: Engine) -> None:
    """Nothing is watched, and nothing hears of changes."""
    matcher = views(one)
    assert one.watched == () and not matcher.watched_views.views and matcher.loops.depth == 0
    assert matcher.watched_views not in one.model.graph.store.followers
    assert all(relation.added is None for relation in one.model.graph.store.relations)
    one.check_integrity()


@pytest.mark.parametrize("long", [0, 5, 40])
@pytest.mark.parametrize("unit", UNITS)
def test_the_run_can_be_replayed_and_leaves_no_views(unit: str, long: int, monkeypatch: pytest.MonkeyPatch) -> None:
    one = made(long, monkeypatch)
    plain = made(None, monkeypatch)
    start = one.model.commit()
    with one.recording() as trace:
        assert one.run(unit)
    assert_left(one)
    after = snapshot(one.model)
    one.checkout(start, discard=True)
    one.replay(trace)  # each match is looked at again
    assert snapshot(one.model) == after
    set_thresholds(monkeypatch, {"long loop": 10**9})
    plain.run(unit)
    if unit != "choosing":  # whatever is drawn, the end is the same
        assert snapshot(plain.model) == after


@pytest.mark.parametrize("unit", UNITS)
def test_a_seed_has_one_result(unit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = []
    for _ in range(2):
        one = made(7, monkeypatch)
        runs.append((one.run(unit).firings, snapshot(one.model)))
    assert runs[0] == runs[1]


def test_few_rows_are_listed_however_many_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    one = made(1_000, monkeypatch, chain(600))
    listed = 0
    original = ViewMatcher._list_rows

    def counting(matcher: ViewMatcher, pattern: str, search: Callable[[], list[object]]) -> list[object]:
        nonlocal listed
        rows = original(matcher, pattern, search)  # type: ignore[arg-type]
        listed += len(rows)
        return rows  # type: ignore[return-value]

    monkeypatch.setattr(ViewMatcher, "_list_rows", counting)
    for unit in ("plain", "calling"):
        one.run("inner")
        listed = 0
        assert one.run(unit).applications == 600 and listed < 2_000


def test_endless_loops_stop_at_the_limit_and_roll_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = made(20, monkeypatch)
    one.step_limit = 500
    before = snapshot(one.model)
    for _ in range(2):
        with pytest.raises(EvaluationError, match="took more than 500 steps, the last one in `grow`"):
            one.run("endless")
        assert snapshot(one.model) == before
        assert_left(one)


def test_watched_patterns_stay_watched_after_a_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    one = made(0, monkeypatch)
    one.watch("open")
    for unit in UNITS:
        one.run(unit)
        assert one.watched == ("open#lhs",)
        one.check_integrity()


def test_loop_views_do_not_change_results(monkeypatch: pytest.MonkeyPatch) -> None:
    one = made(0, monkeypatch)
    seen: list[object] = []

    @one.unit
    def look(engine: Engine) -> None:
        seen.append(engine.watched)
        engine.unwatch("mark")
        with pytest.raises(TransactionError):
            engine.watch("mark")
        seen.append(engine.count("mark") == sum(not node.done for node in engine.model.nodes("Item")))

    one.add(*definitions("unit u { alap { mark; look; } }"))
    assert one.run("u")
    assert seen and set(seen) == {(), True}
    assert_left(one)


@pytest.mark.parametrize("problem", [KeyboardInterrupt, ZeroDivisionError, RecursionError])
def test_an_exception_inside_a_loop_rolls_back(problem: type[BaseException], monkeypatch: pytest.MonkeyPatch) -> None:
    one = made(0, monkeypatch)
    calls = 0

    @one.unit
    def stop() -> None:
        nonlocal calls
        calls += 1
        if calls == 5:
            assert views(one).watched_views.views
            raise problem

    one.add(*definitions("unit u { try { alap { alap { open; } mark; stop; } never; } }"))
    before = snapshot(one.model)
    with pytest.raises((problem, EvaluationError)):
        one.run("u")
    assert snapshot(one.model) == before
    assert_left(one)
    assert one.run("u") and one.run("plain")
    assert_left(one)


def test_explorations_support_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    states = []
    for long in (0, 10**9):
        one = made(long, monkeypatch, chain(3))
        states.append(len(one.explore(["plain", "clear"]).states))
        assert_left(one)
    assert states[0] == states[1]


FEW = """
rule walk { lhs { x : Item -next-> y : Item; check x.done && !y.done; }
    modify { set y.done = true; set x.done = false; } }
rule back { lhs { x : Item -next-> y : Item; check y.done && !x.done; }
    modify { set x.done = true; set y.done = false; } }
rule tag { lhs { x : Item; check x.done && x.label != "end"; } modify { set x.label = "end"; } }
rule meet { lhs { x : Item; y : Special; check x.done && x.n == y.n && !y.done; } modify { set y.done = true; } }
rule stop { lhs { x : Item; check x.done; } not { x -next-> y : Item; } modify { set x.done = false; } }
rule lose { lhs { x : Item -next-> y : Item; check x.done && y.n % 40 == 39; } modify { delete x -next-> y; } }
rule ahead { lhs { x : Item; check x.done; x -next+-> y : Item; check y.label == "goal"; }
    modify { set x.done = false; } }

unit few { alap { walk; } }
unit turns { alap { walk; walk; back; } }
unit drawn { alap { walk | tag | meet; } }
unit inside { alap { alap { walk; } stop; } }
unit beside { alap { tag; alap { walk; } alap { lose; } } }
unit all_ { alap { all walk; } }
unit tested { alap { walk; if tag() { tag; } else { meet | walk; } } }
unit closed { alap { walk; try { ahead; } } }
"""


def few(length: int) -> Model:
    """Return a chain in which a few items are done and some are special."""
    model = chain(length)
    items = model.nodes("Item")
    for item in items[1 : length // 2 : 9]:
        item.done = True
    for item in items[5::11]:
        item.retype("Special")
    items[-1].label = "goal"
    return model


@pytest.mark.parametrize("unit", ["few", "turns", "drawn", "inside", "beside", "all_", "tested", "closed"])
def test_replacing_a_search_for_few_rows_by_a_view_changes_no_result(
    unit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_thresholds(monkeypatch, {"long loop": 100})
    set_thresholds(monkeypatch, {"cost of sorting a row": 1})
    aside = 0
    original = KEPT_VIEWS.sorted_view

    def counting(kept: Any, pattern: str) -> object:
        nonlocal aside
        found = original(kept, pattern)
        aside += found is not None
        return found

    monkeypatch.setattr(KEPT_VIEWS, "sorted_view", counting)
    runs = []
    for searching in (False, True):
        one = engine(FEW, model=few(60), seed=3)
        one.step_limit = 300
        if searching:
            monkeypatch.setattr(LOOPS, "_count_search", lambda *_: False)
        with one.recording() as trace:
            outcome: object
            try:
                outcome = one.run(unit).reason
            except EvaluationError as error:
                outcome = error.message
        runs.append((list(trace), outcome, snapshot(one.model)))
        assert_left(one)
        assert bool(aside) is (not searching), unit
        aside = 0
    assert runs[0] == runs[1]


def test_a_loop_whose_rule_has_one_match_searches_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    set_thresholds(monkeypatch, {"long loop": 4_000})
    one = engine(FEW, model=chain(600))
    one.model.nodes("Item")[0].done = True
    searches = 0
    original = LOOPS._count_search

    def counting(loops: Any, pattern: str) -> bool:
        nonlocal searches
        searches += 1
        return original(loops, pattern)

    monkeypatch.setattr(LOOPS, "_count_search", counting)
    assert one.run("few").applications == 599 and searches < 20
    searches = 0
    assert not one.run("few").applications and searches == 1


def test_a_closure_from_one_start_is_kept_for_a_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    text = """
    rule reach { lhs { x : Item -next+-> y : Item; check x.n == 0 && !y.done; } modify { set y.done = true; } }
    unit few { alap { reach; } }
    """
    set_thresholds(monkeypatch, {"long loop": 1_000})
    watched: list[str] = []
    original = KEPT_VIEWS.watch_temporarily

    def noting(kept: Any, *arguments: Any) -> bool:
        found = original(kept, *arguments)
        watched.extend(kept.views)
        return found

    monkeypatch.setattr(KEPT_VIEWS, "watch_temporarily", noting)
    one = engine(text, model=chain(200))
    assert one.run("few").applications == 199 and watched == ["reach#lhs"]
    assert_left(one)


def test_a_pattern_with_a_too_large_view_is_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    text = """
    rule odd { lhs { x : Item -next-> y : Item; check x.done; }
        not { a : Item -next+-> b : Item; check a.n > b.n + x.n; }
        modify { set x.done = false; set y.done = true; } }
    unit u { alap { odd; } }
    """
    set_thresholds(monkeypatch, {"long loop": 100})
    one = engine(text, model=chain(40))
    one.model.nodes("Item")[0].done = True
    assert one.run("u").applications == 39
    assert views(one).watched_views.too_large == {"odd#lhs"}
    assert_left(one)
