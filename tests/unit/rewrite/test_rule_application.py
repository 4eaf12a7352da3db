"""What applying a rule does, and when it is refused."""

from __future__ import annotations

import pytest

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import METAMODEL, chain, definitions, engine, snapshot


def refused(made: Engine, reason: str, name: str = "r", **arguments: object) -> RuleError:
    """Apply a rule that must be refused for a reason, leaving everything as it was."""
    before = snapshot(made.model)
    with pytest.raises(RuleError) as caught:
        made.apply(name, **arguments)
    assert caught.value.reason == reason
    assert caught.value.rule == name
    assert snapshot(made.model) == before
    made.model.check_integrity()
    return caught.value


# --- right sides


@pytest.mark.parametrize(
    "right",
    [
        "rhs { a -links-> b; b : Special; c : Item { n = 9 }; b -next-> c; delete d; }",
        """modify {
            delete a -next-> b; delete d; create a -links-> b; retype b : Special;
            create b -next-> c : Item { n = 9 };
        }""",
    ],
)
def test_rhs_and_modify_have_equal_effects(right: str) -> None:
    model = chain(2)
    d = model.create("Box", n=5)
    made = engine(f"rule r {{ lhs {{ a : Item -next-> b : Item; d : Box; }} {right} }}", model=model)
    application = made.apply("r")
    assert application is not None
    a, b, c = model.node(0), model.node(1), application.created["c"]
    assert d not in model
    assert a.next is None and list(a.links) == [b]
    assert b.cls == "Special" and b.next == c
    assert c.cls == "Item" and c.n == 9
    model.check_integrity()


def test_nodes_omitted_from_the_rhs_are_deleted() -> None:
    made = engine("rule r { lhs { a : Item -next-> b : Item; } rhs { a; } }", model=chain(2))
    made.apply("r")
    assert [node.id for node in made.model.nodes("Item")] == [0]


def test_context_is_never_deleted_by_omission() -> None:
    made = engine(
        "rule r(p : Item) { lhs { p -next-> b : Item; find linked(p, c); Item.next(b, d); } rhs { b; } }",
        "pattern linked(from : Item, to : Item) { Item.links(from, to); }",
        model=chain(3),
    )
    made.model.node(0).links.append(made.model.create("Item"))
    made.apply("r")
    assert len(made.model) == 4
    assert made.model.node(0).next is None  # the arrow is left out, so the link goes


def test_context_may_be_deleted_explicitly() -> None:
    made = engine("rule r(p : Item) { lhs { } modify { delete p; } }", model=chain(1))
    made.apply("r", p=0)
    assert len(made.model) == 0


def test_an_opposite_arrow_is_the_same_link() -> None:
    made = engine("rule r { lhs { a : Item -next-> b : Item; } rhs { b -prev-> a; } }", model=chain(2))
    before = snapshot(made.model)
    made.apply("r")
    assert snapshot(made.model) == before


def test_a_symmetric_arrow_has_no_direction() -> None:
    model = chain(2)
    model.node(0).next = None
    model.node(0).friends.append(model.node(1))
    made = engine("rule r(a : Item) { lhs { a -friends-> b : Item; } rhs { b -friends-> a; } }", model=model)
    before = snapshot(model)
    made.apply("r", a=0)
    assert snapshot(model) == before


def test_a_class_in_the_right_side_retypes_to_exactly_it() -> None:
    model = Model(METAMODEL)
    model.create("Special")
    made = engine(
        "rule keep { lhs { a : Item; } rhs { a : Item; } } rule lower { lhs { a : Special; } rhs { a : Item; } }",
        model=model,
    )
    made.apply("keep")
    assert model.node(0).cls == "Special"
    made.apply("lower")
    assert model.node(0).cls == "Item"


def test_retyping_keeps_identity_and_shared_features_and_adds_initial_values() -> None:
    model = chain(2)
    made = engine("rule r(a : Item) { lhs { } modify { retype a : Special; } }", model=model)
    made.apply("r", a=0)
    special = model.node(0)
    assert (special.cls, special.n, special.next, special.extra) == ("Special", 0, model.node(1), 7)


def test_rules_may_retype_and_set_what_only_the_new_class_has() -> None:
    made = engine("rule r(a : Item) { lhs { } modify { set a.extra = 3; retype a : Special; } }", model=chain(1))
    made.apply("r", a=0)
    assert made.model.node(0).extra == 3


