"""`.rules` files as rules, units and derived groups."""

from typing import Any

import pytest

from envgraph.lang import to_text
from envgraph.pattern import (
    Action,
    Alap,
    Assignment,
    AtomicStep,
    Binary,
    Check,
    Constant,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    Derivation,
    EnumLiteral,
    IfStep,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    Navigation,
    Negation,
    Parameter,
    PathConstraint,
    PatternCall,
    RedirectAction,
    Repeat,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    Step,
    StepSequence,
    TryStep,
    TypeConstraint,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)
from tests.reading import read_definitions

a, b, c, x = (Variable(name) for name in "abcx")


def read(text: str) -> Any:
    return read_definitions(text, "rules")


def rule(text: str) -> Rule:
    file = read(text)
    assert file.diagnostics == ()
    (only,) = file.definitions
    assert isinstance(only, Rule)
    return only


def left(text: str) -> LeftSide:
    return rule(f"rule r {{ lhs {{ {text} }} }}").left


def actions(text: str) -> tuple[Action, ...]:
    right = rule(f"rule r {{ lhs {{ }} modify {{ {text} }} }}").right
    assert isinstance(right, Modification)
    return right.actions


def steps(text: str) -> tuple[Step, ...]:
    file = read(f"unit u {{ {text} }}")
    assert file.diagnostics == ()
    (unit,) = file.definitions
    assert isinstance(unit, Unit)
    assert isinstance(unit.body, StepSequence)
    return unit.body.steps


def call(name: str) -> StepSequence:
    return StepSequence((UnitCall(name),))


# --- left sides


def test_arrows_in_both_directions_and_chains_are_parsed_to_edges() -> None:
    assert left("a -r-> b : T -s-> c; c <-t- a;") == LeftSide(
        (RuleNode("a"), RuleNode("b", "T"), RuleNode("c")),
        (RuleEdge("a", "r", "b"), RuleEdge("b", "s", "c"), RuleEdge("a", "t", "c")),
    )


def test_closures_on_arrows_are_parsed() -> None:
    assert left("a -r+-> b; a <-s*- b;").edges == (RuleEdge("a", "r", "b", "+"), RuleEdge("b", "s", "a", "*"))


def test_a_node_is_kept_once_with_the_class_of_its_declaration() -> None:
    assert left("a -r-> b; a -s-> b : T; b;").nodes == (RuleNode("a"), RuleNode("b", "T"))


def test_two_declarations_of_a_node_are_two_nodes() -> None:
    assert left("a : T; a : U;").nodes == (RuleNode("a", "T"), RuleNode("a", "U"))


def test_an_anonymous_end_of_an_arrow_is_not_a_node() -> None:
    assert left("a -r-> _; _ : T;") == LeftSide((RuleNode("a"), RuleNode("_", "T")), (RuleEdge("a", "r", "_"),))


def test_a_left_hand_side_can_contain_query_constraints_and_arrows() -> None:
    assert left("find p(a, b); T(a); T.f(a, 1); check a.f > 1 && b; neg find q(a); a : T;") == LeftSide(
        (RuleNode("a", "T"),),
        (),
        (
            PatternCall("p", (a, b)),
            TypeConstraint("T", a),
            PathConstraint("T", ("f",), a, Constant(1)),
            Check(Binary("&&", Binary(">", Navigation(a, "f"), Constant(1)), b)),
            Negation(PatternCall("q", (a,))),
        ),
    )


@pytest.mark.parametrize("name", ["from", "to", "at", "among", "create", "set", "move", "lhs", "rule", "not"])
def test_keywords_are_names_where_they_are_not_expected(name: str) -> None:
    assert left(f"a -{name}-> {name} : T;").edges == (RuleEdge("a", name, name),)


