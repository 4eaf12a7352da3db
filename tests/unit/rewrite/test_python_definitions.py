"""Definitions of Python at an engine: added, looked up, printed; functions as rules and units."""

from __future__ import annotations

import re

import pytest

from envgraph import Pattern, Rule, Unit as UnitOf
from envgraph.errors import InvalidArgument, LoadError, ResolutionError
from envgraph.graph import Node
from envgraph.lang import from_text, spelled_out, to_text
from envgraph.pattern import (
    Binary,
    Body,
    Check,
    Constant,
    Derivation,
    LeftSide,
    Navigation,
    Pattern as PatternData,
    Rule as RuleData,
    RuleNode as Node_,
    Unit,
    UnitCall,
    Variable,
)
from envgraph.rewrite import Engine, Firing, Steps
from tests.unit.rewrite.graphs import METAMODEL, chain, engine

LAST_TEXT = "pattern last(x : Item) { Item(x); neg Item.next(x, _); }"
LAST = Pattern("last", "x : Item", "Item(x); neg Item.next(x, _)")


def test_only_definitions_are_added() -> None:
    made = engine("")
    with pytest.raises(
        InvalidArgument,
        match=r"expected a pattern, .*, not 'rule r .*; parse definitions with `envgraph\.lang\.from_text`",
    ):
        made.add("rule r { lhs { } }")  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="expected a pattern, rule, unit or derivation, not 3"):
        made.check(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("definition", "message"),
    [
        (RuleData("r", left="x : Item"), "`left` of `r` must be a `LeftSide`, not 'x : Item'"),  # type: ignore[arg-type]
        (
            RuleData("r", left=LeftSide((Node_("x", 3),))),
            "`left.nodes[0].type` of `r` must be a `str` or None, not 3",
        ),  # type: ignore[arg-type]
        (RuleData("r", semantics="x"), "`semantics` of `r` must be 'dpo' or 'spo', not 'x'"),  # type: ignore[arg-type]
        (Unit("u", (), "r"), "`body` of `u` must be a `UnitCall`, "),  # type: ignore[arg-type]
        (PatternData("p", (), []), "`bodies` of `p` must be a tuple, not []"),  # type: ignore[arg-type]
        (
            PatternData("p", (), (Body((Check("x > 1"),)),)),
            "`bodies[0].constraints[0].expression` of `p` must be ",
        ),  # type: ignore[arg-type]
        (RuleData(3), "`name` of `Rule` must be a `str`, not 3"),  # type: ignore[arg-type]
    ],
)
def test_data_with_a_part_of_the_wrong_type_is_refused(definition: RuleData | PatternData | Unit, message: str) -> None:
    made = engine("")
    with pytest.raises(InvalidArgument, match=re.escape(message)):
        made.add(definition)
    assert made.definitions == ()


def test_definitions_are_found_by_their_names() -> None:
    made = engine("package p\nrule r { lhs { x : Item; } } unit u { r; }")
    made.add(LAST, Derivation("kinds", "retype", ("Item", "Special")))
    assert to_text(made.definition("r"), made.definition("p.u")).startswith("package p")
    assert made.definition("last") is LAST
    assert made.definition("kinds") == Derivation("kinds", "retype", ("Item", "Special"))
    derived = made.definition("kinds.Special.Item")
    assert isinstance(derived, type(made.definition("r")))
    assert "retype object : Item" in to_text(*spelled_out([derived], METAMODEL))
    with pytest.raises(InvalidArgument, match="unknown pattern, rule, unit or group `lats`; did you mean `last`"):
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
    with pytest.raises(InvalidArgument, match="`drop` is a Python function, which has no definition as data"):
        made.definition("drop")
    with pytest.raises(ResolutionError, match="unknown"):
        made.rule(when=Pattern("bad", "x : Itme", "Itme(x)"))
    with pytest.raises(InvalidArgument, match="the weight is inf, but must be a finite number above 0"):
        made.rule(when=LAST, weight=float("inf"))(lambda x: None)


def test_rules_from_data_and_from_functions_can_be_combined() -> None:
    made = engine("", model=chain(2))
    made.add(LAST, Rule("done", lhs="find last(x); x : Item", modify="set x.done = true"))
    assert made.run("done")
    assert [node.done for node in made.model.nodes("Item")] == [False, True]


# --- functions that describe units

RULES = """
rule walk(x : Item, out y : Item) { lhs { x -next-> y; } modify { set y.n = 0; } }
rule grow { lhs { x : Item; check x.n < 3; } modify { set x.n += 1; } }
rule cut { lhs { x : Item -next-> y : Item; } modify { delete x -next-> y; } }
"""