def test_creating_takes_values_and_links_in_one_literal() -> None:
    model = chain(2)
    made = engine(
        """
        rule r(a : Item) {
            lhs { a -next-> b : Item; }
            modify {
                create box : Box -content-> x : Special {
                    n = a.n + 5, weight = 2, label = "x" + b.n, colour = ::blue, done = true,
                    links = [a, b], favourite = b.prev, parent = none
                };
            }
        }
        """,
        model=model,
    )
    application = made.apply("r", a=0)
    assert application is not None
    x, box = application.created["x"], application.created["box"]
    assert (x.n, x.weight, x.label, x.colour, x.done, x.extra) == (5, 2.0, "x1", "blue", True, 7)
    assert list(x.links) == [model.node(0), model.node(1)] and x.favourite == model.node(0)
    assert list(box.content) == [x]
    model.check_integrity()


# --- set, move, merge, redirect


def test_values_are_computed_on_the_state_before_the_rule() -> None:
    made = engine(
        "rule r { lhs { a : Item -next-> b : Item; } modify { set a.n = b.n; set b.n = a.n; } }",
        model=chain(2),
    )
    made.apply("r")
    assert (made.model.node(0).n, made.model.node(1).n) == (1, 0)


def test_values_of_a_deleted_object_can_be_used() -> None:
    made = engine("rule r { lhs { a : Item -next-> b : Item; } modify { set a.n = b.n; delete b; } }", model=chain(2))
    made.apply("r")
    assert made.model.node(0).n == 1 and len(made.model) == 1


def test_attributes_can_be_increased_and_cleared() -> None:
    made = engine(
        """
        rule more(a : Item) { lhs { } modify { set a.n += 2; set a.weight += 1; set a.label += "!"; } }
        rule less(a : Item) { lhs { } modify { set a.n -= 5; set a.weight = none; } }
        """,
        model=chain(1),
    )
    node = made.model.node(0)
    node.label = "hey"
    made.apply("more", a=node)
    assert (node.n, node.weight, node.label) == (2, 1.0, "hey!")
    made.apply("less", a=node)
    assert (node.n, node.weight) == (-3, None)
    with pytest.raises(EvaluationError, match=r"Item\.weight. has no value"):
        made.apply("more", a=node)
    assert node.n == -3


def test_a_single_reference_that_is_set_releases_the_opposite() -> None:
    model = chain(4)  # 0 -> 1 -> 2 -> 3
    made = engine("rule r(a : Item, b : Item) { lhs { } modify { set a.next = b; } }", model=model)
    made.apply("r", a=0, b=3)
    node = model.node
    assert node(0).next == node(3) and node(3).prev == node(0)
    assert node(1).prev is None and node(2).next is None
    model.check_integrity()


def test_references_can_be_set_to_nothing_or_to_a_path() -> None:
    model = chain(3)
    made = engine(
        """
        rule clear(a : Item) { lhs { } modify { set a.next = none; set a.links = none; } }
        rule skip(a : Item) { lhs { } modify { set a.next = a.next.next; } }
        """,
        model=model,
    )
    made.apply("skip", a=0)
    assert model.node(0).next == model.node(2)
    made.apply("skip", a=0)
    assert model.node(0).next is None
    model.node(1).links = [model.node(0), model.node(2)]
    made.apply("clear", a=1)
    assert not model.node(1).links


def test_many_valued_references_are_set_extended_and_reduced() -> None:
    model = chain(4)
    made = engine(
        """
        rule put(a : Item, b : Item, c : Item) { lhs { } modify { set a.links = [c, b]; } }
        rule more(a : Item, b : Item) { lhs { } modify { set a.links += b; } }
        rule less(a : Item, b : Item) { lhs { } modify { set a.links -= b; } }
        """,
        model=model,
    )
    node = model.node
    made.apply("put", a=0, b=1, c=2)
    assert list(node(0).links) == [node(2), node(1)]
    made.apply("more", a=0, b=3)
    made.apply("more", a=0, b=3)
    assert list(node(0).links) == [node(2), node(1), node(3)]
    made.apply("less", a=0, b=1)
    made.apply("less", a=0, b=1)
    assert list(node(0).links) == [node(2), node(3)]


def test_moving_leaves_the_old_container_before_anything_is_linked() -> None:
    model = Model(METAMODEL)
    boxes = [model.create("Box", content=[model.create("Item"), model.create("Item")]) for _ in range(2)]
    made = engine(
        """
        rule swap {
            lhs { a : Box -content-> x : Item; b : Box -content-> y : Item; }
            modify { move x to b.content; move y to a.content; }
        }
        """,
        model=model,
    )
    made.apply("swap", a=boxes[0], b=boxes[1], x=0, y=3)
    assert [[item.id for item in box.content] for box in boxes] == [[1, 3], [4, 0]]
    model.check_integrity()


