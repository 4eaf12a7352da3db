"""Whatever rules and units do, a rollback restores the state and its order, and a trace does it again."""

from __future__ import annotations

from contextlib import suppress

from hypothesis import given, settings, strategies as st
from numpy.random import default_rng

from envgraph.errors import RuleError
from envgraph.graph import Model
from envgraph.rewrite import Engine
from tests.profile import examples
from tests.unit.rewrite.graphs import METAMODEL, engine, snapshot

RULES = """
rule grow { lhs { a : Item; } modify { create b : Item { n = a.n + 1, links = [a] }; set a.links += b; } }
@semantics(spo) rule drop { lhs { a : Item; b : Item; } modify { delete a; set b.n += 1; } }
rule dropSafely { lhs { a : Item; } modify { delete a; } }
rule chainUp { lhs { a : Item; b : Item; } modify { set a.next = b; } }
rule link { lhs { a : Item; b : Item; } modify { create a -next-> b; create b -pair-> a; set a.n = 3; } }
rule befriend { lhs { a : Item; b : Item; } not { a -friends-> b; } rhs { a -friends-> b; } }
rule adopt { lhs { a : Item; b : Item; } modify { move b to a.kids; } }
@semantics(spo) rule kind { lhs { a : Special; } rhs { a : Item; } }
rule special { lhs { a : Item; b : Item; } modify { retype a : Special; set a.favourite = b; } }
rule merge { lhs { a : Item; b : Item; } modify { merge a <- b; } }
rule redirect { lhs { a : Item -links-> b : Item; c : Item; } modify { redirect a -links-> b to c; } }
@match(homomorphic) rule both { lhs { a : Item -links-> b : Item; c : Item; } rhs { a; b; c; } }
@semantics(spo) rule prune { lhs { a : Item; } forall { lhs { a -links-> b : Item; } modify { delete b; } } }
rule copies { lhs { a : Item; } forall { lhs { a -links-> b : Item; } modify { create b -kids-> c : Item; } } }
unit tidy { alap { merge; } try { dropSafely; grow; } else { grow; } }
unit spree { repeat 1..4 { grow | link | chainUp; } atomic { befriend; adopt; } all redirect; }
"""
NAMES = [
    "grow", "drop", "dropSafely", "chainUp", "link", "befriend", "adopt", "kind", "special", "merge", "redirect",
    "both", "prune", "copies", "tidy", "spree",
]  # fmt: skip

steps = st.lists(st.sampled_from(NAMES), min_size=1, max_size=12)


def start(size: int, seed: int) -> Engine:
    model = Model(METAMODEL)
    for number in range(size):
        model.create("Special" if number % 3 == 2 else "Item", n=number)
    made = engine(RULES, model=model, seed=seed)
    made.step_limit = 500
    return made


def play(made: Engine, names: list[str]) -> None:
    for name in names:
        before = snapshot(made.model)
        try:
            made.run(name)
        except RuleError:
            assert snapshot(made.model) == before
        if len(made.model) > 40:
            return


@settings(max_examples=examples(20))
@given(st.integers(1, 5), st.integers(0, 2**32 - 1), steps, steps)
def test_rollback_restores_state_and_order(size: int, seed: int, first: list[str], second: list[str]) -> None:
    made = start(size, seed)
    play(made, first)
    before = snapshot(made.model)
    savepoint = made.model.graph.history.savepoint()
    play(made, second)
    made.model.check_integrity()
    made.model.graph.history.rollback(savepoint)
    assert snapshot(made.model) == before
    made.model.check_integrity()


@settings(max_examples=examples(20))
@given(st.integers(1, 5), st.integers(0, 2**32 - 1), steps)
def test_replayed_trace_gives_the_same_state_and_order(size: int, seed: int, names: list[str]) -> None:
    made = start(size, seed)
    version = made.commit()
    with made.recording() as trace:
        play(made, names)
    after = snapshot(made.model)
    made.checkout(version, discard=True)
    made.replay(trace)
    assert snapshot(made.model) == after
    other = start(size, seed)
    other.replay(trace)
    assert snapshot(other.model) == after


@settings(max_examples=examples(10))
@given(st.integers(1, 5), st.integers(0, 2**32 - 1), steps)
def test_result_of_a_seed_does_not_depend_on_rolled_back_changes(size: int, seed: int, names: list[str]) -> None:
    straight, detour = start(size, seed), start(size, seed)
    savepoint = detour.model.graph.history.savepoint()
    with suppress(RuleError):
        play(detour, names[::-1])
    detour.model.graph.history.rollback(savepoint)
    detour.rng = default_rng(seed)
    play(straight, names)
    play(detour, names)
    assert snapshot(straight.model) == snapshot(detour.model)
