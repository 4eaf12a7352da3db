"""The facade: names, matches as people see them, Python rules, recording, transactions, versions."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from envgraph.errors import InvalidArgument, RuleError, TransactionError
from envgraph.graph import Node
from envgraph.rewrite import Application, Engine, Firing, Match
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.rewrite.graphs import chain, definitions, engine, patterns, snapshot

NEXT = "pattern following(left : Item, right : Item, value : int) { Item.next(left, right); Item.n(left, value); }"


# --- names


def test_names_may_be_simple_or_qualified() -> None:
    made = engine(
        "package a.b\nrule r { lhs { x : Item; } }",
        "package p\npattern q(x : Item) { Item(x); }",
        model=chain(1),
    )
    assert made.rules == ("a.b.r",) and made.patterns == ("p.q",)
    assert made.count("r") == made.count("a.b.r") == made.count("q") == made.count("p.q") == 1


def test_a_simple_name_of_two_definitions_is_ambiguous() -> None:
    made = engine("package a\nrule r { lhs { } }")
    made.add(*definitions("package b\nrule r { lhs { } } unit u { r; }"))
    assert made.count("a.r") == 1
    with pytest.raises(InvalidArgument, match=r"`r` is ambiguous: `a\.r`, `b\.r`"):
        made.matches("r")
    assert made.run("u")  # a unit means the rule of its own package


CLASHING = ("name", "rule", "match", "by", "where", "choose", "top", "unit", "self", "bound", "values")
"""Names of variables that are also names of Python's, in the verbs or in any method."""


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize("name", CLASHING)
def test_a_variable_of_any_name_is_bound_by_a_mapping(name: str, watched: bool) -> None:
    made = engine(
        f"rule r({name} : Item) {{ lhs {{ {name}; }} modify {{ set {name}.n += 1; }} }}"
        f" unit u({name} : Item) {{ r({name}); }}",
        f"pattern p({name} : Item) {{ Item({name}); }}",
        model=chain(3),
    )
    if watched:
        made.watch("p", "r")
    item = made.model.nodes("Item")[1]
    bound = {name: item}
    for asked in ("p", "r"):
        assert made.matches(asked, bound=bound) == [made.first(asked, bound=bound)]
        assert made.exists(asked, bound=bound) and made.count(asked, bound=bound) == 1
        assert made.why_not(asked, bound=bound).match == {name: item.id}
        assert f", given {name}\n" in made.explain(asked, bound=bound)
    before = item.n
    done = [
        made.apply("r", bound=bound),
        made.apply("r", choose="first", bound=bound),
        *made.apply_all("r", bound=bound),
    ]
    assert [one.match[name] for one in done if one is not None] == [item] * 3
    assert made.run("u", bound=bound).succeeded and made.run("r", bound=bound).succeeded
    assert item.n == before + 5


def test_a_variable_called_like_an_argument_by_position_is_a_keyword_too() -> None:
    made = engine(
        "rule r(self : Item, name : int) { lhs { check name == self.n; } modify { set self.n += 1; } }",
        model=chain(3),
    )
    item = made.model.nodes("Item")[1]
    assert made.count("r", self=item, name=item.n) == 1
    done = made.apply("r", self=item, name=item.n)
    assert done is not None and done.match["self"] == item


def test_duplicate_bindings_and_non_mappings_are_refused() -> None:
    made = engine("rule r { lhs { x : Item; } }", model=chain(1))
    item = made.model.nodes("Item")[0]
    with pytest.raises(InvalidArgument, match="`x` is given twice: in `bound`, and as a keyword argument"):
        made.matches("r", bound={"x": item}, x=item)
    with pytest.raises(InvalidArgument, match="`bound` must be a mapping from variables to their values, not <Item"):
        made.count("r", bound=item)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`r` has no variable `y`"):
        made.apply("r", bound={"y": item})


