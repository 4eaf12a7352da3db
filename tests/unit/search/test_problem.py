"""Constraints, one by one and as the one query that a search asks."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any

import pytest
from numpy import float32
from numpy.random import default_rng

from envgraph.env.compiled import ActionPlan, NotCompiled, Plans
from envgraph.errors import EvaluationError, InvalidArgument, RuleError
from envgraph.rewrite import Engine
from envgraph.search import (
    Constraint,
    Domain,
    Forbid,
    Problem,
    Require,
)


@pytest.fixture(scope="module")
def domain() -> Domain:
    return Domain.load("burning_forest/paper.toml")


def problem_with(domain: Domain, constraints: Sequence[Constraint]) -> Problem:
    return replace(domain.problem(domain.engine()), constraints=constraints)


def fires(count: str) -> Constraint:
    """Return the constraint on the number of fires that a family file writes as a range such as `18..20`."""
    override = f'constraints.count={{ burningTile = "{count}" }}'
    family = Domain.load("burning_forest/paper.toml", overrides=[override])
    constraints = family.problem(family.engine()).constraints
    (found,) = (one for one in constraints if getattr(one, "pattern", "") == "burningTile")
    return found


ANY_NUMBER = fires("0..*")
SOLVABLE, FLOODED = Require("solvable"), Forbid("collectedWater")
CONSTRAINTS = [
    (SOLVABLE,),
    (FLOODED,),
    (fires("18..20"),),
    (fires("20..*"),),
    (ANY_NUMBER,),
    (FLOODED, SOLVABLE, fires("0..20")),
]


def remains_valid(problem: Problem) -> bool:
    return not isinstance(problem.measures_or_rejection(is_mutated=True), str)


@pytest.mark.parametrize("name", ["burning_forest/paper.toml", "network/diverse.toml"])
def test_skipping_constraints_that_mutations_cannot_violate_keeps_the_verdict(name: str) -> None:
    family = Domain.load(name)
    problem, rng = family.problem(family.engine()), default_rng(5)
    engine, found = problem.engine, []
    for _ in range(60):
        savepoint = engine.model.graph.history.savepoint()
        for _ in range(3):
            chosen = engine.choose(problem.mutations, rng)
            assert chosen is not None
            with suppress(RuleError):
                engine.fire(*chosen)
        found.append(problem.is_valid())
        assert remains_valid(problem) == found[-1]
        if found[-1]:
            engine.model.graph.history.release(savepoint)
        else:
            engine.model.graph.history.rollback(savepoint)
    assert len({*found}) == 2


def shift(engine: Engine) -> None:
    """May do anything."""


def test_constraint_is_skipped_only_after_mutations_that_cannot_affect_it(domain: Domain) -> None:
    problem = problem_with(domain, [Require("startTileFixedLocation")])
    problem.engine.model.node(next(iter(problem.engine.model.graph.extent("StartTile")))).x = 1
    assert (problem.is_valid(), remains_valid(problem)) == (False, True)
    written = replace(problem, mutations=("collect", "burnDown"))
    assert (written.is_valid(), remains_valid(written)) == (False, True)
    problem.engine.unit(shift)
    unknown = replace(problem, mutations=("shift",))
    assert (unknown.is_valid(), remains_valid(unknown)) == (False, False)


@pytest.mark.parametrize("constraints", CONSTRAINTS, ids=lambda found: ", ".join(map(str, found)))
def test_a_model_is_valid_if_every_constraint_holds(domain: Domain, constraints: tuple[Constraint, ...]) -> None:
    problem, rng = problem_with(domain, constraints), default_rng(3)
    engine, seen = problem.engine, set()
    engine.rng = rng
    for step in range(150):
        engine.apply("retypings")
        if step % 40 == 30:
            engine.apply("collect")
        if step % 40 == 35:
            engine.model.nodes("WaterTile")[0].collected = False
        assert problem.is_valid() == (next(problem.violated_constraints(), None) is None)
        seen.add(problem.is_valid())
    assert seen == ({True} if constraints == (ANY_NUMBER,) else {True, False})


def test_custom_constraints_can_be_combined_with_query_constraints(domain: Domain) -> None:
    class Never:
        def holds(self, engine: Engine) -> bool:
            return False

    assert problem_with(domain, ()).is_valid()
    assert problem_with(domain, (SOLVABLE,)).is_valid()
    assert not problem_with(domain, (SOLVABLE, Never())).is_valid()


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


def test_constraint_and_measure_share_one_search_of_the_states(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches: list[float] = []

    whole = Plans.plan

    def counted(plans: Plans, *arguments: Any) -> ActionPlan:
        plan = whole(plans, *arguments)
        searches.append(plan.steps)
        return plan

    monkeypatch.setattr(Plans, "plan", counted)
    monkeypatch.setattr("envgraph.env.can_end", None)  # what must not be called
    domain = Domain.load("keydoor/diverse.toml")
    problem = domain.problem(domain.engine())
    plan = problem.compute_measures()["plan"] if problem.is_valid() else None
    engine = problem.engine
    savepoint = engine.model.graph.history.savepoint()
    for key in engine.model.nodes("Key"):
        key.delete(semantics="spo")
    assert not problem.is_valid()
    with pytest.raises(EvaluationError, match="the model has no value of `plan`"):
        problem.compute_measures()
    engine.model.graph.history.rollback(savepoint)
    assert problem.is_valid() and problem.compute_measures()["plan"] == plan == 9.0
    assert searches == [9.0, inf, 9.0]


@pytest.mark.parametrize("kept", [1, 20])
def test_verdict_of_a_state_is_cached(monkeypatch: pytest.MonkeyPatch, kept: int) -> None:
    monkeypatch.setattr("envgraph.search.problem._problem.MOST_CACHED_RESULTS", kept)
    searches: list[float] = []
    monkeypatch.setattr(
        Plans, "plan", lambda plans, engine, progress: ActionPlan(searches.append(1) or 9.0, (), 1, 1, None)
    )
    domain = Domain.load("keydoor")
    problem = domain.problem(domain.engine())
    model, judged = problem.engine.model, []
    for _ in range(3):
        judged.append(problem.measures_or_rejection())
        savepoint = model.graph.history.savepoint()
        model.nodes("Door")[0].open = True
        judged.append(problem.measures_or_rejection(is_mutated=True))
        model.graph.history.rollback(savepoint)
    assert judged == [{"plan": 9.0}] * 6
    assert len(searches) == (2 if kept == 20 else 6)


@pytest.mark.parametrize(
    ("width", "reason"),
    [(None, "`reachable success` is violated"), (7, "no plan to success was found within 200,000 states")],
)
def test_search_that_stops_early_reports_its_number_of_states(
    monkeypatch: pytest.MonkeyPatch, width: int | None, reason: str
) -> None:
    monkeypatch.setattr(Plans, "plan", lambda *arguments: ActionPlan(inf, (), 3, 2, width))
    domain = Domain.load("keydoor")
    assert domain.problem(domain.engine()).measures_or_rejection() == reason


def test_constraints_that_are_not_compiled_are_checked_by_the_live_engine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*arguments: Any, **options: Any) -> ActionPlan:
        raise NotCompiled("what is not there")

    monkeypatch.setattr(Plans, "plan", refused)
    domain = Domain.load("keydoor/diverse.toml")
    problem = domain.problem(domain.engine())
    assert problem.is_valid() and problem.compute_measures()["plan"] == 9.0
    for key in problem.engine.model.nodes("Key"):
        key.delete(semantics="spo")
    assert not problem.is_valid()


@dataclass
class Returns:
    """A measure, of models and of families, that returns what it is told."""

    value: object

    def evaluate(self, engine: Engine) -> float:
        return self.value  # type: ignore[return-value]

    def score(self, values: Sequence[float]) -> float:
        return self.value  # type: ignore[return-value]

    def maximum(self, size: int) -> float:
        return self.value  # type: ignore[return-value]

    def delta(self, leaving: int, entering: int) -> float:
        return self.value  # type: ignore[return-value]

    def swap(self, leaving: int, entering: int) -> None:
        pass

    def swaps(self, values: Sequence[float], members: Sequence[int]) -> Returns:
        return self


@pytest.mark.parametrize("value", [3, 0.5, True, float32(0.25)])
def test_measure_can_return_any_number_type(domain: Domain, value: object) -> None:
    problem = replace(domain.problem(domain.engine()), measures={"mine": Returns(value)})
    assert problem.compute_measures() == {"mine": value}
    assert type(problem.compute_measures()["mine"]) is float


@pytest.mark.parametrize(
    ("value", "found"),
    [
        (nan, "`nan`"),
        (None, "a `NoneType`"),
        ("abc", "a `str`"),
        (10**400, "an integer with more than 308 digits"),
        (1j, "a `complex`"),
    ],
    ids=str,
)
def test_measure_or_diversity_that_returns_no_number_is_reported(domain: Domain, value: object, found: str) -> None:
    problem = domain.problem(domain.engine())
    with pytest.raises(EvaluationError, match=f"measure `mine` must return a number, but returned {found}"):
        replace(problem, measures={"mine": Returns(value)}).compute_measures()
    mine = replace(problem, diversity=Returns(value))
    for asked in (lambda: mine.diversity.score([]), lambda: mine.largest_diversity(2)):
        with pytest.raises(EvaluationError, match=f"diversity `Returns` must return a number, but returned {found}"):
            asked()
    with pytest.raises(EvaluationError, match="diversity `Returns` must return a number"):
        mine.diversity.swaps([0.0, 1.0], [0]).delta(0, 1)


def test_an_infinite_diversity_is_refused(domain: Domain) -> None:
    problem = replace(domain.problem(domain.engine()), diversity=Returns(inf))
    with pytest.raises(EvaluationError, match="diversity `Returns` is infinite"):
        problem.diversity.score([1.0])
    assert problem.largest_diversity(2) == inf  # nobody knows the maximum


@pytest.mark.parametrize("value", [inf, -inf])
def test_infinite_measure_counts_as_a_missing_value(domain: Domain, value: float) -> None:
    problem = replace(domain.problem(domain.engine()), measures={"one": Returns(1.0), "mine": Returns(value)})
    with pytest.raises(EvaluationError, match="the model has no value of `mine`"):
        problem.compute_measures()
    assert replace(problem, otherwise={"mine": 7.0}).compute_measures() == {"one": 1.0, "mine": 7.0}
