"""The semantics of a step, clause by clause, with probabilities worked out by hand."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from envgraph.env import KeyIndex, Simulator, StepOutcome, explore, indexed_classes
from envgraph.errors import EvaluationError, InvalidArgument, ResolutionError, RuleError
from tests.unit.env.coins import QUERY, loaded, sides, simulator, table


def outcomes(environment: str, action: int = 0) -> list[tuple[float, str, StepOutcome]]:
    """Probability, coins that show heads afterwards, and outcome."""
    coins = simulator(environment)
    return [
        (round(p, 12), sides(coins.engine), StepOutcome(reward, end, coins.observe()))
        for p, reward, end in coins.outcomes(action)
    ]


def rewards(environment: str, action: int = 0) -> dict[float, float]:
    """Probability of each reward."""
    found: dict[float, float] = defaultdict(float)
    for probability, _, outcome in outcomes(environment, action):
        found[round(outcome.reward, 9)] += probability
    return {reward: round(probability, 9) for reward, probability in found.items()}


# --- (a) the action


def test_matches_are_equally_likely_and_listed_in_creation_order() -> None:
    # b was created before a: turning b leaves a.
    assert [(p, up) for p, up, _ in outcomes("action turn = turn()")] == [(0.5, "a"), (0.5, "b")]


def test_matches_share_the_probability_of_a_branch_and_the_rest_does_nothing() -> None:
    found = outcomes("action turn = 0.5: turn()")
    assert [(p, up) for p, up, _ in found] == [(0.25, "a"), (0.25, "b"), (0.5, "ab")]


def test_rule_without_a_match_leaves_the_state_unchanged() -> None:
    assert [(p, up) for p, up, _ in outcomes("action drop = drop(hand)")] == [(1.0, "ab")]


def test_probability_expressions_are_evaluated_in_the_current_state() -> None:
    text = "action toss(coin : Coin) = (coin.value / 8.0): turnOver(coin) | 0.25: count(hand, coin.value)"
    assert [(p, up) for p, up, _ in outcomes(text, 1)] == [(0.25, "a"), (0.25, "ab"), (0.5, "ab")]
    moved = simulator("action move = (0.75 - hand.moves / 4.0): count(hand, 2) reward 1 else reward -1")
    assert [p for p, _, _ in moved.outcomes(0)] == [0.75, 0.25]
    moved.engine.model["hand"].moves = 2
    assert [p for p, _, _ in moved.outcomes(0)] == [0.25, 0.75]


def test_probability_read_from_a_deleted_object_is_zero() -> None:
    text = "action wait = nothing()\naction take(coin : Coin) = (coin.value / 4.0): turnOver(coin) | 0.5: lose(coin)"
    coins = simulator(text)
    take = coins.action_names.index("take(a)")
    assert [round(p, 12) for p, _, _ in coins.outcomes(take)] == [0.25, 0.5, 0.25]
    coins.engine.apply("lose", coin=coins.engine.model["a"])
    assert [(p, sides(coins.engine)) for p, _, _ in coins.outcomes(take)] == [(0.5, "b"), (0.5, "b")]


@pytest.mark.parametrize(
    ("chance", "message", "place"),
    [
        (
            "(coin.value - 3.0)",
            "-1 is not a probability from 0 to 1, where `coin` is Coin#",
            "coin.value - 3.0",
        ),
        ("(coin.over.value / 4.0)", "a probability has no value", "coin.over"),
        ("(coin.value / 2.0)", "the probabilities add up to 1.5, which is above 1, where `coin` is", "0.5"),
    ],
)
def test_invalid_probability_in_a_state_is_an_error(chance: str, message: str, place: str) -> None:
    coins = simulator(f"action toss(coin : Coin) = {chance}: turnOver(coin) | 0.5: nothing()")
    with pytest.raises(EvaluationError) as caught:
        list(coins.outcomes(1))
    assert caught.value.message.startswith(message)
    assert caught.value.span is not None and caught.value.span.text.startswith(place)


def test_reward_counts_when_a_rule_was_applied_and_else_reward_when_none_matched() -> None:
    assert rewards("action turn = 0.75: turn() | 0.25: drop(hand) reward 2 else reward -3") == {
        2.0: 0.75,
        -3.0: 0.25,
    }


def test_nothing_always_applies_and_missing_probability_applies_no_rule() -> None:
    assert rewards("action wait = nothing() reward 2 else reward -3") == {2.0: 1.0}
    assert rewards("action wait = 0.4: nothing() reward 2 else reward -3") == {2.0: 0.4, -3.0: 0.6}


def test_branches_of_probability_zero_never_happen() -> None:
    assert rewards("action wait = 0.0: turn() | 1.0: nothing() reward hand.moves + 1.0") == {1.0: 1.0}


def test_outputs_of_a_rule_can_be_rewarded() -> None:
    text = "action grab(coin : Coin) = grab(hand, coin, gained) reward gained * 10 else reward -1"
    assert [rewards(text, action) for action in range(3)] == [{10.0: 1.0}, {20.0: 1.0}, {40.0: 1.0}]


def test_a_created_object_can_be_an_output() -> None:
    assert rewards("action mint = mint(table, coin) reward coin.value") == {8.0: 1.0}


def test_match_that_cannot_be_applied_is_an_error_and_leaves_the_model_unchanged() -> None:
    # A coin is over one other at most.
    coins = simulator("action stack(one : Coin, other : Coin) = stack(one, other)")
    rng = np.random.default_rng(0)
    coins.reset(rng)
    coins.step(coins.action_names.index("stack(a, b)"), rng)
    before = coins.engine.model.state_hash()
    with pytest.raises(RuleError, match="stack"):
        coins.step(coins.action_names.index("stack(a, c)"), rng)
    assert coins.engine.model.state_hash() == before


def test_a_deleted_object_matches_nothing_any_more() -> None:
    coins = simulator("action lose(coin : Coin) = lose(coin) reward 1 else reward -1")
    rng = np.random.default_rng(0)
    coins.reset(rng)
    assert [coins.step(1, rng).reward for _ in range(3)] == [1.0, -1.0, -1.0]


def test_a_deleted_parameter_matches_nothing_any_more() -> None:
    environment = "action lose = lose(a) else reward -1\non find up(a) reward 1\non neg find up(a) reward 2"
    coins = simulator(environment, "hand : Hand, table : Table, a : Coin")
    rng = np.random.default_rng(0)
    coins.reset(rng)
    # Nothing holds of an object that is gone, so what asks for that has its match.
    assert [coins.step(0, rng).reward for _ in range(2)] == [2.0, 1.0]


# --- parameters of actions


def test_actions_enumerate_enums_ranges_and_objects_by_key() -> None:
    names = simulator(
        "action a(side : Side) = nothing()\naction b(n : -1..1) = count(hand, n)\naction c(coin : Coin) = lose(coin)\n"
        "action d(side : Side, n : 0..1) = nothing()"
    ).action_names
    assert names == (
        *("a(heads)", "a(tails)", "b(-1)", "b(0)", "b(1)", "c(a)", "c(b)", "c(c)"),
        *("d(heads, 0)", "d(heads, 1)", "d(tails, 0)", "d(tails, 1)"),
    )


def test_action_on_an_object_missing_from_the_member_does_nothing() -> None:
    engine, behaviour = loaded("action lose(coin : Coin) = lose(coin) reward 1 else reward -1")
    keys = KeyIndex({"Coin": (("a",), ("b",), ("bb",), ("c",))})
    coins = Simulator(engine, behaviour, keys)
    assert coins.action_names == ("lose(a)", "lose(b)", "lose(bb)", "lose(c)")
    assert [[reward for _, reward, _ in coins.outcomes(action)] for action in range(4)] == [
        [1.0],
        [1.0],
        [-1.0],
        [1.0],
    ]


def test_action_can_use_an_object_created_during_the_episode_by_its_key() -> None:
    engine, behaviour = loaded("action mint = mint(table, _)\naction lose(coin : Coin) = lose(coin) reward 1")
    coins = Simulator(engine, behaviour, KeyIndex({"Coin": (("a",), ("b",), ("c",), ("new",))}))
    rng = np.random.default_rng(0)
    coins.reset(rng)
    assert [coins.step(action, rng).reward for action in (4, 0, 4, 4)] == [0.0, 0.0, 1.0, 0.0]


def test_rewards_and_arguments_may_call_functions_of_python() -> None:
    declared = "function priced(value : int) : float;\nfunction next(moves : int) : int;\n"
    environment = """
        action move = count(hand, next(hand.moves)) reward priced(hand.moves)
        on find worth(_, value) reward priced(value)
        """
    engine, behaviour = loaded(environment, texts={"coins.query": QUERY.replace("pattern up", declared + "pattern up")})
    engine.function("priced", lambda value: value / 4)
    engine.function("next", lambda moves: moves + 2)
    coins = Simulator(engine, behaviour)
    ((probability, reward, _),) = coins.outcomes(0)
    assert (probability, reward) == (1.0, 2 / 4 + 1 / 4 + 2 / 4)
    assert explore(engine, behaviour).tabular.n_states == 3


# --- (b) each step


def test_each_step_clauses_apply_after_the_action_and_multiply_the_outcomes() -> None:
    found = outcomes("action turn = turn()\neach step apply 0.5: turn() | 0.25: drop(hand)")
    # Two ways to turn one coin, then the other may be turned as well; dropping has no match.
    assert [(p, up) for p, up, _ in found] == [
        *((0.25, ""), (0.125, "a"), (0.125, "a")),
        *((0.25, ""), (0.125, "b"), (0.125, "b")),
    ]


def test_rewards_are_evaluated_on_the_state_after_the_each_step_effects() -> None:
    text = "action wait = nothing() reward hand.moves\neach step reward 10 * hand.moves apply count(hand, 1)"
    assert rewards(text) == {11.0: 1.0}


# --- (c) and (d): clauses on one state


def test_a_clause_counts_once_per_match_of_its_named_variables() -> None:
    wait = "action wait = nothing()\n"
    assert rewards(wait + "on find pair(x, y) reward 1") == {2.0: 1.0}
    assert rewards(wait + "on find pair(x, _) reward 1") == {2.0: 1.0}
    assert rewards(wait + "on find pair(_, _) reward 1") == {1.0: 1.0}
    assert rewards(wait + "on find worth(_, value) reward value") == {3.0: 1.0}
    assert rewards(wait + "on find worth(coin, 2) reward coin.value") == {2.0: 1.0}
    assert rewards(wait + "on find pair(x, x) reward 1") == {0.0: 1.0}


def test_a_negated_clause_counts_when_there_is_no_match() -> None:
    wait = "action wait = nothing()\n"
    assert rewards(wait + "on neg find held(hand, _) reward 5") == {5.0: 1.0}
    assert rewards(wait + "on neg find up(_) reward 5") == {0.0: 1.0}


def test_clauses_see_the_state_after_action_and_each_step() -> None:
    text = "action turn = turn()\neach step apply turn()\non neg find up(_) reward 7"
    assert rewards(text) == {7.0: 1.0}


@pytest.mark.parametrize("order", [("success", "failure"), ("failure", "success")])
def test_failure_beats_success_in_any_order(order: tuple[str, str]) -> None:
    clauses = "\n".join(f"on find any(hand) terminate {word}" for word in order)
    assert [o.terminated for _, _, o in outcomes("action wait = nothing()\n" + clauses)] == [2]


# --- (e) what clauses apply


def test_applies_run_after_all_clauses_have_been_matched() -> None:
    text = "action wait = nothing()\non find up(coin) reward 1 apply turnOver(coin)\non find up(_) reward 10"
    assert [(up, o.reward) for _, up, o in outcomes(text)] == [("", 12.0)]


def test_apply_is_skipped_if_its_match_no_longer_holds() -> None:
    # Both clauses match b and a; the first turns the coins over, so the second finds them turned already.
    text = "action wait = nothing()\non find up(x) apply turnOver(x)\non find up(y) apply lose(y)"
    coins = simulator(text)
    for _ in coins.outcomes(0):
        assert len(coins.engine.model.nodes("Coin")) == 3
    other = simulator("action wait = nothing()\non find up(y) apply lose(y)\non find up(x) apply turnOver(x)")
    for _ in other.outcomes(0):
        assert len(other.engine.model.nodes("Coin")) == 1


def test_apply_samples_among_the_matches_of_its_rule() -> None:
    found = outcomes("action wait = nothing()\non find any(hand) apply turn()")
    assert [(p, up) for p, up, _ in found] == [(0.5, "a"), (0.5, "b")]


def test_apply_probability_is_sampled_for_each_match_independently() -> None:
    text = "action wait = nothing()\non find up(coin) reward 1 apply 0.1: turnOver(coin) | 0.3: nothing()"
    found: dict[str, float] = defaultdict(float)
    for probability, up, outcome in outcomes(text):
        assert outcome.reward == 2.0
        found[up] += probability
    assert found == {
        "ab": pytest.approx(0.81),
        "a": pytest.approx(0.09),
        "b": pytest.approx(0.09),
        "": pytest.approx(0.01),
    }


def test_no_outcome_is_sampled_for_a_match_that_no_longer_holds() -> None:
    # Of the two pairs, (b, a) and (a, b), the second is gone when the first was turned over.
    text = "action wait = nothing()\non find pair(x, y) apply 0.25: turnOver(x)"
    assert [(p, up) for p, up, _ in outcomes(text)] == [(0.25, "a"), (0.1875, "b"), (0.5625, "ab")]


def test_observation_is_computed_after_all_applications() -> None:
    text = "action wait = nothing()\non find any(hand) apply count(hand, 2)\nobserve hand.moves in 0..3"
    assert [o.observation for _, _, o in outcomes(text)] == [2]


# --- reset


def test_reset_samples_one_match_and_evaluates_no_find_clause() -> None:
    text = "action wait = nothing()\non reset apply turn()\non reset apply turn()\non find up(_) terminate failure"
    coins = simulator(text)
    assert [(p, sides(coins.engine)) for p in coins.reset_outcomes()] == [(0.5, ""), (0.5, "")]
    drawn = table(text)
    assert drawn.start_probability.tolist() == [1.0]
    tabular = table("action wait = nothing()\non reset apply turn()\nobserve count find up(_) up to 3")
    assert (tabular.start_states.tolist(), tabular.start_probability.tolist()) == ([0, 1], [0.5, 0.5])
    assert tabular.observation.tolist() == [1, 1]


def test_reset_samples_a_branch_by_probability() -> None:
    coins = simulator("action wait = nothing()\non reset apply 0.5: turn() | (table.hand.moves + 0.25): drop(hand)")
    assert [(p, sides(coins.engine)) for p in coins.reset_outcomes()] == [
        (0.25, "a"),
        (0.25, "b"),
        (0.25, "ab"),
        (0.25, "ab"),
    ]


def test_reset_without_a_match_starts_from_the_initial_model() -> None:
    coins = simulator("action wait = nothing()\non reset apply drop(hand)")
    assert [(p, sides(coins.engine)) for p in coins.reset_outcomes()] == [(1.0, "ab")]


# --- (f) observations


def test_the_first_component_varies_fastest() -> None:
    coins = simulator(
        "action grab(coin : Coin) = grab(hand, coin, _)\nobserve hand.moves in 0..4\n"
        "observe hand.holds among Coin or none\nobserve coin.side for coin : Coin\nobserve find held(hand, _)"
    )
    assert coins.observation_shape == (5, 4, 2, 2, 2, 2)
    assert coins.n_observations == 5 * 4 * 16
    rng = np.random.default_rng(0)
    # moves 0; nothing held (3); sides of a, b, c: 0, 0, 1; held: 0
    assert coins.reset(rng) == 0 + 3 * 5 + 1 * 5 * 4 * 2 * 2
    # coin b (1) is held
    assert coins.step(1, rng).observation == 0 + 1 * 5 + 1 * 80 + 1 * 160


def test_counts_and_ranges_are_clipped() -> None:
    text = "action add = count(hand, 3)\nobserve hand.moves in 1..2\nobserve count find up(_) up to 1"
    coins = simulator(text)
    assert coins.observation_shape == (2, 2)
    rng = np.random.default_rng(0)
    assert coins.reset(rng) == 0 + 2 * 1
    assert coins.step(0, rng).observation == 1 + 2 * 1


def test_components_of_objects_missing_from_the_member_are_padded() -> None:
    text = (
        "action wait = nothing()\nobserve coin.side for coin : Coin\n"
        "observe coin.over among Coin or none for coin : Coin"
    )
    engine, behaviour = loaded(text)
    keys = KeyIndex({"Coin": (("a",), ("b",), ("bb",), ("c",))})
    coins = Simulator(engine, behaviour, keys)
    assert coins.observation_shape == (2, 2, 2, 2, 5, 5, 5, 5)
    index = coins.reset(np.random.default_rng(0))
    assert list(np.unravel_index(index, coins.observation_shape, order="F")) == [0, 0, 0, 1, 4, 4, 4, 4]


def test_simulator_allows_more_observations_than_a_table_can_number() -> None:
    text = "action wait = nothing()\nobserve hand.moves in 0..20\nobserve coin.value in 0..1000000 for coin : Coin"
    coins = simulator(text)
    assert coins.n_observations == 21 * 1000001**3 > 2**63
    engine, behaviour = loaded(text)
    with pytest.raises(EvaluationError, match=r"2.10e\+19 observations, but a table can have at most 9,223,372,"):
        explore(engine, behaviour)


def test_observing_an_empty_reference_without_none_is_an_error_with_a_hint() -> None:
    coins = simulator("action wait = nothing()\nobserve hand.holds among Coin")
    with pytest.raises(EvaluationError, match="or none") as caught:
        coins.reset(np.random.default_rng(0))
    assert caught.value.span is not None and caught.value.span.text == "hand.holds"
    assert caught.value.message == "an observed path has no value: `hand` has no `holds`"


@pytest.mark.parametrize("path", ["hand.holds.value in 0..3", "hand.holds.side"])
def test_observing_through_an_empty_reference_names_the_object_that_has_it(path: str) -> None:
    coins = simulator(f"action wait = nothing()\nobserve {path}")
    with pytest.raises(EvaluationError, match="`hand` has no `holds`"):
        coins.reset(np.random.default_rng(0))


def test_reward_without_a_value_is_reported_with_its_span() -> None:
    coins = simulator("action wait = nothing() reward 1 / hand.moves\nobserve find worth(_, 8)")
    coins.reset(np.random.default_rng(0))
    with pytest.raises(EvaluationError, match="a reward has no value: division by zero") as caught:
        coins.step(0, np.random.default_rng(0))
    assert caught.value.span is not None and caught.value.span.text == "1 / hand.moves"
    assert caught.value.hint == "write `hand.moves != 0 ? .. : ..` around it"


def test_observing_an_object_without_an_index_is_an_error() -> None:
    coins = simulator(
        "action mint = mint(table, _)\naction grab = grab(hand, hand.holds, _)\n"
        "on find worth(coin, 8) apply grab(hand, coin, _)\nobserve hand.holds among Coin or none"
    )
    rng = np.random.default_rng(0)
    coins.reset(rng)
    with pytest.raises(EvaluationError, match="no index among `Coin`"):
        coins.step(0, rng)


# --- life of a simulator


def test_stepping_before_a_reset_or_with_an_unknown_action_is_refused() -> None:
    coins = simulator("action wait = nothing()")
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidArgument, match="reset"):
        coins.step(0, rng)
    coins.reset(rng)
    with pytest.raises(InvalidArgument, match="action 1"):
        coins.step(1, rng)


def test_closing_restores_the_initial_state() -> None:
    coins = simulator("action lose(coin : Coin) = lose(coin)")
    before = coins.engine.model.state_hash()
    rng = np.random.default_rng(0)
    coins.reset(rng)
    coins.step(0, rng)
    coins.step(1, rng)
    coins.close()
    assert coins.engine.model.state_hash() == before
    coins.engine.commit()
    coins.engine.model.check_integrity()


def test_two_simulators_share_an_engine_and_its_helper_patterns() -> None:
    engine, behaviour = loaded("action wait = nothing()\non find up(_) reward 1")
    Simulator(engine, behaviour)
    names = engine.library.names()
    Simulator(engine, behaviour)
    assert engine.library.names() == names
    assert not any("Coins" in name for name in engine.patterns)


def test_behaviours_with_the_same_name_keep_separate_clauses() -> None:
    engine, one = loaded("action wait = nothing()\non find up(_) reward 1")
    _, other = loaded("action wait = nothing()\non find down(_) reward 2")
    first, second = Simulator(engine, one), Simulator(engine, other)
    assert [reward for _, reward, _ in first.outcomes(0)] == [1.0]
    assert [reward for _, reward, _ in second.outcomes(0)] == [2.0]


def test_a_parameter_without_an_object_is_reported() -> None:
    model = 'import "coins.metamodel"\nmodel empty : coins { table : Table { hand = left : Hand {} } }\n'
    engine, behaviour = loaded("action wait = nothing()", texts={"coins.model": model})
    assert Simulator(engine, behaviour).action_names == ("wait",)
    engine.model.create("Hand", object_name="right")
    with pytest.raises(ResolutionError, match=r"cannot bind parameter `hand`: the model has 2 objects"):
        Simulator(engine, behaviour)
    engine.model.create("Hand", object_name="hand")
    assert Simulator(engine, behaviour).action_names == ("wait",)


def test_simulator_refuses_an_invalid_behaviour() -> None:
    engine, behaviour = loaded("action wait = nothing()\non find up(_) reward 1")
    broken = replace(behaviour, actions=(behaviour.actions[0], behaviour.actions[0]))
    with pytest.raises(ResolutionError, match="defined twice"):
        Simulator(engine, broken)


def test_key_index_of_a_family_contains_the_keys_of_all_members() -> None:
    engine, behaviour = loaded("action lose(coin : Coin) = lose(coin)")
    metamodel = engine.model.metamodel
    one = KeyIndex.of_model(engine.model, indexed_classes(behaviour, metamodel))
    engine.model["a"].name = "z"
    other = KeyIndex.of_model(engine.model, indexed_classes(behaviour, metamodel))
    assert one.merge(other, metamodel).keys == {"Coin": (("a",), ("b",), ("c",), ("z",))}
