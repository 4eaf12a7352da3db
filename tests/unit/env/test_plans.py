"""Plans in compiled environments, against tables of all states and the live engine."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env import Behaviour, EnvgraphLiveEnv, Simulator, TooManyStates, explore
from envgraph.env.compiled import (
    ActionPlan,
    CompiledBatch,
    CompiledProgram,
    Plans,
    PlanSearch,
    has_numba,
    program_of,
    with_guide_counts,
)
from envgraph.env.compiled.layout._compiled_costs import CompiledCosts
from envgraph.env.compiled.programs import _compiled_program
from envgraph.env.compiled.visiting import _plan_search
from envgraph.errors import LIMITS
from envgraph.pattern import PatternCall, Variable
from envgraph.rewrite import Engine
from envgraph.solve import shortest_plan
from tests.profile import AT_NIGHT, NIGHTLY
from tests.unit.env import coins, test_agents, test_keydoor
from tests.unit.env.coins import loaded
from tests.unit.env.side_by_side import BUNDLED, opened

SOKOBAN = Path(__file__).parents[2] / "data" / "compiled" / "sokoban"
HALL = test_agents.Hall(["....d"], [(0, 0), (1, 0)], 20, [(0, 0), (2, 0)])


def found(
    engine: Engine,
    behaviour: Behaviour,
    outcome: int = 1,
    limit: int = 20_000,
    width: int = 500,
    native: bool = NIGHTLY,
) -> ActionPlan:
    """The plan of a program in Python, which is that of a compiled one (by day that costs too much for each)."""
    with_guides, guides = with_guide_counts(behaviour, outcome)
    program = program_of(engine, with_guides, native=False)
    plan = PlanSearch(program, outcome, limit, width).plan(guides)
    if native and has_numba():
        native = replace(program, native=True)
        assert PlanSearch(native, outcome, limit, width).plan(guides) == plan
    return plan


def success_step(engine: Engine, behaviour: Behaviour, plan: ActionPlan) -> int:
    """The step in which a plan ends an episode of a live environment in success; 0 if it does not."""
    env = EnvgraphLiveEnv(Simulator(engine, behaviour))
    env.reset(seed=0)
    for number, action in enumerate(plan.actions, 1):
        _, _, terminated, _, info = env.step(env.simulator.action_names.index(action))
        if terminated:
            return number if info["success"] else 0
    return 0


@pytest.mark.parametrize(
    "name", ["keydoor/two_rooms", "hall", "network/backbone", *(["warehouse/small_hall"] if NIGHTLY else [])]
)
def test_plan_episode_is_replayed_on_the_live_engine(name: str) -> None:
    folder, _, model = name.partition("/")
    files = BUNDLED / folder / f"{model}.model", BUNDLED / folder / f"{folder}.environment"
    small = test_agents.Hall(["..d."], [(0, 0), (3, 0)], 9, [(0, 0)])
    engine, behaviour = opened(*files) if model else test_agents.opened(small.text())
    before, plans = engine.model.state_hash(), Plans(behaviour)
    plan, states = plans.plan(engine), list[int]()
    following: set[int] = set()
    for simulator in plans.episode(engine):
        state = simulator.engine.model.state_hash()
        assert not states or state in following
        if len(states) < plan.steps:
            action = simulator.action_names.index(plan.actions[len(states)])
            following = {simulator.engine.model.state_hash() for _ in simulator.outcomes(action)}
        states.append(state)
    assert len(states) == plan.steps + 1
    assert engine.model.state_hash() == before


def assert_same_as_the_table(engine: Engine, behaviour: Behaviour) -> None:
    table = explore(engine, behaviour).tabular
    for outcome in (1, 2):
        plan = found(engine, behaviour, outcome)
        assert plan.is_exact
        assert plan.steps == shortest_plan(table, outcome)
        assert plan.states <= table.n_states
        assert len(plan.actions) == (plan.steps if isfinite(plan.steps) else 0)


@pytest.mark.parametrize("rows", [*test_keydoor.MAZES, test_keydoor.TWO_KEYS, ["####", "#.#X"], ["####", "#.RX"]])
def test_plans_of_solvable_and_unsolvable_mazes_equal_those_of_the_table(rows: list[str]) -> None:
    assert_same_as_the_table(*test_keydoor.loaded(rows))


@pytest.mark.parametrize("battery", [2, 5])
def test_plans_of_robots_with_any_battery_equal_those_of_the_table(battery: int) -> None:
    hall = test_agents.Hall(["..d."], [(0, 0), (3, 0)], battery, [(0, 0), (3, 0)])
    assert_same_as_the_table(*test_agents.opened(hall.text()))


@pytest.mark.parametrize(
    "clauses",
    [
        "action turn = 0.5: turn() on find pair(_, _) terminate success on neg find up(_) terminate failure",
        "action wait = nothing() on reset apply turn() on neg find up(_) terminate success",
    ],
)
def test_plans_with_chance_and_several_starts_equal_those_of_the_table(clauses: str) -> None:
    assert_same_as_the_table(*loaded(clauses, "hand : Hand"))


@pytest.mark.parametrize(("limit", "width"), [(20_000, 500), pytest.param(50, 500, marks=AT_NIGHT), (50, 20), (1, 20)])
def test_executing_a_plan_terminates_the_live_episode(limit: int, width: int) -> None:
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    shortest = found(engine, behaviour)
    plan = found(engine, behaviour, limit=limit, width=width, native=True)
    assert shortest.is_exact and shortest.steps == 14.0
    assert plan.is_exact == (limit == 20_000)
    assert plan.steps == len(plan.actions) >= 14
    assert success_step(engine, behaviour, plan) == plan.steps


def test_plan_of_a_beam_search_reports_its_width_and_limit() -> None:
    engine, behaviour = test_agents.opened(test_agents.Hall(["...d"], [(0, 0)], 12, [(0, 0), (1, 0)]).text())
    assert str(found(engine, behaviour)) == "11 steps, the fewest"
    lost = found(engine, replace(behaviour, limit=6), limit=5, width=2)
    plan = found(engine, behaviour, limit=5, width=3)
    assert (plan.steps, plan.width, plan.limit) == (15.0, 3, 5)
    assert str(plan) == "at most 15 steps, found by a beam of 3 states after the first 5"
    assert success_step(engine, behaviour, plan) == plan.steps
    assert (lost.steps, lost.actions, lost.is_exact) == (inf, (), False)
    assert str(lost) == f"none within {lost.states} states, by a beam of 2 after the first 5"


def test_exhausted_beam_continues_with_the_states_it_dropped() -> None:
    """Who hurries has fewer coins in the way, and can do nothing any more."""
    rules = """
        rule wait(hand : Hand) {
            lhs { check hand.moves < 3; coin : Coin; Coin.name(coin, "a"); find up(coin); }
            modify { set hand.moves += 1; }
        }
        rule hurry { lhs { coin : Coin; Coin.name(coin, "a"); find up(coin); } modify { set coin.side = ::tails; } }
        rule end(hand : Hand) {
            lhs { check hand.moves == 3; coin : Coin; find up(coin); }
            modify { set coin.side = ::tails; }
        }
    """
    clauses = """
        action wait = wait(hand)  action hurry = hurry()  action end = end(hand)
        on neg find up(_) terminate success
    """
    engine, behaviour = loaded(clauses, "hand : Hand", {"coins.rules": coins.RULES + rules})
    assert found(engine, behaviour).steps == 5.0
    plan = found(engine, behaviour, limit=1, width=1)
    assert (plan.steps, plan.is_exact) == (5.0, False)
    assert success_step(engine, behaviour, plan) == 5


def test_plan_search_in_python_stops_at_its_outcome_limit() -> None:
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    program = program_of(engine, behaviour, native=False)
    search = PlanSearch(program)
    plan = search.plan(0)
    search = PlanSearch(program)
    search.max_outcomes = len(program.action_names) * plan.states  # of each action in a state there is one
    assert search.plan(0) == plan
    search = PlanSearch(program)
    search.max_outcomes = 40
    with pytest.raises(TooManyStates, match="more than 40 outcomes"):
        search.plan(0)


def test_plan_search_with_pauses_finds_the_same_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    whole = found(engine, behaviour)
    monkeypatch.setattr(CompiledCosts, "progress_interval", 7)
    assert found(engine, behaviour) == whole


def test_guide_observation_counts_the_matches_that_prevent_success() -> None:
    engine, behaviour = test_agents.opened(HALL.text())
    with_guides, guides = with_guide_counts(behaviour)
    assert guides == 1
    batch = CompiledBatch(program_of(engine, with_guides, native=False), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    assert batch.components[0, 0] == Simulator(engine, behaviour).obstacle_counter(1)() == 2
    assert with_guide_counts(behaviour, 2)[1] == 0
    named, one = with_guide_counts(behaviour, 2, PatternCall("pending", (Variable("_"),)))
    assert one == 1 and len(named.agents[0].observations) == len(behaviour.agents[0].observations) + 1


def test_guide_component_follows_the_block_number_with_several_agent_blocks() -> None:
    engine, behaviour = loaded(
        """
        agent coin : Coin { action flip = turnOver(coin) observe coin.side }
        agent player : Hand { action count = count(player, 1) observe player.moves in 0..3 }
        on neg find up(_) terminate success
        """
    )
    with_guides, _ = with_guide_counts(behaviour)
    batch = CompiledBatch(program_of(engine, with_guides, native=False), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    assert batch.components[0, :2].tolist() == [0, Simulator(engine, behaviour).obstacle_counter(1)()]
    assert_same_as_the_table(engine, behaviour)


def test_one_compiled_program_plans_for_many_models_of_an_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    written = []

    def counted(*arguments: Any, **options: Any) -> CompiledProgram:
        written.append(arguments)
        return program_of(*arguments, **options, native=NIGHTLY and has_numba())

    monkeypatch.setattr(_compiled_program, "program_of", counted)
    monkeypatch.setattr(CompiledCosts, "searches_of_python", 6)
    engine, behaviour = opened(
        BUNDLED / "burning_forest/running_4x4.model", BUNDLED / "burning_forest/burning_forest.environment"
    )
    plans, rng = Plans(behaviour), np.random.default_rng(0)
    rules = [name for name in engine.rules if "retypings" in name]
    for number in range(12):
        plan = plans.plan(engine)
        assert (plan.steps, plan.is_exact) == (shortest_plan(explore(engine, behaviour).tabular), True)
        engine.model.commit()
        for _ in range(3):
            name = rules[int(rng.integers(len(rules)))]
            if engine.exists(name):
                engine.apply(name)
        assert len(written) <= number + 1
    assert len(written) < 4


def test_compiled_program_finds_the_same_plan_for_a_large_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(CompiledCosts, "few_states", 10)
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    assert Plans(behaviour).plan(engine) == found(engine, behaviour)


def test_pattern_of_the_domain_can_guide_the_plan_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CompiledCosts, "few_states", 100_000)
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    assert (
        with_guide_counts(behaviour, guide=PatternCall("left", (Variable("_"),)))[0] == with_guide_counts(behaviour)[0]
    )
    assert Plans(behaviour, guide="stored").plan(engine).steps == 14.0


@pytest.mark.parametrize("shortest", [True, False])
def test_plan_search_stops_at_the_state_limit(monkeypatch: pytest.MonkeyPatch, shortest: bool) -> None:
    monkeypatch.setitem(LIMITS, "planned states", 100)
    monkeypatch.setattr(CompiledCosts, "few_states", 10)
    monkeypatch.setattr(_compiled_program, "has_numba", lambda: False)
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    plan = Plans(behaviour, shortest=shortest).plan(engine)
    assert (plan.steps, plan.is_exact) == (inf, False)
    assert 100 < plan.states < 200


@pytest.mark.parametrize("narrow", [(50, 20), (1, 1)])
def test_search_for_any_plan_tries_a_narrow_beam_first(
    monkeypatch: pytest.MonkeyPatch, narrow: tuple[int, int]
) -> None:
    """And where that finds none, the answer is that of the whole search."""
    monkeypatch.setattr(_plan_search, "NARROW_BEAM", narrow)
    monkeypatch.setattr(_compiled_program, "has_numba", lambda: False)
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    plan = Plans(behaviour, shortest=False).plan(engine)
    beam = found(engine, behaviour, limit=narrow[0], width=narrow[1])
    assert plan == (beam if isfinite(beam.steps) else found(engine, behaviour))
    assert success_step(engine, behaviour, plan) == plan.steps >= 14


def test_narrow_beam_follows_a_search_with_too_many_outcomes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_plan_search, "NARROW_BEAM", (50, 20))
    monkeypatch.setattr(_compiled_program, "has_numba", lambda: False)
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    beam, plans = found(engine, behaviour, limit=50, width=20), Plans(behaviour)
    plans.max_outcomes = 1_500
    assert plans.plan(engine) == beam != found(engine, behaviour)
    plans.max_outcomes = 40
    with pytest.raises(TooManyStates, match="more than 40 outcomes"):
        plans.plan(engine)


@pytest.mark.parametrize("width", [20, 500])
def test_total_reward_of_a_plan_is_that_of_its_steps(width: int) -> None:
    engine, behaviour = opened(SOKOBAN / "small.model", SOKOBAN / "sokoban.environment")
    plan = found(engine, behaviour, limit=50, width=width)
    simulator, rng, total = Simulator(engine, behaviour), np.random.default_rng(0), 0.0
    simulator.reset(rng)
    for action in plan.actions:
        total += simulator.step(simulator.action_names.index(action), rng).reward
    simulator.close()
    assert plan.total_reward == total != 0.0 and not plan.is_exact


def test_models_with_different_objects_get_separate_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is written once, whichever model comes next."""
    written, program_of = [], _compiled_program.program_of

    def counted(*arguments: Any, **options: Any) -> CompiledProgram:
        written.append(options["keys"])
        return program_of(*arguments, **options)

    monkeypatch.setattr(_compiled_program, "program_of", counted)
    halls = [test_agents.Hall(["..d"], [(0, 0)], 9, [(0, 0), (1, 0)][:count]) for count in (1, 2)]
    engines = [test_agents.opened(hall.text()) for hall in halls]
    plans = Plans(engines[0][1])
    steps = [plans.plan(engine).steps for engine, _ in (*engines, *engines)]
    assert steps[:2] == steps[2:] and steps[0] < steps[1]
    assert len(written) == 2 and written[0] != written[1]


def test_search_tries_actions_of_other_blocks_once_and_finds_the_same_plan(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine, behaviour = loaded(
        """
        agents together
        agent coin : Coin { action wait = nothing() action flip = 0.5: turnOver(coin) observe coin.side }
        agent player : Hand {
            action add(n : 1..2) = count(player, n)
            action rest = nothing() reward 1
            observe player.moves in 0..3
        }
        on neg find up(_) terminate success
        """
    )
    program = program_of(engine, behaviour, native=False)
    tried = _plan_search.distinct_actions(program)
    assert len(program.action_names) == 5**4 and len(tried) == 2**3 * 4  # a coin flips, a hand adds, rests or does not
    names = [program.action_names[number] for number in tried]
    assert names[:2] == [
        "a: wait, b: wait, c: wait, player 0: wait",
        "a: flip, b: wait, c: wait, player 0: wait",
    ]
    assert_same_as_the_table(engine, behaviour)
    plan = found(engine, behaviour)
    monkeypatch.setattr(_plan_search, "distinct_actions", lambda *_: np.arange(5**4))
    assert found(engine, behaviour) == plan and plan.steps == 1
