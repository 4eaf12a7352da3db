"""What a left side matches: the tuple, injectivity, context, conditions."""

from __future__ import annotations

import pytest

from envgraph.errors import InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import Model
from tests.unit.rewrite.graphs import METAMODEL, chain, engine

LINKED = """
pattern linked(from : Item, to : Item) { Item.links(from, to); }
pattern size(n : int) { n == count Item(_); }
"""


def rows(found: list) -> list[tuple]:
    return sorted(match.row for match in found)


def test_a_match_is_parameters_then_named_variables_without_those_of_blocks() -> None:
    made = engine(
        """
        rule r(b : Item) {
            lhs { a : Item -next-> b; find size(total); check total > 1; a -links-> _; }
            not { c : Item -prev-> a; d : Special; }
        }
        """,
        LINKED,
    )
    assert made.prepare("r").shape.names == ("b", "a", "total")


def test_variables_only_in_negations_are_not_in_the_match() -> None:
    made = engine("rule r { lhs { a : Item; neg find linked(a, b); } }", LINKED)
    assert made.prepare("r").shape.names == ("a",)


def test_objects_of_a_match_are_different() -> None:
    model = chain(1)
    model.node(0).next = model.node(0)
    made = engine("rule r { lhs { a : Item -next-> b : Item; } }", model=model)
    assert made.matches("r") == []


def test_values_of_a_match_may_be_equal() -> None:
    model = chain(2)
    model.node(0).n = model.node(1).n = 5
    made = engine("rule r { lhs { a : Item -next-> b : Item; Item.n(a, x); Item.n(b, y); } }", model=model)
    assert rows(made.matches("r")) == [(0, 1, 5, 5)]


def test_parameters_count_among_the_different_objects() -> None:
    made = engine("rule r(a : Item) { lhs { b : Item; } }", model=chain(2))
    assert rows(made.matches("r")) == [(0, 1), (1, 0)]


def test_called_patterns_stay_homomorphic() -> None:
    model = chain(1)
    model.node(0).links.append(model.node(0))
    made = engine(
        "rule outside { lhs { a : Item; find loop(a); } } rule inside { lhs { find linked(a, b); } }",
        LINKED + "pattern loop(x : Item) { Item.links(x, y); Item.links(y, x); }",
        model=model,
    )
    assert rows(made.matches("outside")) == [(0,)]
    assert made.matches("inside") == []


def test_homomorphic_rules_let_objects_coincide() -> None:
    model = chain(2)
    made = engine(
        """
        @match(homomorphic) rule all { lhs { a : Item; b : Item; } }
        @hom(a, b) rule some { lhs { a : Item; b : Item; c : Item; } }
        """,
        model=model,
    )
    assert rows(made.matches("all")) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert rows(made.matches("some")) == [(0, 0, 1), (1, 1, 0)]


def test_variables_that_are_equated_may_coincide() -> None:
    made = engine("rule r { lhs { a : Item; b : Item; a == b; } }", model=chain(2))
    assert rows(made.matches("r")) == [(0, 0), (1, 1)]


def test_variables_of_a_block_differ_from_the_enclosing_ones() -> None:
    model = chain(2)
    model.node(0).links.append(model.node(0))
    made = engine("rule r { lhs { a : Item; } not { a -links-> b; } }", model=model)
    assert rows(made.matches("r")) == [(0,), (1,)]
    model.node(0).links.append(model.node(1))
    assert rows(made.matches("r")) == [(1,)]


def test_conditions_can_be_nested() -> None:
    # An item all of whose links lead to something with a next.
    text = "rule r { lhs { a : Item; } not { a -links-> b : Item; not { b -next-> c : Item; } } }"
    model = Model(METAMODEL)
    items = [model.create("Item") for _ in range(4)]
    made = engine(text, model=model)
    items[0].links = [items[1]]
    items[1].next = items[2]
    items[2].links = [items[3]]
    assert rows(made.matches("r")) == [(0,), (1,), (3,)]


def test_require_asks_for_something_without_adding_it_to_the_match() -> None:
    model = chain(3)
    made = engine("rule r { lhs { a : Item; } require { a -next-> b : Item; b -next-> c : Item; } }", model=model)
    assert rows(made.matches("r")) == [(0,)]


