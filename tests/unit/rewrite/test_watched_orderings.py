"""Watched patterns that negate or count an ordering of objects which a closure, a recursive pattern or a view links."""

from __future__ import annotations

from itertools import pairwise

import pytest

from envgraph import Engine, Model, Pattern, Rule
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

CHAIN = Metamodel(
    "chain",
    (
        Class(
            "N",
            features=(
                Attribute("k", Scalar.INT),
                Reference("next", "N", 0, 1),
                Reference("to", "N", 0, None),
            ),
        ),
    ),
)
LINKED = {
    "closure": "N.next+(a, b)",
    "recursion": "find rec(a, b)",
}


@pytest.mark.parametrize("linked", LINKED)
def test_an_ordering_of_what_is_linked_is_watched(linked: str) -> None:
    model = Model(CHAIN)
    nodes = [model.create("N", k=number) for number in (3, 1, 2)]
    for one, other in pairwise(nodes):
        one.next = other
    engine = Engine(model)
    engine.add(
        Pattern(
            "rec",
            "a : N, b : N",
            ["N.next(a, b)", "find rec(a, c); N.next(c, b)"],
            annotations="@SafeRecursion",
        ),
        Pattern("up", "a : N, b : N", f"{LINKED[linked]}; check(a.k <= b.k)"),
        Pattern("last", "a : N", "N(a); neg find up(a, _)"),
        Pattern("number", "a : N, n : int", "N(a); n == count find up(a, _)"),
    )
    engine.watch("last", "number")
    assert [match.a.k for match in engine.matches("last")] == [3, 2]
    nodes[0].k = 0
    assert [match.a.k for match in engine.matches("last")] == [2]
    assert {match.a.k: match.n for match in engine.matches("number")} == {0: 2, 1: 1, 2: 0}


def test_a_rule_with_nested_blocks_and_orderings_is_watched() -> None:
    model = Model(CHAIN)
    one, other = model.create("N", k=3), model.create("N", k=1)
    one.next, one.to = other, [other]
    engine = Engine(model)
    inner = "i2 : N <-to- i0; x -to-> i2; check i2.k != x.k; i2 != x;"
    blocks = f"not {{ i0 : N <-next- x; not {{ i1 : N <-to- x; check i1.k <= x.k; require {{ {inner} }} }} }}"
    engine.add(Rule("r", lhs="x : N", modify="set x.k = 0", blocks=blocks))
    engine.watch("r")
    assert [match.x for match in engine.matches("r")] == [other]
    third, fourth = model.create("N", k=2), model.create("N", k=1)
    other.to, one.to = [third], [other, third]
    assert one not in [match.x for match in engine.matches("r")]
    other.to, one.to = [third, fourth], [other, third, fourth]
    assert {match.x for match in engine.matches("r")} == {one, other, third, fourth}
