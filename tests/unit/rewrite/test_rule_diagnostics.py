"""What can be wrong with a rule: one mistake, one diagnostic, at the exact place, with a hint."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument, ResolutionError, Severity
from envgraph.graph import Model
from envgraph.pattern import (
    Assignment,
    Constant,
    CreateAction,
    LeftSide,
    Modification,
    Parameter,
    RightSide,
    Rule,
    RuleEdge,
    RuleNode,
    SetAction,
    Variable,
)
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import METAMODEL, definitions, engine, patterns, problems

LINKED = "pattern linked(from : Item, to : Item) { Item.links(from, to); }"

GOLDEN = Path(__file__).with_name("diagnostics_of_rules.txt")


def examples(path: Path) -> list[tuple[str, str, str]]:
    """Title, text and diagnostics of every example of a file."""
    found = []
    for part in path.read_text().removeprefix("=== ").split("\n=== "):
        title, _, rest = part.partition("\n")
        text, _, expected = rest.partition("\n---\n")
        found.append((title, text + "\n", expected.strip("\n")))
    return found


@pytest.mark.parametrize(("title", "text", "expected"), examples(GOLDEN), ids=lambda value: value[:40])
def test_each_mistake_is_reported_once_and_exactly(title: str, text: str, expected: str) -> None:
    found = problems(text, LINKED)
    assert "\n\n".join(map(str, found)) == expected
    assert [diagnostic.code for diagnostic in found] == [title]
    if found[0].severity is Severity.WARNING:
        engine(text, LINKED)  # stops nothing
    else:
        with pytest.raises(ResolutionError):
            engine(text, LINKED)


@pytest.mark.parametrize(
    "text",
    [
        "rule r { lhs { a : Item -next-> b : Item; } rhs { a; delete b; } }",
        "rule r { lhs { a : Special -favourite-> b : Item; } modify { retype a : Item; delete a -favourite-> b; } }",
        "@semantics(spo) rule r { lhs { a : Special -favourite-> b : Item; } modify { retype a : Item; } }",
        "rule r { lhs { a : Special -favourite-> b : Item; } modify { retype a : Item; delete b; } }",
        "rule r { lhs { a : Special -favourite-> b : Item; } modify { retype b : Special; } }",
        "rule r { lhs { a : Item -kids-> b : Item; c : Box; } modify { retype b : Special; move b to c.content; } }",
        "rule r { lhs { a : Item -kids-> b : Item; } rhs { a; b : Special; } }",
        "rule r(i : Item) { lhs { i -kids-> b; } modify { retype b : Box; set b.must = i; delete i -kids-> b; } }",
        "rule r(i : Item) { lhs { b : Item -parent-> i; } "
        "modify { retype b : Box; set b.must = i; delete b -parent-> i; } }",
        "rule r(i : Item) { lhs { b : Box; i : Item; } modify { retype b : Item; } }",
        "derive d = retype among { Item, Special };",
        "rule r { lhs { a : Item -kids-> b : Item; } modify { delete a; delete b; } }",
        "rule r { lhs { a : Item -kids-> b : Item; } modify { delete a; delete a -kids-> b; } }",
        "rule r { lhs { a : Item -kids-> b : Item; c : Item; } modify { delete a; create b -parent-> c; } }",
        "rule r { lhs { a : Item -kids-> b : Item; c : Item; } modify { delete a; set c.kids += b; } }",
        "rule r { lhs { a : Item -kids-> b : Item; c : Item; } modify { merge c <- a; } }",
        "rule r { lhs { a : Item -kids-> b : Item; } rhs { b; delete a; } }",
        "rule r { lhs { a : Item; Item.links(a, b); Item.n(a, value); } modify { delete a; } }",
        "rule r { lhs { a : Item; } not { Item.pair(a, one1); Item.links(a, one2); } modify { delete a; } }",
        "rule r { lhs { a : Item; } not { Item.pair(a, other); } modify { delete a; } }",
        "rule r(i : Item) { lhs { } modify { create b : Box { must = i }; } }",
        "rule r(i : Item) { lhs { } modify { create b : Box; set b.must = i; } }",
        "rule r(i : Item) { lhs { } modify { create b : Box -must-> i; } }",
        "@weight(2.0) @priority(1) @semantics(spo) @match(homomorphic) @hom(a, b) "
        "rule r { lhs { a : Item; b : Item; } modify { } }",
    ],
)
def test_intended_constructs_give_no_warning(text: str) -> None:
    assert problems(text) == []


def test_all_mistakes_of_all_rules_are_reported_in_the_order_of_the_text() -> None:
    found = problems(
        """
        rule one { lhs { a : Itm; } modify { retype a : Spcial; set b.n = 1; } }
        derive two = retype among { Item, Thing };
        unit three { noe; }
        """
    )
    assert [d.code for d in found] == [
        "unknown-type",
        "unknown-type",
        "unknown-variable",
        "abstract-class",
        "unknown-rule",
    ]


def test_rule_diagnostics_have_their_expected_text() -> None:
    (found,) = problems("rule r {\n    lhs { a : Item; }\n    modify { set a.lable = 1; }\n}\n")
    assert str(found) == (
        "test.rules:3:20: `Item` has no feature `lable`\n"
        " 3 |     modify { set a.lable = 1; }\n"
        "   |                    ^^^^^\n"
        "hint: did you mean `label`?"
    )


def test_users_of_a_pattern_with_errors_get_no_errors() -> None:
    found = problems(
        "rule r { lhs { a : Item; find broken(a, b); } modify { set b.n = 1; } }",
        "pattern broken(x : Item, y : Item) { Item.lnks(x, y); }",
    )
    assert [d.code for d in found] == ["unknown-feature"]


def test_definitions_with_errors_add_nothing() -> None:
    made = Engine(Model(METAMODEL))
    with pytest.raises(ResolutionError):
        made.add(*patterns(LINKED), *definitions("rule good { lhs { } } rule bad { lhs { a : Itm; } }"))
    assert made.rules == () and made.patterns == () and made.library.names() == ()


def test_names_are_defined_once() -> None:
    made = engine("rule r { lhs { } }", LINKED)
    for text in ("rule r { lhs { } modify { } }", "unit r { }", "rule linked { lhs { } }"):
        codes = [d.code for d in made.check(*definitions(text)) if d.severity is Severity.ERROR]
        assert codes == ["duplicate-definition"]
    twice = problems("rule r { lhs { } modify { } } unit r { r; }")
    assert [d.code for d in twice] == ["duplicate-definition"]
    assert twice[0].notes[0].span is not None


def test_rules_made_in_python_are_checked_without_spans() -> None:
    engine = Engine(Model(METAMODEL))
    a, wrong = Variable("a"), SetAction(Variable("a"), "nn", "=", Constant(1))
    made = Rule("r", left=LeftSide((RuleNode("a", "Item"),)), right=Modification((wrong,)), weight=0.0)
    assert [d.code for d in engine.check(made)] == ["bad-weight", "unknown-feature"]
    twice = Modification((SetAction(a, "n", "=", Constant(1)), SetAction(a, "n", "=", Constant(2))))
    assert [d.code for d in engine.check(Rule("r", (Parameter("a", "Item"),), right=twice))] == ["duplicate-assignment"]
    create = CreateAction((RuleNode("b", "Item", (Assignment("n", Constant("x")),)),), (RuleEdge("b", "next", "c"),))
    codes = [d.code for d in engine.check(Rule("r", right=Modification((create,))))]
    assert sorted(codes) == ["unknown-variable", "wrong-type"]
    misplaced = RightSide(actions=(CreateAction((RuleNode("b", "Item"),)),))
    assert [d.code for d in engine.check(Rule("r", right=misplaced))] == ["misplaced-action"]
    semantics = Rule("r", semantics="maybe")  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="`semantics` of `r` must be 'dpo' or 'spo', not 'maybe'"):
        engine.check(semantics)


@pytest.mark.parametrize(
    "actions",
    [
        ("create a -kids-> x;", "create x : Item;"),
        ("merge a <- b;", "delete b;"),
        ("merge a <- b;", "delete a;"),
        ("delete a;", "retype a : Special;"),
        ("create x : Item;", "delete a -links-> x;"),
        ("create x : Item;", "redirect a -links-> x to b;"),
    ],
)
@pytest.mark.parametrize("header", ["", "@match(homomorphic)"])
def test_the_order_of_actions_does_not_matter(header: str, actions: tuple[str, str]) -> None:
    one, other = (
        problems(f"{header} rule r {{ lhs {{ a : Item; b : Item; }} modify {{ {' '.join(order)} }} }}")
        for order in (actions, actions[::-1])
    )
    assert [(p.code, p.message) for p in one] == [(p.code, p.message) for p in other]


def test_a_new_object_has_no_links_before_the_rule() -> None:
    found = problems("rule r { lhs { a : Item; } modify { create x : Item; delete a -links-> x; } }")
    assert [problem.code for problem in found] == ["no-value-yet"]


@pytest.mark.parametrize("block", ["", "require { x : Item; }", "not { Item.n(x, 3); }"])
def test_blocks_do_not_determine_classes_of_outer_objects(block: str) -> None:
    found = problems(f"rule q {{ lhs {{ a : Item; x -next-> b; }} {block} modify {{ }} }}")
    assert [(problem.code, problem.span and problem.span.column) for problem in found] == [("untyped-source", 26)]