def test_moving_to_the_current_container_changes_nothing() -> None:
    model = Model(METAMODEL)
    box = model.create("Box", content=[model.create("Item")])
    made = engine("rule r(b : Box) { lhs { b -content-> x : Item; } modify { move x to b.content; } }", model=model)
    before = snapshot(model)
    made.apply("r", b=box)
    assert snapshot(model) == before


def test_moving_into_itself_is_refused() -> None:
    model = Model(METAMODEL)
    inner = model.create("Item")
    model.create("Item", kids=[inner])
    made = engine("rule r { lhs { a : Item -kids-> b : Item; } modify { move a to b.kids; } }", model=model)
    refused(made, "containment")


def test_merging_hands_over_links() -> None:
    model = chain(3)  # 0 -> 1 -> 2
    node = model.node
    other = model.create("Item", links=[node(0), node(1)])
    node(0).links.append(other)
    node(2).links.append(other)
    other.kids.append(model.create("Item"))
    made = engine("rule r(a : Item, b : Item) { lhs { } modify { merge a <- b; } }", model=model)
    made.apply("r", a=1, b=other)
    assert other not in model
    assert [n.id for n in node(1).links] == [0, 1]  # the link to node 1 has become a loop
    assert list(node(0).links) == [node(1)] and list(node(2).links) == [node(1)]
    assert [n.id for n in node(1).kids] == [4]
    model.check_integrity()


def test_merging_is_refused_where_a_reference_is_full_or_missing() -> None:
    model = chain(4)
    model.create("Special", favourite=model.node(0))
    made = engine("rule r(a : Item, b : Item) { lhs { } modify { merge a <- b; } }", model=model)
    refused(made, "full", a=0, b=2)
    refused(made, "lost-link", a=3, b=4)


def test_redirecting_gives_an_arrow_another_target() -> None:
    model = chain(3)
    model.node(0).next = None
    model.node(0).links = [model.node(1)]
    made = engine(
        "rule r(c : Item) { lhs { a : Item -links-> b : Item; } modify { redirect a -links-> b to c; } }",
        model=model,
    )
    made.apply("r", c=2)
    assert list(model.node(0).links) == [model.node(2)]


# --- links


def test_an_existing_link_is_not_made_twice() -> None:
    made = engine(
        "rule r { lhs { a : Item -next-> b : Item; } modify { create a -next-> b; create b -prev-> a; } }",
        model=chain(2),
    )
    before = snapshot(made.model)
    assert made.apply("r") is not None
    assert snapshot(made.model) == before


def test_a_link_into_a_full_reference_is_refused() -> None:
    model = chain(3)
    made = engine(
        """
        rule source(a : Item, b : Item) { lhs { } modify { create a -next-> b; set a.n = 99; } }
        rule pair(a : Item, b : Item) { lhs { } modify { create a -pair-> b; } }
        rule one(a : Item) { lhs { b : Item -next-> a; } modify { create c : Item { next = a, n = 4 }; } }
        """,
        model=model,
    )
    error = refused(made, "full", "source", a=0, b=2)
    assert error.message == ("rule `source` cannot be applied: `Item#0` has 1 of at most 1 targets of `next` already")
    refused(made, "full", "one", a=1)  # the opposite is full
    model.node(0).pair = [model.node(1), model.node(2)]
    third = model.create("Item")
    refused(made, "full", "pair", a=0, b=third)


def test_a_link_may_take_the_place_of_one_that_the_rule_removes() -> None:
    made = engine("rule r(c : Item) { lhs { a : Item -next-> b : Item; } rhs { a -next-> c; b; } }", model=chain(2))
    new = made.model.create("Item")
    made.apply("r", c=new)
    assert made.model.node(0).next == new


def test_links_of_the_left_side_can_be_exchanged() -> None:
    model = Model(METAMODEL)
    items = [model.create("Item") for _ in range(4)]
    items[0].next, items[1].next = items[2], items[3]
    made = engine(
        "rule r { lhs { p : Item -next-> a : Item; q : Item -next-> b : Item; } rhs { p -next-> b; q -next-> a; } }",
        model=model,
    )
    made.apply("r", p=0)
    assert items[0].next == items[3] and items[1].next == items[2]


# --- deletion


