"""The Train Benchmark: published counts, and the six queries against loops by hand after every batch of edits."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from inspect import signature
from typing import Any

import pytest

from benchmarks._railway import QUERIES, build, generate, workspace
from benchmarks._railway_edits import BATCHES, QUOTAS, Operation, Protocol, Quota, rows_of, steps
from envgraph.lang import Workspace
from envgraph.match import FREE, CompiledMatcher, Row
from envgraph.rewrite import Engine, Match
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.railway_by_hand import BY_HAND
from tests.profile import AT_NIGHT, NIGHTLY

LARGE = 8 if NIGHTLY else 2
"""Size of the larger railway: what by hand is compared after each batch takes longer than all else."""

RUNS = [
    pytest.param(kind, size, quota, id=f"{kind}-{size}-{quota}")
    for kind in ("repair", "inject")
    for size in (1, LARGE)
    for quota in QUOTAS
    if NIGHTLY or (size == LARGE) == (quota is QUOTAS[0])
]


@pytest.fixture(scope="module")
def domain() -> Workspace:
    """The bundled domain, which has no problems."""
    found = workspace()
    assert found.diagnostics == ()
    return found


def engine_on(domain: Workspace, scenario: str, size: int) -> Engine:
    """An engine with all queries and rules on a generated railway."""
    assert domain.metamodel is not None
    return domain.engine_on(build(generate(scenario, size), domain.metamodel))


def counts(engine: Engine) -> list[int]:
    return [engine.count(f"railway.{query}") for query in QUERIES]


def assert_as_by_hand(engine: Engine) -> None:
    """Each query has the matches that the loops find, each once; the engine's, and on demand."""
    on_demand = CompiledMatcher(engine.model, engine.library)
    for query in QUERIES:
        pattern = f"railway.{query}"
        expected = sorted(BY_HAND[query](engine.model))
        assert sorted(rows_of(engine, pattern)) == expected, query
        assert sorted(on_demand.prepare(pattern, ())()) == expected, query


@pytest.mark.parametrize(
    ("scenario", "size", "expected"),
    [
        ("batch", 1, [0, 0, 0, 0, 0, 0]),
        ("repair", 1, [52, 0, 12, 1, 4, 8]),
        ("repair", 8, [868, 5, 145, 24, 70, 47]),
        pytest.param("repair", 64, [8_163, 78, 1_415, 232, 821, 236], marks=AT_NIGHT),
    ],
)
def test_match_counts_equal_the_published_counts(
    domain: Workspace, scenario: str, size: int, expected: list[int]
) -> None:
    engine = engine_on(domain, scenario, size)
    assert counts(engine) == expected
    assert_as_by_hand(engine)


@pytest.mark.parametrize(
    "scenario",
    [pytest.param("batch", marks=AT_NIGHT), "repair", pytest.param("inject", marks=AT_NIGHT)],
)
def test_naive_matcher_finds_the_same_rows(domain: Workspace, scenario: str) -> None:
    engine = engine_on(domain, scenario, 1)
    naive = NaiveMatcher(engine.model, engine.library)
    for query in QUERIES:
        pattern = f"railway.{query}"
        free = (FREE,) * len(engine.library.parameter_types(pattern))
        assert list(naive.rows(pattern, free)) == list(rows_of(engine, pattern))


def snapshot(engine: Engine) -> list[list[Row]]:
    """The rows of the six queries, in order."""
    return [list(rows_of(engine, f"railway.{query}")) for query in QUERIES]


@pytest.mark.parametrize(("kind", "size", "quota"), RUNS)
def test_views_are_updated_by_batches_rollbacks_and_versions(
    domain: Workspace, kind: str, size: int, quota: Quota
) -> None:
    """After every batch, after it is rolled back and done again, and at every version: rows, and their order."""
    engine = engine_on(domain, kind, size)
    model = engine.model
    engine.watch(*(f"railway.{query}" for query in QUERIES))
    protocol = Protocol(engine, kind, quota)
    states = [(engine.commit(), snapshot(engine))]
    for _ in range(BATCHES):
        batch = list(steps(protocol.choose()))
        savepoint = model.graph.history.savepoint()
        edit(batch)
        done = snapshot(engine)
        model.graph.history.rollback(savepoint)
        assert snapshot(engine) == states[-1][1]
        edit(batch)
        assert snapshot(engine) == done
        assert_as_by_hand(engine)
        states.append((engine.commit(), done))
    for version, rows in (*reversed(states), *states[::3], states[-1]):
        engine.checkout(version)
        assert snapshot(engine) == rows
    engine.check_integrity()


@pytest.mark.parametrize("kind", ["repair", "inject"])
def test_listeners_are_notified_of_the_difference_between_states(domain: Workspace, kind: str) -> None:
    engine = engine_on(domain, kind, LARGE)
    heard: dict[str, set[Row]] = {}
    for query in QUERIES:
        rows = heard[query] = set(rows_of(engine, f"railway.{query}"))
        engine.listen(query, partial(follow, rows))
    protocol = Protocol(engine, kind, Quota(fixed=10))
    for _ in range(BATCHES):
        with engine.transaction():
            edit(steps(protocol.choose()))
        for query in QUERIES:
            assert heard[query] == set(rows_of(engine, f"railway.{query}"))
    assert_as_by_hand(engine)


def follow(rows: set[Row], appeared: list[Match], disappeared: list[Match]) -> None:
    """Keep rows as a listener would; nothing appears that was there, or goes that was not."""
    gone, new = {match.row for match in disappeared}, {match.row for match in appeared}
    assert gone <= rows
    assert not new & rows
    rows -= gone
    rows |= new


def edit(batch: Iterable[tuple[Operation, Row]]) -> None:
    for operation, row in batch:
        operation.edit(*row)


def test_repairs_remove_all_violations(domain: Workspace) -> None:
    engine = engine_on(domain, "repair", 1)
    protocol = Protocol(engine, "repair", Quota(fixed=10))
    for _ in range(BATCHES):
        edit(steps(protocol.choose()))
    assert counts(engine) == [0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("kind", ["repair", "inject"])
def test_rules_change_the_model_like_the_python_operations(domain: Workspace, kind: str) -> None:
    """At each chosen match, unless it is gone by then: the same facts, ids of new elements included."""
    engine = engine_on(domain, kind, 8)
    model = engine.model
    protocol = Protocol(engine, kind, Quota(fixed=10))
    done: set[str] = set()
    for _ in range(BATCHES):
        for operation, row in steps(protocol.choose()):
            savepoint = model.graph.history.savepoint()
            applied = engine.apply(operation.rule, **arguments(engine, operation, row))
            by_rule = model.state_hash()
            model.graph.history.rollback(savepoint)
            operation.edit(*row)
            if applied is not None:
                assert model.state_hash() == by_rule, operation.rule
                done.add(operation.query)
    assert done == set(QUERIES)


def arguments(engine: Engine, operation: Operation, row: Row) -> dict[str, Any]:
    """The variables of the rule that the match of an operation has."""
    variables = engine.prepare(operation.rule).shape.names
    found = zip(signature(operation.edit).parameters, row, strict=True)
    return {name: value for name, value in found if name in variables}