def test_blocks_see_values_of_the_match() -> None:
    model = chain(3)
    made = engine("rule r { lhs { a : Item; Item.n(a, x); } not { b : Item; check b.n > x; } }", model=model)
    assert rows(made.matches("r")) == [(2, 2)]


def test_arrows_may_be_closures() -> None:
    made = engine("rule r { lhs { a : Item -next+-> b : Item; } }", model=chain(3))
    assert rows(made.matches("r")) == [(0, 1), (0, 2), (1, 2)]


def test_arrows_may_be_written_backwards() -> None:
    made = engine("rule r { lhs { a : Item <-next- b : Item; } }", model=chain(2))
    assert rows(made.matches("r")) == [(1, 0)]


def test_arguments_bind_any_part_of_the_match() -> None:
    made = engine("rule r { lhs { a : Item -next-> b : Item; Item.n(b, x); } }", model=chain(3))
    node = made.model.node
    assert rows(made.matches("r", a=node(1))) == [(1, 2, 2)]
    assert rows(made.matches("r", b=1)) == [(0, 1, 1)]
    assert rows(made.matches("r", x=2)) == [(1, 2, 2)]
    assert made.count("r") == 2
    assert made.exists("r", a=0, b=1) and not made.exists("r", a=0, b=2)
    assert made.first("r", x=9) is None


def test_parameters_that_are_not_enumerated_must_be_given() -> None:
    made = engine(
        """
        rule above(limit : int) { lhs { a : Item; check a.n > limit; } }
        rule put(a : Item, value : int) { lhs { } modify { set a.n = value; } }
        """,
        model=chain(3),
    )
    assert rows(made.matches("above", limit=1)) == [(1, 2)]
    with pytest.raises(InvalidArgument, match="needs values for `limit`"):
        made.matches("above")
    made.apply("put", a=0, value=40)
    assert made.model.node(0).n == 40


def test_an_object_of_another_class_has_no_match() -> None:
    model = chain(2)
    made = engine("rule r(s : Special) { lhs { } }", model=model)
    assert made.matches("r", s=0) == []


def test_an_alias_may_be_what_the_name_may_be_that_it_stands_for() -> None:
    made = engine(
        """
        @hom(a, b) rule some(out c : Item) { lhs { a : Item; b : Item; c == a; } }
        @hom(a, b) rule chained(out d : Item) { lhs { a : Item; b : Item; c : Item; c == a; d == c; } }
        rule none(out c : Item) { lhs { a : Item; b : Item; c == a; } }
        @hom(a, d) rule inside(out c : Item) {
            lhs { a : Item; c == a; }
            forall { lhs { d : Item; } modify { set d.n = 7; } }
        }
        @hom(a, d) rule deleted(out c : Item) { lhs { a : Item; d : Item; c == d; } modify { delete a; set d.n = 1; } }
        """,
        model=chain(1),
    )
    assert [made.count(name) for name in ("some", "chained", "none", "inside")] == [1, 1, 0, 1]
    assert made.apply("inside") is not None and made.model.node(0).n == 7
    with pytest.raises(RuleError) as caught:
        made.apply("deleted")
    assert caught.value.reason == "identification"


def test_wrong_arguments_are_refused() -> None:
    made = engine("rule r { lhs { first : Item; Item.label(first, text); } }", model=chain(2))
    with pytest.raises(InvalidArgument, match="did you mean `first`"):
        made.matches("r", frist=0)
    with pytest.raises(TypeMismatch, match="`text` of `r` takes `string`, not 3"):
        made.matches("r", text=3)
    with pytest.raises(TypeMismatch, match="takes a `Item`, not 'x'"):
        made.matches("r", first="x")
    with pytest.raises(InvalidArgument, match="another model"):
        made.matches("r", first=chain(1).node(0))


def test_a_rule_without_a_left_side_matches_once() -> None:
    made = engine("rule r { lhs { } modify { create x : Item; } }")
    assert rows(made.matches("r")) == [()]
    assert rows(made.matches("r")) == [()]


def test_a_node_of_a_block_may_be_an_enclosing_one() -> None:
    model = chain(1)
    model.create("Special")
    made = engine("rule r { lhs { a : Item; } not { a : Special; } }", model=model)
    assert rows(made.matches("r")) == [(0,)]