def test_dpo_refuses_to_leave_dangling_links_and_lists_them() -> None:
    made = engine("rule r(a : Item) { lhs { } modify { delete a; } }", model=chain(3))
    error = refused(made, "dangling", a=1)
    assert error.details == ("`Item#1` -next-> `Item#2`", "`Item#1` -prev-> `Item#0`")
    assert "2 links would be left dangling" in str(error)


@pytest.mark.parametrize("reference", ["links", "friends", "next", "favourite"])
def test_a_link_to_itself_that_is_not_matched_is_left_dangling(reference: str) -> None:
    text = f"""
    rule cut(a : Special) {{ lhs {{ }} modify {{ delete a; }} }}
    rule loop(a : Special) {{ lhs {{ a -{reference}-> a; }} modify {{ delete a; }} }}
    rule whole(a : Item) {{ lhs {{ }} modify {{ delete a; }} }}
    @semantics(spo) rule lossy(a : Special) {{ lhs {{ }} modify {{ delete a; }} }}
    """
    made = engine(text)
    one = made.model.create("Special")
    one[reference] = [one] if reference in ("links", "friends") else one
    with pytest.raises(RuleError) as caught:
        made.apply("cut")
    assert (caught.value.reason, len(caught.value.details)) == ("dangling", 1)
    for rule in ("loop", "lossy"):
        savepoint = made.model.graph.history.savepoint()
        assert made.apply(rule) is not None and not made.model.graph.alive(one.id)
        made.model.graph.history.rollback(savepoint)
    made.model.create("Item", kids=[one])
    assert made.apply("whole", a=1) is not None and len(made.model) == 0  # its parts go with their loops


@pytest.mark.parametrize(
    "rule",
    [
        "rule r(x : Item, y : Item) { lhs { } modify { delete x; delete y; } }",
        "rule r(x : Item, y : Item) { lhs { } modify { delete y; delete x; } }",
        "rule r(x : Item) { lhs { } forall { lhs { y : Item; check y.n == 1; } modify { delete y; } } "
        "modify { delete x; } }",
        "rule r(y : Item) { lhs { } forall { lhs { x : Item; check x.n == 0; } modify { delete x; } } "
        "modify { delete y; } }",
        "rule r { lhs { } forall { lhs { y : Item; check y.n != 2; } modify { delete y; } } modify { } }",
    ],
)
def test_parts_and_containers_are_deleted_in_any_order(rule: str) -> None:
    for second in (False, True):
        model = Model(METAMODEL)
        if second:  # so that the container comes after its parts
            y, z, x = (model.create("Item", n=n) for n in (1, 2, 0))
        else:
            x, y, z = (model.create("Item", n=n) for n in (0, 1, 2))
        x.kids = [y, z]
        y.links = [z, y]
        made = engine(rule, model=model)
        shape = made.prepare("r").shape.names
        assert made.apply("r", bound={name: node for name, node in (("x", x), ("y", y)) if name in shape})
        assert len(model) == 0
        model.check_integrity()


def test_spo_removes_dangling_links() -> None:
    made = engine("@semantics(spo) rule r(a : Item) { lhs { } modify { delete a; } }", model=chain(3))
    made.apply("r", a=1)
    assert made.model.node(0).next is None and made.model.node(2).prev is None
    made.model.check_integrity()


def test_links_of_the_left_side_go_with_their_node() -> None:
    made = engine("rule r { lhs { a : Item -next-> b : Item; } modify { delete b; } }", model=chain(2))
    made.apply("r")
    assert made.model.node(0).next is None


def test_contents_go_with_their_container() -> None:
    model = Model(METAMODEL)
    model.create("Box", content=[model.create("Item", kids=[model.create("Item")])])
    made = engine("rule r { lhs { a : Box; } modify { delete a; } }", model=model)
    made.apply("r")
    assert len(model) == 0


def test_container_and_contents_may_both_be_deleted() -> None:
    model = Model(METAMODEL)
    model.create("Box", content=[model.create("Item")])
    made = engine("rule r { lhs { a : Box -content-> b : Item; } modify { delete a; delete b; } }", model=model)
    made.apply("r")
    assert len(model) == 0


@pytest.mark.parametrize("header", ["", "@semantics(spo)", "@match(homomorphic)"])
def test_preserved_objects_are_not_deleted_with_their_container(header: str) -> None:
    model = Model(METAMODEL)
    inner = model.create("Item")
    outer = model.create("Item", kids=[model.create("Item", kids=[inner])])
    made = engine(
        f"{header} rule r(a : Item, b : Item) {{ lhs {{ }} modify {{ delete a; set b.n += 1; }} }}",
        model=model,
    )
    error = refused(made, "containment", a=outer, b=inner)
    assert "`b` is kept, but would be deleted with its container" in str(error)
    made.apply("r", a=inner, b=outer)
    assert outer.n == 1


