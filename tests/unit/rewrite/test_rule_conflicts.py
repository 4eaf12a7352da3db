"""Wants that do not go together: within a rule they are a mistake, between matches the application is refused."""

from __future__ import annotations

import pytest

from envgraph.errors import RuleError, Severity
from envgraph.graph import Model
from tests.unit.rewrite.graphs import METAMODEL, chain, engine, problems, snapshot


def star(leaves: int) -> Model:
    """Item 0 with links to items 1, 2, ..."""
    model = Model(METAMODEL)
    centre = model.create("Item")
    centre.links = [model.create("Item", n=number) for number in range(1, leaves + 1)]
    return model


def both(one: str, other: str) -> str:
    """A rule with two `forall` blocks over the same links: in the first the leaf is `b`, in the second `c`."""
    return (
        "rule r(a : Item) { lhs { } "
        f"forall {{ lhs {{ a -links-> b : Item; }} modify {{ {one} }} }} "
        f"forall {{ lhs {{ a -links-> c : Item; }} modify {{ {other} }} }} }}"
    )


@pytest.mark.parametrize(
    ("one", "other", "message"),
    [
        ("delete b;", "set a.links += c;", "`Item#1` is both deleted and changed"),
        ("delete b;", "create x : Item { links = c };", "`Item#1` is both deleted and changed"),
        ("delete b;", "move c to a.kids;", "`Item#1` is both deleted and changed"),
        ("merge a <- b;", "delete c;", "`Item#1` is merged, but also deleted or merged into another object"),
        ("retype b : Special;", "retype c : Item;", "`Item#1` is retyped to both `Special` and `Item`"),
        (
            "retype b : Box;",
            "set c.done = true;",
            "`Item#1` is retyped to `Box`, but another change needs class `Item`",
        ),
        (
            "retype b : Box;",
            "create a -links-> c;",
            "`Item#1` is retyped to `Box`, but another change needs class `Item`",
        ),
        ("set a.links -= b;", "set a.links += c;", "`Item#0` -links-> `Item#1` is both removed and added"),
        ("set a.links = [a];", "set a.links += c;", "`Item#0` gets two values of `Item.links`"),
        ("set a.links = [a];", "create a -links-> c;", "values of `Item.links`: `Item#0` and `Item#1`"),
        ("set b.next = a;", "set c.next = a;", "`Item#0` gets two values of `Item.prev`"),
        ("set a.next = none;", "create a -next-> c;", "values of `Item.next`: none and `Item#1`"),
        ("set a.next = b;", "create a -next-> c;", "values of `Item.next`: `Item#1` and `Item#2`"),
        ("move b to a.kids;", "create x : Item { kids = c };", "`Item#1` gets two values of `Item.parent`"),
        ("move b to a.kids;", "create x : Box { content = c };", "`Item#1` gets two containers"),
        ("create x : Item; set a.next = x;", "", "two values of `Item.next`: a new object and a new object"),
        ("set a.n = 1;", "set a.n += 1;", "`Item#0` gets two values of `Thing.n`"),
        ('set a.label += "" + b.n;', "", "`Item#0` gets two values of `Item.label`"),
    ],
)
def test_conflicting_block_matches_are_refused(one: str, other: str, message: str) -> None:
    made = engine(both(one, other), model=star(2))
    before = snapshot(made.model)
    with pytest.raises(RuleError) as caught:
        made.apply("r", a=0)
    assert message in str(caught.value)
    assert caught.value.reason == "ambiguous" and len(caught.value.details) == 2
    assert snapshot(made.model) == before
    made.model.check_integrity()


def test_a_conflict_names_both_matches_and_what_they_want() -> None:
    model = Model(METAMODEL)
    root = model.create("Item", object_name="root")
    root.links = [model.create("Item", object_name=name) for name in ("left", "right")]
    made = engine(both("set a.next = b;", ""), model=model)
    with pytest.raises(RuleError) as caught:
        made.apply("r", a=root)
    assert str(caught.value).splitlines() == [
        "test.rules:1:75: rule `r` cannot be applied: `root` gets two values of `Item.next`: `left` and `right`",
        " 1 | " + str(both("set a.next = b;", "")),
        "   |" + " " * 75 + "^" * 14,
        "note: forall(a = `root`, b = `left`): set a.next = b",
        "note: forall(a = `root`, b = `right`): set a.next = b",
        "hint: restrict the left side of the block, so that its matches make the same changes",
    ]


def test_a_conflict_of_two_variables_for_one_object_names_both_actions() -> None:
    made = engine(
        "@hom(a, b) rule r { lhs { a : Item; b : Item; } modify { set a.n = 1; set b.n = 2; } }",
        model=chain(1),
    )
    with pytest.raises(RuleError) as caught:
        made.apply("r")
    assert caught.value.details == (
        "rule(a = `Item#0`, b = `Item#0`): set a.n = 1",
        "rule(a = `Item#0`, b = `Item#0`): set b.n = 2",
    )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("delete b;", "delete c;"),
        ("merge a <- b;", "merge a <- c;"),
        ("retype b : Special;", "retype c : Special; set c.n = 4;"),
        ("set b.next = none;", ""),
        ("create b -links-> a;", "create c -links-> a;"),
        ("set a.links -= b;", "delete a -links-> c;"),
        ("set a.weight += 0.5;", "set a.weight -= 0.25;"),
        ('set a.label += "x";', 'set a.label += "x";'),
        ("delete b;", "create x : Item { n = c.n };"),
    ],
)
def test_matches_that_agree_are_applied(one: str, other: str) -> None:
    made = engine(both(one, other), model=star(2))
    assert made.apply("r", a=0) is not None
    made.model.check_integrity()


