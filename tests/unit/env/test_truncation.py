"""Episodes that a behaviour truncates: live, from a table, compiled, in packages, and what learners make of it."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Literal

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from envgraph.behaviour import Behaviour
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, explore
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, enumerate_states, program_of
from envgraph.rewrite import Engine
from envgraph.solve import certify, value_iteration
from envgraph.solve.learning import Backend, TrainingSettings, train_curriculum
from tests.profile import NIGHTLY
from tests.unit.env.coins import QUERY, loaded
from tests.unit.env.side_by_side import Corner

LATE = "pattern late(hand : Hand) { Hand.moves(hand, moves); check(moves >= 3); }\n"
CLOCK = """
action turnOver(coin : Coin) = turnOver(coin)
action wait = nothing()
each step reward 1.0 apply count(hand, 1)
on find late(hand) truncate
on neg find up(_) terminate success
observe coin.side for coin : Coin
"""
"""Hands count to 3; two coins show heads."""
WAIT = 3


def clock(environment: str = CLOCK) -> tuple[Engine, Behaviour]:
    return loaded(environment, texts={"coins.query": QUERY + LATE})


def test_a_truncated_step_is_over_but_not_terminated() -> None:
    engine, behaviour = clock()
    for env in (
        EnvgraphLiveEnv(Simulator(*clock())),
        EnvgraphEnv(explore(engine, behaviour).tabular),
        CompiledEnv(program_of(engine, behaviour, native=False)),
    ):
        env.reset(seed=0)
        found = [env.step(WAIT)[2:4] for _ in range(3)]
        assert found == [(False, False), (False, False), (False, True)]
        with pytest.raises(Exception, match="over"):
            env.step(WAIT)


def test_termination_overrides_truncation_in_any_order_of_clauses() -> None:
    for first, second in (("truncate", "terminate failure"), ("terminate failure", "truncate")):
        engine, behaviour = clock(f"action wait = nothing()\non find up(_) {first}\non find up(_) {second}")
        program = program_of(engine, behaviour, native=False)
        for env in (EnvgraphLiveEnv(Simulator(engine.copy(), behaviour)), CompiledEnv(program)):
            env.reset(seed=0)
            assert env.step(0)[2:4] == (True, False)


def test_tables_mark_truncated_steps_and_absorb_after_them() -> None:
    engine, behaviour = clock()
    table = explore(engine, behaviour).tabular
    table.check()
    assert (table.terminated == -1).any()
    assert set(np.unique(table.terminated).tolist()) == {-1, 0, 1}
    after = np.unique(table.next_state[table.terminated == -1])
    assert (table.next_state[after] == after[:, None, None]).all(), "a truncated episode is over"
    compiled = enumerate_states(program_of(engine, behaviour, native=False))
    assert compiled.terminated.tolist() == table.terminated.tolist()


CORNERS = {"episodes that a behaviour truncates": Corner(clock)}


@pytest.mark.parametrize("mode", AutoresetMode)
def test_table_and_compiled_vector_environments_truncate_alike(mode: AutoresetMode) -> None:
    engine, behaviour = clock()
    table = EnvgraphVectorEnv([explore(engine, behaviour).tabular], 4, autoreset_mode=mode)
    program = CompiledVectorEnv(program_of(engine, behaviour, native=False), 4, autoreset_mode=mode)
    rng, done = np.random.default_rng(1), np.zeros(4, dtype=np.bool_)
    table.reset(seed=5)
    program.reset(seed=5)
    truncations = 0
    for _ in range(30):
        if mode is AutoresetMode.DISABLED and done.any():
            table.reset(options={"reset_mask": done})
            program.reset(options={"reset_mask": done})
        actions = rng.integers(4, size=4)
        one, other = table.step(actions), program.step(actions)
        for wanted, found in zip(one[:4], other[:4], strict=True):
            assert np.array_equal(wanted, found)
        done = one[2] | one[3]
        truncations += int(one[3].sum())
        assert not (one[2] & one[3]).any()
    assert truncations > 3


def test_truncated_episode_counts_in_the_return_but_not_as_success() -> None:
    engine, behaviour = clock(CLOCK.replace("terminate success", "reward 5.0 terminate success"))
    table = explore(engine, behaviour).tabular
    known = certify(table, np.full(table.n_states, WAIT), limit=100)
    assert (known.policy_return, known.success) == (3.0, 0.0)
    assert known.optimal_return == 8.0, "the last coin is turned in the third step, and termination wins"


AGENTS = "q_learning", "sarsa", "expected_sarsa"
LOOP = """
action wait = nothing()
each step reward 1.0
on find up(_) truncate
observe hand.moves in 0..3
"""


@pytest.mark.parametrize(
    ("backend", "agent"),
    [
        *(("python", agent) for agent in AGENTS),
        *(("numba", agent) for agent in (AGENTS if NIGHTLY else AGENTS[:1])),
    ],
)
def test_learners_bootstrap_where_an_episode_is_truncated(
    agent: Literal["q_learning", "sarsa", "expected_sarsa"], backend: Backend
) -> None:
    if backend == "numba" and not find_spec("numba"):
        pytest.skip("numba is not installed")
    table = explore(*clock(LOOP)).tabular
    settings = TrainingSettings(agent=agent, discount=0.5, learning_rate=0.5, steps_per_environment=200, checkpoint=200)
    learnt = train_curriculum([table], settings, np.random.default_rng(1), backend=backend)
    assert learnt.q[0, 0] == pytest.approx(2.0), "1 + 0.5 + 0.25 + .., though each episode has one step"
    assert value_iteration(table, discount=0.5).values[table.start_states[0]] == 1.0, "what an episode pays"
