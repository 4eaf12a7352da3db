"""What happens by itself when an episode begins: for one object, and for each."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from envgraph.env import Simulator, explore
from envgraph.env.compiled import enumerate_states, program_of
from envgraph.errors import EvaluationError, LoadError
from tests.unit.env.coins import PARAMETERS, loaded, sides
from tests.unit.env.side_by_side import step_side_by_side

TURNS = """
action turn = turn()
on neg find up(_) terminate success
observe coin.side for coin : Coin
"""


NAMED = f"{PARAMETERS}, c : Coin"


def starts(resets: str) -> dict[str, float]:
    """Probability of each start, by the coins that show heads; the compiled program has the same ones."""
    engine, behaviour = loaded(TURNS + resets, NAMED)
    simulator, found = Simulator(engine, behaviour), Counter[str]()
    for probability in simulator.reset_outcomes():
        found[sides(engine)] += probability
    table, compiled = (
        explore(engine, behaviour).tabular,
        enumerate_states(program_of(engine, behaviour, native=False)),
    )
    for name in ("start_states", "start_probability", "next_state", "observation"):
        assert np.array_equal(getattr(compiled, name), getattr(table, name)), name
    step_side_by_side([engine], behaviour, 40, native=False)
    return dict(found)


def test_reset_probability_is_sampled_for_each_match_independently() -> None:
    found = starts("on reset find worth(coin, value) apply (value / 4.0): turnOver(coin)")
    assert found == pytest.approx({"ab": 0.375, "b": 0.125, "a": 0.375, "": 0.125}), "a is worth 1, b 2"


def test_reset_skips_matches_that_no_longer_hold() -> None:
    assert starts("on reset find pair(one, other) apply turnOver(one)") == {"a": 1.0}, "b came first"
    assert starts("on reset neg find down(_) apply turn()") == {"ab": 1.0}, "c shows tails"
    assert starts("on reset neg find pair(c, _) apply turnBack(c)") == {"abc": 1.0}


def test_reset_clauses_run_in_order_on_the_updated_model() -> None:
    found = starts(
        "on reset apply turnBack(c)\non reset find up(coin) apply 0.5: turnOver(coin)\non reset apply turn()"
    )
    assert len(found) == 7 and found[""] == pytest.approx(0.125 + 3 * 0.125)
    assert found["ab"] == pytest.approx(1 / 24)
    chosen = starts("on reset apply 0.2: turnOver(c) | 0.3: turnBack(c)\non reset find up(c) apply turnOver(c)")
    assert chosen == {"ab": 1.0}


def test_mistakes_in_resets_are_reported() -> None:
    for clause, said in (
        ("on reset find upp(coin) apply turn()", "did you mean `up`"),
        ("on reset find up(coin) apply turnOver(hand)", "expected `Coin`, found `Hand`"),
        ("on reset find up(coin) reward 1", "no reward and no end"),
        ("on reset find up(coin)", "this clause does nothing"),
        ("on reset up(coin) apply turn()", "must be followed by `find` or `neg find`"),
    ):
        with pytest.raises(LoadError, match=said):
            loaded(TURNS + clause)


def test_reset_samples_one_match_by_weight() -> None:
    found = starts("on reset find worth(coin, value) apply turnOver(coin) weight value")
    assert found == pytest.approx({"a": 2 / 3, "b": 1 / 3}), "a is worth 1, b 2"
    found = starts(
        "on reset find pair(one, _) apply turnOver(one) weight 1\n"
        "on reset find down(coin) apply turnBack(coin) weight coin.value"
    )
    assert found == pytest.approx({"ab": 0.5 * 2 / 6 + 0.5 * 1 / 5, "bc": 0.5 * 4 / 5, "ac": 0.5 * 4 / 6})
    assert starts("on reset find up(coin) apply turnOver(coin) weight 0") == {"ab": 1.0}


def test_step_samples_one_match_by_weight() -> None:
    clause = "action wait = nothing()\non find worth(coin, value) reward 1.0 apply turnOver(coin) weight value - 1\n"
    assert starts(
        clause + "on find down(coin) apply 0.5: turnBack(coin)\non find up(coin) apply turnOver(coin) weight 1"
    ) == {"ab": 1.0}
    table = explore(*loaded(TURNS + clause, NAMED)).tabular
    wait = table.action_names.index("wait")
    assert table.reward[0, wait].max() == 2.0 and table.probability[0, wait].max() == 1.0, "a has no weight"


def test_negative_or_misplaced_weights_are_refused() -> None:
    said = "-1 is not a weight"
    with pytest.raises(EvaluationError, match=said):
        starts("on reset find worth(coin, value) apply turnOver(coin) weight 1 - value")
    for clause, said in (
        ("each step apply turn() weight 1", "`weight` needs matches"),
        ("on reset apply turn() weight 1", "`weight` needs matches"),
        ("on reset find up(coin) apply turnOver(coin) weight coin.side", "expected `float`"),
    ):
        with pytest.raises(LoadError, match=said):
            loaded(TURNS + clause, NAMED)
