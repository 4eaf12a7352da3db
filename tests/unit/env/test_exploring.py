"""Enumerating states: numbering, absorbing ends, limits, errors on the way."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import Simulator, explore
from envgraph.errors import EvaluationError, RuleError
from tests.unit.env import forest
from tests.unit.env.coins import loaded, table


def test_adjacent_equal_outcomes_are_merged() -> None:
    tabular = table("action turn = 0.5: drop(hand) | 0.2: drop(hand)\nobserve hand.moves in 0..1")
    assert tabular.deterministic
    assert tabular.probability.tolist() == [[[1.0]]]


def test_missing_outcomes_are_padded_with_probability_zero() -> None:
    tabular = table("action turn = turn()\naction wait = nothing()\nobserve count find up(_) up to 2")
    assert tabular.next_state.shape == (4, 2, 2)
    assert tabular.probability[0].tolist() == [[0.5, 0.5], [1.0, 0.0]]
    assert tabular.next_state[0].tolist() == [[1, 2], [0, 0]]
    assert tabular.observation.tolist() == [2, 1, 1, 0]


def test_terminal_states_absorb_and_differ_from_running_states() -> None:
    # The clause holds in every state: the start state runs, the same model after a step is over.
    tabular = table("action wait = nothing()\non find any(hand) reward 3 terminate success")
    assert tabular.next_state[:, 0, 0].tolist() == [1, 1]
    assert tabular.reward[:, 0, 0].tolist() == [3.0, 0.0]
    assert tabular.terminated[:, 0, 0].tolist() == [1, 0]


def test_too_many_states_raise_an_error_and_leave_the_model_unchanged() -> None:
    engine, behaviour = loaded("action mint = mint(table, _)\naction turn = turn()")
    before = engine.model.state_hash()
    with pytest.raises(EvaluationError, match=r"more than 50 states[\s\S]*hint: use .*which need no table"):
        explore(engine, behaviour, limit=50)
    assert engine.model.state_hash() == before
    assert not engine.model.graph.history.savepoint_depth
    engine.model.check_integrity()


def test_rule_error_during_exploration_leaves_the_model_unchanged() -> None:
    engine, behaviour = loaded("action stack(one : Coin, other : Coin) = stack(one, other)")
    before = engine.model.state_hash()
    with pytest.raises(RuleError, match="stack"):
        explore(engine, behaviour)
    assert engine.model.state_hash() == before
    assert not engine.model.graph.history.savepoint_depth


def test_equal_start_states_are_merged_and_their_probabilities_summed() -> None:
    tabular = table("action wait = nothing()\non reset apply turn()\non reset apply turn()")
    assert tabular.start_states.tolist() == [0]
    assert tabular.start_probability.tolist() == [1.0]


def test_pictures_are_made_on_request_only() -> None:
    engine, behaviour = forest.engine(["SVG"]), forest.behaviour()
    assert explore(engine, behaviour).pictures == ()
    pictures = explore(engine, behaviour, pictures=True).pictures
    assert [picture.marks[0].place for picture in pictures] == [(0, 0), (1, 0), (2, 0)]
    assert len({id(picture.cells) for picture in explore(engine, behaviour, pictures=True).pictures}) <= 3


def test_exploration_keeps_the_versions_of_the_engine() -> None:
    engine, behaviour = forest.engine(["SVG"]), forest.behaviour()
    first = engine.commit()
    engine.model.graph.retype(1, "BurningTile")
    second = engine.commit()
    burning = explore(engine, behaviour).tabular
    engine.checkout(first)
    green = explore(engine, behaviour).tabular
    engine.checkout(second)
    assert (burning.n_states, green.n_states) == (2, 3)
    assert (explore(engine, behaviour).tabular.reward == burning.reward).all()


def test_rewards_are_summed_in_the_order_of_the_file() -> None:
    # 0.1 + 0.2 + 0.3 is not 0.3 + 0.2 + 0.1.
    wait = "action wait = nothing() reward 0.3\n"
    clauses = "each step reward 0.1\neach step reward 0.2\n"
    assert table(clauses + wait).reward.item() == 0.1 + 0.2 + 0.3
    assert table(wait + clauses).reward.item() == 0.3 + 0.1 + 0.2


def test_exploration_numbers_states_alike_in_every_run() -> None:
    one, other = (table("action turn = turn()\non reset apply turn()\nobserve find up(_)") for _ in range(2))
    assert all(np.array_equal(getattr(one, f), getattr(other, f)) for f in ("next_state", "probability", "observation"))


def test_each_state_is_observed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    observe, seen = Simulator.observe, list[int]()

    def counted(simulator: Simulator) -> int:
        seen.append(observe(simulator))
        return seen[-1]

    monkeypatch.setattr(Simulator, "observe", counted)
    engine, behaviour = loaded("action turn(coin : Coin) = 0.5: turnOver(coin)\nobserve count find up(_) up to 3")
    tabular = explore(engine, behaviour).tabular
    assert len(seen) == tabular.n_states < np.count_nonzero(tabular.probability)
    assert sorted(seen) == sorted(tabular.observation.tolist())
