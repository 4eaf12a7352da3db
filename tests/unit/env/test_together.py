"""Agents that act together: the warehouse against a direct implementation, and what coins can show."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
import pytest

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, KeyIndex, Simulator, explore
from envgraph.env.compiled import (
    CompiledVectorEnv,
    PlanSearch,
    enumerate_states,
    program_of,
    with_guide_counts,
)
from envgraph.errors import EvaluationError, LoadError, ResolutionError
from tests.unit.env.coins import loaded, sides, simulator
from tests.unit.env.side_by_side import Corner
from tests.unit.env.test_agents import HALLS, Hall, State, opened


def simultaneous_outcomes(
    hall: Hall, state: State, actions: tuple[int, ...]
) -> list[tuple[State, list[float], float, int]]:
    """The equally likely outcomes of a step of all robots: state, reward of each, of all, end."""
    found: list[tuple[State, list[float]]] = [(state, [])]
    for robot, action in enumerate(actions):
        found = [
            (after, [*rewards, reward])
            for before, rewards in found
            for after, reward in hall.moves(before, robot, action)
        ]
    result = []
    for after, rewards in found:
        empty, done = [battery == 0 for battery in after.battery], all(after.shipped)
        own = [reward - 2.0 * flat for reward, flat in zip(rewards, empty, strict=True)]
        shared = -0.01 + 10.0 * done
        result.append((after, [one + shared for one in own], sum(own) + shared, 2 if any(empty) else int(done)))
    return result


def observation_of_all_robots(hall: Hall, state: State) -> int:
    """Place, load and battery of each robot, then all places, as one number."""
    cells, parcels = len(hall.cells), len(state.parcels)
    parts = []
    for at, load, battery in zip(state.at, state.load, state.battery, strict=True):
        own = (hall.cells.index(at), cells), (parcels if load is None else load, parcels + 1), (battery, 51)
        parts += own
    parts += [(hall.cells.index(at), cells) for at in state.at]
    parts += [(cells if at is None else hall.cells.index(at), cells + 1) for at in state.parcels]
    index, weight = 0, 1
    for value, size in parts:
        index += value * weight
        weight *= size
    return index


@pytest.mark.parametrize("hall", HALLS[1:], ids=lambda hall: "/".join(hall.rows))
def test_every_simultaneous_transition_equals_that_of_a_warehouse_in_python(hall: Hall) -> None:
    tabular = explore(*opened(hall.text(), together=True)).tabular
    tabular.check()
    assert tabular.turn is None and tabular.n_actions == 7**hall.count
    (start,) = tabular.start_states.tolist()
    seen: dict[int, tuple[State, bool]] = {start: (hall.start, False)}
    queue = [start]
    for number in queue:
        state, over = seen[number]
        assert tabular.observation[number] == observation_of_all_robots(hall, state)
        for place, digits in enumerate(product(range(7), repeat=hall.count) if not over else ()):
            actions = digits[::-1]  # that of the first robot varies fastest
            merged: dict[tuple[State, float, int], int] = {}
            expected = simultaneous_outcomes(hall, state, actions)
            for after, _, reward, ended in expected:
                key = after, round(reward, 9), ended
                merged[key] = merged.get(key, 0) + 1
            for outcome, ((after, reward, ended), times) in enumerate(merged.items()):
                at = number, place, outcome
                assert tabular.probability[at] == pytest.approx(times / len(expected))
                assert tabular.reward[at] == pytest.approx(reward, abs=1e-9)
                assert tabular.terminated[at] == ended
                found = int(tabular.next_state[at])
                if found not in seen:
                    seen[found] = after, ended > 0
                    queue.append(found)
                assert seen[found] == (after, ended > 0)
    assert len(seen) == tabular.n_states


def test_each_robot_gets_its_own_reward_and_the_shared_reward() -> None:
    hall = HALLS[1]
    live = Simulator(*opened(hall.text(), together=True))
    assert live.joint_stepper is not None and live.all_agent_names == ("a", "b") and live.agent_names == ()
    rng, state = np.random.default_rng(4), hall.start
    live.reset(rng)
    for _ in range(200):
        actions = tuple(rng.integers(7, size=2).tolist())
        found = live.step(live.joint_stepper.joint_action(actions), rng)
        ((state, each, total, ended),) = simultaneous_outcomes(
            hall, state, actions
        )  # no two parcels in one cell: no chance
        assert live.joint_stepper.rewards == pytest.approx(tuple(each))
        assert (found.reward, found.terminated) == (pytest.approx(total), ended)
        assert found.observation == observation_of_all_robots(hall, state)
        if ended:
            live.reset(rng)
            state = hall.start


def test_single_simultaneous_agent_equals_an_agent_that_takes_turns() -> None:
    hall = HALLS[2]
    turns, same = explore(*opened(hall.text())).tabular, explore(*opened(hall.text(), together=True)).tabular
    for name in ("next_state", "probability", "reward", "terminated", "observation", "start_states"):
        assert np.array_equal(getattr(turns, name), getattr(same, name)), name
    assert same.action_names[4:] == ("a: lift", "a: ship", "a: wait")


def test_table_and_live_environment_step_alike() -> None:
    hall = HALLS[0]
    rows = EnvgraphEnv(explore(*opened(hall.text(), together=True)).tabular, observation="multi")
    live = EnvgraphLiveEnv(Simulator(*opened(hall.text(), together=True)), observation="multi")
    rng = np.random.default_rng(3)
    for seed in range(10):
        (one, _), (other, info) = rows.reset(seed=seed), live.reset(seed=seed)
        assert (one == other).all() and "agent" not in info
        ended = False
        while not ended:
            action = int(rng.integers(49))
            (one, reward, ended, _, _), (other, gain, over, _, _) = rows.step(action), live.step(action)
            assert (one == other).all() and (reward, ended) == (gain, over)


# --- coins


COINS = """
    agents together
    agent coin : Coin {
        action wait = nothing()
        action hold = grab(hand, coin, value) reward value else reward -1.0
        action lose = lose(coin)
        observe coin.side
    }
