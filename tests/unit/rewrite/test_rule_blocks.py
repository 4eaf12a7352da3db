"""`forall`, `forall+` and `optional`: rules inside rules."""

from __future__ import annotations

import pytest

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, problems, snapshot


def star(leaves: int) -> Model:
    """Item 0 with links to items 1, 2, ..."""
    model = Model(METAMODEL)
    centre = model.create("Item")
    centre.links = [model.create("Item", n=number) for number in range(1, leaves + 1)]
    return model


def test_forall_rewrites_every_match_of_its_block_at_once() -> None:
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall { lhs { a -links-> b : Item; } modify { retype b : Special; set b.n = b.n * 10; } }
        }
        """,
        model=star(3),
    )
    made.apply("r", a=0)
    assert [(node.cls, node.n) for node in made.model.nodes("Item")] == [
        ("Item", 0),
        ("Special", 10),
        ("Special", 20),
        ("Special", 30),
    ]


def test_forall_may_have_no_match_and_forall_plus_needs_one() -> None:
    text = "rule r(a : Item) {{ lhs {{ }} {kind} {{ lhs {{ a -links-> b : Item; }} modify {{ set b.n = 1; }} }} }}"
    assert engine(text.format(kind="forall"), model=chain(1)).apply("r", a=0) is not None
    assert engine(text.format(kind="forall+"), model=chain(1)).apply("r", a=0) is None


def test_conditions_of_a_forall_choose_among_its_matches() -> None:
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall {
                lhs { a -links-> b : Item; }
                not { b -next-> c : Item; }
                modify { set b.done = true; }
            }
        }
        """,
        model=star(2),
    )
    made.model.node(1).next = made.model.node(2)
    made.apply("r", a=0)
    assert [node.done for node in made.model.nodes("Item")] == [False, False, True]


def test_blocks_create_one_object_for_each_match_and_link_it_to_what_the_rule_creates() -> None:
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall {
                lhs { a -links-> b : Item; }
                modify { create b -kids-> copy : Item { n = b.n, links = [fresh] }; }
            }
            modify { create fresh : Special; }
        }
        """,
        model=star(2),
    )
    application = made.apply("r", a=0)
    assert application is not None
    fresh = application.created["fresh"]
    node = made.model.node
    assert fresh.id == 3
    assert [(kid.id, kid.n, list(kid.links)) for kid in node(1).kids] == [(4, 1, [fresh])]
    assert [(kid.id, kid.n, list(kid.links)) for kid in node(2).kids] == [(5, 2, [fresh])]


def test_blocks_can_be_nested() -> None:
    model = star(2)
    model.node(1).links = [model.create("Item"), model.create("Item")]
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall {
                lhs { a -links-> b : Item; }
                forall { lhs { b -links-> c : Item; } modify { set c.n = 5; set b.n += 1; } }
                modify { set b.done = true; }
            }
        }
        """,
        model=model,
    )
    made.apply("r", a=0)
    assert [(node.n, node.done) for node in model.nodes("Item")] == [
        (0, False),
        (3, True),
        (2, True),
        (5, False),
        (5, False),
    ]


def test_optional_rewrites_one_match_if_there_is_one() -> None:
    text = "rule r(a : Item) { lhs { } optional { lhs { a -links-> b : Item; } modify { delete b; } } }"
    made = engine(text, model=star(2))
    made.apply("r", a=0)
    assert [node.id for node in made.model.nodes("Item")] == [0, 2]
    made.apply("r", a=0)
    assert made.apply("r", a=0) is not None
    assert len(made.model) == 1


def test_blocks_match_the_state_before_the_rule() -> None:
    block = "optional { lhs { check a.n == 0; } modify { set a.done = true; } }"
    text = f"rule r(a : Item) {{ lhs {{ }} {block} modify {{ set a.n = 1; }} }}"
    made = engine(text, model=star(0))
    made.apply("r", a=0)
    (item,) = made.model.nodes("Item")
    assert (item.n, item.done) == (1, True)


def test_links_of_a_block_go_with_a_node_that_the_rule_deletes() -> None:
    made = engine(
        "rule r(a : Item) { lhs { } forall { lhs { a -links-> b : Item; } } modify { delete a; } }",
        model=star(3),
    )
    made.apply("r", a=0)
    assert len(made.model) == 3


def test_a_block_with_a_right_side_deletes_by_omission() -> None:
    made = engine("rule r(a : Item) { lhs { } forall { lhs { a -links-> b : Item; } rhs { a; } } }", model=star(3))
    made.apply("r", a=0)
    assert len(made.model) == 1