def test_unknown_names_get_a_suggestion() -> None:
    made = engine("rule spread { lhs { } } unit u { spread; }", NEXT)
    with pytest.raises(InvalidArgument, match="unknown pattern or rule `folowing`; did you mean `following`"):
        made.matches("folowing")
    with pytest.raises(InvalidArgument, match="unknown rule, unit or group `sprad`; did you mean `spread`"):
        made.apply("sprad")
    with pytest.raises(InvalidArgument, match="expected the name of a rule, unit or group, not 5"):
        made.apply(5)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="expected the name of a rule, unit or group, not None"):
        made.run(None)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`u` is a unit, not a rule"):
        made.apply("u")
    with pytest.raises(InvalidArgument, match="`following` is a pattern, not a rule, unit or group"):
        made.apply("following")
    with pytest.raises(InvalidArgument, match="`u` is a unit, which has no matches of its own"):
        made.matches("u")
    with pytest.raises(InvalidArgument, match="unknown pattern or rule"):
        made.matches("spread#lhs")


def test_added_definitions_are_listed_without_generated_patterns() -> None:
    made = engine("rule r { lhs { a : Item; } not { a -next-> _; } } derive d = retype among { Item, Special };", NEXT)
    assert made.patterns == ("following",)
    assert made.rules == ("r", "d.Item.Special", "d.Special.Item")
    assert made.groups == ("d",) and made.units == ()
    assert [definition.name for definition in made.definitions] == ["following", "r", "d"]
    assert made.group("d") == ("d.Item.Special", "d.Special.Item")
    assert made.group("r") == ("r",)


def test_signatures_say_what_a_call_takes() -> None:
    made = engine("rule r(a : Item, x : int, out y : int) { lhs { Item.n(a, y); check y > x; } }")
    taken = made.signature("r").parameters
    assert [(t.name, t.is_output, t.is_required) for t in taken] == [
        ("a", False, False),
        ("x", False, True),
        ("y", True, False),
    ]


# --- matches


def test_a_match_is_an_immutable_mapping() -> None:
    made = engine("", NEXT, model=chain(2))
    (match,) = made.matches("following")
    assert isinstance(match, Match)
    assert match.left == match["left"] == made.model.node(0) and isinstance(match.left, Node)
    assert match.value == 0
    assert match.names == tuple(match.keys()) == ("left", "right", "value") and match.row == (0, 1, 0)
    assert dict(match) == {"left": made.model.node(0), "right": made.model.node(1), "value": 0}
    assert list(match) == list(match.names) and len(match) == 3 and "left" in match and "up" not in match
    assert repr(match) == "following(left=<Item#0>, right=<Item#1>, value=0)"
    with pytest.raises(AttributeError, match="immutable"):
        match.left = 3  # type: ignore[misc]
    with pytest.raises(AttributeError, match="has no variable `lft`: did you mean `left`"):
        _ = match.lft
    with pytest.raises(KeyError):
        _ = match["lft"]


def test_matches_are_equal_by_model_definition_and_values() -> None:
    made = engine(
        "rule r(left : Item, right : Item, value : int) { lhs { find following(left, right, value); } }",
        NEXT,
        model=chain(2),
    )
    other = engine("", NEXT, model=chain(2))
    (match,) = made.matches("following")
    assert match == made.first("following") and hash(match) == hash(made.first("following"))
    assert match != other.first("following")
    assert match != made.first("r")
    assert len({match, made.matches("following")[0]}) == 1


def test_a_match_outlives_its_objects() -> None:
    made = engine("", NEXT, model=chain(2))
    (match,) = made.matches("following")
    made.model.graph.delete(0, "spo")
    assert match.row == (0, 1, 0)
    assert "deleted #0" in repr(match)


# --- apply


def test_applying_a_match_of_another_rule_is_refused() -> None:
    made = engine("rule r { lhs { a : Item; } } rule s { lhs { a : Item; } }", NEXT, model=chain(2))
    match = made.first("r")
    assert match is not None
    assert isinstance(made.apply("r", match), Application)
    with pytest.raises(InvalidArgument, match="is no match of `s`"):
        made.apply("s", match)
    with pytest.raises(InvalidArgument, match="a match or arguments, not both"):
        made.apply("r", match, a=0)
    with pytest.raises(InvalidArgument, match="is a match in another model"):
        made.apply("r", engine("rule r { lhs { a : Item; } }", model=chain(1)).first("r"))


def test_matches_are_sampled_uniformly_and_repeatably() -> None:
    def draws(seed: int) -> list[tuple]:
        made = engine("rule r { lhs { a : Item; } }", model=chain(4), seed=seed)
        found = [made.apply("r") for _ in range(400)]
        return [application.match.row for application in found if application]

    assert draws(1) == draws(1) != draws(2)
    assert all(70 < draws(1).count((node,)) < 130 for node in range(4))


