"""Rules whose left sides are views: the same matches, at hand without a search."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.errors import InvalidArgument, RuleError
from envgraph.graph import Model, Node
from envgraph.rewrite import Engine, Match, Row
from tests.facts import Fact, Notified
from tests.profile import NIGHTLY
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, patterns, snapshot

RULES = """
rule cut { lhs { a : Item -next-> b : Item; } modify { delete a -next-> b; } }
rule tie {
    lhs { a : Item; b : Item; check a.n + 1 == b.n; }
    not { a -next-> other : Item; }
    not { other : Item -next-> b; }
    modify { create a -next-> b; }
}
rule grow { lhs { a : Item; neg Item.next(a, _); } modify { create b : Item { n = a.n + 1 }; create a -next-> b; } }
rule befriend { lhs { a : Item; b : Item; } not { a -friends-> b; } modify { create a -friends-> b; } }
rule estrange { lhs { a : Item -friends-> b : Item; } modify { delete a -friends-> b; } }
rule pairUp { lhs { a : Item; b : Item; } not { a -pair-> b; } modify { create a -pair-> b; } }
rule adopt { lhs { a : Item; b : Item; } not { a -kids-> b; } not { b -kids-> a; }
    modify { create b -parent-> a; } }
rule orphan { lhs { a : Item -kids-> b : Item; } modify { delete b -parent-> a; } }
rule above(low : int) { lhs { a : Item; check a.n > low; } }
unit churn { repeat 5 { cut | tie; } }
unit all_of_them { all cut; all tie; }
"""
WATCHED = ("cut", "tie", "grow", "befriend", "estrange", "pairUp", "adopt", "orphan")


def made(watched: bool) -> Engine:
    found = engine(RULES, model=chain(6))
    if watched:
        found.watch(*WATCHED)
    return found


def test_a_watched_rule_lists_its_matches_without_a_search() -> None:
    watched = made(True)
    assert watched.watched == tuple(f"{name}#lhs" for name in WATCHED)
    cut = watched.prepare("cut")
    assert cut.live_rows() is cut.live_rows() and list(cut.live_rows()) == cut.all_rows()
    assert cut.all_rows() is not cut.live_rows()
    watched.unwatch("cut")
    assert cut.live_rows() is not cut.live_rows()
    assert cut.live_rows() == [(number, number + 1) for number in range(5)]


def test_a_rule_that_needs_values_is_not_watched() -> None:
    with pytest.raises(InvalidArgument, match="its parameter `low` always needs a value"):
        made(False).watch("above")


def test_listeners_are_notified_of_rule_matches() -> None:
    watched = engine(RULES, model=chain(3))
    heard: list[tuple[list[Match], list[Match]]] = []
    watched.listen("cut", lambda came, went: heard.append((came, went)))
    with watched.transaction():
        watched.model.node(0).next = None
    assert [([m.row for m in came], [m.row for m in went]) for came, went in heard] == [([], [(0, 1)])]
    assert heard[0][1][0].definition == "cut"


@pytest.mark.parametrize("watched", [True, False], ids=["watched", "searched"])
def test_once_applies_a_rule_at_a_sampled_match(watched: bool) -> None:
    one, random = made(watched), Random(3)
    cut, tie = one.prepare("cut"), one.prepare("tie")
    found = [cut.once(random) for _ in range(6)]
    assert sorted(row for row in found if row) == [(number, number + 1) for number in range(5)]
    assert found[5] is None and not one.exists("cut")
    assert tie.once(random) is not None and one.count("cut") == 1
    one.check_integrity()


def test_once_applies_exact_retypings() -> None:
    one = engine("derive d = retype among { Item, Special };", model=chain(3))
    there, back = one.prepare("d.Item.Special"), one.prepare("d.Special.Item")
    random = Random(1)
    assert sorted(row for row in (there.once(random) for _ in range(3)) if row) == [(0,), (1,), (2,)]
    assert there.once(random) is None and list(there.live_rows()) == []
    assert back.once(random) is not None and one.model.graph.extent("Special") != [0, 1, 2]


def test_rows_are_valid_until_they_stop_matching() -> None:
    for watched in (True, False):
        one = made(watched)
        cut = one.prepare("cut")
        assert cut.still_holds((0, 1)) and not cut.still_holds((1, 0))
        one.model.node(0).next = None
        assert not cut.still_holds((0, 1))
        one.model.node(5).delete("spo")
        assert not cut.still_holds((4, 5)) and cut.still_holds((3, 4))


@pytest.mark.parametrize("seed", range(20 if NIGHTLY else 6))
def test_watched_and_searched_rules_do_the_same(seed: int) -> None:
    """The matches are listed in another order, so each is chosen by its rank among the sorted ones."""
    engines = [made(True), made(False)]
    states = []
    for one in engines:
        random = Random(seed)
        for step in range(60):
            runner = one.prepare(random.choice(WATCHED))
            rows = sorted(runner.live_rows())
            number = int(random.random() * len(rows))
            keep = random.random() < 0.8
            if rows:
                fire(one, runner.name, rows[number], keep)
            if step % 10 == 0:
                one.check_integrity()
        states.append(snapshot(one.model))
    assert states[0] == states[1]


def fire(one: Engine, name: str, row: Row, keep: bool) -> None:
    """Apply a rule, which the model may refuse, and perhaps take it back."""
    before = snapshot(one.model)
    mark = one.model.graph.history.savepoint()
    try:
        one.fire(name, row)
    except RuleError as error:
        assert error.reason in ("full", "containment")
        assert snapshot(one.model) == before
    if keep:
        one.model.graph.history.release(mark)
    else:
        one.model.graph.history.rollback(mark)
        assert snapshot(one.model) == before


class Ear:
    """Writes down what a model tells."""

    def __init__(self) -> None:
        self.facts: list[str] = []

    def inserted(self, fact: Fact) -> None:
        self.facts.append(f"+{type(fact).__name__}")

    def removing(self, fact: Fact) -> None:
        self.facts.append(f"-{type(fact).__name__}")

    def restored(self) -> None:
        self.facts.append("restored")


def test_link_changes_by_rules_are_notified() -> None:
    one, ear = made(False), Ear()
    Notified(one.model, ear)
    one.apply("cut", a=0)
    one.apply("tie", a=0)
    assert ear.facts == ["-LinkFact", "+LinkFact"]


def test_a_full_reference_refuses_a_link_of_a_rule() -> None:
    model = Model(METAMODEL)
    items: list[Node] = [model.create("Item") for _ in range(4)]
    one = engine(RULES, model=model)
    one.apply("pairUp", a=0, b=1)
    one.apply("pairUp", a=0, b=2)
    before = snapshot(model)
    with pytest.raises(RuleError, match="`pairUp` cannot be applied") as refused:
        one.apply("pairUp", a=0, b=3)
    assert refused.value.reason == "full" and snapshot(model) == before
    assert [target.id for target in items[0].pair] == [1, 2]


def test_listeners_are_notified_after_each_outermost_call() -> None:
    """Also after a rule that needs no transaction of its own."""
    one, told = engine(RULES, model=chain(6)), []
    one.listen("cut", lambda came, went: told.append((len(came), len(went))))

    def heard() -> list[tuple[int, int]]:
        found = told[:]
        told.clear()
        return found

    one.apply("cut", a=0)
    assert heard() == [(0, 1)]
    one.apply("cut", one.matches("cut", a=1)[0])
    assert heard() == [(0, 1)]
    one.run("cut")
    assert heard() == [(0, 1)]
    one.run("all_of_them")
    assert heard() == [(3, 0)]  # two were cut and tied again
    one.fire("cut", (0, 1))
    assert heard() == [(0, 1)]
    one.replay([("cut", (1, 2)), ("tie", (0, 1))])
    assert heard() == [(1, 1)]
    with one.transaction():
        one.apply("cut", a=0)
        one.fire("cut", (2, 3))
        assert heard() == []
    assert heard() == [(0, 2)]
    assert one.apply("cut", a=0) is None and heard() == []


def test_listeners_are_notified_once_for_a_function_rule() -> None:
    one, told = engine(RULES, model=chain(4)), []
    one.add(*patterns("pattern pair(a : Item, b : Item) { Item.next(a, b); }"))

    @one.rule("pair", name="twice")
    def twice(engine: Engine) -> None:
        before = len(told)
        engine.apply("cut")
        engine.apply("cut")
        assert len(told) == before
        if not engine.exists("pair"):
            raise ZeroDivisionError

    one.listen("pair", lambda came, went: told.append((len(came), len(went))))
    one.apply("twice")
    assert told == [(0, 2)]
    with pytest.raises(ZeroDivisionError):
        one.apply("twice")
    assert one.count("pair") == 1 and told == [(0, 2)]
