"""Units where rules are named: as actions, as effects, and what their choices become."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, Tabular, explore
from envgraph.errors import LIMITS, EvaluationError, LoadError, RuleError
from tests.unit.env.coins import RULES, loaded

UNITS = """
unit exchange(hand : Hand, coin : Coin, out value : int) { try { drop(hand); } grab(hand, coin, value); }
unit both(hand : Hand, coin : Coin) { drop(hand); turnOver(coin); }
unit late(hand : Hand) { turn; drop(hand); }
@weight(3.0)
rule heavy { lhs { coin : Coin; Coin.name(coin, "a"); find up(coin); } modify { set coin.side = ::tails; } }
rule light { lhs { coin : Coin; Coin.name(coin, "b"); find up(coin); } modify { set coin.side = ::tails; } }
unit either { heavy | light; }
unit some { repeat 1..2 { turn; } }
unit every { all turn; }
unit one { turn; }
unit bad(a : Coin, b : Coin, c : Coin) { turn; stack(a, b); stack(a, c); }
"""
TEXTS = {"coins.rules": RULES + UNITS}
SEES = "observe coin.side for coin : Coin\nobserve hand.holds among Coin or none"


def table(clauses: str) -> Tabular:
    return explore(*loaded(f"{clauses}\n{SEES}", texts=TEXTS)).tabular


def outcomes(tabular: Tabular, state: int = 0, action: int = 0) -> dict[int, float]:
    """Probability of each following state, by what is seen of it: a, b, c (1 for tails), and who is held (3: none)."""
    found: dict[int, float] = {}
    for chance, to in zip(tabular.probability[state, action], tabular.next_state[state, action], strict=True):
        if chance:
            seen = int(tabular.observation[to])
            found[seen] = found.get(seen, 0.0) + float(chance)
    return found


def test_unit_as_an_action_runs_its_steps_in_order() -> None:
    tabular = table("action swap(coin : Coin) = exchange(hand, coin, value) reward value else reward -1")
    assert tabular.action_names == ("swap(a)", "swap(b)", "swap(c)")
    assert tabular.n_states == 4 and tabular.deterministic
    assert tabular.reward[0, :, 0].tolist() == [1.0, 2.0, 4.0]
    held = int(tabular.next_state[0, 1, 0])
    assert tabular.observation[[0, held]].tolist() == [4 + 8 * 3, 4 + 8 * 1]
    assert tabular.reward[held].ravel().tolist() == [1.0, 2.0, 4.0]


def test_failing_unit_leaves_the_state_unchanged() -> None:
    tabular = table("action late = late(hand) reward 1 else reward -1")
    assert tabular.n_states == 1
    assert tabular.reward.ravel().tolist() == [-1.0] * tabular.reward.size
    assert set(tabular.next_state.ravel().tolist()) == {0}


def test_choices_in_a_unit_become_outcome_probabilities() -> None:
    start = 4 + 8 * 3
    assert outcomes(table("action x = one()")) == {start + 1: 0.5, start + 2: 0.5}
    assert outcomes(table("action x = either()")) == pytest.approx({start + 1: 0.75, start + 2: 0.25})
    assert outcomes(table("action x = some()")) == {start + 1: 0.25, start + 2: 0.25, start + 3: 0.5}
    assert outcomes(table("action x = every()")) == {start + 3: 1.0}
    assert outcomes(table("action x = 0.5: one() | 0.25: every()")) == {
        start: 0.25, start + 1: 0.25, start + 2: 0.25, start + 3: 0.25,
    }  # fmt: skip


def test_units_can_be_applied_by_reset_each_step_and_find_clauses() -> None:
    tabular = table(
        "action wait = nothing()\non reset apply one()\neach step apply every()\non neg find up(_) reward 1"
    )
    assert sorted(tabular.start_probability.tolist()) == [0.5, 0.5]
    assert outcomes(tabular) == {7 + 8 * 3: 1.0}
    assert (tabular.reward[:2, 0, 0] == 1.0).all()
    tabular = table(
        "action grab(coin : Coin) = grab(hand, coin, _)\non find held(hand, coin) reward 1 apply both(hand, coin)"
    )
    assert outcomes(tabular, action=0) == {5 + 8 * 3: 1.0}
    assert outcomes(tabular, action=2) == {4 + 8 * 2: 1.0}  # tails already: the unit fails, and takes the drop back


@pytest.mark.parametrize(
    "clauses",
    [
        "action x = some()\naction y(coin : Coin) = turnBack(coin)",
        "action x = either()\naction y(coin : Coin) = 0.7: exchange(hand, coin, _) | 0.2: one()",
    ],
)
def test_table_and_live_environment_step_alike(clauses: str) -> None:
    rows = EnvgraphEnv(table(clauses))
    live = EnvgraphLiveEnv(Simulator(*loaded(f"{clauses}\n{SEES}", texts=TEXTS)))
    rng = np.random.default_rng(3)
    assert rows.reset(seed=5)[0] == live.reset(seed=5)[0]
    for _ in range(200):
        action = int(rng.integers(4))
        assert rows.step(action)[:3] == live.step(action)[:3]


def test_unit_samples_matches_in_the_same_order_as_a_rule() -> None:
    def episode(call: str) -> list[object]:
        clauses = f"action x = {call}\naction y(coin : Coin) = turnBack(coin)\n{SEES}"
        engine, behaviour = loaded(clauses, texts=TEXTS)
        engine.watch("turn")
        live, rng = EnvgraphLiveEnv(Simulator(engine, behaviour)), np.random.default_rng(4)
        return [live.reset(seed=5)[0], *(live.step(int(rng.integers(4)))[0] for _ in range(60))]

    assert episode("one()") == episode("turn()")


def test_unit_that_the_model_refuses_is_an_error_and_is_rolled_back() -> None:
    engine, behaviour = loaded("action x(a : Coin, b : Coin, c : Coin) = bad(a, b, c)", texts=TEXTS)
    before = engine.model.state_hash()
    with pytest.raises(RuleError, match="targets of `over` already"):
        explore(engine, behaviour)
    assert engine.model.state_hash() == before and not engine.model.graph.history.savepoint_depth
    engine.model.check_integrity()


def test_unit_with_too_many_outcomes_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "outcomes", 3)
    with pytest.raises(EvaluationError, match=r"`x` has more than 3 outcomes in one state[\s\S]*write `all r;`"):
        table("action x = some()")


def test_unit_call_with_missing_arguments_is_refused() -> None:
    with pytest.raises(LoadError, match="unit `both` takes 2 arguments, not 1") as found:
        table("action x = both(hand)")
    assert "write `action x(coin : Coin) = both(hand, coin)`" in str(found.value)