def test_applying_a_group_samples_a_rule() -> None:
    made = engine("derive d = retype among { Item, Special };", model=chain(1))
    application = made.apply("d")
    assert application is not None and application.rule == "d.Item.Special"
    match = made.first("d.Special.Item")
    assert match is not None and made.apply("d", match) is not None
    with pytest.raises(InvalidArgument, match="no match of a rule of `d`"):
        made.apply("d", engine("rule r { lhs { a : Item; } }", model=made.model).first("r"))
    made.model.graph.delete(0)
    assert made.apply("d") is None
    with pytest.raises(InvalidArgument, match="which takes no arguments"):
        made.apply("d", object=0)


# --- rules in Python


def test_a_function_can_be_a_rule() -> None:
    made = engine("", NEXT, model=chain(2))

    @made.rule(when="following", weight=2.0)
    def swap(left: Node, value: int, engine: Engine) -> None:
        """Shorten the chain."""
        assert engine is made
        left.n = value + 10
        left.next = None

    assert made.rules == ("swap",)
    assert swap.__doc__ == "Shorten the chain."
    assert made.matches("swap")[0].names == ("left", "right", "value")
    application = made.apply("swap")
    assert application is not None and application.match.row == (0, 1, 0)
    assert made.model.node(0).n == 10
    assert made.apply("swap") is None


def test_a_function_rule_takes_matches_of_its_pattern_and_takes_part_in_units() -> None:
    made = engine("", NEXT, model=chain(3))

    @made.rule(when="following", name="cut")
    def anything(**match: object) -> None:
        left = match["left"]
        assert isinstance(left, Node) and set(match) == {"left", "right", "value"}
        left.next = None

    made.apply("cut", made.first("following"))
    made.add(*definitions("unit u { alap { cut; } }"))
    made.run("u")
    assert not made.exists("following")


def test_changes_of_a_raising_function_are_rolled_back() -> None:
    made = engine("", NEXT, model=chain(2))

    @made.rule(when="following")
    def broken(left: Node) -> None:
        left.n = 99
        raise ZeroDivisionError("mine")

    before = snapshot(made.model)
    with pytest.raises(ZeroDivisionError, match="mine"):
        made.apply("broken")
    assert snapshot(made.model) == before


def test_function_rules_are_checked_when_they_are_registered() -> None:
    made = engine("rule r { lhs { } }", NEXT)
    with pytest.raises(InvalidArgument, match="unknown pattern `folowing`; did you mean `following`"):
        made.rule(when="folowing")
    with pytest.raises(InvalidArgument, match="parameter `lft` is not a variable of `<lambda>`: did you mean `left`"):
        made.rule(when="following")(lambda lft: None)
    with pytest.raises(InvalidArgument, match="`r` is defined already"):
        made.rule(when="following", name="r")(lambda left: None)
    with pytest.raises(InvalidArgument, match="but must be a finite number above 0"):
        made.rule(when="following", weight=0)(lambda left: None)
    made.rule(when="following", name="fine")(lambda left, extra=3: None)


# --- traces


def test_applications_can_be_recorded_and_replayed() -> None:
    text = """
    rule grow { lhs { a : Item; } modify { create b : Item { n = a.n + 1, prev = a }; } }
    rule shift { lhs { a : Item -next-> b : Item; } modify { set a.n = b.n; } }
    derive kinds = retype among { Item, Special };
    unit u { repeat 2..5 { try { grow; shift; } } kinds; atomic { grow; } }
    """
    model = chain(2)
    made = engine(text, NEXT, model=model, seed=3)
    made.rule(when="following", name="double")(lambda left: setattr(left, "n", left.n * 2))
    start = made.commit()
    with made.recording() as trace:
        made.run("u")
        made.apply("shift")
        made.apply("kinds")
        made.apply("double")
        for _ in range(3):
            chosen = made.choose(["grow", "kinds", "u"])
            assert chosen is not None
            with suppress(RuleError):
                made.fire(*chosen)
        with pytest.raises(KeyError), made.transaction():
            made.apply("shift")
            raise KeyError
    after = snapshot(model)
    stored = json.loads(json.dumps(trace))
    made.checkout(start, discard=True)
    made.replay(stored)
    assert snapshot(model) == after
    assert all(isinstance(firing, Firing) for firing in trace) and len(trace) > 5


