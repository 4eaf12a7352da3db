"""Definitions as text: the files of the repository, what Python builds, what cannot be said, what derivations make."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import FrameType

import pytest

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.lang import data_path, load_workspace, model_to_text, open as open_files, spelled_out, to_text
from envgraph.metamodel import Annotation, Class, Metamodel, Reference
from envgraph.pattern import (
    Body,
    Check,
    Constant,
    CreateAction,
    Derivation,
    IfStep,
    LeftSide,
    Modification,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    RetypeAction,
    Rule,
    RuleEdge,
    RuleNode,
    SetAction,
    StepSequence,
    TryStep,
    TypeConstraint,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)
from envgraph.rewrite import Engine, derived
from tests.reading import read_definitions

TESTS = Path(__file__).parents[2]
QUERIES = sorted(data_path("rules").rglob("*.query"))
RULES = sorted([*data_path("rules").rglob("*.rules"), *(TESTS / "golden" / "shared").rglob("*.rules")])


def read(text: str, language: str = "rules") -> tuple:
    found = read_definitions(text, language)
    assert not found.diagnostics
    return found.definitions


@pytest.mark.parametrize("path", QUERIES, ids=lambda path: path.name)
def test_patterns_of_files_are_read_back(path: Path) -> None:
    patterns = read(path.read_text(encoding="utf-8"), "query")
    assert read(to_text(*patterns), "query") == patterns != ()


@pytest.mark.parametrize("path", RULES, ids=lambda path: path.name)
def test_rules_of_files_are_read_back(path: Path) -> None:
    definitions = read(path.read_text(encoding="utf-8"))
    assert read(to_text(*definitions)) == definitions != ()


def test_a_file_has_its_package_and_imports() -> None:
    definitions = (
        Derivation("kinds", "retype", ("A", "B"), package="a.rule"),
        Derivation("all", "operators", ("A",), "a.rule"),
    )
    assert to_text(*definitions, imports=["a.query", 'b"c.query']) == (
        'package a.rule\n\nimport "a.query"\nimport "b\\"c.query"\n\n'
        "derive kinds = retype among { A, B };\n\nderive all = operators for A;\n"
    )
    assert to_text() == ""


def test_names_are_escaped_only_where_they_are_keywords() -> None:
    rule = Rule(
        "rule",
        (Parameter("in", "T"), Parameter("to", "in", "in")),
        LeftSide((RuleNode("find", "T"), RuleNode("to")), (RuleEdge("find", "lhs", "to"),)),
        right=Modification((SetAction(Variable("to"), "to", "=", Variable("true")),)),
    )
    text = to_text(rule)
    assert text == (
        "rule rule(^in : T, in to : in) {\n    lhs { ^find : T -lhs-> to; }\n    modify { set to.to = ^true; }\n}\n"
    )
    assert read(text) == (rule,)


def test_fields_of_rules_are_written_as_annotations() -> None:
    rule = Rule("r", weight=2.5, priority=-1, semantics="spo", injective=False, homomorphic=(("a", "b"), ("c", "d")))
    text = to_text(rule)
    assert text.startswith(
        "@weight(2.5)\n@priority(-1)\n@semantics(spo)\n@match(homomorphic)\n@hom(a, b)\n@hom(c, d)\nrule r {\n"
    )
    (found,) = read(text)
    assert replace(found, annotations=()) == rule
    changed = replace(found, weight=1.0, homomorphic=(("a", "c"),), semantics="dpo")
    assert to_text(changed).startswith(
        "@weight(1.0)\n@priority(-1)\n@semantics(dpo)\n@match(homomorphic)\n@hom(a, c)\n"
    )
    assert "@weight(1)\n" in to_text(replace(rule, weight=1.0, annotations=(Annotation("weight", (1,)),)))


def test_edges_are_written_as_chained_arrows_if_the_node_order_allows() -> None:
    left = LeftSide(
        (RuleNode("b", "B"), RuleNode("a", "A"), RuleNode("c", "C"), RuleNode("alone", "D")),
        (
            RuleEdge("a", "x", "b"),
            RuleEdge("a", "y", "c"),
            RuleEdge("b", "z", "c", "+"),
            RuleEdge("a", "w", "_"),
            RuleEdge("a", "v", "new"),
        ),
    )
    text = to_text(Rule("r", left=left))
    assert "    lhs { b : B <-x- a : A -y-> c : C <-z+- b; a -w-> _; alone : D; a -v-> new; }" in text
    (found,) = read(text)
    assert found.left == replace(left, nodes=(*left.nodes, RuleNode("new")))


def test_a_creation_that_is_not_one_chain_is_written_as_several_creations() -> None:
    nodes, edges = (
        (RuleNode("a", "A"), RuleNode("b", "B")),
        (RuleEdge("a", "x", "b"), RuleEdge("x", "y", "b")),
    )
    text = to_text(Rule("r", right=Modification((CreateAction(nodes, edges), CreateAction((), ())))))
    assert "modify { create a : A -x-> b : B <-y- x; }" in text
    apart = to_text(
        Rule(
            "r",
            right=Modification((CreateAction(nodes, (RuleEdge("b", "x", "_"), RuleEdge("a", "x", "a"))),)),
        )
    )
    assert "modify { create a : A; create b : B -x-> _; create a -x-> a; }" in apart


def test_steps_of_units_become_blocks() -> None:
    a, b = UnitCall("a"), UnitCall("b", (Constant(1),), every=True)
    inner = IfStep(PatternCall("p", ()), a)
    step = StepSequence(
        (
            UnitChoice((a,)),
            StepSequence((UnitChoice((a, b)), TryStep(a, b))),
            IfStep(Check(Constant(True)), b, inner),
        )
    )
    text = to_text(Unit("u", (), step))
    assert text == (
        "unit u {\n    a;\n    a | all b(1);\n    try { a; } else { all b(1); }\n"
        "    if check(true) { all b(1); } else if find p() { a; }\n}\n"
    )
    nested = replace(step.steps[2], otherwise=StepSequence((inner,)))
    assert "else { if find p() { a; } }" in to_text(Unit("u", (), nested))


@pytest.mark.parametrize(
    ("definition", "reason"),
    [
        (Rule("a.b"), "`a.b` is not a name"),
        (Rule("2a"), "`2a` is not a name"),
        (
            Rule("r", left=LeftSide(constraints=(TypeConstraint("T", Variable("x"), exact=True),))),
            "conditions also allow subclasses",
        ),
        (Pattern("p", (), ()), "the pattern has no body"),
        (
            Pattern("p", (), (Body((PathConstraint("", ("f",), Variable("a"), Variable("b")),)),)),
            "a path needs a class",
        ),
        (Pattern("p", (), (Body((Check(Constant(float("inf"))),)),)), "the number `inf` is not finite"),
        (
            Pattern("p", (), (Body((Check(Constant(2**63)),)),)),
            "the number is too large, in `check(9223372036854775808);`",
        ),
        (
            Pattern("p", (), (Body((TypeConstraint("T", Constant(None)),)),)),
            "`none` means that there is no value",
        ),
        (Pattern("p", (), (Body(()),), doc="a */ b"), "its comment contains"),
        (Rule("r", weight=-1.0), "the weight is"),
        (Unit("u", (), UnitChoice((StepSequence(()),))), "a choice has only one alternative"),
        (Unit("u", (), UnitChoice(())), "a choice has no alternatives"),
        (
            Derivation("d", "operators", ("A", "B")),
            "`d` derives operators for 2 classes, but must name one class",
        ),
    ],
)
def test_rules_that_cannot_be_written_as_text_are_refused(definition: Rule, reason: str) -> None:
    with pytest.raises(InvalidArgument) as caught:
        to_text(definition)
    assert f"`{definition.name}` cannot be written as text: " in str(caught.value)
    assert reason in str(caught.value)


def test_definitions_of_several_languages_or_packages_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="patterns and rules cannot be written to one file"):
        to_text(Pattern("p", (), (Body(()),)), Rule("r"))
    with pytest.raises(InvalidArgument, match=r"of several packages \(`a`, none\)"):
        to_text(Rule("r", package="a"), Rule("r"))


def test_a_rule_of_python_and_its_text_do_the_same() -> None:
    rule = Rule(
        "burn",
        left=LeftSide((RuleNode("tile", "RoadTile"),)),
        right=Modification((RetypeAction(Variable("tile"), "BurningTile"),)),
        package="burning_forest",
        weight=2.0,
    )
    states = []
    for one in (rule, *read(to_text(rule))):
        engine = open_files("burning_forest", seed=3)
        engine.add(one)
        drawn = [engine.choose(["burn", "retypings"]) for _ in range(5)]
        for _ in range(5):
            engine.apply("burn")
        states.append((drawn, engine.model.state_hash()))
    assert states[0] == states[1]


MODELS = {"network": "backbone", "warehouse": "small_hall", "keydoor": "two_rooms"}
CLASSES = {"network": "Router", "warehouse": "Parcel", "keydoor": "Key"}


@pytest.mark.parametrize("domain", ["network", "warehouse", "keydoor"])
def test_derived_rules_and_their_texts_do_the_same(domain: str) -> None:
    """Spelled out, that is with names that a text can have; matches, order and what is drawn are the same."""
    model = data_path("rules", domain, f"{MODELS[domain]}.model")
    metamodel = load_workspace([str(model)]).metamodel
    assert metamodel is not None
    made = derived(Derivation("all", "operators", (CLASSES[domain],), package="p"), metamodel)
    patterns, rules = spelled_out(made.patterns, metamodel), spelled_out(made.rules, metamodel)
    read_patterns = read(to_text(*patterns), "query") if patterns else ()
    read_back = read(to_text(*rules))
    assert len(read_back) == len(made.rules) > 3
    states = []
    for own_patterns, own_rules in ((made.patterns, made.rules), (read_patterns, read_back)):
        engine: Engine = load_workspace([str(model)]).engine(seed=5)
        engine.add(*own_patterns, *own_rules)
        names = [f"p.{rule.name}" for rule in own_rules]
        said = [[match.row for match in engine.matches(name)] for name in names]
        for _ in range(12):
            chosen = engine.choose(names)
            assert chosen is not None
            engine.fire(*chosen)
        states.append((said, engine.model.state_hash()))
    assert states[0] == states[1]


def lines_run_for_a_chain_of(size: int) -> int:
    """Return how many lines of the writer run for a chain of objects without names."""
    model = Model(Metamodel("chains", (Class("Ring", features=(Reference("next", "Ring", upper=1),)),)), "chain")
    rings = [model.create("Ring") for _ in range(size)]
    for ring, following in pairwise(rings):
        ring.next = following
    count = 0

    def trace(frame: FrameType, event: str, _: object) -> object:
        nonlocal count
        count += event == "line"
        return trace if frame.f_code.co_filename.endswith("_model_to_text.py") else None

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        text = model_to_text(model)
    finally:
        sys.settrace(before)
    assert f"ring_{size - 2} : Ring" in text
    return count


def test_names_for_many_objects_take_linear_time() -> None:
    assert lines_run_for_a_chain_of(400) < 2.5 * lines_run_for_a_chain_of(200)
