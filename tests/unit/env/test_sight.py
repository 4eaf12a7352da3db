"""Observations of what is seen now and then: `observe .. if find ..`; live, in tables, and compiled."""

from __future__ import annotations

from envgraph.behaviour import Behaviour
from envgraph.env import Simulator, explore
from envgraph.env.compiled import enumerate_states, program_of
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


def load_partially_observed_coins() -> tuple[Engine, Behaviour]:
    texts = {"coins.query": QUERY + HEAVIER, "coins.rules": RULES + MORE}
    return loaded(ACTIONS + HELD, texts=texts)


def observed_components(simulator: Simulator) -> list[int]:
    index, found = simulator.observe(), []
    for size in simulator.observation_shape:
        index, value = divmod(index, size)
        found.append(value)
    return found


def act_and_observe(simulator: Simulator, name: str) -> list[int]:
    simulator.step_with(simulator.action_names.index(name), 0.5)
    return observed_components(simulator)


def test_hidden_components_have_a_separate_value() -> None:
    simulator = Simulator(*load_partially_observed_coins())
    assert simulator.observation_shape == (3, 3, 3, 5, 5, 5, 5, 5, 5, 5)
    assert observed_components(simulator) == [2, 2, 2, 4, 4, 4, 4, 4, 4, 4]
    assert act_and_observe(simulator, "take(c)") == [2, 2, 1, 4, 4, 3, 4, 4, 4, 0], "c shows tails, and lies on no coin"
    assert act_and_observe(simulator, "stack(c, a)") == [2, 2, 1, 4, 4, 0, 4, 4, 3, 0], "4 is more than 1"
    assert act_and_observe(simulator, "lose(a)") == [0, 2, 1, 3, 4, 3, 0, 4, 4, 0], (
        "a is gone: 0 or none, whoever looks"
    )


def test_tables_and_compiled_programs_observe_hidden_components_alike() -> None:
    engine, behaviour = load_partially_observed_coins()
    table = explore(engine, behaviour).tabular
    assert len(set(table.observation.tolist())) < table.n_states / 4, "many states look alike"
    compiled = enumerate_states(program_of(engine, behaviour, native=False))
    assert compiled.observation.tolist() == table.observation.tolist()


CORNERS = {"what is seen now and then": Corner(load_partially_observed_coins, members=1)}


def test_object_missing_from_a_member_is_not_reported_as_hidden() -> None:
    engine, behaviour = load_partially_observed_coins()
    other = engine.copy()
    (lost,) = (one for one in other.model.nodes("Coin") if one.name == "b")
    other.apply("lose", coin=lost)
    keys = family_keys([engine, other], behaviour)
    assert observed_components(Simulator(other, behaviour, keys))[:3] == [2, 0, 2]
    step_side_by_side([engine, other], behaviour, 60, native=False)


def test_deleted_agent_observes_all_components_as_hidden() -> None:
    clauses = "agent me : Hand { action bye = toss(me)\nobserve coin.side for coin : Coin if find held(me, coin) }\n"
    engine, behaviour = loaded(clauses, "table : Table", texts={"coins.rules": RULES + TOSS})
    simulator = Simulator(engine, behaviour)
    assert observed_components(simulator) == [UNSEEN] * 3
    assert act_and_observe(simulator, "bye") == [UNSEEN] * 3
