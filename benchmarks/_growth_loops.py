"""Run loops of units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import envgraph
from benchmarks._growth import Case, Prepare
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar

PLACES = Metamodel(
    "places",
    [
        Class("World", features=(Reference("places", "Place", upper=None, containment=True),)),
        Class(
            "Place",
            features=(
                Attribute("key", Scalar.INT),
                Attribute("mark", Scalar.BOOL),
                Attribute("seen", Scalar.BOOL),
                Reference("next", "Place", upper=None, opposite="before"),
                Reference("before", "Place", upper=None, opposite="next"),
            ),
        ),
    ],
)
LOOP_RULES = (
    envgraph.Rule("mark", lhs="x : Place; check !x.mark;", modify="set x.mark = true;"),
    envgraph.Rule(
        "walk",
        lhs="x : Place -next-> y : Place; check x.mark && !y.mark;",
        modify="set y.mark = true; set x.mark = false;",
    ),
    envgraph.Rule("leave", lhs="x : Place; check x.mark && !x.seen;", modify="set x.seen = true;"),
    envgraph.Rule(
        "eat",
        lhs="w : World -places-> x : Place -next-> y : Place; check x.key == 0;",
        modify="set y.key = 0; delete x;",
    ),
    envgraph.Rule(
        "reach", lhs="x : Place -next+-> y : Place; check x.key == 0 && !y.mark;", modify="set y.mark = true;"
    ),
)
LOOPS = {
    "mark all": ("alap { mark; }", 0),
    "mark all, first match": ("alap { first mark; }", 0),
    "one token walks": ("alap { walk; }", 1),
    "ten tokens walk": ("alap { walk; }", 10),
    "one token walks, two rules": ("alap { walk; leave; }", 1),
    "one token walks, a choice": ("alap { leave | walk; }", 1),
    "one token walks, loop in a loop": ("alap { leave; alap { walk; } }", 1),
    "a chain is eaten from its head": ("alap { eat; }", 0),
    "closure from one start": ("alap { reach; }", 0),
}


def cases() -> Iterator[Case]:
    """Yield loops `alap` on chains, without watched patterns; each round changes one object."""
    yield from ((name, 5_000, loop_case(body, tokens)) for name, (body, tokens) in LOOPS.items())


def loop_case(body: str, tokens: int) -> Prepare:
    """Return a case that runs a unit on a chain with `tokens` marked objects, one hundredth of the chain apart."""

    def case(number: int) -> Callable[[], object]:
        model = envgraph.Model(PLACES)
        with model.loading():
            places = [model.create("Place", key=key, mark=False, seen=False) for key in range(number)]
            model.create("World").places = places
            for one, other in pairwise(places):
                one.next = [other]
            for token in range(tokens):
                places[token * number // 100].mark = True
        engine = envgraph.Engine(model)
        engine.step_limit = 100 * number
        engine.add(*LOOP_RULES, envgraph.Unit("loop", body=body))
        return lambda: engine.run("loop")

    return case