def test_nested_blocks_are_parsed() -> None:
    text = """rule r {
        lhs { a : T; }
        not { a -r-> b : T; require { b -r-> c; } T(b); }
        forall+ { lhs { a -s-> x : T; } not { x -r-> a; } modify { delete x; } }
        forall { lhs { a -t-> x : T; } }
        optional { lhs { a -u-> x; } rhs { a; } }
    }"""
    first, second, third, fourth = rule(text).blocks
    inner = RuleBlock("require", LeftSide((RuleNode("b"), RuleNode("c")), (RuleEdge("b", "r", "c"),)))
    assert first == RuleBlock(
        "not",
        LeftSide((RuleNode("a"), RuleNode("b", "T")), (RuleEdge("a", "r", "b"),), (TypeConstraint("T", b),)),
        (inner,),
    )
    assert (second.kind, second.right) == ("forall+", Modification((DeleteNode(x),)))
    assert [block.kind for block in second.blocks] == ["not"]
    assert (third.kind, third.right) == ("forall", None)
    assert (fourth.kind, fourth.right) == ("optional", RightSide((RuleNode("a"),)))


# --- right sides


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("create a : T;", [CreateAction((RuleNode("a", "T"),))]),
        (
            "create a -r-> b : T { f = 1, g = [a, b], h = ::red, };",
            [
                CreateAction(
                    (
                        RuleNode("a"),
                        RuleNode(
                            "b",
                            "T",
                            (
                                Assignment("f", Constant(1)),
                                Assignment("g", (a, b)),
                                Assignment("h", EnumLiteral(None, "red")),
                            ),
                        ),
                    ),
                    (RuleEdge("a", "r", "b"),),
                )
            ],
        ),
        ("delete a;", [DeleteNode(a)]),
        ("delete a -r-> b;", [DeleteEdge(RuleEdge("a", "r", "b"))]),
        ("delete a <-r- b -s-> c;", [DeleteEdge(RuleEdge("b", "r", "a")), DeleteEdge(RuleEdge("b", "s", "c"))]),
        ("set a.f = b.f + 1;", [SetAction(a, "f", "=", Binary("+", Navigation(b, "f"), Constant(1)))]),
        ("set a.f += b; set a.f -= b;", [SetAction(a, "f", "+=", b), SetAction(a, "f", "-=", b)]),
        ("set a.f = none; set a.f=-1;", [SetAction(a, "f", "=", Constant(None)), SetAction(a, "f", "=", Constant(-1))]),
        ("set a.f = [b, c]; set a.f = [];", [SetAction(a, "f", "=", (b, c)), SetAction(a, "f", "=", ())]),
        ("retype a : T;", [RetypeAction(a, "T")]),
        ("move a to b.r;", [MoveAction(a, b, "r")]),
        ("merge a <- b;", [MergeAction(a, b)]),
        ("redirect a -r-> b to c;", [RedirectAction(RuleEdge("a", "r", "b"), c)]),
        ("set a.to = to; move to to to.to;", [
            SetAction(a, "to", "=", Variable("to")), MoveAction(Variable("to"), Variable("to"), "to")
        ]),
    ],
)  # fmt: skip
def test_an_action_is_parsed_to_its_data(text: str, data: list[Action]) -> None:
    assert actions(text) == tuple(data)


def test_a_right_hand_side_is_parsed_to_nodes_edges_and_actions() -> None:
    text = "rule r { lhs { a -r-> b : T; } rhs { a -r-> c : T { f = 1 }; b : U; set a.f = 2; delete x; } }"
    assert rule(text).right == RightSide(
        (RuleNode("a"), RuleNode("c", "T", (Assignment("f", Constant(1)),)), RuleNode("b", "U")),
        (RuleEdge("a", "r", "c"),),
        (SetAction(a, "f", "=", Constant(2)), DeleteNode(x)),
    )


# --- the header of a rule


def test_a_rule_has_its_package_doc_annotations_and_parameters() -> None:
    text = """package p.q
        /** Documented. */
        @weight(0.5) @priority(-2) @semantics(spo) @match(homomorphic) @hom(a, b) @hom(c, a, b)
        rule r(a : T, out n : int) { lhs { } }"""
    found = rule(text)
    assert found.qualified_name == "p.q.r"
    assert found.parameters == (Parameter("a", "T"), Parameter("n", "int", "out"))
    assert (found.weight, found.priority, found.semantics, found.injective) == (0.5, -2, "spo", False)
    assert found.homomorphic == (("a", "b"), ("c", "a", "b"))
    assert [annotation.name for annotation in found.annotations] == [
        "weight", "priority", "semantics", "match", "hom", "hom"
    ]  # fmt: skip
    assert found.doc == "Documented."
    assert found.right is None


