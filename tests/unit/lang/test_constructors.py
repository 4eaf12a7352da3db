"""`Rule`, `Pattern` and `Unit` of Python: the data of a file, from texts and data."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

import envgraph
from envgraph import Pattern, Rule, Unit
from envgraph.errors import InvalidArgument, LoadError, ResolutionError
from envgraph.lang import from_text, to_text
from envgraph.metamodel import Annotation
from envgraph.pattern import (
    Alap,
    Binary,
    Body,
    Check,
    Constant,
    DeleteNode,
    LeftSide,
    Modification,
    Navigation,
    Parameter,
    PathConstraint,
    RetypeAction,
    Rule as RuleData,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    TypeConstraint,
    UnitCall,
    UnitChoice,
    Variable,
)
from tests.unit.rewrite.graphs import chain, engine

X = Variable("x")


def single_definition(text: str, language: str = "rules") -> object:
    (found,) = from_text(text, language)
    return found


# --- equal to a file


@pytest.mark.parametrize("make", [Rule, Unit])
def test_annotations_given_as_data_set_the_same_fields_as_their_text(make: Callable[..., Any]) -> None:
    data = make("r", annotations=[Annotation("weight", (2.0,)), Annotation("priority", (3,))])
    assert (data.weight, data.priority) == (2.0, 3)
    assert data == make("r", annotations="@weight(2.0) @priority(3)")


def test_a_rule_built_from_texts_equals_the_rule_read_from_a_file() -> None:
    made = Rule(
        "step",
        "in n : int, out m : int",
        lhs="a : Item -next-> b : Item; check a.n == n; Item.n(b, m)",
        blocks="not { b -next-> _; } forall { lhs { c : Item -next-> a; } modify { delete c; } }",
        modify="retype b : Special;\nset a.n += 1  // the last line",
        annotations="@semantics(spo) @hom(a, b)",
        weight=2.0,
        package="p",
        doc=" One step. ",
    )
    text = """package p
    /** One step. */
    @semantics(spo) @hom(a, b) @weight(2.0)
    rule step(in n : int, out m : int) {
        lhs { a : Item -next-> b : Item; check a.n == n; Item.n(b, m); }
        not { b -next-> _; }
        forall { lhs { c : Item -next-> a; } modify { delete c; } }
        modify { retype b : Special; set a.n += 1; }
    }
    """
    assert made == single_definition(text)
    assert isinstance(made, RuleData) and (made.semantics, made.homomorphic) == ("spo", (("a", "b"),))


def test_conditions_in_the_blocks_argument_restrict_the_matches() -> None:
    made = engine("", model=chain(4))
    made.add(
        Rule("last", lhs="a : Item -next-> b : Item", blocks="not { b -next-> _; }", modify=""),
        Rule(
            "inner",
            lhs=[RuleNode("a", "Item"), RuleNode("b", "Item"), RuleEdge("a", "next", "b")],
            blocks="require { not { not { b -next-> _; } } }",
            modify="",
        ),
        Rule(
            "each",
            lhs="a : Item",
            blocks="forall+ { lhs { a -next-> b : Item; } not { b -next-> _; } modify { delete a -next-> b; } }",
        ),
    )
    ends = made.matches("last")
    assert len(ends) == 1 and made.count("inner") == 2 and made.count("each") == 1
    made.apply("each")
    assert made.matches("last") != ends and made.count("last") == 1


def test_a_rule_built_from_data_equals_the_rule_built_from_texts() -> None:
    made = Rule(
        "step",
        [Parameter("n", "int", "in")],
        [
            RuleEdge("a", "next", "b"),
            RuleNode("a", "Item"),
            Check(Binary("==", Navigation(X, "n"), Variable("n"))),
        ],
        blocks=[RuleBlock("not", LeftSide((), (RuleEdge("b", "next", "_"),)))],
        modify=[DeleteNode(Variable("b")), SetAction(Variable("a"), "n", "=", Constant(1))],
        weight=2.0,
        priority=1,
        injective=False,
    )
    assert made == single_definition(to_text(made))
    assert [one.name for one in made.annotations] == ["weight", "priority", "match"]
    assert [node.name for node in made.left.nodes] == ["a", "b"], "an arrow mentions its ends"


def test_a_rule_can_be_built_from_texts_and_data_together() -> None:
    mixed = Rule("r", lhs="x : Item", modify=RetypeAction(X, "Special"))
    assert mixed == Rule("r", lhs=RuleNode("x", "Item"), modify="retype x : Special")
    assert mixed == Rule(
        "r", lhs=LeftSide((RuleNode("x", "Item"),)), modify=Modification((RetypeAction(X, "Special"),))
    )
    assert Rule("r", lhs="x : Item", rhs="x : Special") == Rule("r", lhs="x : Item", rhs=[RuleNode("x", "Special")])


def test_a_pattern_has_one_body_or_several() -> None:
    text = "pattern near(a : Item, b : Item) { Item.next(a, b); } or { Item.next(b, a); }"
    texts = Pattern("near", "a : Item, b : Item", ["Item.next(a, b);", "Item.next(b, a)"])
    a, b = Variable("a"), Variable("b")
    bodies = [Body((PathConstraint("Item", ("next",), *ends),)) for ends in ((a, b), (b, a))]
    data = Pattern("near", [Parameter("a", "Item"), Parameter("b", "Item")], bodies)
    assert single_definition(text, "query") == texts == data
    constraints = [TypeConstraint("Item", a), PathConstraint("Item", ("next",), a, b)]
    one = Pattern("p", "a, b", constraints, private=True, strategy="search", annotations="@Constraint(key = a)")
    assert one == single_definition(
        "@Constraint(key = a) private search pattern p(a, b) { Item(a); Item.next(a, b); }", "query"
    )


def test_a_unit_can_be_built_from_a_text_or_from_steps() -> None:
    text = "@priority(3) unit u(x : Item) { a(x); alap { b; } c | d; }"
    steps = ["a(x)", Alap(UnitCall("b")), UnitChoice((UnitCall("c"), UnitCall("d")))]
    assert single_definition(text) == Unit("u", "x : Item", "a(x); alap { b; } c | d", priority=3)
    assert single_definition(text) == Unit(
        "u", "x : Item", steps, annotations=[Annotation("priority", (3,))], priority=3
    )
    assert Unit("u", body="a; alap { b; }").body.steps[1] == Alap(Unit("u", body="b").body)


def test_constructed_patterns_rules_and_units_run_in_an_engine() -> None:
    made = engine("", model=chain(3))
    made.add(
        Pattern("last", "x : Item", "Item(x); neg Item.next(x, _)"),
        Rule("cut", lhs="find last(x); x : Item; y : Item -next-> x", modify="delete y -next-> x"),
        Unit("cutAll", body="alap { cut; }"),
    )
    assert made.run("cutAll") and made.count("last") == 3


# --- mistakes


def test_syntax_errors_of_all_texts_are_reported_together_with_positions() -> None:
    with pytest.raises(LoadError) as caught:
        Rule("r", "x Item", "x : Item;\n  y : ;", modify="set x.n == 2")
    assert str(caught.value) == (
        "parameters of r:1:3: unexpected `Item`\n"
        " 1 | x Item\n"
        "   |   ^^^^\n"
        "hint: expected `)`, `,` or `:`\n\n"
        "lhs of r:2:7: unexpected `;`\n"
        " 2 |   y : ;\n"
        "   |       ^\n"
        "hint: expected a name\n\n"
        "modify of r:1:9: `==` is a comparison, not an assignment\n"
        " 1 | set x.n == 2\n"
        "   |         ^^\n"
        "hint: write `=`"
    )


def test_unknown_names_in_texts_are_reported_with_positions() -> None:
    made = engine("", model=chain(1))
    with pytest.raises(ResolutionError) as caught:
        made.add(Rule("r", lhs="x : Item;\ny : Itme"), Unit("u", body="r;\nq"))
    assert str(caught.value) == (
        "lhs of r:2:5: unknown type `Itme`\n"
        " 2 | y : Itme\n"
        "   |     ^^^^\n"
        "hint: did you mean `Item`?\n\n"
        "body of u:2:1: unknown rule or unit `q`\n"
        " 2 | q\n"
        "   | ^\n"
        "hint: there are `r`, `u`"
    )


@pytest.mark.parametrize(
    ("kind", "part", "text"),
    [
        (Rule, "blocks", "not { x -next-> y; }"),
        (Rule, "blocks", "not { a : Item -next-> b; not { find p(a, b); } }"),
        (
            Rule,
            "blocks",
            "forall { lhs { a : Item; } forall { lhs { check a.n > 1; } modify { create b : Item { n = 1 }; } } "
            "modify { set a.n += 1; } } optional { lhs { a : Item; } rhs { a : Item { n = 1 }; } }",
        ),
        (Unit, "body", "alap { try { a; } else { repeat 1..3 { b; } } } { c; } | d;"),
    ],
)
def test_the_last_separator_of_a_block_may_be_left_out(kind: Any, part: str, text: str) -> None:
    without = re.sub(r";(?=\s*(\}|$))", " ", text)
    assert without != text and kind("x", **{part: without}) == kind("x", **{part: text})


def test_a_separator_between_statements_may_not_be_left_out() -> None:
    with pytest.raises(LoadError) as caught:
        Rule("x", blocks="not { a : Item find p(a, b) } forall { lhs { a : Item } }")
    assert [one.message for one in caught.value.diagnostics] == ["unexpected `p`"]


@pytest.mark.parametrize(
    ("part", "text", "message"),
    [
        ("lhs", "x : Item; } modify { delete x", "`}` has no opening bracket in this text"),
        ("parameters", "a : Item) { lhs { } } rule q(", "`)` has no opening bracket in this text"),
        (
            "blocks",
            "not { Item(y); } modify { delete y; }",
            "this text contains more than `blocks` can have",
        ),
        ("annotations", "rule q { lhs { } }", "this text contains more than `annotations` can have"),
        (
            "annotations",
            'import "x.query" @weight(2)',
            "this text contains more than `annotations` can have",
        ),
        ("lhs", "x : Item; not { Item(y); }", "`not { .. }` is not allowed in `lhs`"),
        ("lhs", "x : Item; forall+ { lhs { } }", "`forall { .. }` is not allowed in `lhs`"),
        ("modify", "delete x; rhs { }", "`rhs { .. }` is not allowed in `modify`"),
        ("lhs", "lhs { x : Item; }", "`lhs` takes only the text between its braces"),
        ("rhs", "{ x : Item; }", "`rhs` takes only the text between its braces"),
        ("parameters", "(x : Item)", "`parameters` takes only the text between the brackets"),
        ("blocks", "neg Item(x)", "`blocks` takes only `not`, `require`, `forall` and `optional` blocks"),
        ("blocks", "not x -next-> _", "missing `{`"),
        ("lhs", "x -next->", "unexpected `;`"),
        ("annotations", "weight(2)", "unexpected `weight`"),
        ("lhs", "x : Item; /* open", "the comment is not closed"),
        ("lhs", '"open', "the string is not closed on its line"),
        ("modify", "create y : Item { n = 1", "missing `}`"),
    ],
)
def test_a_text_with_more_than_its_argument_allows_is_refused(part: str, text: str, message: str) -> None:
    with pytest.raises(LoadError) as caught:
        Rule("r", **{part: text})
    assert [one.message for one in caught.value.diagnostics] == [message]
    assert all(one.span and one.span.source.text == text for one in caught.value.diagnostics)


def test_several_bodies_in_one_text_are_refused() -> None:
    with pytest.raises(LoadError, match="hint: remove the braces; give several bodies as a list of texts"):
        Pattern("p", "x : Item", "{ Item(x); } or { Item(x); }")


def test_arguments_of_wrong_types_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="`lhs` of `r` takes a text or nodes, edges and constraints, not 3"):
        Rule("r", lhs=[RuleNode("x"), 3])  # type: ignore[list-item]
    with pytest.raises(InvalidArgument, match="`modify` of `r` takes a text or actions, not RuleNode"):
        Rule("r", modify=[RuleNode("x")])  # type: ignore[list-item]
    with pytest.raises(InvalidArgument, match=r"`r` has both `rhs` .* and `modify` .*: keep one"):
        Rule("r", rhs="", modify="")
    with pytest.raises(InvalidArgument, match="`body` of `p` takes a text or constraints, or several texts"):
        Pattern("p", "a", [])
    with pytest.raises(InvalidArgument, match="`body` of `u` takes a text or steps, not None"):
        Unit("u", body=None)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="the name of a rule must be a string that is not empty, not None"):
        Rule(None)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`a b` is not a name; a name consists of letters, digits and `_`"):
        Rule("a b")
    assert to_text(Rule("rule")).startswith("rule rule {"), "a word of the language is a name like any other"


def test_from_text_reads_definitions_and_ignores_imports() -> None:
    rule, unit = from_text('package p\nimport "a.query"\nrule r { lhs { x : Item; } }\nunit u { r; }')
    assert (rule.qualified_name, unit.qualified_name) == ("p.r", "p.u")
    with pytest.raises(LoadError, match=r"mine\.rules:1:8: unexpected"):
        from_text("rule r [ lhs { } }", name="mine.rules")
    with pytest.raises(InvalidArgument, match='`language` is \'model\', but must be "rules" or "query"'):
        from_text("", "model")


@pytest.mark.parametrize(
    ("text", "language", "hint"),
    [
        ("pattern p(x : Item) { Item(x); }", "rules", 'pass `language="query"`'),
        ("rule r { lhs { x : Item; } }", "query", 'pass `language="rules"`'),
        (
            "metamodel m\nclass A",
            "rules",
            "write it to a file `name.metamodel`",
        ),
    ],
)
def test_a_text_in_the_wrong_language_gets_a_hint(text: str, language: str, hint: str) -> None:
    with pytest.raises(LoadError) as raised:
        from_text(text, language)
    (problem,) = raised.value.diagnostics
    assert problem.hint == hint


def test_constructors_are_exported_by_the_top_package() -> None:
    assert envgraph.Rule is Rule and {"Pattern", "Rule", "Unit"} <= set(envgraph.__all__)