@pytest.mark.parametrize(
    ("actions", "message", "places"),
    [
        ("set a.next = c; set b.next = c;", "`c` gets two values of `Item.prev`: `a` and `b`", (57, 73)),
        ("set a.next = c; set c.prev = none;", "`c` gets two values of `Item.prev`", (57, 73)),
        ("set a.next = c; create a -next-> b;", "`a` gets two values of `Item.next`", (57, 80)),
        ("set a.links += [b, c]; set a.links -= b;", "`a` -links-> `b` is both removed and added", (57, 80)),
        ("move a to b.kids; move a to c.kids;", "`a` gets two values of `Item.parent`", (57, 75)),
        ("move a to b.kids; set a.parent = none;", "`a` gets two values of `Item.parent`", (57, 75)),
        ("merge a <- b; delete a;", "`a` is both deleted and changed", (57, 78)),
        ("delete a; retype a : Special;", "`a` is both deleted and changed", (64, 78)),
        ("retype b : Special; merge a <- b;", "`b` is both deleted and changed", (68, 77)),
    ],
)
def test_contradictory_actions_are_reported_statically(actions: str, message: str, places: tuple[int, int]) -> None:
    found = problems(f"rule r {{ lhs {{ a : Item; b : Item; c : Item; }} modify {{ {actions} }} }}")
    assert [(one.code, one.severity) for one in found] == [("contradiction", Severity.ERROR)]
    assert message in found[0].message
    assert found[0].span is not None and found[0].notes[0].span is not None
    assert (found[0].notes[0].span.column, found[0].span.column) == places


@pytest.mark.parametrize(
    "right",
    [
        "modify { create a -next-> b; create a -next-> c; }",
        "modify { create a -kids-> b; create c -kids-> b; }",
        "rhs { a -next-> b; c; a -next-> c; }",
        "modify { create x : Item { next = b }; create x -next-> c; }",
    ],
)
def test_a_rule_that_can_never_be_applied_is_warned_of(right: str) -> None:
    found = problems(f"rule r {{ lhs {{ a : Item; b : Item; c : Item; }} {right} }}")
    assert [(one.code, one.severity) for one in found] == [("never-applicable", Severity.WARNING)]


def test_links_in_the_rhs_may_not_be_set_otherwise() -> None:
    found = problems("rule r { lhs { a : Item -next-> b : Item; c : Item; } rhs { a -next-> b; c; set a.next = c; } }")
    assert [one.code for one in found] == ["contradiction"]


@pytest.mark.parametrize(
    "actions",
    [
        "set a.n = 1; set b.n = 2;",
        "set a.next = b; set b.next = c; set c.next = a;",
        "move a to b.kids; move c to b.kids;",
        "set a.next = a.next.next; set b.next = b.next.next;",
        "delete a; set b.n = a.n;",
    ],
)
def test_compatible_actions_are_not_reported(actions: str) -> None:
    assert problems(f"rule r {{ lhs {{ a : Item; b : Item; c : Item; }} modify {{ {actions} }} }}") == []


def test_objects_that_only_values_name_are_looked_at_when_the_rule_is_applied() -> None:
    made = engine(
        """
        rule skip(a : Item, b : Item) { lhs { } modify { set a.next = a.next.next; set b.links = [a.next.next]; } }
        rule drop(a : Item, b : Item) { lhs { } modify { set a.favourite = a.next; delete b; retype a : Special; } }
        rule two(a : Item, b : Item) { lhs { } modify { set a.next = a.next.next; set b.next = a.next.next; } }
        """,
        model=chain(4),
    )
    model = made.model
    made.apply("skip", a=0, b=1)
    assert model.node(0).next == model.node(2) and list(model.node(1).links) == [model.node(2)]
    with pytest.raises(RuleError) as caught:
        made.apply("drop", a=0, b=2)
    assert caught.value.reason == "ambiguous" and caught.value.details[1].endswith("set a.favourite = `Item#2`")
    with pytest.raises(RuleError, match=r"`Item#3` gets two values of `Item.prev`: `Item#0` and `Item#1`"):
        made.apply("two", a=0, b=1)
    model.check_integrity()


def test_a_value_inside_a_deleted_container_is_not_linked() -> None:
    model = Model(METAMODEL)
    inner = model.create("Item")
    outer = model.create("Item", kids=[inner])
    first = model.create("Item", next=inner)
    made = engine(
        "@semantics(spo) rule r(a : Item, b : Item) { lhs { } modify { set a.links = [a.next]; delete b; } }",
        model=model,
    )
    before = snapshot(model)
    with pytest.raises(RuleError) as caught:
        made.apply("r", a=first, b=outer)
    assert caught.value.reason == "containment"
    assert snapshot(model) == before


def test_objects_are_merged_into_one_by_several_matches() -> None:
    made = engine(
        "rule r(a : Item) { lhs { } forall { lhs { a -links-> b; a -links-> c; } modify { merge a <- b; } } }",
        model=star(3),
    )
    made.apply("r", a=0)
    assert [node.id for node in made.model.nodes()] == [0]
    assert list(made.model.node(0).links) == [made.model.node(0)]


def test_an_added_target_takes_what_a_created_link_wants() -> None:
    made = engine(
        """
        @match(homomorphic) rule r(a : Item, b : Item) {
            lhs { }
            forall { lhs { check b.n == 1; } modify { create b -kids-> c : Item; create c -kids-> a; } }
            modify { set b.kids += [a]; }
        }
        """,
        model=chain(2),
    )
    with pytest.raises(RuleError) as caught:
        made.apply("r", a=0, b=1)
    assert caught.value.reason == "ambiguous" and "`Item#0` gets two values of `Item.parent`" in str(caught.value)
