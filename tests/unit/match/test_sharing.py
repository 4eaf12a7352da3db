"""Questions that are asked again and again: the answers are those of the matcher, whatever has changed in between."""

from __future__ import annotations

from typing import Any

import numpy
import pytest

import envgraph
from envgraph.match import FREE, RepeatedQueries
from envgraph.match.demand._repeated_queries import _ResultCache
from envgraph.match.plan import CallGraph, PatternQuery, Planner
from envgraph.pattern import Body, Parameter, Pattern, TypeConstraint, Variable

PATTERNS = ("craIndex", "cohesion", "coupling", "unassigned", "dependency", "tied", "several")


def test_shared_answers_equal_the_matcher_after_every_change_and_rollback() -> None:
    engine, rng = envgraph.open("assignment"), numpy.random.default_rng(3)
    names = [engine.queries.resolve_query(name)[1] for name in PATTERNS]
    questions = RepeatedQueries(engine.model, engine.library)
    for step in range(60):
        chosen = engine.choose(("introduce", "assign", "move", "extract", "join"), rng)
        assert chosen is not None
        savepoint = engine.model.graph.history.savepoint()
        engine.fire(*chosen)
        for kept in (True, False):
            for name in names:
                found = engine.matcher.rows(name, engine.queries.resolve_query(name)[2])
                assert sorted(questions.rows(name)) == sorted(found)
                assert questions.count(name) == len(found)
            if kept and step % 3:
                engine.model.graph.history.release(savepoint)
                break
            if kept:
                engine.model.graph.history.rollback(savepoint)


def test_aggregates_are_computed_once_for_each_object(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, rng, asked = envgraph.open("assignment"), numpy.random.default_rng(3), list[tuple[int, Any]]()
    for _ in range(12):
        chosen = engine.choose(("introduce", "move", "extract"), rng)
        assert chosen is not None
        engine.fire(*chosen)
    compute = _ResultCache.__missing__

    def counting(answers: _ResultCache, value: object) -> object:
        asked.append((id(answers), value))
        return compute(answers, value)

    monkeypatch.setattr(_ResultCache, "__missing__", counting)
    questions = RepeatedQueries(engine.model, engine.library)
    for _ in range(2):
        questions.rows(engine.queries.resolve_query("craIndex")[1])
    assert len(asked) == len(set(asked)) > len(engine.model.nodes("Class"))


def test_bodies_over_disjoint_classes_need_no_distinct_set() -> None:
    engine = envgraph.open("assignment")
    planner = Planner(engine.library, CallGraph(engine.library))
    found = {
        name: planner.plan_pattern(PatternQuery(engine.queries.resolve_query(name)[1], (), outputs)).is_distinct
        for name, outputs in (("dependency", (0, 1, 2, 3, 4)), ("uses", (0, 1)), ("tied", (0, 1)))
    }
    assert found == {"dependency": True, "uses": True, "tied": False}


@pytest.mark.parametrize("watched", [False, True])
def test_retyped_objects_change_the_body_that_they_match(watched: bool) -> None:
    engine, rng = envgraph.open("burning_forest"), numpy.random.default_rng(3)
    bodies = (Body((TypeConstraint(cls, Variable("tile")),)) for cls in ("BurningTile", "RoadTile"))
    engine.library.add(Pattern("dry", (Parameter("tile", "Tile"),), tuple(bodies)))
    if watched:
        engine.watch("dry")
    for _ in range(30):
        chosen = engine.choose(("retypings",), rng)
        assert chosen is not None
        engine.fire(*chosen)
        found = {(node,) for cls in ("BurningTile", "RoadTile") for node in engine.model.graph.extent(cls)}
        assert {*engine.matcher.rows("dry", (FREE,))} == found
        assert engine.count("dry") == len(found)