def test_blocks_may_not_preserve_contents_of_deleted_containers() -> None:
    model = Model(METAMODEL)
    model.create("Item", kids=[model.create("Item")])
    text = "rule r(a : Item) { lhs { } forall { lhs { find inside(a, b); } %s } modify { delete a; } }"
    inside = "pattern inside(a : Item, b : Item) { Item.kids(a, b); }"
    refused(engine(text % "", inside, model=model), "containment", a=1)
    made = engine(text % "modify { delete b; }", inside, model=model)
    made.apply("r", a=1)
    assert len(model) == 0


def test_the_arrow_of_the_left_side_takes_the_contents_out_of_a_deleted_container() -> None:
    model = Model(METAMODEL)
    model.create("Box", content=[model.create("Item")])
    made = engine("rule r { lhs { a : Box -content-> b : Item; } modify { delete a; } }", model=model)
    made.apply("r")
    assert [node.cls for node in model.nodes()] == ["Item"]


def test_retyping_that_would_lose_links_is_refused_under_dpo_and_loses_them_under_spo() -> None:
    for semantics in ("dpo", "spo"):
        model = chain(1)
        special = model.create("Special", favourite=model.node(0))
        made = engine(
            f"@semantics({semantics}) rule r {{ lhs {{ a : Special; }} modify {{ retype a : Item; }} }}",
            model=model,
        )
        if semantics == "dpo":
            refused(made, "lost-link")
        else:
            made.apply("r")
            assert special.cls == "Item"
        model.check_integrity()


def test_deleted_objects_may_not_be_matched_as_preserved() -> None:
    made = engine(
        """
        @match(homomorphic) rule r { lhs { a : Item; b : Item; } modify { delete a; set b.n = 1; } }
        @match(homomorphic) @semantics(spo) rule both { lhs { a : Item; b : Item; } modify { delete a; } }
        """,
        model=chain(1),
    )
    assert "`a` and `b` are one object, but only `a` is deleted" in str(refused(made, "identification"))
    refused(made, "identification", "both")


def test_a_link_that_is_removed_may_not_be_matched_as_one_that_is_kept() -> None:
    model = chain(2)
    made = engine(
        """
        @hom(b, c) rule r {
            lhs { a : Item -links-> b : Item; a -links-> c : Item; }
            modify { delete a -links-> b; }
        }
        """,
        model=model,
    )
    model.node(0).links = [model.node(1)]
    refused(made, "identification")
    model.node(0).links.append(model.create("Item"))
    made.apply("r", b=1, c=2)
    assert [n.id for n in model.node(0).links] == [2]


def test_variables_that_coincide_may_not_get_two_values() -> None:
    made = engine(
        "@match(homomorphic) rule r { lhs { a : Item; b : Item; } modify { set a.n = 1; set b.n = 2; } }",
        model=chain(1),
    )
    assert "gets two values of `Thing.n`: 1 and 2" in str(refused(made, "ambiguous"))


# --- failing


def test_refused_applications_are_rolled_back() -> None:
    model = chain(3)
    made = engine(
        """
        rule r(a : Item, b : Item, c : Item) {
            lhs { }
            modify {
                create x : Item { n = 4, links = [a] };
                set a.n = 77;
                retype b : Special;
                delete a -next-> b;
                set a.links += c;
                delete c;
            }
        }
        """.replace("set a.links += c;", ""),
        model=model,
    )
    refused(made, "dangling", a=0, b=1, c=2)
    assert model.create("Item").id == 3


def test_a_value_that_cannot_be_computed_leaves_the_model_alone() -> None:
    made = engine("rule r(a : Item) { lhs { } modify { set a.n = 1 / a.n; } }", model=chain(1))
    before = snapshot(made.model)
    with pytest.raises(EvaluationError, match="division by zero"):
        made.apply("r", a=0)
    assert snapshot(made.model) == before


def test_outdated_matches_are_refused() -> None:
    model = chain(3)
    made = engine("rule r { lhs { a : Item -next-> b : Item; } modify { set a.next = none; } }", model=model)
    first, second = made.matches("r")
    made.apply("r", first)
    with pytest.raises(RuleError, match="is not a match any more") as caught:
        made.apply("r", first)
    assert caught.value.reason == "stale-match"
    model.node(1).next = None
    model.graph.delete(2)
    with pytest.raises(RuleError) as caught:
        made.apply("r", second)
    assert caught.value.reason == "stale-match"