def test_a_function_with_steps_describes_the_unit_of_a_text() -> None:
    made = engine(RULES, "pattern big(x : Item, n : int) { Item.n(x, n); check(n > 2); }", model=chain(3))

    @made.unit(weight=2.0, priority=1)
    def day(steps: Steps, x: "Item", k: int) -> None:  # noqa: F821, UP037
        """A day."""
        steps.call("walk", x, ...)
        with steps.repeat(1, 3):
            steps.choose("grow", UnitCall("cut"))
        with steps.attempt():
            steps.call("cut", first=True)
        with steps.otherwise(), steps.alap():
            steps.call("grow", where=[Check(Binary("<", Navigation(Variable("x"), "n"), k))])
        with steps.when("big", x, k):
            steps.every("grow", by=Navigation(Variable("x"), "n"), top=2)
        with steps.otherwise(), steps.unless("big", x, Binary("+", k, Constant(1))), steps.atomic():
            steps.every("cut")
        with steps.when(Check(Binary(">", k, Constant(0)))), steps.repeat(2):
            steps.call("grow")

    text = """
    /** A day. */
    @weight(2.0) @priority(1)
    unit day(x : Item, k : int) {
        walk(x, _);
        repeat 1..3 { grow | cut; }
        try { first cut; } else { alap { grow where check(x.n < k); } }
        if find big(x, k) { top 2 grow by x.n; }
        else { if neg find big(x, eval(k + 1)) { atomic { all cut; } } }
        if check(k > 0) { repeat 2 { grow; } }
    }
    """
    made.definition("day")
    assert to_text(made.definition("day")) == to_text(*from_text(text))


def test_a_described_choice_may_have_blocks() -> None:
    made = engine(RULES)

    @made.unit
    def day(steps: Steps, k: int) -> None:
        with steps.either(), steps.repeat(k):
            steps.call("grow")
        with steps.alternatively():
            steps.call("cut")
            steps.call("grow")
        steps.choose("grow", "cut")
        with steps.alternatively(), steps.repeat(0, k):
            steps.call("cut")

    text = """
unit day(k : int) {
    { repeat k { grow; } } | { cut; grow; }
    grow | cut | { repeat 0..k { cut; } }
}
"""
    assert to_text(made.definition("day")) == text.lstrip()
    with (
        pytest.raises(InvalidArgument, match="`alternatively` must directly follow"),
        Steps().alternatively(),
    ):
        pass


def test_the_body_of_a_unit_may_begin_with_an_alternative() -> None:
    (read,) = from_text("unit u { { grow; cut; } | cut; grow; }")
    assert UnitOf("u", body="{ grow; cut; } | cut; grow") == read
    with pytest.raises(LoadError, match="`body` takes only the text between its braces"):
        UnitOf("u", body="{ grow; cut; }")


def test_a_described_unit_runs_like_its_text() -> None:
    made = engine(RULES, model=chain(3))

    @made.unit
    def tidy(steps: Steps) -> None:
        with steps.alap():
            steps.call("cut")
        with steps.alap():
            steps.choose("grow")

    twin = made.copy()
    result = made.run("tidy")
    assert result and result.applications == 2 + 3 + 2 + 1
    assert made.definition("tidy") == twin.definition("tidy")
    twin.run("tidy")
    assert twin.model.state_hash() == made.model.state_hash()


def test_what_a_function_describes_is_checked() -> None:
    made = engine(RULES)

    def unknown(steps: Steps) -> None:
        steps.call("wakl")

    with pytest.raises(ResolutionError, match="unknown rule or unit `wakl`\nhint: did you mean `walk`"):
        made.unit(unknown)
    with pytest.raises(InvalidArgument, match="`otherwise` must directly follow"), Steps().otherwise():
        pass
    with pytest.raises(InvalidArgument, match="`choose` takes at least one"):
        Steps().choose()
    with pytest.raises(InvalidArgument, match="expected the name of a rule or unit, not 3"):
        Steps().call(3)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match=r"an argument must be a parameter, .* not \[\]"):
        Steps().call("walk", [])  # type: ignore[arg-type]
    steps = Steps()
    with steps.alap(), pytest.raises(InvalidArgument, match="a block of the unit is still open"):
        assert steps.body
    assert made.units == ()


# --- functions that are units


def test_a_function_can_be_a_unit() -> None:
    made = engine(RULES, model=chain(4))

    @made.unit
    def shorten(x: "Item", times: int, engine: Engine) -> None:  # noqa: F821, UP037
        """Cut behind a node."""
        assert isinstance(x, Node) and engine is made
        for _ in range(times):
            engine.apply("cut", x=x)
            x = engine.model.node(x.id + 1)

    assert made.units == ("shorten",) and shorten.__doc__ == "Cut behind a node."
    result = made.run("shorten", x=made.model.node(1), times=2)
    assert result and [match.row for match in result.matches] == [(1, 2), (2, 3)]
    assert not made.run("shorten", x=3, times=0).applications
    with pytest.raises(InvalidArgument, match="unit `shorten` needs values for `times`"):
        made.run("shorten", x=1)
    with pytest.raises(InvalidArgument, match="`shorten` is a Python function"):
        made.definition("shorten")


def test_units_of_text_call_those_of_functions() -> None:
    made = engine(RULES, model=chain(4))

    @made.unit(weight=3.0)
    def cutOnce(engine: Engine) -> bool:
        return engine.apply("cut") is not None

    made.add(*from_text("unit all_ { alap { cutOnce; } } unit one { cutOnce | grow; }"))
    assert made.run("all_").applications == 3
    assert not made.exists("cut")
    failed = made.run("cutOnce")
    assert not failed and failed.reason == "`cutOnce` returned False"
    assert made.run("one"), "the other alternative"


