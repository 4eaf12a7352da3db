"""Objects that observations and rewards read from, and rules that take them away."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from envgraph.env import Simulator, can_end, check_behaviour, explore
from envgraph.errors import EvaluationError, Severity
from tests.unit.env.coins import METAMODEL, MODEL, RULES, loaded

A = "hand : Hand, table : Table, a : Coin"

MORE = """
rule clear(table : Table) { lhs { check true; } modify { delete table; } }
rule other(coin : Coin) { lhs { table : Table -coins-> coin; table -coins-> loss : Coin; } modify { delete loss; } }
rule melt(one : Coin, into : Coin) { lhs { check true; } modify { merge into <- one; } }
rule wear(coin : Penny) { lhs { check true; } modify { retype coin : Coin; } }
rule sweep(hand : Hand) {
    lhs { check true; }
    forall { lhs { table : Table -coins-> coin : Coin; find down(coin); } modify { delete coin; } }
    modify { set hand.moves += 0; }
}
unit spend(coin : Coin) { try { lose(coin); } }
"""

TEXTS = {
    "coins.metamodel": METAMODEL + "class Penny extends Coin {}",
    "coins.model": MODEL.replace("a : Coin", "a : Penny"),
    "coins.rules": RULES + MORE,
}


def warned(environment: str, parameters: str = A) -> list[str]:
    """The clauses that are warned of, each with the rules."""
    engine, behaviour = loaded(environment, parameters, TEXTS)
    said = [one for one in check_behaviour(behaviour, engine) if one.code == "lost-object"]
    assert all(one.severity is Severity.WARNING and one.span and one.hint and one.notes for one in said)
    return [f"{one.span.text if one.span else ''}: {one.message.split(' may ')[0]}" for one in said]


# --- what is warned of


@pytest.mark.parametrize(
    ("action", "rules"),
    [
        ("lose(a)", ["rule `lose`"]),
        ("clear(table)", ["rule `clear`"]),  # what contains it
        ("turn()", []),
        ("sweep(hand)", ["rule `sweep`"]),
        ("spend(a)", ["rule `lose`"]),
        ("0.5: lose(a) | 0.5: clear(table)", ["rules `clear`, `lose`"]),
        ("wear(a)", []),  # still a Coin
        ("other(a)", []),  # rules are injective: `loss` is another coin
    ],
)
def test_rules_that_may_delete_an_observed_object_are_reported(action: str, rules: list[str]) -> None:
    assert warned(f"action go = {action}\nobserve a.side") == [f"a.side: {rule}" for rule in rules]


def test_retyping_an_observed_object_is_reported_like_deletion() -> None:
    penny = "hand : Hand, a : Penny"
    assert warned("action go = wear(a)\nobserve a.side", penny) == ["a.side: rule `wear`"]
    assert warned("action go = wear(a)\non neg find up(a) terminate failure\nobserve a.side", penny) == []
    assert error_of("action go = wear(a)\nobserve a.side", penny).message.startswith("rule `wear` has retyped `a`")
    ends = "action go = wear(a)\non neg find up(a) terminate failure\nobserve a.side"
    engine, behaviour = loaded(ends, penny, TEXTS)
    assert explore(engine, behaviour).tabular.terminated.ravel().tolist() == [2, 0]


def test_only_rules_that_delete_the_observed_parameter_are_reported() -> None:
    two = f"{A}, b : Coin"
    assert warned("action go = lose(b)\nobserve a.side", two) == []
    assert warned("action go = melt(b, a)\nobserve a.side", two) == []
    assert warned("action go = melt(a, b)\nobserve a.side", two) == ["a.side: rule `melt`"]


def test_action_that_deletes_any_object_of_the_observed_class_is_reported() -> None:
    assert warned("action go(coin : Coin) = lose(coin)\nobserve a.side") == ["a.side: rule `lose`"]


def test_one_warning_covers_all_observations_of_an_object() -> None:
    assert warned("action go = lose(a)\nobserve a.side\nobserve a.value in 0..3") == ["a.side: rule `lose`"]


def test_observations_defined_without_the_object_give_no_warning() -> None:
    asked = "observe find up(a)\nobserve count find held(_, a) up to 1\nobserve a.over among Coin or none"
    assert warned(f"action go = lose(a)\non find up(a) reward a.value\n{asked}") == []


@pytest.mark.parametrize(
    ("clauses", "warned_of"),
    [
        ("action go = lose(a)\non neg find up(a) terminate failure", []),
        ("action go = nothing()\neach step apply lose(a)\non neg find up(a) terminate success", []),
        ("action go = lose(a)\non neg find up(a) reward -1", ["a.side: rule `lose`"]),
        ("action go = lose(a)\non find up(a) terminate failure", ["a.side: rule `lose`"]),
        ("action go = nothing()\non find down(a) terminate failure apply lose(a)", []),
        # What `on` applies happens after the question whether the episode ends.
        (
            "action go = nothing()\non find down(a) apply lose(a)\non neg find up(a) terminate failure",
            ["a.side: rule `lose`"],
        ),
        ("action go = nothing()\non reset apply lose(a)", ["a.side: rule `lose`"]),
    ],
)
def test_termination_in_the_step_of_the_deletion_avoids_the_warning(clauses: str, warned_of: list[str]) -> None:
    assert warned(f"{clauses}\nobserve a.side") == warned_of


@pytest.mark.parametrize(
    ("clauses", "warned_of"),
    [
        ("action go = lose(a) reward a.value", ["a: rule `lose`"]),
        ("action go = lose(a)\neach step reward a.value * 0.5", ["a: rule `lose`"]),
        ("action go = lose(a)\non neg find up(a) reward a.value", ["a: rule `lose`"]),
        ("action go(coin : Coin) = lose(coin) reward coin.value", ["coin: rule `lose`"]),
        ("action go(coin : Coin) = spend(coin) reward coin.value", ["coin: rule `lose`"]),
        # A rule with the object had a match, and did not take it away itself.
        ("action go = turnOver(a) reward a.value\naction gone = lose(a)", []),
        ("action go = turnOver(a) else reward a.value\naction gone = lose(a)", ["a: rule `lose`"]),
        ("action go(coin : Coin) = turnOver(coin) reward coin.value\naction gone = lose(a)", []),
    ],
)
def test_rewards_that_read_a_deletable_object_are_reported(clauses: str, warned_of: list[str]) -> None:
    assert warned(clauses) == warned_of


def test_action_that_deletes_its_own_agent_is_reported() -> None:
    block = "agent me : Coin {{ action go = {}\n each step reward me.value * 1.0\n observe me.side }}"
    assert warned(block.format("lose(me)"), "") == ["me: rule `lose`"]
    assert warned(block.format("other(me)"), "") == []  # others have no turn any more


# --- at run time


def error_of(environment: str, parameters: str = A) -> EvaluationError:
    """What the table and the live engine say of the first action."""
    engine, behaviour = loaded(environment, parameters, TEXTS)
    with pytest.raises(EvaluationError) as told:
        explore(engine, behaviour)
    with pytest.raises(EvaluationError) as reached:
        can_end(engine, behaviour, 1)
    live, rng = Simulator(engine, behaviour), np.random.default_rng(0)
    with pytest.raises(EvaluationError) as stepped:
        live.reset(rng)
        live.step(0, rng)
    assert str(stepped.value) == str(told.value) == str(reached.value)
    assert str(pickle.loads(pickle.dumps(told.value))) == str(told.value)
    return told.value


@pytest.mark.parametrize(
    ("clauses", "message", "clause"),
    [
        ("action go = lose(a)\nobserve a.side", "rule `lose` has deleted `a`", "a.side"),
        ("action go = clear(table)\nobserve a.side", "rule `clear` has deleted `a`", "a.side"),
        ("action go = spend(a)\nobserve a.value in 0..4", "rule `lose` has deleted `a`", "a.value"),
        (
            "action go = melt(a, b)\nobserve a.side",
            "rule `melt` has merged away `a`",
            "a.side",
        ),
        ("action go = lose(a)\neach step reward a.value * 0.5", "rule `lose` has deleted `a`", "a"),
        ("action go = lose(a) reward a.value", "rule `lose` has deleted `a`", "a"),
        ("action go(coin : Coin) = lose(coin) reward coin.value", "rule `lose` has deleted `coin`", "coin"),
        (
            "action go = nothing()\non find up(a) apply lose(a)\nobserve a.side",
            "rule `lose` has deleted `a`",
            "a.side",
        ),
        (
            "action go = nothing()\non reset apply lose(a)\nobserve a.side",
            "rule `lose` has deleted `a`",
            "a.side",
        ),
        # Else the rule would not be known when the action is chosen at last.
        (
            "action go = lose(a)\naction ask = nothing() reward a.value",
            "rule `lose` has deleted `a`",
            "a",
        ),
    ],
)
def test_the_error_names_the_rule_and_the_clause(clauses: str, message: str, clause: str) -> None:
    error = error_of(clauses, f"{A}, b : Coin")
    assert error.message.startswith(f"{message}, which this ")
    assert error.span is not None and error.span.text == clause
    assert error.hint is not None
    (note,) = error.notes
    assert note.span is not None and note.span.source.name == "coins.rules"
    assert "^^^" in str(error)


def test_observing_an_object_deleted_by_a_python_rule_is_an_error() -> None:
    engine, behaviour = loaded(
        "action go = take(a)\nobserve a.side",
        A,
        {**TEXTS, "coins.rules": RULES + "rule take(coin : Coin) { lhs { check true; } modify { } }"},
    )
    engine.remove("take")

    @engine.rule("up", name="take")
    def take(coin) -> None:  # type: ignore[no-untyped-def]
        coin.delete()

    with pytest.raises(EvaluationError, match="`a` no longer exists after `take`, but this observation reads it"):
        explore(engine, behaviour)


def test_terminal_state_is_observed_without_the_deleted_object() -> None:
    clauses = (
        "action stay = nothing()\naction go = lose(a)\non neg find up(a) terminate failure\n"
        "observe a.value in 1..2\nobserve a.over among Coin or none"
    )
    engine, behaviour = loaded(clauses, A)
    tabular = explore(engine, behaviour).tabular
    # a.over leads nowhere before, too; of the number there is the least.
    assert tabular.observation.tolist() == [6, 6]
    assert tabular.terminated[0].ravel().tolist() == [0, 2]


def test_argument_path_from_a_deleted_object_has_no_match() -> None:
    engine, behaviour = loaded("action go = lose(a)\naction on = lose(a.over) reward 1 else reward -1", A)
    live, rng = Simulator(engine, behaviour), np.random.default_rng(0)
    live.reset(rng)
    assert [live.step(action, rng).reward for action in (0, 1, 0)] == [0.0, -1.0, 0.0]