"""


def steps(text: str, *actions: tuple[int, ...]) -> list[tuple[float, ...]]:
    """The rewards of the coins, step by step."""
    live = simulator(text)
    assert live.joint_stepper is not None
    rng = np.random.default_rng(0)
    live.reset(rng)
    found = []
    for chosen in actions:
        live.step(live.joint_stepper.joint_action(chosen), rng)
        found.append(live.joint_stepper.rewards)
    return found


def test_simultaneous_actions_are_applied_in_key_order_to_the_updated_model() -> None:
    # All three grab: each takes the hand from the one before. Then c has it already.
    assert steps(COINS, (1, 1, 1), (0, 0, 1)) == [(1.0, 2.0, 4.0), (0.0, 0.0, -1.0)]


def test_shared_clauses_are_evaluated_once_after_all_agents_have_acted() -> None:
    text = COINS + "\non find held(hand, other) reward other.value * 10.0"
    assert steps(text, (1, 1, 1)) == [(41.0, 42.0, 44.0)]


def test_clauses_of_an_agent_block_are_evaluated_for_each_of_its_agents() -> None:
    text = COINS.replace("observe", "on find held(hand, coin) reward 100.0 apply drop(hand)\nobserve")
    text = text.replace("on find", "each step reward coin.value * 0.5\non find")
    assert steps(text, (0, 1, 0), (0, 0, 0)) == [(0.5, 103.0, 2.0), (0.5, 1.0, 2.0)]


def test_deleted_agent_neither_acts_nor_is_rewarded_from_the_next_step() -> None:
    text = COINS.replace("observe", "each step reward 0.5\nobserve") + "\neach step reward 1.0"
    assert steps(text, (2, 0, 0), (0, 0, 0), (2, 2, 2), (0, 0, 0)) == [
        (1.5, 1.5, 1.5),
        (0.0, 1.5, 1.5),
        (0.0, 1.5, 1.5),
        (0.0, 0.0, 0.0),
    ]


def test_total_reward_counts_shared_rewards_once() -> None:
    live = simulator(COINS + "\neach step reward 100.0")
    assert live.joint_stepper is not None
    rewards = {name: reward for name, reward in zip(live.action_names, all_rewards(live), strict=True)}
    assert rewards["a: hold, b: hold, c: wait"] == 103.0
    assert rewards["a: wait, b: wait, c: wait"] == 100.0


def all_rewards(live: Simulator) -> list[float]:
    return [reward for action in range(27) for _, reward, _ in live.outcomes(action)]


def test_shared_clauses_continue_when_all_agents_are_deleted() -> None:
    live = simulator(COINS + "\neach step reward 7.0")
    rng = np.random.default_rng(0)
    live.reset(rng)
    assert [live.step(26, rng).reward, live.step(26, rng).reward] == [7.0, 7.0]
    live.close()
    assert sides(live.engine) == "ab"


def test_table_of_two_agent_blocks_with_chance_steps_like_the_live_environment() -> None:
    text = """
        agents together
        agent coin : Coin {
            action flip = 0.5: turnOver(coin)
            observe coin.side
        }
        agent fist : Hand { action wait = nothing() action drop = drop(fist) reward 3.0 observe fist.moves in 0..3 }
        each step apply 0.5: grab(fist0, a, _)
        on find up(one) reward 1.0
    """
    parameters = "fist0 : Hand, a : Coin"
    rows = EnvgraphEnv(explore(*loaded(text, parameters)).tabular)
    live = EnvgraphLiveEnv(Simulator(*loaded(text, parameters)))
    assert rows.tabular.n_actions == 3**4 and rows.tabular.observation_shape == (2, 2, 2, 4)
    rng = np.random.default_rng(3)
    assert rows.reset(seed=1)[0] == live.reset(seed=1)[0]
    for _ in range(100):
        action = int(rng.integers(81))
        assert rows.step(action)[:2] == live.step(action)[:2]


# --- compiled


BUSY = """
    agents together
    agent coin : Coin {
        action wait = nothing()
        action hold = grab(hand, coin, value) reward value * 0.1 else reward -1.0
        on find held(hand, coin) reward 100.3 apply 0.5: drop(hand)
        action flip = 0.5: turnOver(coin) | 0.2: turnBack(coin) reward coin.value
        each step reward coin.value * 0.3
        each step apply 0.1: turnBack(coin)
        action lose = lose(coin)
        on find up(coin) reward 0.7 apply stack(coin, a)
        observe coin.side
        observe coin.over among Coin or none
    }
    observe count find up(_) up to 3
    agent fist : Hand {
        action wait = nothing()
        action drop = drop(fist) reward 3.1
        action count(n : 0..1) = count(fist, n)
        observe fist.moves in 0..3
    }
    each step reward 0.1
    on find up(one) reward one.value * 0.1 apply 0.1: turnOver(one)
    on neg find up(_) reward 5.0
    on find held(hand, other) reward other.value * 10.0
    observe find held(hand, _)