def test_replaying_an_invalid_match_rolls_back_everything() -> None:
    made = engine("rule cut { lhs { a : Item -next-> b : Item; } rhs { a; b; } }", model=chain(3))
    before = snapshot(made.model)
    with pytest.raises(RuleError) as caught:
        made.replay([("cut", (0, 1)), ("cut", (0, 1))])
    assert caught.value.reason == "stale-match"
    assert snapshot(made.model) == before
    with pytest.raises(InvalidArgument, match="has 2 values, not 1"):
        made.replay([("cut", (0,))])
    with pytest.raises(InvalidArgument, match="unknown rule `cutt`"):
        made.replay([("cutt", (0,))])


def test_prepared_rules_give_the_same_results() -> None:
    made = engine("rule r(a : Item) { lhs { a -next-> b : Item; } modify { set a.n = b.n; } }", model=chain(3))
    runner = made.prepare("r")
    assert runner.rows() == [(0, 1), (1, 2)] and runner.rows({"b": 2}) == [(1, 2)]
    assert runner.prepare(("b", "a"))(2, 1) == [(1, 2)]
    assert runner.exists() and not runner.exists({"a": 2})
    assert runner.apply_row((1, 2)) == ("r", (1, 2))
    assert made.model.node(1).n == 2
    with pytest.raises(InvalidArgument, match="has no variable `c`"):
        runner.rows({"c": 1})


# --- transactions and versions


@pytest.mark.parametrize("recording", [False, True])
def test_transactions_can_be_entered_by_an_exit_stack(recording: bool) -> None:
    made = engine("rule up { lhs { a : Item; } modify { set a.n += 1; } }", model=chain(1))
    with ExitStack() as outer:
        if recording:
            outer.enter_context(made.recording())
        before = made.model.state_hash()
        with ExitStack() as stack:
            stack.enter_context(made.transaction())
            made.apply("up")
        kept = made.model.state_hash()
        assert kept != before and not made.model.graph.history.savepoint_depth
        with pytest.raises(KeyError), ExitStack() as stack:
            stack.enter_context(made.transaction())
            made.apply("up")
            raise KeyError
        assert made.model.state_hash() == kept and not made.model.graph.history.savepoint_depth


def test_transactions_nest_and_exceptions_roll_back() -> None:
    made = engine(model=chain(2))
    with made.transaction():
        made.model.node(0).n = 1
        before = snapshot(made.model)
        with pytest.raises(KeyError), made.transaction():
            made.model.node(0).n = 2
            raise KeyError
        assert snapshot(made.model) == before
        with pytest.raises(TransactionError):
            made.commit()
    assert made.model.node(0).n == 1


def test_versions_can_be_visited() -> None:
    made = engine(model=chain(2))
    first = made.commit()
    before = snapshot(made.model)
    made.model.node(0).n = 7
    second = made.commit()
    made.checkout(first)
    assert snapshot(made.model) == before
    made.checkout(second)
    assert made.model.node(0).n == 7
    with made.transaction(), pytest.raises(TransactionError):
        made.checkout(first)


# --- the rest


def test_plans_can_be_explained() -> None:
    made = engine("rule r { lhs { find following(a, b, v); } }", NEXT)
    assert "following" in made.explain("following") and made.explain("r", "b", "a") == made.explain("r", "a", "b")
    with pytest.raises(InvalidArgument, match="has no variable `c`"):
        made.explain("r", "c")
    naive = Engine(chain(1), matcher=NaiveMatcher)
    naive.add(*patterns(NEXT))
    with pytest.raises(InvalidArgument, match="no plans"):
        naive.explain("following")


def test_the_naive_matcher_can_replace_the_compiled_one() -> None:
    made = Engine(chain(3), matcher=NaiveMatcher)
    assert isinstance(made.matcher, NaiveMatcher)
    made.add(*patterns(NEXT), *definitions("rule r { lhs { find following(a, b, v); } modify { set a.n = 5; } }"))
    assert made.count("r") == 2
    made.apply("r", a=0)
    assert made.model.node(0).n == 5


