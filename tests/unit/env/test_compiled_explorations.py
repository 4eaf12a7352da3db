"""Explorations that a compiled program continues: the same result, and when the engine does all of it."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from envgraph.env.compiled import explore_compiled
from envgraph.errors import LIMITS, RuleError
from envgraph.graph import Model
from envgraph.rewrite import Engine
from tests.unit.rewrite.explorations import assert_equal_explorations, compiling, explore_twice
from tests.unit.rewrite.graphs import METAMODEL, engine

RULES = """
rule light { lhs { a : Item; check !a.done; } modify { set a.done = true; } }
rule step { lhs { a : Item; n == eval(a.n + 1); check n < 3; } modify { set a.n = n; } }
rule weigh { lhs { a : Item; Thing.n(a, n); Item.weight(a, w); check w < 2.0; } modify { set a.weight = w + 0.5 * n; } }
rule name { lhs { a : Item; Item.label(a, s); Item.colour(a, c); Item.done(a, d); check d; }
    modify { set a.colour = ::blue; } }
rule link { lhs { a : Item; b : Item; } not { a -pair-> b; } modify { create a -pair-> b; } }
rule all { lhs { } forall { lhs { a : Item; check a.n > 0; } modify { set a.done = true; } } modify { } }
rule clash { lhs { a : Item; } forall { lhs { b : Item; } modify { set a.n = b.n; } } modify { } }
rule special { lhs { a : Item; check a.n == 1; } modify { retype a : Special; } }
rule remove { lhs { a : Item; } modify { delete a; } }
rule grow { lhs { a : Item; } modify { create b : Box; set b.n = 1; } }
rule empty { lhs { b : Box; } modify { delete b; } }
rule divide { lhs { a : Item; } modify { set a.n = 1 / a.n; } }
unit both { light; light; }
"""
QUERIES = """
pattern lit(a : Item) { Item.done(a, true); }
pattern allLit() { neg find unlit(_); }
pattern unlit(a : Item) { Item.done(a, false); }
pattern linked(a : Item, b : Item) { Item.pair(a, b); }
"""


def made(size: int = 3) -> Engine:
    model = Model(METAMODEL)
    for number in range(size):
        model.create("Item", n=number % 2, weight=0.5, label=f"i{size - number}", done=False, colour="red")
    return engine(RULES, QUERIES, model=model)


@pytest.mark.parametrize(
    "names",
    [
        ["light"], ["step", "light"], ["weigh"], ["light", "name"], ["link"], ["all"], ["clash"], ["special", "step"],
        ["remove"], ["remove", "link"], ["grow"], ["grow", "light"], ["light", "step", "special", "remove"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_compiled_explorations_find_what_the_engine_finds(names: list[str]) -> None:
    options: dict[str, Any]
    for options in ({}, {"limit": 7}, {"depth": 2}, {"goal": "allLit", "predicates": ["lit", "linked"]}):
        found = explore_twice(made(), names, limit=options.pop("limit", 60), **options)
        if found is not None:
            assert found.not_compiled is None, options


def test_explorations_by_numba_find_what_the_engine_finds() -> None:
    pytest.importorskip("numba")
    one, names = made(), ["light", "step", "weigh", "link", "name"]
    for limit in (5_000, 50):
        found = explore_twice(one, names, native=True, limit=limit, predicates={"on": "lit", "linked": "linked"})
        assert found is not None and found.not_compiled is None and len(found) == limit


def test_the_engine_explores_first_and_a_program_continues() -> None:
    one = made()
    for after in (1, 10, 10_000):
        found = explore_twice(one, ["light", "step"], after=after)
        assert found is not None
        assert (found.not_compiled is None) == (after < 10_000 or one.catalog.compiled_explorations != {})


def test_known_programs_explore_at_once_until_definitions_change() -> None:
    one = made()
    with compiling(10):
        one.explore(["light", "step"])
    with compiling(10_000):
        assert one.explore(["light", "step"]).not_compiled is None
        one.model.create("Item", n=0, done=False)
        assert one.explore(["light", "step"]).not_compiled is None
        one.add(*engine("rule other { lhs { a : Item; } modify { set a.n = 5; } }").catalog.definitions)
        assert one.explore(["light", "step"]).not_compiled == "it makes fewer than 50,000 moves"
    explore_twice(one, ["light", "step"], limit=100)


def test_created_objects_have_the_ids_that_the_engine_gives() -> None:
    one = made(2)
    one.model.create("Item").delete()
    found = explore_twice(one, ["grow", "light"], limit=20)
    assert found is not None and found.not_compiled is None
    most = LIMITS["created objects"]
    long = explore_twice(made(1), ["grow"], limit=100)
    assert long is not None and long.not_compiled is None and long.statistics.depth == 99 < most


@pytest.mark.parametrize(
    ("names", "options", "reason"),
    [
        (["both"], {}, "it runs units"),
        (["light"], {"strategy": "depth"}, '`strategy` is "depth"'),
        (["light"], {"up_to": "isomorphism"}, '`up_to` is "isomorphism"'),
        (["light"], {"keep": True}, "`keep` is true"),
        (["light"], {"goal": lambda one: False}, "a goal or predicate is a function"),
        (
            ["grow", "empty"],
            {"limit": 20},
            "rules delete objects of classes that they create",
        ),
    ],
)
def test_what_only_the_engine_explores_is_told(names: list[str], options: dict[str, Any], reason: str) -> None:
    with compiling():
        assert made().explore(names, **options).not_compiled == reason


def test_numba_that_is_switched_off_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert explore_compiled(made(), {}, {}, None, 1, None, {}, lambda: None) == "numba is switched off"


def test_errors_of_rules_are_those_of_the_engine() -> None:
    assert explore_twice(made(), ["divide"]) is None
    assert explore_twice(made(), ["clash"]) is None
    with compiling(), pytest.raises(RuleError, match="gets two values"):
        made().explore(["clash"])


def test_states_and_matches_are_made_when_they_are_read() -> None:
    with compiling():
        found = made().explore(["light", "step"])
    assert "_record" not in vars(found)
    assert found.states[-1].number == len(found) - 1
    assert "_record" in vars(found)


def test_the_model_may_change_after_an_exploration() -> None:
    one = made()
    with compiling():
        found = one.explore(["light", "step"])
    wanted = made().explore(["light", "step"])
    for node in one.model.nodes():
        node.delete()
    assert_equal_explorations(wanted, found)


def test_environments_are_not_imported_for_small_explorations() -> None:
    text = (
        "import sys, envgraph\n"
        "envgraph.open('burning_forest').explore(['moveLeft', 'moveDown'])\n"
        "assert 'envgraph.env' not in sys.modules and 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", text], check=True)
