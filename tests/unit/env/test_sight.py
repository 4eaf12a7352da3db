"""Observations of what is seen now and then: `observe .. if find ..`; live, in tables, and compiled."""

from __future__ import annotations

import pytest

from envgraph.behaviour import Behaviour
from envgraph.env import Simulator, explore, model_view
from envgraph.env.compiled import enumerated, program_of
from envgraph.errors import InvalidArgument
from envgraph.rewrite import Engine
from tests.unit.env.coins import QUERY, RULES, loaded
from tests.unit.env.side_by_side import Corner, family_keys, step_side_by_side

ACTIONS = """
action take(coin : Coin) = grab(hand, coin, _)
action drop = drop(hand)
action over(coin : Coin) = turnOver(coin)
action stack(coin : Coin, other : Coin) = put(coin, other)
action lose(coin : Coin) = melt(coin)
"""
HELD = """
observe coin.side for coin : Coin if find held(hand, coin)
observe coin.over among Coin or none for coin : Coin if find held(hand, coin)
observe coin.value in 1..4 for coin : Coin if find heavier(coin, other)
observe hand.moves in 0..3 if find held(hand, _)
"""
HEAVIER = """
pattern heavier(coin : Coin, other : Coin) {
    Coin.value(coin, value); Coin.value(other, less); Coin.over(coin, other); check(value > less);
}
"""
MORE = """rule put(one : Coin, other : Coin) { lhs { one != other; } modify { set one.over = other; } }
@semantics(spo) rule melt(coin : Coin) { lhs { Coin(coin); } modify { delete coin; } }
"""
TOSS = """
rule toss(hand : Hand) { lhs { table : Table -hand-> hand; } modify { delete hand; } }
"""
UNSEEN = 2


def hands() -> tuple[Engine, Behaviour]:
    texts = {"coins.query": QUERY + HEAVIER, "coins.rules": RULES + MORE}
    return loaded(ACTIONS + HELD, texts=texts)


def seen(simulator: Simulator) -> list[int]:
    index, found = simulator.observe(), []
    for size in simulator.observation_shape:
        index, value = divmod(index, size)
        found.append(value)
    return found


def do(simulator: Simulator, name: str) -> list[int]:
    simulator.act(simulator.action_names.index(name), 0.5)
    return seen(simulator)


def test_what_is_out_of_sight_has_a_value_of_its_own() -> None:
    simulator = Simulator(*hands())
    assert simulator.observation_shape == (3, 3, 3, 5, 5, 5, 5, 5, 5, 5)
    assert seen(simulator) == [2, 2, 2, 4, 4, 4, 4, 4, 4, 4]
    assert do(simulator, "take(c)") == [2, 2, 1, 4, 4, 3, 4, 4, 4, 0], "c shows tails, and lies on no coin"
    assert do(simulator, "stack(c, a)") == [2, 2, 1, 4, 4, 0, 4, 4, 3, 0], "4 is more than 1"
    assert do(simulator, "lose(a)") == [0, 2, 1, 3, 4, 3, 0, 4, 4, 0], "a is gone: 0 or none, whoever looks"


def test_tables_and_compiled_programs_see_the_same() -> None:
    engine, behaviour = hands()
    table = explore(engine, behaviour).tabular
    assert len(set(table.observation.tolist())) < table.n_states / 4, "many states look alike"
    compiled = enumerated(program_of(engine, behaviour, native=False))
    assert compiled.observation.tolist() == table.observation.tolist()


CORNERS = {"what is seen now and then": Corner(hands, members=1)}


def test_an_object_that_a_member_lacks_is_not_out_of_sight() -> None:
    engine, behaviour = hands()
    other = engine.copy()
    (lost,) = (one for one in other.model.nodes("Coin") if one.name == "b")
    other.apply("lose", coin=lost)
    keys = family_keys([engine, other], behaviour)
    assert seen(Simulator(other, behaviour, keys))[:3] == [2, 0, 2]
    step_side_by_side([engine, other], behaviour, 60, native=False)


def test_who_is_gone_sees_nothing() -> None:
    clauses = "agent me : Hand { action bye = toss(me)\nobserve coin.side for coin : Coin if find held(me, coin) }\n"
    engine, behaviour = loaded(clauses, "table : Table", texts={"coins.rules": RULES + TOSS})
    simulator = Simulator(engine, behaviour)
    assert seen(simulator) == [UNSEEN] * 3
    assert do(simulator, "bye") == [UNSEEN] * 3


def test_an_image_would_show_what_is_out_of_sight() -> None:
    engine, behaviour = hands()
    with pytest.raises(InvalidArgument, match="hides a part of it from its agents"):
        model_view("graph", behaviour, [engine.model])
