"""What each construct of a query means, by hand, on every matcher."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from envgraph.pattern import (
    Check,
    Conditional,
    Constant,
    EnumLiteral,
    FunctionCall,
    Navigation,
    PathConstraint,
    Pattern,
    Relation,
    Variable,
)
from tests.oracle.naive._naive import NaiveMatcher
from tests.unit.match.kinds import KINDS, Kind, assert_sound
from tests.unit.match.people import World
from tests.unit.match.writing import check, equal, find, fold, is_a, neg, op, path, pattern, unequal, v, value

Make = Callable[..., World]


@pytest.fixture(params=KINDS.values(), ids=KINDS)
def world(request: pytest.FixtureRequest) -> Iterator[Make]:
    kind: Kind = request.param
    made: list[World] = []

    def make(*patterns: Pattern) -> World:
        made.append(World(kind, *patterns))
        return made[-1]

    yield make
    for each in made:
        assert_sound(each.matcher)


def names(*texts: str) -> set[tuple[object, ...]]:
    """`names("ada bob")` is the row ada, bob."""
    return {tuple(text.split()) for text in texts}


KNOWS = pattern("knows(a : Person, b : Person)", [path("Person.knows", "a", "b")])
BOSS = pattern("boss(a : Person, b : Person)", [path("Person.boss", "a", "b")])


# --- types


def test_a_class_has_the_objects_of_its_subclasses(world: Make) -> None:
    w = world(pattern("p(x : Person)", [is_a("Person", "x")]), pattern("q(x : Chief)", [is_a("Chief", "x")]))
    assert w.rows("p") == names("ada", "bob", "cyd", "dan")
    assert w.rows("q") == names("ada")


def test_an_exact_type_leaves_subclasses_out(world: Make) -> None:
    w = world(pattern("p(x : Person)", [is_a("Person", "x", exact=True)]))
    assert w.rows("p") == names("bob", "cyd", "dan")
    assert w.rows("p", "ada") == set()
    assert w.rows("p", "bob") == names("bob")


def test_the_type_of_a_parameter_constrains_every_body(world: Make) -> None:
    w = world(pattern("p(x : Chief)", [path("Person.knows", "x", "_")], [path("Person.boss", "_", "x")]))
    assert w.rows("p") == names("ada")


def test_a_class_without_objects_has_no_matches(world: Make) -> None:
    w = world(
        pattern("p(x : Ghost)", [is_a("Ghost", "x")]),
        pattern("q(x : Person)", [is_a("Person", "x"), neg(is_a("Ghost", "_"))]),
    )
    assert w.rows("p") == set()
    assert len(w.rows("q")) == 4


# --- paths


def test_an_attribute_has_one_value(world: Make) -> None:
    w = world(pattern("p(x : Person, n : int)", [path("Person.age", "x", "n")]))
    assert w.rows("p") == {("ada", 50), ("bob", 30), ("cyd", 30), ("dan", 20)}
    assert w.rows("p", ..., 30) == {("bob", 30), ("cyd", 30)}
    assert w.rows("p", "bob", 20) == set()


def test_an_attribute_without_a_value_has_no_tuple(world: Make) -> None:
    w = world(
        pattern("p(x : Person, n : int)", [path("Person.age", "x", "n")]),
        pattern("q(x : Person)", [neg(path("Person.age", "x", "_"))]),
    )
    w.model["bob"].age = None
    assert ("bob", 30) not in w.rows("p")
    assert w.rows("q") == names("bob")


def test_constants_are_compared_at_the_type_of_the_attribute(world: Make) -> None:
    w = world(
        pattern("p(x : Person)", [path("Person.pay", "x", 4)]),
        pattern("q(x : Person)", [path("Person.mood", "x", EnumLiteral("Mood", "cross"))]),
        pattern(
            "r(x : Person, m : Mood)",
            [path("Person.mood", "x", "m"), unequal("m", EnumLiteral("Mood", "calm"))],
        ),
    )
    assert w.rows("p") == names("bob", "dan")
    assert w.rows("q") == names("ada")
    assert w.rows("r") == {("ada", "cross")}


def test_links_are_found_from_either_end(world: Make) -> None:
    w = world(KNOWS, BOSS)
    assert w.rows("knows") == names("ada bob", "bob cyd", "cyd ada", "dan dan")
    assert w.rows("knows", "bob", ...) == names("bob cyd")
    assert w.rows("knows", ..., "bob") == names("ada bob")
    assert w.rows("knows", "ada", "cyd") == set()
    assert w.rows("boss", ..., "ada") == names("bob ada", "cyd ada")


def test_opposites_hold_the_same_links(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [path("Person.staff", "a", "b")]))
    assert w.rows("p") == names("ada bob", "ada cyd", "bob dan")


def test_paths_project_intermediate_objects_away(world: Make) -> None:
    w = world(pattern("p(a : Person, n : int)", [path("Person.boss.boss.age", "a", "n")]))
    assert w.rows("p") == {("dan", 50)}


def test_repeated_variables_join_relations(world: Make) -> None:
    w = world(
        pattern("self(x : Person)", [path("Person.knows", "x", "x")]),
        pattern("call(x : Person)", [find("knows", "x", "x")]),
        pattern(
            "triangle(x : Person)",
            [find("knows", "x", "y"), find("knows", "y", "z"), find("knows", "z", "x")],
        ),
        KNOWS,
    )
    assert w.rows("self") == w.rows("call") == names("dan")
    assert w.rows("triangle") == names("ada", "bob", "cyd", "dan")


def test_a_variable_may_repeat_in_a_call_that_is_searched_for_it(world: Make) -> None:
    near = [path("Person.boss", "a", "b")], [path("Person.knows", "a", "b")]
    w = world(
        pattern("near(a : Person, b : Person)", *near),
        pattern(
            "near3(a : Person, b : Person, c : Person)",
            *(([*b, path("Person.knows", "b", "c")]) for b in near),
        ),
        pattern("far(a : Person, b : Person)", *near, [find("near", "a", "c"), find("far", "c", "b")]),
        pattern("p(x : Person)", [find("near", "x", "x")]),
        pattern("q(x : Person)", [find("near3", "x", "x", "x")]),
        pattern("r(x : Person)", [find("far", "x", "x")]),
        pattern("s(x : Person)", [find("near+", "x", "x")]),
        pattern("t(n : int)", [equal("n", fold("count", find("near3", "x", "x", "_")))]),
    )
    assert w.rows("p") == w.rows("q") == names("dan")
    assert w.rows("r") == w.rows("s") == names("ada", "bob", "cyd", "dan")
    assert w.rows("t") == {(1,)}


def test_matches_are_not_injective(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [path("Person.boss", "a", "c"), path("Person.boss", "b", "c")]))
    assert w.rows("p") == names("bob bob", "bob cyd", "cyd bob", "cyd cyd", "dan dan")


# --- projection, bodies and calls


def test_projected_matches_are_reported_once(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [path("Person.staff", "a", "b")]),
        pattern("n(n : int)", [path("Person.age", "_", "n")]),
    )
    assert w.rows("p") == names("ada", "bob")
    assert w.rows("n") == {(50,), (30,), (20,)}
    assert w.matcher.count("p", w.arguments("p", ...)) == 2


def test_matches_are_the_union_of_all_bodies(world: Make) -> None:
    w = world(
        pattern("p(a : Person, b : Person)", [find("knows", "a", "b")], [path("Person.boss", "b", "a")]),
        KNOWS,
    )
    assert w.rows("p") == names("ada bob", "bob cyd", "cyd ada", "dan dan", "ada cyd", "bob dan")


def test_bodies_that_differ_in_constants_are_both_evaluated(world: Make) -> None:
    w = world(
        pattern(
            "p(a : Person, n : int)",
            [is_a("Chief", "a"), equal("n", 1)],
            [is_a("Person", "a"), equal("n", 2)],
        )
    )
    assert w.rows("p", "ada", ...) == {("ada", 1), ("ada", 2)}
    assert w.rows("p", ..., 1) == {("ada", 1)}
    assert w.rows("p", "bob", 1) == set()


def test_a_called_pattern_is_a_relation_over_its_parameters(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [find("both", "a", "_", 30)]),
        pattern(
            "both(a : Person, b : Person, n : int)",
            [path("Person.knows", "a", "b"), path("Person.age", "b", "n")],
        ),
    )
    assert w.rows("p") == names("ada", "bob")


def test_a_pattern_may_have_no_parameters(world: Make) -> None:
    w = world(pattern("some()", [is_a("Person", "_")]), pattern("none()", [is_a("Ghost", "_")]))
    assert w.rows("some") == {()}
    assert w.rows("none") == set()
    assert w.matcher.exists("some", ())
    assert w.matcher.count("some", ()) == 1


# --- comparison


def test_equated_variables_have_one_value(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [path("Person.knows", "a", "c"), equal("b", "c")]))
    assert w.rows("p") == names("ada bob", "bob cyd", "cyd ada", "dan dan")


def test_parameters_may_be_united(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [is_a("Person", "a"), equal("a", "b")]))
    assert w.rows("p") == names("ada ada", "bob bob", "cyd cyd", "dan dan")
    assert w.rows("p", ..., "bob") == w.rows("p", "bob", "bob") == names("bob bob")
    assert w.rows("p", "bob", "cyd") == set()


def test_unequal_variables_have_different_values(world: Make) -> None:
    w = world(
        pattern(
            "p(a : Person, b : Person)",
            [path("Person.boss", "a", "_"), path("Person.knows", "a", "b"), unequal("a", "b")],
        )
    )
    assert w.rows("p") == names("bob cyd", "cyd ada")


# --- expressions


def test_checks_filter_matches(world: Make) -> None:
    w = world(
        pattern(
            "p(a : Person)",
            [path("Person.age", "a", "n"), path("Person.pay", "a", "m"), check("n", ">", op("m", "*", 7))],
        )
    )
    assert w.rows("p") == names("bob")


def test_an_expression_without_a_value_does_not_hold(world: Make) -> None:
    divided = op(1, "/", op("n", "-", 30))
    w = world(
        pattern("p(a : Person)", [path("Person.age", "a", "n"), check(divided, "<=", 0)]),
        pattern("q(a : Person, m : int)", [path("Person.age", "a", "n"), equal("m", value(divided))]),
    )
    assert w.rows("p") == names("ada", "dan")
    assert w.rows("q") == {("ada", 0), ("dan", 0)}


def test_paths_in_checks_must_have_values(world: Make) -> None:
    older = op(Navigation(Navigation(v("a"), "boss"), "age"), ">", 40)
    w = world(
        pattern("p(a : Person)", [Check(older)]),
        pattern("q(a : Person)", [Check(op(older, "||", op(1, "==", 1)))]),
        pattern("r(a : Person)", [check(Navigation(v("a"), "boss"), "==", None)]),
        pattern("s(a : Person)", [check(Navigation(v("a"), "boss"), "!=", None)]),
    )
    assert w.rows("p") == names("bob", "cyd")
    assert w.rows("q") == names("bob", "cyd", "dan")
    assert w.rows("r") == names("ada")
    assert w.rows("s") == names("bob", "cyd", "dan")


def test_eval_binds_its_value(world: Make) -> None:
    half = Conditional(op("n", ">", 30), op("n", "/", 2), FunctionCall("min", (Variable("n"), Constant(25))))
    w = world(pattern("p(a : Person, m : int)", [path("Person.age", "a", "n"), equal("m", value(half))]))
    assert w.rows("p") == {("ada", 25), ("bob", 25), ("cyd", 25), ("dan", 20)}
    assert w.rows("p", ..., 20) == {("dan", 20)}


def test_literals_that_compare_equal_are_kept_apart(world: Make) -> None:
    w = world(
        pattern("ints(x : int)", [path("Person.age", "_", "n"), equal("x", value(op(op("n", "/", 100), "+", 1)))]),
        pattern(
            "floats(x : float)",
            [path("Person.age", "_", "n"), equal("x", value(op(op("n", "/", 100.0), "+", 1)))],
        ),
    )
    assert w.rows("ints") == {(1,)}
    assert w.rows("floats") == {(1.5,), (1.3,), (1.2,)}


# --- negation


def test_negation_requires_the_absence_of_matches(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [neg(path("Person.boss", "a", "_"))]),
        pattern("q(a : Person)", [neg(is_a("Chief", "a"))]),
        pattern("r(a : Person, b : Person)", [path("Person.boss", "a", "b"), neg(find("knows", "b", "a"))]),
        KNOWS,
    )
    assert w.rows("p") == names("ada")
    assert w.rows("q") == names("bob", "cyd", "dan")
    assert w.rows("r") == names("cyd ada", "dan bob")


def test_a_variable_used_only_in_a_negation_is_free_inside(world: Make) -> None:
    w = world(pattern("p(a : Person)", [neg(find("knows", "x", "x")), is_a("Person", "a")]), KNOWS)
    assert w.rows("p") == set()
    w.model["dan"].knows.remove(w.model["dan"])
    assert len(w.rows("p")) == 4


@pytest.mark.parametrize("wrong", [is_a("Person", "n"), path("Person.knows", "n", "_"), find("knows", "n", "_")])
def test_numbers_never_match_objects(world: Make, wrong: Relation) -> None:
    """The number of chiefs is also the id of Bob, who knows Cyd."""
    w = world(
        KNOWS,
        pattern("none(n : int)", [equal("n", fold("count", is_a("Chief", "_"))), neg(wrong)]),
        pattern(
            "zero(n : int, z : int)",
            [equal("n", fold("count", is_a("Chief", "_"))), equal("z", fold("count", wrong))],
        ),
    )
    assert w.id("bob") == 1
    assert w.rows("none") == {(1,)}
    assert w.rows("zero") == {(1, 0)}


def test_a_negated_pattern_may_have_several_bodies_and_locals(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [neg(find("linked", "a"))]),
        pattern(
            "linked(a : Person)",
            [path("Person.staff", "a", "b"), is_a("Person", "b")],
            [find("knows", "b", "a"), unequal("a", "b")],
        ),
        KNOWS,
    )
    assert w.rows("linked") == names("ada", "bob", "cyd")
    assert w.rows("p") == names("dan")


def test_negation_of_negation(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [neg(find("free", "a"))]),
        pattern("free(a : Person)", [neg(path("Person.boss", "a", "_"))]),
    )
    assert w.rows("p") == names("bob", "cyd", "dan")


# --- aggregates


def test_constants_inside_negated_patterns_are_respected(world: Make) -> None:
    w = world(
        pattern("old(x : Person)", [path("Person.age", "x", 50)]),
        pattern(
            "p(a : Person, b : Person)",
            [path("Person.knows", "a", "b"), neg(find("old", "a")), neg(find("old", "b"))],
        ),
    )
    assert w.rows("p") == names("bob cyd", "dan dan")
    w.model["cyd"].age = 49
    w.model["ada"].age = None
    assert w.rows("p") == names("ada bob", "bob cyd", "cyd ada", "dan dan")
    w.model["bob"].age = 50
    assert w.rows("p") == names("cyd ada", "dan dan")
    w.model["bob"].age = 30
    assert w.rows("p") == names("ada bob", "bob cyd", "cyd ada", "dan dan")


def test_a_pattern_without_parameters_is_counted(world: Make) -> None:
    w = world(
        pattern("any()", [is_a("Ghost", "_")]),
        pattern("p(x : Person, n : int)", [is_a("Person", "x"), equal("n", fold("count", find("any")))]),
    )
    assert w.rows("p", "bob", ...) == {("bob", 0)}
    w.model.create("Ghost")
    w.model.create("Ghost")
    assert w.rows("p", "bob", ...) == {("bob", 1)}
    assert w.rows("p", ..., 0) == set()


def test_count_is_zero_for_an_empty_group(world: Make) -> None:
    w = world(
        pattern("p(a : Person, n : int)", [equal("n", fold("count", path("Person.staff", "a", "_")))]),
        pattern("all(n : int)", [equal("n", fold("count", is_a("Person", "_")))]),
        pattern("called(n : int)", [equal("n", fold("count", find("knows", "_", "_")))]),
        pattern("loops(n : int)", [equal("n", fold("count", find("knows", "x", "x")))]),
        pattern("ghosts(n : int)", [equal("n", fold("count", is_a("Ghost", "_")))]),
        KNOWS,
    )
    assert w.rows("p") == {("ada", 2), ("bob", 1), ("cyd", 0), ("dan", 0)}
    assert w.rows("p", ..., 0) == {("cyd", 0), ("dan", 0)}
    assert w.rows("all") == w.rows("called") == {(4,)}
    assert w.rows("loops") == {(1,)}
    assert w.rows("ghosts") == {(0,)}


def test_aggregates_take_distinct_tuples(world: Make) -> None:
    w = world(
        pattern("sums(n : int)", [equal("n", fold("sum", find("age", "_", "#")))]),
        pattern("values(n : int)", [equal("n", fold("sum", find("anyAge", "#")))]),
        pattern("mean(n : float)", [equal("n", fold("avg", find("age", "_", "#")))]),
        pattern("least(n : int)", [equal("n", fold("min", path("Person.age", "_", "#")))]),
        pattern("most(n : float)", [equal("n", fold("max", path("Person.pay", "_", "#")))]),
        pattern("age(a : Person, n : int)", [path("Person.age", "a", "n")]),
        pattern("anyAge(n : int)", [path("Person.age", "_", "n")]),
    )
    assert w.rows("sums") == {(130,)}
    assert w.rows("values") == {(100,)}
    assert w.rows("mean") == {(32.5,)}
    assert w.rows("least") == {(20,)}
    assert w.rows("most") == {(9.5,)}


def test_empty_groups_have_a_sum_but_no_min_max_or_avg(world: Make) -> None:
    def of_staff(function: str) -> Pattern:
        head = f"{function}(a : Person, n : {'float' if function == 'avg' else 'int'})"
        return pattern(head, [equal("n", fold(function, find("staffAge", "a", "_", "#")))])

    ages = pattern(
        "staffAge(a : Person, b : Person, n : int)",
        [path("Person.staff", "a", "b"), path("Person.age", "b", "n")],
    )
    w = world(ages, *map(of_staff, ("sum", "min", "max", "avg")))
    assert w.rows("sum") == {("ada", 60), ("bob", 20), ("cyd", 0), ("dan", 0)}
    assert w.rows("min") == w.rows("max") == {("ada", 30), ("bob", 20)}
    assert w.rows("avg") == {("ada", 30.0), ("bob", 20.0)}


def test_sums_of_floats_do_not_depend_on_the_order_of_objects(world: Make) -> None:
    w = world(pattern("p(n : float)", [equal("n", fold("sum", path("Person.pay", "_", "#")))]))
    for name, pay in zip(("ada", "bob", "cyd", "dan"), (1e16, 1.0, -1e16, 1.0), strict=True):
        w.model[name].pay = pay
    assert w.rows("p") == {(2.0,)}


def test_an_aggregate_of_nested_aggregates(world: Make) -> None:
    w = world(
        pattern("p(n : int)", [equal("n", fold("max", find("size", "_", "#")))]),
        pattern("size(t : Team, n : int)", [equal("n", fold("count", path("Team.members", "t", "_")))]),
    )
    assert w.rows("size") == {("red", 2), ("blue", 1)}
    assert w.rows("p") == {(2,)}


# --- closures


def test_plus_closures_need_one_step_and_follow_cycles(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [find("knows+", "a", "b")]), KNOWS)
    circle = ("ada", "bob", "cyd")
    assert w.rows("p") == {(a, b) for a in circle for b in circle} | names("dan dan")
    assert w.rows("p", "ada", ...) == names("ada bob", "ada cyd", "ada ada")
    assert w.rows("p", ..., "ada") == names("bob ada", "cyd ada", "ada ada")
    assert w.rows("p", "ada", "dan") == set()
    assert w.rows("p", "ada", "ada") == names("ada ada")


def test_plus_does_not_relate_an_object_to_itself_without_a_cycle(world: Make) -> None:
    w = world(pattern("p(a : Person, b : Person)", [path("Person.boss+", "a", "b")]))
    assert w.rows("p") == names("dan bob", "dan ada", "bob ada", "cyd ada")
    assert w.rows("p", "ada", "ada") == set()


def test_star_relates_every_object_of_the_source_type_to_itself(world: Make) -> None:
    w = world(
        pattern("p(a : Person, b : Person)", [path("Person.boss*", "a", "b")]),
        pattern("q(a : Person, b : Person)", [find("chief*", "a", "b")]),
        pattern("chief(a : Chief, b : Person)", [path("Person.staff", "a", "b")]),
    )
    everyone = names("ada ada", "bob bob", "cyd cyd", "dan dan")
    assert w.rows("p") == names("dan bob", "dan ada", "bob ada", "cyd ada") | everyone
    assert w.rows("p", "bob", "bob") == names("bob bob")
    assert w.rows("p", ..., "bob") == names("bob bob", "dan bob")
    assert w.rows("q") == names("ada ada", "ada bob", "ada cyd")
    assert w.rows("q", "bob", "bob") == set()


def test_a_closure_follows_a_pattern_of_several_bodies(world: Make) -> None:
    w = world(
        pattern("p(a : Person, b : Person)", [find("near+", "a", "b"), unequal("a", "b")]),
        pattern("near(a : Person, b : Person)", [path("Person.boss", "a", "b")], [path("Person.boss", "b", "a")]),
    )
    people = ("ada", "bob", "cyd", "dan")
    assert w.rows("p") == {(a, b) for a in people for b in people if a != b}


def test_closures_may_have_an_anonymous_end(world: Make) -> None:
    w = world(
        pattern("p(a : Person)", [path("Person.boss+", "a", "_")]),
        pattern("q(a : Person)", [path("Person.boss+", "_", "a")]),
        pattern("r(a : Person)", [path("Person.boss+", "a", "b"), is_a("Chief", "b")]),
        pattern("s(a : Person)", [path("Person.knows+", "a", "a")]),
    )
    assert w.rows("p") == w.rows("r") == names("bob", "cyd", "dan")
    assert w.rows("q") == names("ada", "bob")
    assert w.rows("s") == names("ada", "bob", "cyd", "dan")


def test_closures_are_correct_after_every_edit(world: Make) -> None:
    w = world(
        pattern("p(a : Person, b : Person)", [path("Person.boss+", "a", "b")]),
        pattern("q(a : Person)", [is_a("Person", "a"), neg(find("p", "a", "_"))]),
    )
    question = w.arguments("p", "dan", "ada")
    for _ in range(3):
        assert w.matcher.exists("p", question)
    w.model["bob"].boss = None
    assert not w.matcher.exists("p", question)
    assert not w.matcher.exists("p", question)
    assert w.rows("q") == names("ada", "bob")
    w.model["bob"].boss = w.model["cyd"]
    assert w.matcher.exists("p", question)


# --- recursion

ABOVE = pattern(
    "above(a : Person, b : Person)",
    [path("Person.boss", "a", "b")],
    [path("Person.boss", "a", "c"), find("above", "c", "b")],
)


def test_recursion_is_the_least_fixed_point(world: Make) -> None:
    w = world(ABOVE)
    assert w.rows("above") == names("dan bob", "dan ada", "bob ada", "cyd ada")
    assert w.rows("above", "dan", ...) == names("dan bob", "dan ada")
    assert w.rows("above", ..., "ada") == names("dan ada", "bob ada", "cyd ada")
    assert w.rows("above", "cyd", "bob") == set()


def test_recursion_on_a_cycle_is_correct_after_a_deletion(world: Make) -> None:
    w = world(
        pattern(
            "p(a : Person, b : Person)",
            [path("Person.knows", "a", "b")],
            [find("p", "a", "c"), find("p", "c", "b")],
        )
    )
    assert len(w.rows("p")) == 10
    w.model["cyd"].knows.remove(w.model["ada"])
    assert w.rows("p") == names("ada bob", "ada cyd", "bob cyd", "dan dan")


def test_mutually_recursive_patterns_have_their_least_fixed_point(world: Make) -> None:
    w = world(
        pattern(
            "even(a : Person, b : Person)",
            [is_a("Person", "a"), equal("a", "b")],
            [path("Person.boss", "a", "c"), find("odd", "c", "b")],
        ),
        pattern("odd(a : Person, b : Person)", [path("Person.boss", "a", "c"), find("even", "c", "b")]),
    )
    assert w.rows("odd") == names("dan bob", "bob ada", "cyd ada")
    assert w.rows("even", "dan", ...) == names("dan dan", "dan ada")


def test_a_recursive_pattern_under_negation_count_and_closure(world: Make) -> None:
    w = world(
        ABOVE,
        pattern("top(a : Person)", [neg(find("above", "a", "_"))]),
        pattern("depth(a : Person, n : int)", [equal("n", fold("count", find("above", "a", "_")))]),
        pattern("reach(a : Person, b : Person)", [find("above+", "a", "b")]),
        pattern("under(a : Person)", [find("above", "a", "_")]),
    )
    assert w.rows("top") == names("ada")
    assert w.rows("depth") == {("ada", 0), ("bob", 1), ("cyd", 1), ("dan", 2)}
    assert w.rows("reach") == w.rows("above")
    assert w.rows("reach", "dan", "ada") == names("dan ada")
    assert w.rows("under") == names("bob", "cyd", "dan")


def test_recursion_over_lower_recursion_through_negation(world: Make) -> None:
    w = world(
        ABOVE,
        pattern(
            "apart(a : Person, b : Person)",
            [path("Person.knows", "a", "b"), neg(find("above", "a", "b")), neg(find("above", "b", "a"))],
            [find("apart", "a", "c"), find("apart", "c", "b")],
        ),
    )
    assert w.rows("apart") == names("bob cyd", "dan dan")


# --- after edits


def knows(a: str, b: str) -> PathConstraint:
    """`Person.knows(a, b)`."""
    return path("Person.knows", a, b)


TWICE = (
    pattern("oneWay(a : Person, b : Person)", [knows("a", "b"), neg(knows("b", "a"))]),
    pattern("found(a : Person, b : Person)", [find("knows", "a", "b"), neg(find("knows", "b", "a"))]),
    pattern("mutual(a : Person, b : Person)", [knows("a", "b"), knows("b", "a")]),
    pattern("next(a : Person, c : Person)", [find("knows", "a", "b"), find("knows", "b", "c")]),
    pattern("busy(a : Person, b : Person, n : int)", [knows("a", "b"), equal("n", fold("count", knows("b", "_")))]),
    pattern("idle(a : Person, b : Person)", [knows("a", "b"), neg(knows("b", "_"))]),
    pattern("alone(a : Person)", [knows("a", "a"), equal("n", fold("count", knows("_", "a"))), equal("n", 1)]),
)


def test_relations_used_twice_in_a_body_follow_edits(world: Make) -> None:
    w = world(KNOWS, *TWICE)
    naive = NaiveMatcher(w.model, w.library)
    for text in [
        "dan-dan",
        "dan+dan",
        "ada+ada",
        "bob+ada",
        "ada-bob",
        "ada-ada",
        "bob+bob",
        "bob-ada",
        "dan-dan",
        "bob-bob",
        "ada+bob",
        "bob+ada",
        "ada-bob",
    ]:
        one, other = w.model[text[:3]], w.model[text[4:]]
        (one.knows.append if text[3] == "+" else one.knows.remove)(other)
        for name in (each.name for each in TWICE):
            free = w.arguments(name, *[...] * len(w.library.parameter_types(name)))
            assert sorted(w.matcher.rows(name, free)) == naive.rows(name, free), (text, name)
        assert_sound(w.matcher)


def test_matches_follow_creation_retyping_and_deletion(world: Make) -> None:
    w = world(pattern("p(x : Chief)", [is_a("Chief", "x"), neg(path("Person.boss", "x", "_"))]))
    eve = w.model.create("Chief", object_name="eve")
    assert w.rows("p") == names("ada", "eve")
    eve.retype("Person")
    assert w.rows("p") == names("ada")
    w.model["ada"].delete(semantics="spo")
    assert w.rows("p") == set()


def test_patterns_may_be_added_while_the_matcher_is_in_use(world: Make) -> None:
    w = world(KNOWS)
    assert len(w.rows("knows")) == 4
    w.library.add(pattern("p(a : Person)", [find("knows", "a", "a")]))
    assert w.rows("p") == names("dan")
