"""Whether an episode can end in success or failure, against the table of all states."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import Behaviour, can_end, explore
from envgraph.errors import RuleError
from envgraph.rewrite import Engine
from tests.unit.env import test_agents, test_keydoor
from tests.unit.env.coins import loaded
from tests.unit.rewrite.graphs import snapshot


def assert_same_as_the_table(engine: Engine, behaviour: Behaviour) -> None:
    before = snapshot(engine.model)
    ended = np.unique(explore(engine, behaviour).tabular.terminated)
    for outcome in (1, 2):
        assert can_end(engine, behaviour, outcome) == (outcome in ended)
    engine.model.check_integrity()
    assert snapshot(engine.model) == before


@pytest.mark.parametrize("rows", [*test_keydoor.MAZES, test_keydoor.TWO_KEYS, ["####", "#.#X"], ["####", "#.RX"]])
def test_reachable_ends_of_solvable_and_unsolvable_mazes_equal_the_table(rows: list[str]) -> None:
    assert_same_as_the_table(*test_keydoor.loaded(rows))


@pytest.mark.parametrize("battery", [2, 3, 5])
def test_reachable_ends_of_robots_with_any_battery_equal_the_table(battery: int) -> None:
    hall = test_agents.Hall(["..d."], [(0, 0), (3, 0)], battery, [(0, 0), (3, 0)])
    assert_same_as_the_table(*test_agents.opened(hall.text()))


@pytest.mark.parametrize(
    "clauses",
    [
        "action turn = turn() on neg find up(_) terminate success",
        "action turn = 0.5: turn() on find pair(_, _) terminate success on neg find up(_) terminate failure",
        "action wait = nothing() on reset apply turn() on neg find up(_) terminate success",
        "action lose(coin : Coin) = lose(coin) on find any(hand) terminate failure on find up(_) terminate success",
        "action wait = nothing() on reset apply lose(one)",
    ],
)
def test_reachable_ends_with_chance_and_several_starts_equal_the_table(clauses: str) -> None:
    parameters = "hand : Hand, table : Table, one : Coin" if "(one)" in clauses else "hand : Hand"
    texts = None if "(one)" not in clauses else {"coins.model": ONE}
    assert_same_as_the_table(*loaded(clauses, parameters, texts))


ONE = """
import "coins.metamodel"
model one : coins { table : Table { hand = hand : Hand {}  coins = [one : Coin { name = "one" }] } }
"""


def test_search_beyond_its_limit_returns_false_and_leaves_the_model_unchanged() -> None:
    hall = test_agents.Hall(["....d"], [(0, 0)], 20, [(0, 0)])
    engine, behaviour = test_agents.opened(hall.text())
    before = snapshot(engine.model)
    assert can_end(engine, behaviour, 1) and not can_end(engine, behaviour, 1, limit=5)
    assert snapshot(engine.model) == before


def test_rule_error_during_the_search_is_raised_and_rolled_back() -> None:
    text = "action stack(one : Coin, other : Coin) = stack(one, other) on neg find up(_) terminate success"
    engine, behaviour = loaded(text)
    before = snapshot(engine.model)
    with pytest.raises(RuleError):
        can_end(engine, behaviour, 1)
    assert snapshot(engine.model) == before