def test_without_a_match_nothing_is_applied() -> None:
    assert engine("rule r { lhs { a : Box; } modify { delete a; } }").apply("r") is None


def test_out_parameters_are_found_or_created() -> None:
    made = engine(
        """
        rule r(a : Item, out value : int, out made : Special) {
            lhs { a -next-> b : Item; Item.n(b, value); }
            modify { create made : Special { n = value }; }
        }
        """,
        model=chain(2),
    )
    application = made.apply("r", a=0)
    assert application is not None
    assert application.match.names == ("a", "value", "b")
    assert application.outputs == {"value": 1, "made": application.created["made"]}
    assert application.created["made"].n == 1


def test_a_rule_without_a_right_side_changes_nothing() -> None:
    made = engine("rule r { lhs { a : Item; } }", model=chain(1))
    before = snapshot(made.model)
    assert made.apply("r") is not None
    assert snapshot(made.model) == before


def test_out_parameters_may_be_deleted_by_blocks() -> None:
    made = engine(
        "rule r(out x : Item) { lhs { x : Item; } forall { lhs { x -links-> x; } modify { delete x; } } }",
        model=chain(1),
    )
    made.model.node(0).links.append(made.model.node(0))
    application = made.apply("r", x=0)
    assert application is not None and application.outputs["x"] not in made.model


def test_redirecting_requires_a_link_of_the_named_reference() -> None:
    made = engine(
        """
        rule r(a : Item, b : Item, c : Item) { lhs { find linked(a, b); } modify { redirect a -next-> b to c; } }
        """,
        "pattern linked(from : Item, to : Item) { Item.links(from, to); }",
        model=chain(3),
    )
    made.model.node(0).links = [made.model.node(1), made.model.node(2)]
    error = refused(made, "missing-link", a=0, b=2, c=1)
    assert error.details == ("`Item#0` -next-> `Item#2`",)
    made.model.node(1).next = None
    made.apply("r", a=0, b=1, c=2)
    assert made.model.node(0).next == made.model.node(2)


def test_an_object_in_a_container_is_not_created_in_another() -> None:
    model = Model(METAMODEL)
    item = model.create("Item")
    old, new = model.create("Box", content=[item]), model.create("Box")
    made = engine(
        """
        rule make(b : Box, i : Item) { lhs { } modify { create b -content-> i; } }
        rule literal(i : Item) { lhs { } modify { create b : Box { content = i, must = i }; } }
        rule shown(b : Box) { lhs { a : Box -content-> i : Item; } rhs { b -content-> i; a; } }
        rule put(b : Box, i : Item) { lhs { } modify { set b.content += i; } }
        """,
        model=model,
    )
    error = refused(made, "full", "make", b=new, i=item)
    assert "`Item#0` is contained in `Box#1` already" in str(error)
    assert error.details == ("`Box#1` -content-> `Item#0`",)
    refused(made, "full", "literal", i=item)
    made.apply("make", b=old, i=item)
    made.apply("shown", b=new)
    assert list(new.content) == [item]
    made.apply("put", b=old, i=item)
    assert list(old.content) == [item] and not new.content


def test_adding_a_target_releases_its_opposite() -> None:
    model = Model(METAMODEL)
    kid = model.create("Item")
    old, new = model.create("Item", kids=[kid]), model.create("Item")
    made = engine("rule r(a : Item, b : Item) { lhs { } modify { set a.kids += b; } }", model=model)
    made.apply("r", a=new, b=kid)
    assert list(new.kids) == [kid] and not old.kids
    model.check_integrity()


def test_created_objects_can_be_moved_and_merged_into() -> None:
    made = engine(
        """
        rule move(x : Item) { lhs { } modify { create y : Item; move y to x.kids; } }
        rule merge(x : Item) { lhs { } modify { create y : Special; merge y <- x; } }
        rule cycle { lhs { } modify { create y : Item; move y to y.kids; } }
        rule pack(x : Item) { lhs { } modify { create y : Box; move x to y.content; } }
        """,
        model=chain(2),
    )
    model = made.model
    made.apply("move", x=0)
    assert [node.id for node in model.node(0).kids] == [2]
    made.apply("merge", x=0)
    special = model.node(3)
    assert special.next == model.node(1) and list(special.kids) == [model.node(2)]
    refused(made, "containment", "cycle")
    application = made.apply("pack", x=2)
    assert application is not None and list(application.created["y"].content) == [model.node(2)]
    assert not special.kids
    model.check_integrity()


