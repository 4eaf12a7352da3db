"""Optimisation on small problems: what is found, what is left of it, and what is refused."""

from __future__ import annotations

from itertools import pairwise, product
from math import inf

import pytest

import envgraph
from envgraph.errors import EvaluationError, InvalidArgument, TransactionError
from envgraph.rewrite import Engine, trace_to_text
from envgraph.search import Forbid
from envgraph.search.optimising import (
    Annealing,
    Beam,
    Goal,
    HillClimb,
    Optimum,
    Strategy,
    TreeSearch,
    Walk,
    optimise,
    search_goals,
)
from tests.oracle.test_assignment import cra, random_model, value

MOVES = ("introduce", "assign", "move", "extract", "join")
STRATEGIES = (Annealing(), Annealing(runs=3), HillClimb(patience=100), Beam(5, 4), TreeSearch())


def tiny() -> Engine:
    """Five features, two of them attributes."""
    engine = envgraph.open("assignment")
    model = engine.model
    names = {"price", "stock", "reprice", "reserve", "add"}
    for feature in list(model.nodes("Feature")):
        if feature.name not in names:
            model.graph.delete(feature.id, "spo")
    return engine


@pytest.fixture(scope="module")
def best_index() -> float:
    """The best CRA index of all assignments of the tiny problem, by trying them."""
    model, found = tiny().model, []
    root, features = model.nodes("ClassModel")[0], model.nodes("Feature")
    for numbers in product(range(len(features)), repeat=len(features)):
        savepoint = model.graph.history.savepoint()
        classes = {number: model.create("Class", name=f"c{number}") for number in sorted(set(numbers))}
        for cls in classes.values():
            root.classes.append(cls)
        for feature, number in zip(features, numbers, strict=True):
            feature.isEncapsulatedBy = classes[number]
        cohesion, coupling = cra(model)
        found.append(cohesion - coupling)
        model.graph.history.rollback(savepoint)
    return max(found)


def search(engine: Engine, strategy: Strategy | None = None, steps: int = 600, seed: int = 1) -> Optimum:
    return optimise(
        engine, MOVES, maximise="craIndex", forbid=["unassigned"], strategy=strategy, steps=steps, seed=seed
    )


@pytest.mark.parametrize("strategy", STRATEGIES, ids=repr)
def test_every_strategy_finds_the_optimum_of_a_tiny_problem(strategy: Strategy, best_index: float) -> None:
    found = search(tiny(), strategy, steps=400)
    assert found.best.violation == 0
    assert found.best.values["craIndex"] == pytest.approx(best_index, abs=1e-9)


@pytest.mark.parametrize("strategy", STRATEGIES, ids=repr)
def test_engine_ends_at_the_best_model_and_its_trace_reproduces_the_model(strategy: Strategy) -> None:
    engine = envgraph.open("assignment")
    found = search(engine, strategy, steps=150)
    best = found.best
    assert value(engine, "craIndex") == best.values["craIndex"]
    engine.check_integrity()
    again = envgraph.open("assignment")
    again.replay(best.trace)  # compares the states
    assert again.model.state_hash() == engine.model.state_hash()
    assert value(again, "craIndex") == pytest.approx(best.values["craIndex"], abs=1e-12)
    assert trace_to_text(again, best.trace).count("\n") == len(best.trace) + 2


@pytest.mark.parametrize("strategy", STRATEGIES, ids=repr)
def test_result_depends_on_the_seed_and_not_on_watched_patterns(strategy: Strategy) -> None:
    def text(engine: Engine, seed: int) -> str:
        return trace_to_text(engine, search(engine, strategy, 120, seed).best.trace)

    first, second = text(envgraph.open("assignment"), 5), text(envgraph.open("assignment"), 5)
    assert first == second
    engine = envgraph.open("assignment")
    engine.watch("craIndex", "unassigned")
    assert text(engine, 5) == first


def test_search_watches_the_patterns_of_large_models_while_it_runs() -> None:
    def watched(engine: Engine) -> tuple[str, ...]:
        seen: list[tuple[str, ...]] = []

        class Watched:
            def search(self, walk: Walk) -> None:
                seen.append(engine.watched)

        search(engine, Watched())
        assert not engine.watched
        return seen[0]

    small = envgraph.open("assignment")
    assert watched(small) == ()
    large = envgraph.open("assignment")
    for number in range(250):
        large.model.create("Attribute", name=f"a{number}")
    assert watched(large) == ("assignment.craIndex", "assignment.unassigned")
    held = large.commit()
    assert watched(large) == (), "while a version is held nothing new can be watched"
    assert held.model is large.model


