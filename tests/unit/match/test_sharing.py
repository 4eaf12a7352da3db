"""Questions that are asked again and again: the answers are those of the matcher, whatever has changed in between."""

from __future__ import annotations

from typing import Any

import numpy
import pytest

import envgraph
from envgraph.match import FREE, Questions
from envgraph.match.demand._sharing import _Answers
from envgraph.match.plan import CallGraph, Planner, ViewKey
from envgraph.pattern import Body, Parameter, Pattern, TypeConstraint, Variable

PATTERNS = ("craIndex", "cohesion", "coupling", "unassigned", "dependency", "tied", "several")


def test_answers_are_those_of_the_matcher_after_every_change_and_rollback() -> None:
    engine, rng = envgraph.open("assignment"), numpy.random.default_rng(3)
    names = [engine.queries.question(name)[1] for name in PATTERNS]
    questions = Questions(engine.model, engine.library)
    for step in range(60):
        chosen = engine.choose(("introduce", "assign", "move", "extract", "join"), rng)
        assert chosen is not None
        savepoint = engine.model.graph.history.savepoint()
        engine.fire(*chosen)
        for kept in (True, False):
            for name in names:
                found = engine.matcher.rows(name, engine.queries.question(name)[2])
                assert sorted(questions.rows(name)) == sorted(found)
                assert questions.count(name) == len(found)
            if kept and step % 3:
                engine.model.graph.history.release(savepoint)
                break
            if kept:
                engine.model.graph.history.rollback(savepoint)


def test_what_aggregates_is_computed_once_for_an_object(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, rng, asked = envgraph.open("assignment"), numpy.random.default_rng(3), list[tuple[int, Any]]()
    for _ in range(12):
        chosen = engine.choose(("introduce", "move", "extract"), rng)
        assert chosen is not None
        engine.fire(*chosen)
    compute = _Answers.__missing__

    def counting(answers: _Answers, value: object) -> object:
        asked.append((id(answers), value))
        return compute(answers, value)

    monkeypatch.setattr(_Answers, "__missing__", counting)
    questions = Questions(engine.model, engine.library)
    for _ in range(2):
        questions.rows(engine.queries.question("craIndex")[1])
    assert len(asked) == len(set(asked)) > len(engine.model.nodes("Class"))


def test_bodies_whose_objects_are_of_different_classes_need_no_set() -> None:
    engine = envgraph.open("assignment")
    planner = Planner(engine.library, CallGraph(engine.library))
    found = {
        name: planner.view(ViewKey(engine.queries.question(name)[1], (), outputs)).distinct
        for name, outputs in (("dependency", (0, 1, 2, 3, 4)), ("uses", (0, 1)), ("tied", (0, 1)))
    }
    assert found == {"dependency": True, "uses": True, "tied": False}


@pytest.mark.parametrize("watched", [False, True])
def test_what_changes_its_class_goes_from_one_body_to_the_other(watched: bool) -> None:
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
