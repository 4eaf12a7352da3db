"""The weighted choice of a rule and a match, and derived groups."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy
import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.pattern import Derivation
from envgraph.rewrite import Engine, derived_rules
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, problems

RULES = """
@weight(3.0) rule often { lhs { a : Item; } modify { set a.n = 1; } }
rule seldom { lhs { a : Item; } modify { set a.n = 2; } }
rule never { lhs { a : Box; } }
@weight(4.0) unit both { seldom; seldom; }
"""


def test_rules_with_matches_are_sampled_by_weight() -> None:
    made = engine(RULES, model=chain(2))
    rng = numpy.random.default_rng(7)
    found = Counter(made.choose(("often", "seldom", "never"), rng) for _ in range(4000))
    assert set(found) == {("often", (0,)), ("often", (1,)), ("seldom", (0,)), ("seldom", (1,))}
    for (name, _), count in found.items():
        expected = 1500 if name == "often" else 500
        assert abs(count - expected) < 0.15 * expected


def test_units_take_part_with_their_weight() -> None:
    made = engine(RULES, model=chain(1))
    rng = numpy.random.default_rng(7)
    found = Counter(made.choose(("often", "seldom", "both"), rng) for _ in range(4000))
    assert abs(found["both", ()] - 2000) < 150
    assert made.fire("both", ()) == (("seldom", (0,)), ("seldom", (0,)))


def test_choosing_is_repeatable_and_changes_nothing() -> None:
    made = engine(RULES, model=chain(3))
    before = made.model.state_hash()
    draws = [[made.choose(["often", "seldom"], numpy.random.default_rng(seed)) for _ in range(20)] for seed in (1, 1)]
    assert draws[0] == draws[1]
    assert made.model.state_hash() == before


def test_the_engines_own_generator_is_the_default_and_can_be_set() -> None:
    made = engine(RULES, model=chain(3), seed=9)
    first = [made.choose(["often", "seldom"]) for _ in range(20)]
    made.rng = numpy.random.default_rng(9)
    assert [made.choose(["often", "seldom"]) for _ in range(20)] == first


def test_without_a_match_there_is_no_choice() -> None:
    assert engine(RULES).choose(["often", "never"]) is None


def test_a_rule_counts_once_however_often_it_is_named() -> None:
    made = engine("derive d = retype among { Item, Special };" + RULES, model=chain(1))
    rng = numpy.random.default_rng(7)
    found = Counter(made.choose(["d", "d.Item.Special", "seldom", "d"], rng) for _ in range(2000))
    assert abs(found["seldom", (0,)] - 1000) < 100


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="did you mean `seldom`"):
        engine(RULES).choose(["seldon"])
    with pytest.raises(InvalidArgument, match="needs a value for `x`"):
        made = engine("rule r(a : Item, x : int) { lhs { } modify { set a.n = x; } }", model=chain(1))
        made.choose(["r"])


# --- derivations


def test_a_derivation_has_a_rule_for_each_ordered_pair_in_order() -> None:
    rules = derived_rules(Derivation("d", "retype", ("A", "B", "C"), package="p", weight=2.0), METAMODEL)
    assert [rule.qualified_name for rule in rules] == [
        "p.d.A.B",
        "p.d.A.C",
        "p.d.B.A",
        "p.d.B.C",
        "p.d.C.A",
        "p.d.C.B",
    ]
    assert {rule.weight for rule in rules} == {2.0}


def test_the_left_class_of_a_retyping_matches_exactly() -> None:
    model = Model(METAMODEL)
    model.create("Item")
    model.create("Special")
    made = engine("derive d = retype among { Item, Box };", model=model)
    assert [match.row for match in made.matches("d.Item.Box")] == [(0,)]
    assert made.prepare("d.Item.Box").rows() == [(0,)]
    assert made.exists("d.Item.Box", object=0) and not made.exists("d.Item.Box", object=1)


def test_retypings_keep_identity() -> None:
    made = engine("derive d = retype among { Item, Special };", model=chain(1))
    made.model.node(0).n = 5
    made.apply("d")
    assert (made.model.node(0).cls, made.model.node(0).n) == ("Special", 5)


def test_a_derivation_with_too_many_rules_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.0001")
    (found,) = problems("derive d = retype among { Item, Special };")
    assert found.code == "too-many-rules" and found.message == "`d` would derive 2 rules, but the limit is 1"
    assert found.span is not None and found.span.text == "d"
    assert found.hint is not None and "ENVGRAPH_LIMITS=10" in found.hint
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    assert not problems("derive d = retype among { Item, Special };")


@pytest.mark.parametrize(("default", "others"), [("0", set()), ("0.5", {0.5})])
def test_weights_of_kinds_replace_the_default_weight(default: str, others: set[float]) -> None:
    made = engine(f"@weight({default}, set = 2, delete = 0) derive d = operators for Item;")
    weights: dict[str, float] = defaultdict(float)
    for name in made.rules:
        weights[name.split(".")[1]] += made.prepare(name).weight
    assert "delete" not in weights and weights.pop("set") == pytest.approx(2)
    assert {round(weight, 6) for weight in weights.values()} == others


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("derive d = retype among { Item, Itm };", "unknown-type", "Itm"),
        ("derive d = retype among { Item, Thing };", "abstract-class", "Thing"),
        ("derive d = retype among { Item, Special, Item };", "duplicate-definition", "Item"),
        ("derive d = retype among { Item };", "too-few-classes", "d"),
        ("derive d = operators for Itm;", "unknown-type", "Itm"),
        ("@weight(swop = 2) derive d = operators for Item;", "bad-annotation", "2"),
        ("@weight(swap = -1) derive d = operators for Item;", "bad-weight", "-1"),
        ("@weight(0, set = 0) derive d = operators for Item;", "bad-weight", "@weight(0, set = 0)"),
        (
            "@weight(swap = 2) derive d = retype among { Item, Special };",
            "bad-annotation",
            "@weight(swap = 2)",
        ),
        ("@cap(0) derive d = operators for Item;", "bad-annotation", "@cap(0)"),
        ("@priority(2) derive d = retype among { Item, Special };", "unknown-annotation", "@priority(2)"),
    ],
)
def test_each_mistake_of_a_derivation_is_reported_once(text: str, code: str, place: str) -> None:
    (found,) = problems(text)
    assert found.code == code
    assert found.span is not None and found.span.text == place


def test_sampled_rows_can_be_applied() -> None:
    made: Engine = engine("derive d = retype among { Item, Special };", model=chain(3))
    for _ in range(50):
        chosen = made.choose(("d",))
        assert chosen is not None
        before = made.model.graph.class_of(int(chosen[1][0]))
        assert made.fire(*chosen) == (chosen,)
        assert made.model.graph.class_of(int(chosen[1][0])) != before
