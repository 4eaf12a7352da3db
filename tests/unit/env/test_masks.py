"""Action masks: which actions do something, from tables, on the live engine, and in compiled programs."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, enumerate_states, has_numba, program_of
from tests.profile import AT_NIGHT
from tests.unit.env.coins import RULES, loaded

MIXED = """
action over(coin : Coin) = turnOver(coin)
action back(coin : Coin) = turnBack(coin) else reward -1
action maybe = 0.5: drop(hand) | 0.2: turn()
action never = 0.0: turn() | 0.5: drop(hand)
action wait = 0.1: nothing() | 0.9: drop(hand)
on neg find up(_) terminate failure
observe coin.side for coin : Coin
"""
NAMES = ("maybe", "never", "wait")
UNITS = """
unit late(hand : Hand) { turn; drop(hand); }
unit some(coin : Coin) { turn; turnOver(coin); }
"""


def test_mask_allows_an_action_if_one_of_its_branches_is_applicable() -> None:
    env = EnvgraphEnv(explore(*loaded(MIXED)).tabular, action_masks=True)
    assert env.action_names == (*(f"{name}({coin})" for name in ("over", "back") for coin in "abc"), *NAMES)
    _, info = env.reset()
    assert info["action_mask"].tolist() == [1, 1, 0, 0, 0, 1, 1, 0, 1], "c shows tails; nothing is held"
    assert info["action_mask"].dtype == np.int8
    assert env.action_masks().dtype == np.bool_
    assert {int(env.action_space.sample(info["action_mask"])) for _ in range(50)} <= {0, 1, 5, 6, 8}
    _, _, _, _, info = env.step(0)
    assert info["action_mask"].tolist() == [0, 1, 0, 1, 0, 1, 1, 0, 1]
    assert env.step(1)[2]
    assert env.action_masks().all(), "the episode is over"


def test_mask_allows_all_actions_if_none_is_applicable() -> None:
    env = EnvgraphLiveEnv(Simulator(*loaded("action over(coin : Coin) = turnOver(coin)")))
    env.reset()
    assert env.action_masks().tolist() == [True, True, False]
    env.step(1)
    assert env.action_masks().tolist() == [True, False, False]
    env.step(0)
    assert env.action_masks().tolist() == [True, True, True]


def test_mask_allows_units_that_can_succeed_and_leaves_the_state_unchanged() -> None:
    engine, behaviour = loaded(
        "action late = late(hand)\naction some(coin : Coin) = some(coin)",
        texts={"coins.rules": RULES + UNITS},
    )
    simulator = Simulator(engine, behaviour)
    before = simulator.state_key()
    assert simulator.action_mask().tolist() == [False, True, True, False], "b is turned first, or a"
    assert simulator.state_key() == before


def test_mask_allows_actions_whose_arguments_cannot_be_computed() -> None:
    clauses = "action burst = spend(hand, 1 / hand.moves)\naction wait = nothing()"
    spend = "lhs { check hand.moves < much; } modify { set hand.moves = much; }"
    rules = f"{RULES}\nrule spend(hand : Hand, much : int) {{ {spend} }}"
    engine, behaviour = loaded(clauses, texts={"coins.rules": rules})
    assert Simulator(engine, behaviour).action_mask().all()
    env = CompiledEnv(program_of(engine, behaviour, native=False))
    env.reset(seed=0)
    assert env.action_masks().all()
    env.step(1)
    assert env.action_masks().all()


def test_compiled_masks_equal_live_masks_in_all_states() -> None:
    engine, behaviour = loaded(MIXED)
    mine, other = (
        explore(engine, behaviour).tabular,
        enumerate_states(program_of(engine, behaviour, native=False)),
    )
    assert mine.allowed is not None and other.allowed is not None
    assert mine.allowed.tolist() == other.allowed.tolist()
    assert 0.2 < mine.allowed.mean() < 1.0


@pytest.mark.parametrize(
    ("mode", "native"),
    [
        *((mode, False) for mode in AutoresetMode),
        pytest.param(AutoresetMode.NEXT_STEP, has_numba(), marks=AT_NIGHT),
    ],
)
def test_masks_of_vectors_equal_masks_of_single_environments(mode: AutoresetMode, native: bool) -> None:
    engine, behaviour = loaded(MIXED)
    program, table = program_of(engine, behaviour, native=native), explore(engine, behaviour).tabular
    shared = {"num_envs": 3, "autoreset_mode": mode, "action_masks": True}
    ours = [
        EnvgraphVectorEnv(table, **shared),  # type: ignore[arg-type]
        CompiledVectorEnv(program, **shared),  # type: ignore[arg-type]
    ]
    each = CompiledVectorEnv(program, streams="each", **shared)  # type: ignore[arg-type]
    singles = [lambda: CompiledEnv(program, action_masks=True) for _ in range(3)]
    theirs = SyncVectorEnv(singles, autoreset_mode=mode)
    infos = [env.reset(seed=1)[1] for env in (*ours, each, theirs)]
    rng = np.random.default_rng(0)
    for _ in range(12):
        one, two, three, four = (info["action_mask"] for info in infos)
        assert one.dtype == four.dtype == np.int8
        assert one.tolist() == two.tolist()
        assert three.tolist() == four.tolist()
        assert (ours[0].action_masks() == one).all()
        actions = np.array([rng.choice(np.flatnonzero(row)) for row in four])
        steps = [env.step(actions) for env in (*ours, each, theirs)]
        infos = [step[4] for step in steps]
        over = steps[2][2]
        if mode is AutoresetMode.DISABLED and (over.any() or steps[0][2].any()):
            break
        if "final_info" in infos[2]:
            final = (info["final_info"]["action_mask"].tolist() for info in infos[2:])
            assert len({str(one) for one in final}) == 1


PAIR = """
agents together
agent me : Coin {
    action turn = turnOver(me)
    action drop = drop(hand)
    action lose = lose(me)
    observe me.side
}
observe hand.moves in 0..3
"""


def test_masks_of_simultaneous_agents_refer_to_the_state_before_the_step() -> None:
    engine, behaviour = loaded(PAIR)
    simulator = Simulator(engine, behaviour)
    simulator.reset(np.random.default_rng(0))
    names, together = simulator.action_names, simulator.joint_stepper
    assert together is not None
    assert [simulator.agent_action_mask(number).tolist() for number in range(3)] == [
        [True, False, True],
        [True, False, True],
        [False, False, True],
    ], "nothing is held, and c shows tails"
    allowed = {name for name, can in zip(names, simulator.action_mask(), strict=True) if can}
    assert allowed == {f"a: {a}, b: {b}, c: lose" for a in ("turn", "lose") for b in ("turn", "lose")}
    simulator.step_with(together.joint_action([0, 2, 0]), 0.5)
    assert [simulator.agent_action_mask(number).sum() for number in range(3)] == [1, 3, 1], "b is gone: all is one"


def test_masks_of_simultaneous_agents_agree_between_table_program_and_live() -> None:
    table = explore(*loaded(PAIR)).tabular
    assert 0.0 < table.action_masks.mean() < 0.5
    program = program_of(*loaded(PAIR), native=False)
    assert np.array_equal(enumerate_states(program).action_masks, table.action_masks)
    assert (
        table.action_masks[(table.next_state == np.arange(table.n_states)[:, None, None]).all((1, 2))].any(axis=1).all()
    )
    live, compiled = EnvgraphLiveEnv(Simulator(*loaded(PAIR))), CompiledEnv(program)
    single, rng = EnvgraphEnv(table), np.random.default_rng(3)
    for env in (live, compiled, single):
        env.reset(seed=1)
    for action in rng.integers(27, size=12).tolist():
        masks = [env.action_masks().tolist() for env in (live, compiled, single)]
        assert masks[0] == masks[1] == masks[2]
        for env in (live, compiled, single):
            env.step(action)


LAST = """
action rest = nothing()
agent me : Coin {
    action lose = lose(me)
    action over = turnOver(me)
    observe me.side
}
"""


def test_agent_that_is_gone_and_keeps_its_turn_can_do_what_needs_no_agent() -> None:
    table = explore(*loaded(LAST, parameters="")).tabular
    program = program_of(*loaded(LAST, parameters=""), native=False)
    for env in (EnvgraphLiveEnv(Simulator(*loaded(LAST, parameters=""))), CompiledEnv(program), EnvgraphEnv(table)):
        assert env.action_names == ("rest", "lose", "over")
        env.reset(seed=1)
        masks = [env.action_masks().tolist()]
        for _ in range(3):
            env.step(1)
            masks.append(env.action_masks().tolist())
        assert masks[:2] == [[True] * 3] * 2
        assert masks[2:] == [[True, True, False], [True, False, False]], "c shows tails; then all are lost"