def test_anonymous_ends_match_anything() -> None:
    made = engine("rule r { lhs { a : Item -next-> _; } }", model=chain(3))
    assert rows(made.matches("r")) == [(0,), (1,)]


def test_a_nameless_object_may_have_a_class_and_more_than_one_arrow() -> None:
    model = chain(4)
    model.node(2).links = [model.create("Special"), model.create("Special")]
    made = engine(
        """
        rule typed { lhs { a : Item -links-> _ : Special; } modify { } }
        rule between { lhs { a : Item -next-> _ -next-> b; } modify { } }
        rule both { lhs { a : Item -next-> _ : Item; a -prev-> _ : Item; } modify { } }
        rule none { lhs { a : Item; } not { a -next-> _ : Item -next-> _; } modify { } }
        """,
        model=model,
    )
    assert rows(made.matches("typed")) == [(2,)]
    assert rows(made.matches("between")) == [(0, 2), (1, 3)]
    assert rows(made.matches("both")) == [(1,), (2,)]
    assert rows(made.matches("none")) == [(2,), (3,), (4,), (5,)]


def test_anonymous_objects_may_equal_other_objects() -> None:
    model = chain(1)
    model.node(0).next = model.node(0)
    made = engine("rule r { lhs { a : Item -next-> _ -next-> _ : Item; } modify { } }", model=model)
    assert rows(made.matches("r")) == [(0,)]


def test_reflexive_closures_may_end_at_their_start() -> None:
    model = chain(2)
    special = model.create("Special")
    made = engine(
        """
        rule arrow { lhs { x : Item -favourite*-> y; } modify { } }
        rule path { lhs { x : Special; Special.favourite*(x, y); } modify { } }
        rule block { lhs { x : Special -favourite*-> x; } not { y : Item; } modify { } }
        """.replace("rule arrow { lhs { x : Item", "rule arrow { lhs { x : Special"),
        model=model,
    )
    assert made.matches("arrow") == [] and made.matches("path") == [] and made.matches("block") == []
    special.favourite = model.node(0)
    assert rows(made.matches("arrow")) == rows(made.matches("path")) == [(special.id, 0)]


def test_conditions_and_blocks_nest_deeply() -> None:
    opened = "".join(f"not {{ x{level} -next-> x{level + 1} : Item; " for level in range(60))
    made = engine(f"rule r {{ lhs {{ x0 : Item; }} {opened}{'}' * 60} modify {{ }} }}", model=chain(5))
    assert rows(made.matches("r")) == [(0,), (2,), (4,)]
    deep = "".join(f"forall {{ lhs {{ x{level} -next-> x{level + 1}; }} " for level in range(40))
    made = engine(
        f"rule r {{ lhs {{ x0 : Item; }} {deep} modify {{ set x40.done = true; }} {'}' * 40} }}",
        model=chain(42),
    )
    made.apply("r", x0=1)
    assert [node.id for node in made.model.nodes() if node.done] == [41]


def test_a_rule_says_why_it_cannot_be_applied_at_its_match() -> None:
    made = engine(
        """
        rule drop(a : Item) { lhs { a -next-> b; } modify { delete a; } }
        rule halve(a : Item) { lhs { } modify { set a.n = 1 / a.n; } }
        """,
        model=chain(3),
    )
    before = made.model.state_hash()
    why = made.why_not("drop", a=1)
    assert str(why).splitlines() == [
        "`drop` for a = `Item#1` has a match: a = `Item#1`, b = `Item#2`",
        "test.rules:2:60: rule `drop` cannot be applied: `Item#1` cannot be deleted: 1 link would be left dangling",
        " 2 | rule drop(a : Item) { lhs { a -next-> b; } modify { delete a; } }",
        "   |                                                            ^",
        "note: `Item#1` -prev-> `Item#0`",
        "hint: also delete these links, or write `@semantics(spo)` before the rule to delete them as well",
    ]
    assert isinstance(why.refusal, RuleError) and why.refusal.reason == "dangling"
    assert made.why_not("drop", a=0).refusal is None
    assert made.why_not("drop", a=2).match is None
    assert "division by zero" in str(made.why_not("halve", a=0))
    assert made.model.state_hash() == before and not made.model.graph.history.savepoint_depth
