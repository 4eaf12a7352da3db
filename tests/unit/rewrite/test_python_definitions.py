"""Definitions of Python at an engine: added, looked up, printed; functions as rules and units."""

from __future__ import annotations

import pytest

from envgraph import Pattern, Rule
from envgraph.errors import InvalidArgument, ResolutionError
from envgraph.graph import Node
from envgraph.lang import spelled_out, to_text
from envgraph.pattern import Derivation
from tests.unit.rewrite.graphs import METAMODEL, chain, engine

LAST = Pattern("last", "x : Item", "Item(x); neg Item.next(x, _)")


def test_only_definitions_are_added() -> None:
    made = engine("")
    with pytest.raises(InvalidArgument, match=r"is added, not 'rule r .*: `envgraph\.lang\.from_text` reads"):
        made.add("rule r { lhs { } }")  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="a pattern, rule, unit or derivation is added, not 3"):
        made.check(3)  # type: ignore[arg-type]


def test_definitions_are_found_by_their_names() -> None:
    made = engine("package p\nrule r { lhs { x : Item; } } unit u { r; }")
    made.add(LAST, Derivation("kinds", "retype", ("Item", "Special")))
    assert to_text(made.definition("r"), made.definition("p.u")).startswith("package p")
    assert made.definition("last") is LAST
    assert made.definition("kinds") == Derivation("kinds", "retype", ("Item", "Special"))
    derived = made.definition("kinds.Special.Item")
    assert isinstance(derived, type(made.definition("r")))
    assert "retype object : Item" in to_text(*spelled_out([derived], METAMODEL))
    with pytest.raises(
        InvalidArgument, match="unknown pattern, rule, unit or group `lats`: did you mean `last`"
    ):
        made.definition("lats")


# --- functions as rules


def test_a_function_may_bring_its_pattern_along() -> None:
    made = engine("", model=chain(3))

    @made.rule(when=LAST)
    def drop(x: Node) -> None:
        x.prev = None

    @made.rule(when=LAST, weight=2.0)
    def mark(x: Node) -> None:
        x.done = True

    assert made.patterns == ("last",) and made.rules == ("drop", "mark")
    assert made.apply("drop") is not None and made.count("last") == 2
    with pytest.raises(InvalidArgument, match="`drop` is a Python function, of which there is no data"):
        made.definition("drop")
    with pytest.raises(ResolutionError, match="unknown"):
        made.rule(when=Pattern("bad", "x : Itme", "Itme(x)"))
    with pytest.raises(InvalidArgument, match="a weight is a number above 0, not inf"):
        made.rule(when=LAST, weight=float("inf"))(lambda x: None)


def test_rules_of_parts_and_of_functions_stand_side_by_side() -> None:
    made = engine("", model=chain(2))
    made.add(LAST, Rule("done", lhs="find last(x); x : Item", modify="set x.done = true"))
    assert made.run("done")
    assert [node.done for node in made.model.nodes("Item")] == [False, True]