def test_merging_with_the_container_takes_its_place() -> None:
    model = Model(METAMODEL)
    inner = model.create("Item")
    middle = model.create("Item", kids=[inner])
    outer = model.create("Item", kids=[middle])
    made = engine("rule r(x : Item, y : Item) { lhs { } modify { merge x <- y; } }", model=model)
    made.apply("r", x=inner, y=middle)
    assert list(outer.kids) == [inner]
    model.check_integrity()


def test_merging_hands_loops_over_last() -> None:
    model = chain(2)
    model.node(1).next = model.node(1)
    model.node(0).next = model.node(1)
    model.node(1).next = None
    second = model.node(1)
    made = engine("rule r(x : Item, y : Item) { lhs { } modify { merge x <- y; } }", model=model)
    made.apply("r", x=0, y=second)
    assert model.node(0).next == model.node(0)
    model.check_integrity()


def test_a_merged_object_keeps_links_that_its_class_may_have_at_both_ends() -> None:
    model = Model(METAMODEL)
    special, box = model.create("Special"), model.create("Box", must=model.create("Item"))
    holder = model.create("Special", favourite=special)
    made = engine(
        """
        rule r(x : Box, y : Item) { lhs { } modify { merge x <- y; } }
        @semantics(spo) rule lose(x : Box, y : Item) { lhs { } modify { merge x <- y; } }
        """,
        model=model,
    )
    refused(made, "lost-link", x=box, y=special)
    made.apply("lose", x=box, y=special)
    assert holder.favourite is None and special not in model
    model.check_integrity()


def test_increasing_by_a_missing_value_is_an_error() -> None:
    made = engine("rule r(a : Item) { lhs { } modify { set a.weight -= a.next.weight; } }", model=chain(1))
    with pytest.raises(EvaluationError, match=r"rule `r` cannot be applied: `weight` has no value"):
        made.apply("r", a=0)


def test_blocks_do_not_match_what_the_rule_deletes_as_something_else() -> None:
    made = engine(
        """
        @match(homomorphic) rule r {
            lhs { x : Item; }
            forall { lhs { y : Item; } modify { create z : Item { n = y.n }; } }
            modify { delete x; }
        }
        """,
        model=chain(1),
    )
    assert "`x` and `y` are one object, but only `x` is deleted" in str(refused(made, "identification"))


def test_interrupted_applications_leave_no_savepoint(monkeypatch: pytest.MonkeyPatch) -> None:
    model = chain(2)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(type(model.graph), "link", interrupted)
    made = engine("rule r(a : Item) { lhs { } modify { create b : Box; move a to b.content; } }", model=model)
    before = snapshot(model)
    with pytest.raises(KeyboardInterrupt):
        made.apply("r", a=0)
    assert not model.graph.history.savepoint_depth and snapshot(model) == before


def test_links_that_are_made_again_are_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    model = chain(3)
    model.node(0).links.append(model.node(1))
    made = engine(
        """
        rule one { lhs { a : Item -next-> b : Item; } modify { create a -links-> b; } }
        rule all(a : Item) { lhs { } forall { lhs { a -next-> b; } modify { create b -prev-> a; } } }
        rule new { lhs { a : Item; } modify { create a -links-> b : Item -friends-> c : Item; } }
        """,
        model=model,
    )
    before = snapshot(model)
    for _ in range(3):
        made.apply("one", a=0)
    made.apply("all", a=1)
    assert snapshot(model) == before
    made.apply("new", a=0)
    assert [notice.code for notice in made.notices] == ["existing-link", "existing-link"]
    first, second = made.notices
    assert first.message == "rule `one` creates `Item#0` -links-> `Item#1`, which exists already"
    assert first.span is not None and first.span.text == "a -links-> b"
    assert "`all` creates `Item#2` -prev-> `Item#1`" in second.message
    assert [record.getMessage() for record in caplog.records] == [str(first), str(second)]
    made.apply("one", a=1)
    assert len(made.notices) == 2 and made.model.node(2) in made.model.node(1).links


def test_what_a_merged_object_has_leaves_it_before_anything_is_linked() -> None:
    model = Model(METAMODEL)
    inner = model.create("Item")
    outer = model.create("Item", kids=[inner])
    made = engine(
        """
        rule r(a : Item, b : Item) {
            lhs { a -kids-> b; }
            forall { lhs { check a.n == 0; } modify { merge fresh <- a; } }
            modify { create fresh : Item -kids-> b; }
        }
        """,
        model=model,
    )
    application = made.apply("r", a=outer, b=inner)
    assert application is not None and list(application.created["fresh"].kids) == [inner]
    assert outer not in model
    model.check_integrity()