"""
"""Clauses of blocks and shared ones in turn, chance, agents that go."""
SAFE = BUSY.replace("action lose = lose(coin)", "")


A_COIN = "hand : Hand, a : Coin"
CORNERS = {
    "agents together, some of which go": Corner(partial(loaded, BUSY, A_COIN), members=1),
    "agents together": Corner(partial(loaded, SAFE, A_COIN), members=1),
    "agents together, and a reward of all": Corner(partial(loaded, COINS + "each step reward 7.0"), members=1),
    "agents by turns, some of which go": Corner(
        partial(loaded, BUSY.replace("agents together", ""), A_COIN), members=1
    ),
    **{
        f"robots together in {'/'.join(hall.rows)}": Corner(partial(opened, hall.text(), together=True), members=2)
        for hall in HALLS
    },
}


def test_compiled_program_has_the_names_and_states_of_the_live_table() -> None:
    text = COINS.replace("lose(coin)", "0.5: turnOver(coin)")
    wanted = explore(*loaded(text)).tabular
    program = program_of(*loaded(text), native=False)
    found = enumerate_states(program)
    assert found.agent_names == program.agent_names(0) == () and found.turn is None
    for name in ("action_names", "observation_names", "observation_shape"):
        assert getattr(found, name) == getattr(wanted, name), name
    for name in ("next_state", "probability", "reward", "terminated", "observation", "allowed"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name)), name


def test_compiled_vector_environment_steps_like_the_table() -> None:
    tabular = explore(*opened(HALLS[2].text(), together=True)).tabular
    program = program_of(*opened(HALLS[2].text(), together=True), native=False)
    rows = EnvgraphVectorEnv([tabular], 3, observation="dict")
    many = CompiledVectorEnv(program, 3, observation="dict")
    (one, _), (other, _) = rows.reset(seed=4), many.reset(seed=4)
    rng = np.random.default_rng(0)
    for _ in range(60):
        assert one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)
        actions = rng.integers(tabular.n_actions, size=3)
        (one, *before, told), (other, *after, info) = rows.step(actions), many.step(actions)
        assert all(np.array_equal(*pair) for pair in zip(before, after, strict=True))
        assert "agent" not in told and "agent" not in info


def test_plan_of_simultaneous_agents_terminates_the_episode() -> None:
    text = COINS.replace("lose(coin)", "turnOver(coin)") + "on neg find up(_) terminate success"
    engine, behaviour = loaded(text)
    made, guides = with_guide_counts(behaviour)
    program = program_of(engine, made, native=False)
    assert guides == 1
    assert program.observation_names == ("a side", "b side", "c side", "count up(_)")
    for limit in (1000, 1):
        plan = PlanSearch(program, limit=limit, width=1).plan(guides)
        live, rng = Simulator(*loaded(text)), np.random.default_rng(0)
        live.reset(rng)
        ends = [live.step(live.action_names.index(action), rng).terminated for action in plan.actions]
        assert ends == [1]


# --- what is refused


def test_member_that_lacks_an_agent_of_the_family_is_refused() -> None:
    engine, behaviour = loaded(COINS)
    keys = KeyIndex.of_model(engine.model, ["Coin"])
    engine.model.nodes("Coin")[0].delete()
    for make in (Simulator, program_of):
        with pytest.raises(ResolutionError, match="this one has no `Coin` b"):
            make(engine, behaviour, keys=keys)


def test_too_many_action_combinations_are_refused_when_they_are_numbered() -> None:
    live = simulator(COINS.replace("action wait", "action count(n : 0..99) = count(hand, n)\naction wait"))
    assert live.joint_stepper is not None and live.joint_stepper.n_actions == 103**3
    with pytest.raises(EvaluationError, match="1,092,727 joint actions of all agents"):
        live.action_names  # noqa: B018
    with pytest.raises(EvaluationError, match="1,092,727 joint actions of all agents"):
        program_of(live.engine, live.behaviour, native=False)
    live.reset(np.random.default_rng(0))
    assert live.step(103**3 - 1, np.random.default_rng(0)).terminated == 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "agents together action wait = nothing()",
            "`agents together` needs `agent` blocks, but there are none",
        ),
        (
            "agents together agents together agent coin : Coin { action wait = nothing() }",
            "occurs twice",
        ),
        (
            "agent coin : Coin { agents together action wait = nothing() }",
            "`agents together` applies to the whole",
        ),
    ],
)
def test_invalid_clauses_of_simultaneous_agents_are_reported(text: str, told: str) -> None:
    with pytest.raises(LoadError, match=told):
        loaded(text)
