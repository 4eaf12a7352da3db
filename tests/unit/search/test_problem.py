"""Constraints, one by one and as the one query that a search asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from numpy.random import default_rng

from envgraph.env import Tabular, enumerate_states
from envgraph.errors import InvalidArgument
from envgraph.rewrite import Engine
from envgraph.search import Constraint, CountWithin, Domain, Forbid, Problem, Require


@pytest.fixture(scope="module")
def domain() -> Domain:
    return Domain.load("burning_forest")


def problem_with(domain: Domain, constraints: Sequence[Constraint]) -> Problem:
    return replace(domain.problem(domain.engine()), constraints=constraints)


SOLVABLE, FLOODED = Require("solvable"), Forbid("collectedWater")
CONSTRAINTS = [
    (SOLVABLE,),
    (FLOODED,),
    (CountWithin("burningTile", 18, 20),),
    (CountWithin("burningTile", 20, None),),
    (CountWithin("burningTile", 0, None),),
    (FLOODED, SOLVABLE, CountWithin("burningTile", 0, 20)),
]


@pytest.mark.parametrize("constraints", CONSTRAINTS, ids=lambda found: ", ".join(map(str, found)))
def test_a_model_is_valid_if_every_constraint_holds(
    domain: Domain, constraints: tuple[Constraint, ...]
) -> None:
    problem, rng = problem_with(domain, constraints), default_rng(3)
    engine, seen = problem.engine, set()
    engine.rng = rng
    for step in range(150):
        engine.apply("retypings")
        if step % 40 == 30:
            engine.apply("collect")
        if step % 40 == 35:
            engine.model.nodes("WaterTile")[0].collected = False
        assert problem.valid() == (not problem.violations())
        seen.add(problem.valid())
    assert seen == ({True} if constraints == (CountWithin("burningTile", 0, None),) else {True, False})


def test_constraints_of_any_kind_stand_beside_queries(domain: Domain) -> None:
    class Never:
        def holds(self, engine: Engine) -> bool:
            return False

    assert problem_with(domain, ()).valid()
    assert problem_with(domain, (SOLVABLE,)).valid()
    assert not problem_with(domain, (SOLVABLE, Never())).valid()


def test_a_constraint_over_an_unknown_pattern_is_refused(domain: Domain) -> None:
    with pytest.raises(InvalidArgument, match="unknown pattern `solvabel`"):
        problem_with(domain, (Require("solvabel"),))


def test_problems_on_one_engine_share_the_query(domain: Domain) -> None:
    engine = domain.engine()
    domain.problem(engine)
    names = engine.library.names()
    domain.problem(engine)
    assert engine.library.names() == names
    assert not any("violation" in name for name in engine.patterns)


def test_a_constraint_and_a_measure_visit_the_states_of_a_model_once(monkeypatch: pytest.MonkeyPatch) -> None:
    visits: list[int] = []

    def counted(engine: Engine, *rest: object) -> Tabular:
        visits.append(engine.model.state_hash())
        return enumerate_states(engine, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.search._measures.enumerate_states", counted)
    monkeypatch.delattr("envgraph.search._domain.can_end")
    domain = Domain.load("keydoor")
    problem = domain.problem(domain.engine())
    plan = problem.measure()["plan"] if problem.valid() else None
    engine = problem.engine
    savepoint = engine.model.savepoint()
    for key in engine.model.nodes("Key"):
        key.delete(semantics="spo")
    assert not problem.valid() and problem.measure() == {"plan": float("inf")}
    engine.model.rollback(savepoint)
    assert problem.valid() and problem.measure()["plan"] == plan == 9.0
    assert len(visits) == 3 and visits[0] == visits[2] != visits[1]