def test_a_rule_without_annotations_has_the_defaults() -> None:
    found = rule("rule r { lhs { } }")
    assert (found.weight, found.priority, found.semantics, found.injective) == (1.0, 0, "dpo", True)


# --- units


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("a; p.b(1, x); all c;", [UnitCall("a"), UnitCall("p.b", (Constant(1), x)), UnitCall("c", (), True)]),
        ("a | b(x) | c;", [UnitChoice((UnitCall("a"), UnitCall("b", (x,)), UnitCall("c")))]),
        ("alap { a; b; }", [Alap(StepSequence((UnitCall("a"), UnitCall("b"))))]),
        ("repeat 1..3 { a; } repeat 2 { }", [Repeat(1, 3, call("a")), Repeat(2, 2, StepSequence(()))]),
        ("try { a; } try { a; } else { b; }", [TryStep(call("a")), TryStep(call("a"), call("b"))]),
        ("atomic { a; }", [AtomicStep(call("a"))]),
        (
            "if find p(x) { a; } else if neg find q() { b; } else { c; }",
            [
                IfStep(
                    PatternCall("p", (x,)),
                    call("a"),
                    IfStep(Negation(PatternCall("q", ())), call("b"), call("c")),
                )
            ],
        ),
        ("if check x.f > 1 { a; }", [IfStep(Check(Binary(">", Navigation(x, "f"), Constant(1))), call("a"))]),
        ("retypings.A.B;", [UnitCall("retypings.A.B")]),
    ],
)
def test_a_step_is_parsed_to_its_data(text: str, data: list[Step]) -> None:
    assert steps(text) == tuple(data)


def test_units_have_parameters_weights_and_docs() -> None:
    file = read("/** Once. */ @weight(3) @priority(1) unit u(x : T, out y : T) { r(x, y); }")
    assert file.definitions == (
        Unit(
            "u",
            (Parameter("x", "T"), Parameter("y", "T", "out")),
            StepSequence((UnitCall("r", (x, Variable("y"))),)),
            weight=3.0,
            priority=1,
            annotations=file.definitions[0].annotations,
            doc="Once.",
        ),
    )


def test_derive_statements_are_parsed() -> None:
    file = read("@weight(2) derive g = retype among { A, B, C };\nderive h = operators for A;")
    assert file.diagnostics == ()
    first, second = file.definitions
    assert isinstance(first, Derivation)
    assert (first.name, first.kind, first.classes, first.weight) == ("g", "retype", ("A", "B", "C"), 2.0)
    assert second == Derivation("h", "operators", ("A",))
    assert [span.text for span in first.class_spans] == ["A", "B", "C"]


def test_a_rule_with_an_unreadable_part_is_left_out_and_the_others_are_read() -> None:
    file = read("rule a { lhs { x ( } }\nrule b { lhs { x : T } }\nrule c { lhs { } modify { delete } }")
    assert [definition.name for definition in file.definitions] == ["b"]
    assert {"a", "c"} <= file.lost
    assert len(file.diagnostics) == 3


def test_definitions_before_a_missing_brace_are_read() -> None:
    file = read("rule a {\n lhs { x : T; }\n modify { delete x; }\n\nrule b { lhs { } }")
    first, second = file.definitions
    assert isinstance(first, Rule) and first.right == Modification((DeleteNode(Variable("x")),))
    assert second.name == "b" and len(file.diagnostics) == 1


def test_an_unnamed_object_in_an_arrow_gets_a_generated_name_that_is_not_printed() -> None:
    text = "rule a { lhs { x : T -r-> _ : T -r-> _ -s-> y; _ : T -r-> x; } not { y -r-> _ : T; } modify { } }"
    (found,) = read(text).definitions
    assert isinstance(found, Rule)
    names = [node.name for node in found.left.nodes]
    assert names == ["x", "#1", "#2", "y", "#3"]
    assert [(edge.source, edge.target) for edge in found.left.edges] == [
        ("x", "#1"),
        ("#1", "#2"),
        ("#2", "y"),
        ("#3", "x"),
    ]
    assert read(to_text(found)).definitions == (found,)


def test_creating_an_object_without_a_name_is_an_error() -> None:
    file = read("rule a { lhs { x : T; } modify { create x -r-> _ : T; } }")
    assert [one.code for one in file.diagnostics] == ["anonymous-node"]
