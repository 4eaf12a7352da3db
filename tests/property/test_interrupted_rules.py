"""An interruption at any instruction leaves a rule or unit applied or not, and the engine able to go on."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import settings

from envgraph.match import FREE
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.property.interrupting import Trip
from tests.property.snapshots import facts, spelt
from tests.unit.rewrite.graphs import chain, engine

ONCE, TWICE = (1_000, 300) if settings().max_examples > 100 else (4, 1)
"""Instructions at which each is interrupted, and of these how many interruptions are followed by another."""

QUERIES = """
pattern following(a : Item, b : Item) { Item.next(a, b); }
pattern big(a : Item, n : int) { Item.n(a, n); check(n > 2); }
pattern last(a : Item) { Item(a); neg find following(a, _); }
"""

RULES = """
rule safe(a : Item) {
    lhs { b : Item; b -next-> a; }
    modify { delete b -next-> a; create c : Item { n = 9 }; create a -links-> c; set b.label = "x"; set b.n = 8; }
}
rule more(a : Item) { lhs { } modify { set a.n += 5; set a.label = "more"; create a -links-> a; } }
rule lone(a : Item) { lhs { } modify { set a.n += 1; } }
rule boxed(a : Item) { lhs { } modify { create b : Box; move a to b.content; set a.done = true; } }
rule merged(a : Item, b : Item) { lhs { } modify { merge a <- b; } }
rule all { lhs { } forall { lhs { a : Item; check a.n > 1; } modify { create a -links-> k : Item { n = 0 }; } } }
rule up { lhs { a : Item; check a.n < 4; } modify { set a.n = a.n + 1; } }
rule never { lhs { a : Box; check a.n == 77; } modify { delete a; } }
rule grow { lhs { } modify { create a : Item; } }
unit run { alap { up; } atomic { grow; try { never; } else { grow; } } alap { grow; never; } }
"""


class InterruptedEngine:
    """Items in a chain, views of them, and an event rule."""

    def __init__(self) -> None:
        self.model = model = chain(4)
        self.engine = engine(RULES, QUERIES, model=model)
        self.engine.watch("following", "big", "last")
        for rule in ("safe", "more", "lone", "boxed", "merged", "all", "up"):
            self.engine.prepare(rule)

    def state(self) -> object:
        """The facts."""
        return spelt(facts(self.model))

    def check(self) -> None:
        """Assert that everything is right."""
        assert not self.model.graph.history.savepoint_depth
        self.model.check_integrity()
        naive = NaiveMatcher(self.model, self.engine.library)
        for name, arity in (("following", 2), ("big", 2), ("last", 1)):
            rows = self.engine.matcher.rows(name, (FREE,) * arity)
            assert sorted(rows) == naive.rows(name, (FREE,) * arity), name
        self.model.check_integrity()


Step = Callable[[Engine], object]

STEPS: dict[str, Step] = {
    "straight": lambda made: made.apply("safe", a=1),
    "increase": lambda made: made.apply("more", a=0),
    "single": lambda made: made.apply("lone", a=0),
    "savepoint": lambda made: made.apply("boxed", a=2),
    "merge": lambda made: made.apply("merged", a=3, b=0),
    "forall": lambda made: made.apply("all"),
    "unit": lambda made: made.run("run"),
    "every": lambda made: made.apply_all("up"),
    "explore": lambda made: made.explore("up", limit=5),
    "depth": lambda made: made.explore("up", limit=5, strategy="depth"),
    "once": lambda made: made.prepare("up").once(made.rng),
}


def outcomes(name: str) -> tuple[list[object], int]:
    """The states before and after, and how many instructions there are."""
    world, trip = InterruptedEngine(), Trip(0)
    states = [world.state()]
    trip.run(lambda: STEPS[name](world.engine))
    world.check()
    return [*states, world.state()], trip.passed


def interrupt(name: str, trip: Trip, states: list[object]) -> None:
    """Be interrupted, look at everything, and go on."""
    world = InterruptedEngine()
    if trip.run(lambda: STEPS[name](world.engine)):
        world.check()
        assert world.state() in states
        version = world.engine.commit()
        here = world.state()
        world.engine.apply("lone", a=3)
        world.check()
        world.engine.checkout(version, discard=True)
        world.check()
        assert world.state() == here


@pytest.mark.parametrize("name", STEPS)
def test_interrupted_rules_and_units_are_applied_completely_or_not_at_all(name: str) -> None:
    states, instructions = outcomes(name)
    for number in range(ONCE):
        interrupt(name, Trip(1 + instructions * number // ONCE), states)
    for number in range(TWICE):
        for call in (1, 5 + number, 15 + 3 * number):
            interrupt(name, Trip(1 + instructions * number // TWICE, call), states)
