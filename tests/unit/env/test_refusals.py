"""`on refused`: the hand holds a coin, so that the model refuses to lose it."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.behaviour import reward_names, with_only_reward
from envgraph.env import Simulator, explore
from envgraph.env.compiled import CompiledVectorEnv, program_of
from envgraph.errors import RuleError
from tests.unit.env.coins import loaded, simulator
from tests.unit.env.test_together import COINS, steps

LOSE = "action lose(coin : Coin) = lose(coin) reward 5 else reward -1\n"
GRAB = "action grab(coin : Coin) = grab(hand, coin, _)\n"
LOSE_HELD = 0
"""The number of the action `lose(a)`."""


def holding(clauses: str) -> Simulator:
    """The coins, one of which is held."""
    live = simulator(LOSE + clauses)
    live.engine.apply("grab", hand=live.engine.model["hand"], coin=live.engine.model["a"])
    return live


@pytest.mark.parametrize(
    ("clauses", "reward", "end"),
    [
        ("on refused nothing()", -1.0, 0),
        ("on refused reward -0.5", -1.5, 0),
        ("on refused reward 1\non refused reward 2 terminate success", 2.0, 1),
        ("on refused terminate failure\non find any(hand) terminate success", -1.0, 2),
        ("on find any(hand) terminate success\non refused reward 0.25 truncate", -0.75, 1),
        ("on refused truncate", -1.0, -1),
        ("on find held(hand, coin) apply lose(coin)\non refused reward -0.5", -1.5, 0),
        ("on refused reward hand.moves\non find held(hand, coin) apply count(hand, 2)", 1.0, 0),
    ],
)
def test_refused_action_changes_nothing_and_the_clauses_say_what_it_means(
    clauses: str, reward: float, end: int
) -> None:
    live = holding(clauses)
    before = live.engine.model.state_hash()
    for probability, *found in live.outcomes(LOSE_HELD):
        assert [probability, *found] == [1.0, reward, end]
        assert "count" in clauses or live.engine.model.state_hash() == before


def test_refusal_is_an_error_without_a_clause_about_it() -> None:
    with pytest.raises(RuleError, match="lose"):
        list(holding("").outcomes(LOSE_HELD))
    block = "agent coin : Coin { action wait = nothing()\non refused nothing()\nobserve coin.side }\n"
    live = simulator(block + "each step apply stack(a, c)", "a : Coin, c : Coin")
    live.engine.apply("stack", one=live.engine.model["a"], other=live.engine.model["b"])
    with pytest.raises(RuleError, match="stack"):
        live.step_with(0, 0.5)


def test_refused_actions_could_be_done_as_masks_say() -> None:
    text = GRAB + LOSE + "on refused reward -1"
    table = explore(*loaded(text)).tabular
    live = simulator(text)
    live.engine.apply("grab", hand=live.engine.model["hand"], coin=live.engine.model["a"])
    assert live.action_mask()[live.action_names.index("lose(a)")]
    assert table.allowed is not None and table.allowed.all(axis=1).any()


def test_rewards_of_refusals_are_told_apart() -> None:
    engine, behaviour = loaded(LOSE + "on refused reward -0.5 truncate")
    assert reward_names(behaviour) == ("lose", "refused")
    engine.apply("grab", hand=engine.model["hand"], coin=engine.model["a"])
    for name, reward in (("lose", -1.0), ("refused", -0.5)):
        alone = Simulator(engine, with_only_reward(behaviour, name))
        assert [found[1:] for found in alone.outcomes(LOSE_HELD)] == [(reward, -1)]


def test_clause_of_a_block_pays_the_agents_whose_rules_are_refused() -> None:
    text = COINS.replace("observe", "on refused reward -0.5\nobserve")
    assert steps(text, (1, 0, 0), (2, 0, 2)) == [(1.0, 0.0, 0.0), (-0.5, 0.0, 0.0)]
    assert steps(COINS + "on refused reward -0.5", (1, 0, 0), (2, 0, 2))[1] == (-0.5, -0.5, -0.5)


def test_refusals_do_not_stop_a_vector_of_environments() -> None:
    found = []
    for clause in ("on refused reward -0.5", ""):
        engine, behaviour = loaded(GRAB + LOSE + clause)
        many = CompiledVectorEnv(program_of(engine, behaviour, native=False), 16, streams="each")
        many.reset(seed=0)
        rng = np.random.default_rng(0)
        rounds = [rng.integers(6, size=16) for _ in range(8)]
        if clause:
            found = [many.step(actions)[1] for actions in rounds]
        else:
            with pytest.raises(RuleError, match="lose"):
                for actions in rounds:
                    many.step(actions)
    assert (np.concatenate(found) == -1.5).any()