def test_search_changes_only_the_model_of_the_engine() -> None:
    engine = envgraph.open("assignment", seed=3)
    before = engine.rng
    state = before.bit_generator.state
    engine.watch("craIndex")
    search(engine, steps=50)
    assert engine.rng is before
    assert before.bit_generator.state == state
    assert engine.watched == ("assignment.craIndex",)
    assert not engine.model.graph.history.savepoint_depth


def test_fewer_violations_are_preferred_to_any_objective_value() -> None:
    engine = random_model(2, 6)
    found = optimise(engine, ["introduce"], minimise="methodOf", forbid=["unassigned"], steps=200)
    assert found.best.violation == 0, "each class costs, and all features are assigned all the same"
    assert len(engine.model.nodes("Class")) == len(engine.model.nodes("Feature"))
    engine = random_model(2, 6)
    found = optimise(
        engine,
        ["introduce"],
        minimise="methodOf",
        count={"attributeOf": (1, 2)},
        strategy=Annealing(runs=40),
        steps=200,
    )
    assert found.best.violation == 0
    assert found.best.values == {"methodOf": 0.0}, "it has no parameter for a number: its matches count"
    assert 1 <= engine.count("attributeOf") <= 2


def test_unsatisfiable_constraints_are_reported_as_violations() -> None:
    engine = envgraph.open("assignment")
    found = optimise(
        engine, ["introduce"], maximise="craIndex", require=["unassigned"], forbid=["unassigned"], steps=60
    )
    assert found.best.violation == 1
    assert found.initial == {"craIndex": 0.0}


def test_no_solution_of_the_pareto_front_is_dominated() -> None:
    engine = envgraph.open("assignment")
    found = optimise(engine, MOVES, maximise="cohesion", minimise="coupling", forbid=["unassigned"], steps=1500, seed=2)
    points = [(one.values["cohesion"], one.values["coupling"]) for one in found.front]
    assert len(points) > 3
    assert points == sorted(points, reverse=True), "the best in the first objective first"
    assert all(a[1] > b[1] for a, b in pairwise(points))
    for solution in found.front:
        engine.checkout(solution.version)
        cohesion, coupling = cra(engine.model)
        assert (cohesion, coupling) == pytest.approx(tuple(solution.values.values()), abs=1e-9)
        again = envgraph.open("assignment")
        again.replay(solution.trace)
        assert again.model.state_hash() == engine.model.state_hash()


def test_a_target_ends_the_search() -> None:
    found = optimise(
        envgraph.open("assignment"),
        MOVES,
        maximise="craIndex",
        forbid=["unassigned"],
        target=-3.0,
        steps=5000,
    )
    assert found.best.values["craIndex"] >= -3
    assert found.steps < 5000


def test_refused_moves_leave_the_model_unchanged() -> None:
    engine = envgraph.open("network")  # `dropLink` is always refused: links have ends
    state = engine.model.state_hash()
    found = optimise(engine, ["dropLink"], minimise="connected", steps=20)
    assert found.steps == 20
    assert not found.best.trace
    assert engine.model.state_hash() == state