def test_increases_of_several_matches_add_up() -> None:
    made = engine(
        "rule r(a : Item) { lhs { } forall { lhs { a -links-> b : Item; } modify { set a.n += b.n; } } }",
        model=star(3),
    )
    made.apply("r", a=0)
    assert made.model.node(0).n == 6


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ("set a.n = b.n;", "gets two values of `Thing.n`: 1 and 2"),
        ("set a.next = b;", "two values of `Item.next`"),
        ("delete b; set c.n = 1;", "is both deleted and changed"),
        ("retype b : Special; delete c;", "is both deleted and changed"),
        ("create b -links-> c; delete c -links-> b;", "is both removed and added"),
    ],
)
def test_matches_that_contradict_each_other_are_refused_by_name(actions: str, message: str) -> None:
    # b and c take each other's places in two matches of the block.
    block = f"forall {{ lhs {{ a -links-> b : Item; a -links-> c : Item; }} modify {{ {actions} }} }}"
    made = engine(f"rule r(a : Item) {{ lhs {{ }} {block} }}", model=star(2))
    before = snapshot(made.model)
    with pytest.raises(RuleError, match=message) as caught:
        made.apply("r", a=0)
    assert caught.value.reason == "ambiguous"
    assert len(caught.value.details) == 2 and all(
        line.startswith("forall(a = `Item#0`, ") for line in caught.value.details
    )
    assert snapshot(made.model) == before


def test_block_matches_with_equal_effects_do_not_conflict() -> None:
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall {
                lhs { a -links-> b : Item; a -links-> c : Item; }
                modify { delete c; set a.label = "done"; retype a : Special; }
            }
        }
        """,
        model=star(3),
    )
    made.apply("r", a=0)
    assert [(node.id, node.cls, node.label) for node in made.model.nodes("Item")] == [(0, "Special", "done")]


def test_a_refused_block_takes_the_whole_application_back() -> None:
    model = star(2)
    model.node(2).next = model.node(1)
    block = "forall { lhs { a -links-> b : Item; } modify { delete b; } }"
    made = engine(f"rule r(a : Item) {{ lhs {{ }} {block} modify {{ set a.n = 1; }} }}", model=model)
    before = snapshot(model)
    with pytest.raises(RuleError) as caught:
        made.apply("r", a=0)
    assert caught.value.reason == "dangling"
    assert snapshot(model) == before


def test_blocks_read_what_the_left_side_computes() -> None:
    queries = "pattern linked(from : Item, to : Item) { Item.links(from, to); }"
    made = engine(
        """
        rule some { lhs { a : Item; n == count find linked(a, _); } require { b : Item; check b.n < n; } modify { } }
        rule none { lhs { a : Item; n == eval(a.n + 1); } not { not { b : Item; check b.n == n; } } modify { } }
        rule all(k : int) {
            lhs { a : Item; n == eval(a.n + k); }
            forall { lhs { a -links-> b; m == eval(b.n * n); } not { check m > 4; } modify { set b.n = m; } }
            optional { lhs { a -links-> c; check c.n == n; } modify { set c.label = "n"; } }
        }
        """,
        queries,
        model=star(3),
    )
    assert [match.row for match in made.matches("some")] == [(0, 3)]
    assert [match.row for match in made.matches("none")] == [(0, 1), (1, 2), (2, 3)]
    made.apply("all", a=0, k=2)
    assert [node.n for node in made.model.nodes()] == [0, 2, 4, 3]
    assert [node.label for node in made.model.nodes()] == ["", "", "n", ""]


def test_errors_in_computed_values_are_reported_once() -> None:
    text = "rule r { lhs { a : Item; n == eval(a.nn + 1); } not { b : Item; check b.n == n; } modify { } }"
    assert [problem.code for problem in problems(text)] == ["unknown-feature"]


DOUBLE = """
rule double { lhs { } forall { lhs { x : Item; } modify { create y : Item; } } }
rule cross { lhs { } forall { lhs { x : Item; } forall { lhs { y : Item; } modify { set y.n += 1; } } modify { } } }
unit grow { alap { double; } }
"""


def test_a_forall_that_doubles_the_model_each_time_ends_at_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.001")
    made = engine(DOUBLE, model=chain(3))
    with pytest.raises(EvaluationError, match="the blocks of one application have more than 100 matches") as caught:
        made.run("grow")
    assert caught.value.span is not None and caught.value.span.text == "lhs"
    assert caught.value.hint is not None and "ENVGRAPH_LIMITS=10" in caught.value.hint
    assert len(made.model.nodes("Item")) == 3
    made = engine(DOUBLE, model=chain(12))
    with pytest.raises(EvaluationError, match="more than 100 matches"):
        made.apply("cross")  # each block has fewer
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.01")
    assert engine(DOUBLE, model=chain(12)).apply("cross")
