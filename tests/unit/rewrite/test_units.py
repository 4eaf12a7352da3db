"""Control units: what each step does, when it fails, and that every run ends."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from envgraph.errors import EvaluationError, InvalidArgument, Severity, TypeMismatch
from envgraph.graph import Model
from envgraph.lang import to_text
from envgraph.pattern import Applicable, AtomicStep, StepSequence, Unit, UnitCall, Variable
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import METAMODEL, chain, definitions, engine, problems, snapshot

# `up` counts to 3, `big` and `never` tell success from failure, `bad` matches and is refused.
RULES = """
rule up { lhs { a : Item; check a.n < 3; } modify { set a.n = a.n + 1; } }
rule big { lhs { a : Item; check a.n >= 3; } modify { set a.label = "big"; } }
rule never { lhs { a : Box; } modify { delete a; } }
rule bad { lhs { a : Item; } modify { delete a; } }
rule grow { lhs { } modify { create a : Item; } }
rule mark(a : Item, value : int) { lhs { } modify { set a.n = value; } }
rule read(a : Item, out value : int) { lhs { Item.n(a, value); } }
"""


def one(unit: str, *, seed: int = 0, queries: str = "", rules: str = RULES) -> Engine:
    """An engine over one item, with the rules above and a unit `u`."""
    model = Model(METAMODEL)
    model.create("Item")
    return engine(rules + unit, queries, model=model, seed=seed)


def n(made: Engine) -> int:
    value = made.model.node(0).n
    assert isinstance(value, int)
    return value


# --- sequences and calls


def test_a_sequence_runs_in_order_and_says_whether_anything_was_applied() -> None:
    made = one("unit u { up; up; } unit nothing { }")
    assert made.run("u") and n(made) == 2
    result = made.run("nothing")
    assert result and result.applications == 0


def test_a_sequence_ends_at_the_first_step_that_fails_and_keeps_what_was_done() -> None:
    made = one("unit u { up; never; up; }")
    result = made.run("u")
    assert not result and result.applications == 1
    assert n(made) == 1


def test_rules_and_groups_can_be_run_like_units() -> None:
    made = one("derive kinds = retype among { Item, Special };")
    assert made.run("up") and not made.run("never")
    assert made.run("kinds") and made.model.node(0).cls == "Special"


def test_units_call_units_groups_and_rules_with_arguments() -> None:
    made = one(
        """
        unit set(a : Item, value : int) { mark(a, value * 2); }
        derive kinds = retype among { Item, Special };
        unit u(a : Item) { set(a, a.n + 5); kinds; }
        """
    )
    made.run("u", a=0)
    assert (n(made), made.model.node(0).cls) == (10, "Special")


def test_outputs_of_rules_and_units_are_variables_of_what_follows() -> None:
    made = one(
        """
        unit twice(a : Item, out double : int) { read(a, value); double_of(a, value, double); }
        rule double_of(a : Item, x : int, out y : int) { lhs { y == eval(x * 2); } }
        unit u(a : Item) { mark(a, 4); twice(a, more); mark(a, more + 1); }
        """
    )
    made.run("u", a=0)
    assert n(made) == 9


def test_an_output_that_has_a_value_is_a_condition() -> None:
    made = one("unit u(a : Item, value : int) { read(a, value); mark(a, 7); }")
    assert not made.run("u", a=0, value=1)
    assert made.run("u", a=0, value=0)


def test_an_argument_may_be_left_open() -> None:
    made = one("unit u { mark(_, 6); }")
    made.run("u")
    assert n(made) == 6


def test_a_deleted_object_matches_nothing() -> None:
    made = one("rule drop(a : Item) { lhs { } modify { delete a; } } unit u(a : Item) { drop(a); mark(a, 1); }")
    result = made.run("u", a=0)
    assert result.reason == "an argument of `mark` was deleted (test.rules:9:82)"
    assert len(made.model) == 0


# --- refusals


def test_a_refused_application_is_a_failure_like_any_other_and_the_result_has_the_reason() -> None:
    made = one("unit u { up; bad; up; } unit v { atomic { up; bad; } }")
    made.model.create("Special", n=5, favourite=made.model.node(0))
    before = snapshot(made.model)
    whole = made.run("v")
    assert not whole and whole.applications == 0 and snapshot(made.model) == before
    result = made.run("u")
    assert not result and (result.applications, n(made)) == (1, 1)
    assert result.refusal is not None
    assert (result.refusal.rule, result.refusal.reason) == ("bad", "dangling")
    assert result.reason == f"`bad` was refused at each match (test.rules:9:14): {result.refusal.message}"


def test_a_refused_application_is_a_failure_that_units_can_go_on_from() -> None:
    made = one(
        """
        unit tried { try { bad; } else { up; } }
        unit chosen { bad | up; }
        unit looped { alap { bad; } up; }
        """
    )
    made.model.create("Special", n=9, favourite=made.model.node(0))
    for number, unit in enumerate(("tried", "chosen", "looped"), start=1):
        assert made.run(unit)
        assert n(made) == number
    assert len(made.model) == 2


def test_a_call_tries_the_other_matches_when_one_is_refused() -> None:
    for seed in range(8):
        model = chain(3)  # deleting one of these leaves a link dangling
        model.create("Item")
        made = engine("rule drop { lhs { a : Item; } modify { delete a; } } unit u { drop; }", model=model, seed=seed)
        assert made.run("u")
        assert [node.id for node in model.nodes("Item")] == [0, 1, 2]


# --- choice


def test_a_choice_takes_an_alternative_that_succeeds() -> None:
    for seed in range(10):
        made = one("unit u { never | up | never; }", seed=seed)
        assert made.run("u") and n(made) == 1


def test_a_choice_without_an_alternative_that_succeeds_fails() -> None:
    made = one("unit u { up; never | never; up; }")
    made.run("u")
    assert n(made) == 1


def test_choices_sample_alternatives_by_weight() -> None:
    rules = """
    @weight(3.0) rule left { lhs { a : Item; } modify { set a.n = 1; } }
    rule right { lhs { a : Item; } modify { set a.n = 2; } }
    unit u { left | right; }
    """
    made = one(rules)
    made.rng = random.Random(5)  # type: ignore[assignment]
    seen: Counter[int] = Counter()
    for _ in range(2000):
        made.run("u")
        seen[n(made)] += 1
    assert 1400 < seen[1] < 1600


def test_a_choice_prefers_the_highest_priority_that_can_be_applied() -> None:
    rules = """
    @priority(2) rule first { lhs { a : Item; check a.n < 2; } modify { set a.n += 1; } }
    @priority(1) rule second { lhs { a : Item; check a.n < 4; } modify { set a.n += 10; } }
    unit u { second | ^first | up; }
    """
    made = one(rules)
    seen = []
    for _ in range(4):
        made.run("u")
        seen.append(n(made))
    assert seen == [1, 2, 12, 12]


def test_failed_alternatives_are_rolled_back() -> None:
    made = one("unit half { grow; never; } @priority(1) unit better { grow; never; } unit u { better | half | up; }")
    assert made.run("u")
    assert (len(made.model), n(made)) == (1, 1)


# --- loops


def test_an_alternative_may_be_a_block() -> None:
    seen = set()
    for seed in range(20):
        made = one("unit u { { up; up; } | { grow; never; } | grow; }", seed=seed)
        assert made.run("u")
        seen.add((n(made), len(made.model)))
    assert seen == {(2, 1), (0, 2)}


def test_a_block_among_alternatives_has_priority_0_and_weight_1() -> None:
    rules = "@priority(1) rule early { lhs { a : Item; check a.n == 0; } modify { set a.n = 9; } } "
    made = one(rules + "unit u { { up; grow; } | early; }")
    made.run("u")
    assert (n(made), len(made.model)) == (9, 1)
    counts: Counter[int] = Counter()
    heavy = "@weight(3.0) rule heavy { lhs { a : Item; } modify { set a.n = 5; } } "
    made = one(heavy + "unit u { { mark(_, 1); } | heavy; }")
    for _ in range(400):
        made.run("u")
        counts[n(made)] += 1
    assert 60 < counts[1] < 140


def test_a_variable_of_an_alternative_stays_in_it() -> None:
    made = one("unit u { { read(_, k); mark(_, k + 2); } | never; }")
    assert made.run("u") and n(made) == 2
    (wrong,) = problems(RULES + "unit u(a : Item) { { read(a, k); } | never; mark(a, k); }")
    assert str(wrong.message) == "unknown variable `k`"


def test_alap_repeats_as_long_as_possible() -> None:
    made = one("unit u { alap { up; } big; }")
    made.run("u")
    assert (n(made), made.model.node(0).label) == (3, "big")


def test_the_failed_last_round_of_alap_is_rolled_back() -> None:
    made = one("rule box { lhs { } modify { create a : Box; } } unit u { alap { box; up; } }")
    made.run("u")
    assert (n(made), len(made.model.nodes("Box"))) == (3, 3)


def test_alap_ends_when_nothing_changes_any_more() -> None:
    made = one("unit u { alap { try { up; } } }")
    made.run("u")
    assert n(made) == 3


def test_repeat_samples_a_number_of_rounds_between_its_bounds() -> None:
    seen = set()
    for seed in range(30):
        made = one("unit u { repeat 1..3 { grow; } }", seed=seed)
        made.run("u")
        seen.add(len(made.model) - 1)
    assert seen == {1, 2, 3}


@pytest.mark.parametrize(
    ("bounds", "rounds"),
    [("k", {3}), ("1..k", {1, 2, 3}), ("k - 2..a.n + k", {1, 2, 3}), ("a.n", {0}), ("k % 3..0", {0})],
)
def test_bounds_of_repeat_are_evaluated_at_its_start(bounds: str, rounds: set[int]) -> None:
    seen = set()
    for seed in range(30):
        made = one(f"unit u(a : Item, k : int) {{ repeat {bounds} {{ up; }} }}", seed=seed)
        made.run("u", a=0, k=3)
        seen.add(n(made))
    assert seen == rounds


def test_a_bound_of_repeat_may_come_from_a_rule() -> None:
    made = one("unit u(a : Item) { mark(a, 2); read(a, k); repeat k { grow; } }")
    assert made.run("u", a=0) and len(made.model) == 3


def test_repeat_fails_where_a_bound_has_no_value() -> None:
    made = one("unit u(a : Item) { up; try { repeat 0..a.next.n { grow; } } else { up; } }")
    assert made.run("u", a=0) and (n(made), len(made.model)) == (2, 1)
    made = one("unit u(a : Item) { repeat a.next.n { grow; } }")
    reason = made.run("u", a=0).reason
    assert reason is not None and reason.startswith("a bound of the `repeat` has no value (test.rules:9:27)")


def test_bounds_of_repeat_that_are_out_of_order_end_the_run() -> None:
    made = one("unit u(k : int) { up; repeat k { up; } }")
    with pytest.raises(EvaluationError, match=r"test.rules:9:23: cannot repeat -1\.\.-1 times"):
        made.run("u", k=-1)
    assert n(made) == 0
    made = one("unit u(k : int) { repeat k..3 { up; } }")
    with pytest.raises(EvaluationError, match=r"cannot repeat 4\.\.3 times"):
        made.run("u", k=4)


def test_repeat_says_how_many_rounds_of_how_many_have_succeeded() -> None:
    made = one("unit u(k : int) { repeat k { up; } }")
    reason = made.run("u", k=7).reason
    assert reason is not None and reason.startswith("3 of at least 7 rounds succeeded")


def test_repeat_fails_below_its_lower_bound_only() -> None:
    enough = one("unit u { repeat 2..9 { up; } grow; }", seed=1)
    enough.run("u")
    assert len(enough.model) == 2
    short = one("unit u { repeat 4..4 { up; } grow; }")
    short.run("u")
    assert (n(short), len(short.model)) == (3, 1)


def test_the_failed_round_of_repeat_is_rolled_back() -> None:
    made = one(
        """
        unit u { repeat 5..5 { heavier; up; } }
        rule heavier { lhs { a : Item; } modify { set a.weight += 1; } }
        """
    )
    made.run("u")
    assert made.model.node(0).weight == 3.0


def test_all_applies_a_rule_at_each_match_of_a_snapshot() -> None:
    model = chain(4)
    made = engine(
        "rule cut { lhs { a : Item -next-> b : Item; } modify { delete b; } } unit u { all cut; }",
        model=model,
    )
    made.model.node(2).next = None
    assert made.run("u")
    # 0 -> 1 -> 2 and 3: (0, 1) is refused, because 1 -> 2 would dangle, or (1, 2) comes first.
    assert model.graph.alive(0) and model.graph.alive(3)


def test_all_checks_each_match_again() -> None:
    model = Model(METAMODEL)
    for _ in range(4):
        model.create("Item")
    # Every pair of items is a match; each application uses up one of its two.
    made = engine(
        "rule pair { lhs { a : Item; b : Item; } modify { delete b; set a.n += 1; } } unit u { all pair; }",
        model=model,
    )
    assert made.run("u")
    assert len(model) == 1
    assert not made.run("u")


# --- try, if, atomic


def test_try_rolls_back_a_failed_body_and_runs_else() -> None:
    made = one("unit u { try { grow; never; } else { up; } up; }")
    made.run("u")
    assert (len(made.model), n(made)) == (1, 2)


def test_try_without_else_succeeds() -> None:
    made = one("unit u { try { never; } up; }")
    made.run("u")
    assert n(made) == 1


def test_atomic_is_all_or_nothing() -> None:
    made = one("unit u { up; atomic { grow; never; } up; }")
    made.run("u")
    assert (len(made.model), n(made)) == (1, 1)


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("find small(a)", 1),
        ("neg find small(a)", 2),
        ("find small(_)", 1),
        ("find linked(a, _)", 2),
        ("neg Special(a)", 1),
        ("find above(a, limit)", 1),
        ("check a.n < limit", 2),
        ("check limit == 0 && !a.done", 1),
        ("Item(a)", 1),
        ("Special(a)", 2),
        ("Item.n(a, limit)", 1),
        ("Item.links(a, _)", 2),
        ("Item.next*(a, a)", 1),
        ("limit == 0", 1),
        ("limit != 0", 2),
        ("limit == eval(a.n + 1)", 2),
        ("limit == count find linked(a, _)", 1),
    ],
)
def test_if_conditions_are_patterns_or_expressions(condition: str, expected: int) -> None:
    made = one(
        f"unit u(a : Item, limit : int) {{ if {condition} {{ mark(a, 1); }} else {{ mark(a, 2); }} }}",
        queries="""
        pattern small(x : Item) { Item.n(x, v); check(v < 3); }
        pattern linked(x : Item, y : Item) { Item.links(x, y); }
        pattern above(x : Item, v : int) { Item.n(x, v); }
        """,
    )
    made.run("u", a=0, limit=0)
    assert n(made) == expected


def test_matches_are_chosen_by_comparing_objects() -> None:
    made = engine(
        f"{RULES} unit u(b : Item) {{ mark(_, 7) where a == b; all mark(_, 5) where a != b; }}",
        model=chain(3),
    )
    assert made.run("u", b=1)
    assert [node.n for node in made.model.nodes("Item")] == [5, 7, 5]


def test_errors_in_unit_conditions_are_reported() -> None:
    found = problems(RULES + "unit u(a : Item, b : Box) { if a == b { up; } if Itm(a) { up; } if x == a { up; } }")
    assert [one.code for one in found] == ["type-conflict", "unknown-type", "unknown-variable"]


def test_if_without_a_branch_to_run_succeeds() -> None:
    made = one("unit u(a : Item) { if check a.n > 5 { never; } up; }")
    made.run("u", a=0)
    assert n(made) == 1


# --- limits


def nested(step: UnitCall, levels: int) -> AtomicStep | UnitCall:
    body: AtomicStep | UnitCall = step
    for _ in range(levels):
        body = AtomicStep(StepSequence((body, StepSequence(()))))
    return body


def test_endless_runs_are_stopped_and_rolled_back() -> None:
    made = one("unit u { alap { grow; } }")
    made.step_limit = 100
    before = snapshot(made.model)
    with pytest.raises(EvaluationError, match="more than 100 steps"):
        made.run("u")
    assert snapshot(made.model) == before


def test_units_that_call_each_other_forever_are_stopped() -> None:
    made = one("unit u { grow; v; } unit v { u; }")
    with pytest.raises(EvaluationError, match="nested more than 200 levels deep") as caught:
        made.run("u")
    assert len(made.model) == 1
    assert caught.value.span is not None and caught.value.span.text == "u"
    assert (caught.value.hint or "").startswith("use `alap` or `repeat`")


def test_a_unit_that_failed_shows_the_step() -> None:
    made = one("unit u { repeat 2 { atomic { never; } } }")
    result = made.run("u")
    assert result.span is not None and result.span.text == "never"
    assert result.reason is not None and result.reason.endswith("`never` has no match (test.rules:9:30)")
    assert made.run("up").span is None


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("unit u { up; u; }", "`u` always calls itself"),
        ("unit u { repeat 1..2 { u; } }", "`u` always calls itself"),
        ("unit u { u | { grow; atomic { u; } } }", "`u` always calls itself"),
        ("unit u { if check 1 > 2 { u; } else { v; } } unit v { u; }", "`u` always calls itself"),
        (
            "unit u { up; v; } unit v { try { u; } else { w; } } unit w { v; }",
            "`u` always calls itself through `v`",
        ),
    ],
)
def test_unconditional_self_calls_are_reported_once(units: str, message: str) -> None:
    (found,) = problems(RULES + units)
    assert (found.code, found.severity) == ("endless-unit", Severity.WARNING)
    assert found.message == f"{message}, so that it never succeeds"
    assert found.span is not None and found.span.text in ("u", "v")


@pytest.mark.parametrize(
    "body",
    [
        "up; try { u; }",
        "up | u;",
        "if check 1 > 2 { u; }",
        "repeat 0..1 { u; }",
        "alap { up; u; }",
        "try { up; } else { u; }",
        "if check 1 > 2 { u; } else { up; }",
    ],
)
def test_a_unit_may_call_itself_where_it_can_also_end(body: str) -> None:
    assert not problems(f"{RULES} unit u {{ {body} }} unit v {{ u; u; }}")


def test_deeply_nested_steps_are_refused() -> None:
    made = one("")
    body: AtomicStep | UnitCall = UnitCall("up")
    for _ in range(45):
        body = AtomicStep(body)
    made.add(Unit("deep", (), StepSequence((body,))))
    assert made.run("deep")
    for _ in range(10_000):
        body = AtomicStep(body)
    assert [d.code for d in made.check(Unit("deeper", (), body))] == ["nested-too-deeply"]
    calls = UnitCall("up")
    units = [Unit(f"u{i}", (), nested(UnitCall(f"u{i - 1}") if i else calls, 40)) for i in range(45)]
    made.add(*units)
    with pytest.raises(EvaluationError, match="nested more than 200 levels deep"):
        made.run("u44")
    assert n(made) == 1


def test_a_failed_evaluation_ends_the_run() -> None:
    made = one("rule broken { lhs { a : Item; } modify { set a.n = 1 / a.n; } } unit u { grow; try { broken; } }")
    with pytest.raises(EvaluationError, match="division by zero"):
        made.run("u")
    assert len(made.model) == 1


# --- arguments of `run`


def test_arguments_of_a_run_are_checked() -> None:
    made = one("unit u(item : Item, value : int) { mark(item, value); }")
    with pytest.raises(InvalidArgument, match="needs values for `value`"):
        made.run("u", item=0)
    with pytest.raises(InvalidArgument, match="did you mean `item`"):
        made.run("u", itme=0, value=1)
    with pytest.raises(TypeMismatch, match="takes `int`, not 'x'"):
        made.run("u", item=0, value="x")
    with pytest.raises(InvalidArgument, match="unknown rule, unit or group `uu`"):
        made.run("uu")


# --- diagnostics

MISTAKES = [
    ("unit u { upp; }", "unknown-rule", "upp", "did you mean `up`?"),
    ("unit u { mark; }", "wrong-arity", "mark", "write `mark(a, value)`; `_` passes no value"),
    (
        "unit u(a : Item) { mark(a); }",
        "wrong-arity",
        "mark(a)",
        "write `mark(a, value)`; `_` passes no value",
    ),
    ("unit u(a : Item) { mark(a, _); }", "wrong-arity", "_", "write a value instead of `_`"),
    ("unit u(a : Item) { mark(b, 1); }", "unknown-variable", "b", "there is `a`"),
    ('unit u(a : Item) { mark(a, "x"); }', "wrong-type", '"x"', "write a whole number, such as `3`"),
    ("unit u(a : Box) { mark(a, 1); }", "wrong-type", "a", "write a variable that stands for an `Item`"),
    ("unit v { up; } unit u { all v; }", "wrong-kind", "v", "leave `all` out"),
    (
        "unit v(a : Item) { mark(a, 1); } unit u { v; }",
        "wrong-arity",
        "v",
        "write `v(a)`; `_` passes no value",
    ),
    ("unit u(a) { mark(a, 1); }", "missing-type", "a", "write `a : Class`, or a data type"),
    ("unit u(a : Itm) { mark(a, 1); }", "unknown-type", "Itm", "did you mean `Item`?"),
    ("unit u(a : Item, a : Item) { mark(a, 1); }", "duplicate-definition", "a", "choose another name"),
    (
        "unit u(out x : int) { up; }",
        "unbound-output",
        "x",
        "pass it to an `out` parameter of a rule, outside of any block",
    ),
    ("unit u { if find linked(a, _) { up; } }", "unknown-variable", "a", "write `_` for any value"),
    ("unit u { if find linkd(_, _) { up; } }", "unknown-pattern", "linkd", "did you mean `linked`?"),
    ("unit u(a : Item) { if check a.n { up; } }", "wrong-type", "a.n", "compare it: `.. == ..`"),
    (
        "unit u(k : float) { repeat k { up; } }",
        "wrong-type",
        "k",
        "convert it with `round`, `floor` or `toInt`",
    ),
    ("unit u { repeat 1..k { up; } }", "unknown-variable", "k", "no variable is known here"),
    (
        "unit u(k : int) { repeat -1..k { up; } }",
        "bad-bounds",
        "repeat -1..k { up; }",
        "write the lower bound first; it must be at least 0",
    ),
    ("@weigth(2.0) unit u { up; }", "unknown-annotation", "@weigth(2.0)", "did you mean `weight`?"),
]


@pytest.mark.parametrize(("text", "code", "place", "hint"), MISTAKES, ids=lambda value: str(value)[:50])
def test_each_mistake_of_a_unit_is_reported_once_and_exactly(
    text: str, code: str, place: str, hint: str | None
) -> None:
    found = problems(RULES + text, "pattern linked(x : Item, y : Item) { Item.links(x, y); }")
    assert [diagnostic.code for diagnostic in found] == [code], [str(diagnostic) for diagnostic in found]
    assert found[0].span is not None and found[0].span.text == place
    assert found[0].hint == hint


def test_runs_from_a_deep_stack_are_rolled_back() -> None:
    made = one("unit u { grow; try { try { grow; v; } } } unit v { try { grow; u; } }")
    before = snapshot(made.model)

    def dive(levels: int) -> None:
        if levels:
            dive(levels - 1)
        else:
            made.run("u")

    for levels in range(700, 900, 7):
        with pytest.raises((EvaluationError, RecursionError)):
            dive(levels)
        assert snapshot(made.model) == before
        assert not made.model.graph.history.savepoint_depth


def test_calls_that_are_not_written_out_do_the_same() -> None:
    long = one(f"unit u(a : Item) {{ {'grow; ' * 300} read(a, x); mark(a, x + 7); first big; never; }}")
    result = long.run("u", a=0)
    assert not result and result.applications == 303
    assert str(result.reason).startswith("`never` has no match (test.rules:9:")
    assert (n(long), long.model.node(0).label) == (7, "big")
    refused = one(f"unit u {{ {'up; ' * 3} {'grow; ' * 300} first bad; }}")
    refused.model.create("Special", n=5, favourite=refused.model.node(0))
    assert refused.run("u")
    # The first item is linked; the next one goes.
    assert refused.model.graph.alive(0) and len(refused.model) == 2 + 300 - 1


def test_long_call_cycles_are_reported_once() -> None:
    units = "".join(f"unit u{number} {{ up; u{(number + 1) % 300}; }}\n" for number in range(300))
    (found,) = problems(RULES + units)
    assert found.message == "`u0` always calls itself through `u1` and others, so that it never succeeds"


# --- rules as conditions

ASKED = """
rule cut(a : Item) { lhs { } modify { delete a; } }
rule link(a : Item, b : Item) { lhs { } not { a -links-> b; } modify { create a -links-> b; } }
rule never { lhs { a : Box; } modify { delete a; } }
rule mark(a : Item, value : int) { lhs { } modify { set a.n = value; } }
derive kinds = retype among { Special, Item };
unit tell(a : Item) { if cut(a) { mark(a, 7); } else { mark(a, 8); } }
"""


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("cut(a)", False),  # it is linked
        ("neg cut(a)", True),
        ("cut(b)", True),
        ("cut", True),
        ("cut(_)", True),
        ("neg cut", False),
        ("never", False),
        ("neg never()", True),
        ("link(a, b)", True),
        ("link(a, _)", True),
        ("link(_, eval(b.next))", False),  # leads nowhere
        ("neg link(_, eval(b.next))", True),
        ("mark(b, 3)", True),
        ("mark(b, eval(a.n + 1))", True),
        ("kinds", True),
    ],
)
def test_an_if_asks_whether_a_rule_is_applicable(condition: str, holds: bool) -> None:
    model = chain(2)
    model.create("Item", n=2)
    made = engine(ASKED + f"unit u(a : Item, b : Item) {{ if {condition} {{ mark(b, 9); }} }}", model=model)
    before = made.model.state_hash()
    result = made.run("u", a=0, b=2)
    assert result and result.applications == holds
    assert (made.model.state_hash() != before) is holds
    unit = made.definition("u")
    (again,) = definitions(to_text(unit))
    assert again == unit


def test_what_was_deleted_is_not_applicable() -> None:
    text = "unit u(a : Item) { cut(a); if cut(a) { never; } if neg cut(a) { mark(_, 5); } }"
    model = chain(1)
    model.create("Item")
    made = engine(ASKED + text, model=model)
    assert made.run("u", a=0).applications == 2 and made.model.node(1).n == 5


def test_applicability_conditions_change_nothing() -> None:
    made = engine(ASKED, model=chain(1))
    with made.recording() as trace:
        assert made.run("tell", a=0)
    assert trace == [("mark", (0, 7))] and made.model.node(0).n == 7


def test_a_condition_that_fails_otherwise_ends_the_run() -> None:
    made = engine("rule r(a : Item) { lhs { } modify { set a.n = 1 / a.n; } } unit u { if r { r; } }", model=chain(1))
    with pytest.raises(EvaluationError, match="division by zero"):
        made.run("u")


def test_class_names_take_precedence_over_rule_names_in_conditions() -> None:
    made = engine(
        "rule Item(a : Item) { lhs { } modify { delete a; } } unit u(a : Item) { if Item(a) { Item(_); } }",
        model=chain(2),
    )
    assert made.run("u", a=0).refusal is not None


def test_units_with_applicability_conditions_use_the_rule() -> None:
    made = engine(ASKED, model=chain(1))
    with pytest.raises(InvalidArgument, match="`cut` is used by unit `tell`"):
        made.remove("cut")

    @made.unit
    def ask(steps, a: Item):  # type: ignore[no-untyped-def]  # noqa: F821
        with steps.when(Applicable("link", (a, Variable("_")))):
            steps.call("mark", a, 4)

    assert to_text(made.definition("ask")) == "unit ask(a : Item) {\n    if link(a, _) { mark(a, 4); }\n}\n"
    assert made.run("ask", a=0).applications == 0