def test_results_of_moves_are_cached_until_a_move_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is remembered changes no result: a strategy that forgets it finds the same."""
    made = list[str]()
    fire = Engine.fire
    monkeypatch.setattr(Engine, "fire", lambda engine, *chosen: made.append(chosen[0]) or fire(engine, *chosen))
    found = search(tiny(), Annealing(), steps=600)
    assert len(made) < 400
    remembered, undo = len(made), Walk.undo

    def forgetting(walk: Walk) -> None:
        undo(walk)
        walk._choice = None

    monkeypatch.setattr(Walk, "undo", forgetting)
    again = search(tiny(), Annealing(), steps=600)
    assert len(made) > remembered + 500
    assert (again.best.values, again.best.trace) == (found.best.values, found.best.trace)


def test_custom_measure_can_be_an_objective() -> None:
    class Classes:
        def evaluate(self, engine: Engine) -> float:
            return float(len(engine.model.nodes("Class")))

    engine = envgraph.open("assignment")
    found = optimise(engine, MOVES, maximise=Goal("classes", Classes()), steps=200)
    assert found.best.values["classes"] == len(engine.model.nodes("Class")) > 3


def test_progress_is_reported() -> None:
    told: list[int] = []
    engine = envgraph.open("assignment")
    optimise(engine, MOVES, maximise="craIndex", steps=300, progress=lambda done, _: told.append(done))
    assert told == [256]


def search_with_fake_clock(strategy: Strategy, *, steps: int, seconds: float | None) -> tuple[Engine, Optimum]:
    """Search with a clock on which each move takes a second."""
    walks: list[Walk] = []

    class Timed:
        def search(self, walk: Walk) -> None:
            walks.append(walk)
            strategy.search(walk)

    engine = envgraph.open("assignment")
    goals, constraints = [Goal.from_pattern(engine, "craIndex", "maximise")], [Forbid("unassigned")]
    clock = lambda: float(walks[0].moves_tried) if walks else 0.0  # noqa: E731
    return engine, search_goals(
        engine, MOVES, goals, constraints, Timed(), steps=steps, seconds=seconds, seed=1, clock=clock
    )


@pytest.mark.parametrize("strategy", STRATEGIES, ids=repr)
def test_search_limited_by_moves_or_time_finds_the_same_solution(strategy: Strategy) -> None:
    """Annealing cools by whichever is used up first: with 10**9 moves it would never cool by moves alone."""
    results = [
        search_with_fake_clock(strategy, steps=300, seconds=None),
        search_with_fake_clock(strategy, steps=10**9, seconds=300.0),
        search_with_fake_clock(strategy, steps=300, seconds=1e9),
        search_with_fake_clock(strategy, steps=300, seconds=300.0),
    ]
    assert {found.steps for _, found in results} == {300}
    assert len({trace_to_text(engine, found.best.trace) for engine, found in results}) == 1


def test_annealing_with_more_runs_than_moves_or_time_ends_at_the_limit() -> None:
    assert search_with_fake_clock(Annealing(runs=50), steps=7, seconds=None)[1].steps == 7
    assert search_with_fake_clock(Annealing(runs=50), steps=10**9, seconds=7.0)[1].steps == 7
    assert search_with_fake_clock(Annealing(), steps=10**9, seconds=0.0)[1].steps == 0


def test_invalid_arguments_are_refused_before_the_model_is_changed() -> None:
    engine = envgraph.open("assignment")
    state = engine.model.state_hash()

    def refused(message: str, moves: object = MOVES, **arguments: object) -> None:
        with pytest.raises(InvalidArgument, match=message):
            optimise(engine, moves, **arguments)  # type: ignore[arg-type]

    refused("at least one objective")
    refused("with different names", maximise="craIndex", minimise="craIndex")
    refused("unknown .*`craIndx`(.|\n)*did you mean `craIndex`", maximise="craIndx")
    refused("unknown .*`jon`", ["jon"], maximise="craIndex")
    refused("`moves` is empty", [], maximise="craIndex")
    refused("unknown .*`unasigned`", maximise="craIndex", forbid=["unasigned"])
    refused("`steps` is 0, but must be", maximise="craIndex", steps=0)
    refused("`target` must have a finite number for each of the 1 objectives", maximise="craIndex", target=[1, 2])
    for wrong in (lambda: Annealing(0), lambda: HillClimb(0), lambda: Beam(0), lambda: TreeSearch(length=0)):
        with pytest.raises(InvalidArgument):
            wrong()
    with engine.transaction(), pytest.raises(TransactionError):
        search(engine)
    assert engine.model.state_hash() == state


def test_any_objective_value_is_preferred_to_a_missing_value() -> None:
    engine = random_model(2, 6)
    found = optimise(engine, MOVES, minimise="cohesionOf", steps=200)  # a value only where there is a single class
    assert found.initial == {"cohesionOf": inf}
    assert found.best.values["cohesionOf"] == 0.0


def test_error_during_the_search_leaves_the_model_unchanged() -> None:
    class Fails:
        def __init__(self) -> None:
            self.asked = 0

        def evaluate(self, engine: Engine) -> float:
            self.asked += 1
            return float("nan") if self.asked > 20 else float(self.asked)

    engine = envgraph.open("assignment")
    state = engine.model.state_hash()
    with pytest.raises(EvaluationError, match="objective `odd` must return a number"):
        optimise(engine, MOVES, maximise=Goal("odd", Fails()), steps=100)
    assert engine.model.state_hash() == state
    assert not engine.model.graph.history.savepoint_depth
    search(engine, steps=20)


def test_units_and_derived_groups_are_moves() -> None:
    engine = envgraph.open("network")
    found = optimise(engine, ["age", "wiring"], maximise="connected", steps=60, seed=3)
    assert found.best.values["connected"] >= found.initial["connected"]
    again = envgraph.open("network")
    again.replay(found.best.trace)
    assert again.model.state_hash() == engine.model.state_hash()


def test_event_rules_are_refused() -> None:
    engine = envgraph.open("assignment")
    engine.on("unassigned", appear=lambda: None)
    with pytest.raises(InvalidArgument, match="event rules"):
        search(engine)