def test_the_engine_needs_neither_the_parser_nor_numpy_nor_gymnasium() -> None:
    code = """
import sys
for name in ("lark", "numpy", "gymnasium"):
    sys.modules[name] = None
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
from envgraph.pattern import Constant, LeftSide, Modification, Rule, RuleNode, SetAction, Variable
from envgraph.rewrite import Engine
model = Model(Metamodel("m", [Class("C", features=(Attribute("n", Scalar.INT),))]))
for _ in range(3):
    model.create("C")
engine = Engine(model, seed=1)
action = SetAction(Variable("c"), "n", "=", Constant(4))
engine.add(Rule("r", left=LeftSide((RuleNode("c", "C"),)), right=Modification((action,))))
assert engine.apply("r") is not None
print(sum(node.n for node in model.nodes("C")))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("4\n", "")


def test_arguments_bind_a_match() -> None:
    made = engine(
        "rule weigh(a : Item, w : float) { lhs { Item.weight(a, w); } modify { set a.n = 9; } }",
        model=chain(3),
    )
    made.model.node(1).weight = 2.0
    done = made.apply("weigh", w=2)
    assert done is not None and done.match.row == (1, 2.0) and type(done.match.row[1]) is float
    assert made.apply("weigh", w=2.5) is None and made.apply("weigh", a=0, w=2.0) is None


@pytest.mark.parametrize("who", ["deleted", "foreign", "never"])
def test_missing_objects_cannot_be_bound(who: str) -> None:
    made = engine(
        "rule r(a : Item) { lhs { } modify { set a.n = 1; } } unit u(a : Item) { r(a); }",
        "pattern p(a : Item) { Item(a); }",
        model=chain(2),
    )
    gone = made.model.create("Item")
    gone.delete()
    node = {"deleted": gone, "foreign": chain(1).node(0), "never": 77}[who]
    message = "is an object of another model" if who == "foreign" else "which does not exist"
    for name in ("p", "r"):
        for ask in (made.matches, made.first, made.exists, made.count, made.why_not, made.explain):
            with pytest.raises(InvalidArgument, match=message):
                ask(name, a=node)
    for do in (made.apply, made.apply_all, made.run):
        with pytest.raises(InvalidArgument, match=message):
            do("r", a=node)  # type: ignore[operator]
    for choice in ({"choose": "first"}, {"where": "p"}, {"by": lambda match: 1}):
        with pytest.raises(InvalidArgument, match=message):
            made.apply("r", a=node, **choice)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match=message):
        made.run("u", a=node)
    with pytest.raises(InvalidArgument, match=message):
        made.exists("r", applicable=True, a=node)


def test_an_out_parameter_that_a_rule_creates_says_that_it_is_one() -> None:
    made = engine("rule r(a : Item, out b : Item) { lhs { } modify { create b : Item; } }", model=chain(1))
    for do in (made.apply, made.apply_all, made.run, made.matches):
        with pytest.raises(InvalidArgument, match="`b` is an `out` parameter of `r`, which creates it"):
            do("r", b=0)  # type: ignore[operator]
    with pytest.raises(InvalidArgument, match="`r` has no variable `c`; its variables are `a`"):
        made.apply("r", c=0)


def test_engine_methods_keep_signatures_and_docstrings_of_its_parts() -> None:
    parts = vars(engine(model=chain(1))).values()
    public = {name: verb for name, verb in vars(Engine).items() if not name.startswith("_")}
    verbs = {name: verb for name, verb in public.items() if hasattr(verb, "__wrapped__")}
    assert {"apply", "commit", "count", "watch"} < verbs.keys()
    for name, verb in verbs.items():
        methods = [getattr(type(part), name, None) for part in parts]
        assert verb.__wrapped__ in methods and inspect.getdoc(verb), name
        said, own = inspect.signature(verb), inspect.signature(verb.__wrapped__)
        assert said == own, name


def test_engine_subclasses_can_override_methods() -> None:
    class Counting(Engine):
        asked = 0

        def count(self, name: str, /, **options: Any) -> int:  # type: ignore[override]
            self.asked += 1
            return super().count(name, **options)

    made = Counting(chain(2))
    made.add(*definitions("rule r { lhs { x : Item; } }"))
    assert [made.count("r"), made.count("r"), made.asked] == [2, 2, 2]