def test_objects_that_are_linked_to_each_other_are_merged_into_one() -> None:
    made = engine(
        "rule r(c : Item) { lhs { a : Item -next-> b : Item; } modify { merge c <- a; merge c <- b; } }",
        model=chain(3),
    )
    made.model.node(1).next = None
    made.apply("r", c=2)
    assert [(node.id, node.next) for node in made.model.nodes()] == [(2, made.model.node(2))]


def test_merging_asks_what_the_other_ends_have_become() -> None:
    model = Model(METAMODEL)
    kept = model.create("Item")
    text = "rule r(a : Item) {{ lhs {{ b : Item -next-> c : Item; }} modify {{ merge a <- b; retype c : Box; }} }}"
    other = model.create("Item")
    model.create("Item", next=other)
    refused(engine(text.format(), model=model), "lost-link", a=kept)
    made = engine("@semantics(spo) " + text.format(), model=model)
    made.apply("r", a=kept)
    assert other.cls == "Box" and kept.next is None
    model.check_integrity()


def test_deleting_comes_before_merging_whatever_the_block() -> None:
    model = chain(2)
    kept = model.create("Item")
    text = """
        rule r(a : Item, b : Item) {
            lhs { }
            forall { lhs { b : Special; } modify { set b.n = 1; } }
            forall { lhs { b -next-> c; } not { c : Special; } modify { merge a <- b; } }
            forall { lhs { d : Item; check d.n == 1; } modify { delete d; } }
        }
        """
    refused(engine(text, model=model), "dangling", a=kept, b=0)
    made = engine("@semantics(spo) " + text, model=model)
    made.apply("r", a=kept, b=0)
    assert [node.id for node in model.nodes()] == [kept.id] and kept.next is None
    model.check_integrity()


def test_everything_leaves_its_container_before_anything_enters_another() -> None:
    def family() -> Model:
        model = Model(METAMODEL)
        kid = model.create("Item")
        model.create("Item", kids=[model.create("Item", kids=[kid])])
        return model  # 0 in 1 in 2

    actions = {
        "turn": "set b.parent = a; set a.parent = none;",
        "back": "set a.parent = none; set b.parent = a;",
        "moved": "move b to a.kids; set a.parent = none;",
        "listed": "set a.kids = [b]; set b.kids = [];",
        "taken": "set b.kids -= a; create a -kids-> b;",
        "added": "set a.kids += b; set b.kids -= a;",
    }
    for name, body in actions.items():
        model = family()
        free = "delete c -kids-> b;" if name == "taken" else ""
        text = f"rule {name}(a : Item, b : Item, c : Item) {{ lhs {{ c -kids-> b; }} modify {{ {body} {free} }} }}"
        made = engine(text, model=model)
        made.apply(name, a=0, b=1, c=2)
        node = model.node
        assert (node(1).parent, node(0).parent, list(node(2).kids)) == (node(0), None, []), name
        model.check_integrity()


def test_taking_a_target_away_leaves_it_in_another_container() -> None:
    model = Model(METAMODEL)
    kid, other = model.create("Item"), model.create("Item")
    holder = model.create("Item", kids=[kid])
    made = engine(
        "rule r(a : Item, k : Item, o : Item) { lhs { } modify { set a.kids -= k; set a.kids += o; } }",
        model=model,
    )
    empty = model.create("Item")
    made.apply("r", a=empty, k=kid, o=other)
    assert list(holder.kids) == [kid] and list(empty.kids) == [other]


def test_blocks_that_retype_refuse_what_the_old_class_had() -> None:
    made = engine(
        """
        rule r(a : Item) {
            lhs { }
            forall { lhs { check a.n == 0; } modify { retype a : Box; } }
            modify { set a.next = a.prev; }
        }
        """,
        model=chain(1),
    )
    error = refused(made, "ambiguous", a=0)
    assert "`Item#0` is retyped to `Box`, but another change needs class `Item`" in str(error)


def test_check_reports_rules_without_bound_variables() -> None:
    made = engine(queries="pattern alone(x : Item) { neg Item.links(x, _); Item(x); }")
    found = made.check(
        *definitions("rule r { lhs { x != y; } optional { lhs { find alone(x); } modify { delete x; } } }")
    )
    assert {problem.code for problem in found} == {"not-enumerable"} and all(problem.span for problem in found)