def test_refused_changes_of_a_function_are_rolled_back() -> None:
    made = engine(RULES + "rule drop(x : Item) { lhs { x; } modify { delete x; } }", model=chain(3))

    @made.unit
    def greedy(engine: Engine) -> None:
        engine.apply("grow")
        engine.apply("drop", x=1)

    made.add(*from_text("unit u { try { greedy; } else { cut; } }"))
    before = made.model.state_hash()
    failed = made.run("greedy")
    assert not failed and failed.applications == 0 and failed.refusal is not None
    assert failed.refusal.reason == "dangling" and made.model.state_hash() == before
    assert [match.definition for match in made.run("u").matches] == ["cut"]


def test_a_raising_function_rolls_back_the_whole_run() -> None:
    made = engine(RULES, model=chain(3))

    @made.unit
    def broken(engine: Engine) -> None:
        engine.apply("cut")
        raise ZeroDivisionError("mine")

    made.add(*from_text("unit u { grow; try { broken; } }"))
    before, draws = made.model.state_hash(), made.rng
    with pytest.raises(ZeroDivisionError, match="mine"):
        made.run("u")
    assert made.model.state_hash() == before and made.rng is draws
    assert made.run("cut"), "the engine is in order"


def test_runs_of_functions_are_recorded_and_replayed_once() -> None:
    made = engine(RULES, model=chain(4))

    @made.unit
    def some(engine: Engine) -> None:
        engine.apply("cut")
        engine.run("inner")

    made.add(*from_text("unit inner { grow; } unit outer { some; cut; }"))
    twin = engine(RULES, model=chain(4))
    with made.recording() as trace:
        assert made.run("outer")
    assert [firing.rule for firing in trace] == ["cut", "grow", "cut"]
    twin.replay(trace)
    assert twin.model.state_hash() == made.model.state_hash()


def test_every_random_choice_of_a_function_is_explored() -> None:
    made = engine(RULES, model=chain(3))

    @made.unit
    def some(engine: Engine) -> None:
        engine.apply("cut")
        engine.apply("cut")

    @made.unit
    def one(engine: Engine) -> None:
        engine.apply("cut")

    before = made.model.state_hash()
    assert len(made.explore(["one"]).states) == 4
    assert {move.firings for move in made.explore(["some"]).transitions} == {
        (Firing("cut", (0, 1)), Firing("cut", (1, 2))),
        (Firing("cut", (1, 2)), Firing("cut", (0, 1))),
    }
    assert made.model.state_hash() == before


def test_functions_are_sampled_by_weight_and_usable_as_event_jobs() -> None:
    made = engine(RULES, LAST_TEXT, model=chain(3))

    @made.unit
    def finish(x: "Item") -> None:  # noqa: F821, UP037
        x.done = True  # type: ignore[attr-defined]

    @made.unit
    def nothing() -> None:
        pass

    made.on("last", appear="finish")
    made.settle()
    made.run("cut")
    assert sum(node.done for node in made.model.nodes("Item")) == 2
    assert made.choose(["nothing"]) == ("nothing", ()) and made.fire("nothing") == ()


def test_functions_that_cannot_be_units_are_refused() -> None:
    made = engine(RULES)
    with pytest.raises(InvalidArgument, match='parameter `x` of unit `f` has no type: write `x: "Class"`'):
        made.unit(name="f")(lambda x: None)

    def wrong(x: "Itme") -> None:  # noqa: F821, UP037
        pass

    def preset(x: int = 3) -> None:
        pass

    def rest(*x: int) -> None:
        pass

    with pytest.raises(InvalidArgument, match="unknown type `Itme`; did you mean `Item`"):
        made.unit(wrong)
    with pytest.raises(InvalidArgument, match="parameter `x` of unit `preset` cannot have a default"):
        made.unit(preset)
    with pytest.raises(InvalidArgument, match="of unit `rest` cannot be passed by name"):
        made.unit(rest)
    with pytest.raises(InvalidArgument, match="`cut` is defined already"):
        made.unit(name="cut")(lambda: None)
    with pytest.raises(InvalidArgument, match="expected a function to register, not 'walk'"):
        made.unit("walk")  # type: ignore[call-overload]
    assert made.units == ()


def test_functions_and_what_calls_them_are_not_copied() -> None:
    made = engine(RULES, model=chain(3))

    @made.unit
    def mine(engine: Engine) -> None:
        engine.apply("cut")

    @made.rule(when=LAST)
    def drop(x: Node) -> None:
        x.prev = None

    made.add(*from_text("unit a { try { mine; } } unit b { repeat 2 { a; } } unit c { drop | cut; } unit d { cut; }"))
    twin = made.copy()
    assert twin.units == ("d",) and twin.rules == ("walk", "grow", "cut") and twin.patterns == ("last",)
    assert twin.run("d") and made.count("cut") == 2
