"""The normal form of patterns."""

import pytest

from envgraph.metamodel import Attribute, Scalar
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    Binary,
    CallAtom,
    Closure,
    ClosureAtom,
    ConditionAtom,
    Constant,
    InstanceAtom,
    LinkAtom,
    Navigation,
    ObjectType,
    UnequalAtom,
    ValuationAtom,
    Variable,
    relation_variables,
    required_variables,
)
from tests.unit.pattern.building import (
    COLOUR,
    METAMODEL,
    NONE,
    agg,
    check,
    cond,
    eq,
    ev,
    find,
    isa,
    library,
    ne,
    neg,
    op,
    path,
    pattern,
    text,
)

INT = Scalar.INT


def feature(cls, name):
    found = METAMODEL.feature(cls, name)
    assert found is not None
    return found


def negation(relation, *free):
    return AbsenceAtom(((relation,),), tuple(v for v in dict.fromkeys(relation_variables(relation)) if v not in free))


def reads(expression, numbers):
    return tuple(zip(names_in(expression), numbers, strict=True))


def condition(expression, numbers):
    return ConditionAtom(expression, reads(expression, numbers))


def valuation(expression, numbers, result):
    return ValuationAtom(expression, reads(expression, numbers), result)


def names_in(expression):
    if isinstance(expression, Variable):
        return [expression.name]
    parts = [getattr(expression, each) for each in getattr(expression, "__slots__", ()) if each != "span"]
    return list(dict.fromkeys(name for part in parts for name in names_in(part)))


def step(name, source, target, cls="Cell"):
    resolved = feature(cls, name)
    made = AttributeAtom if isinstance(resolved, Attribute) else LinkAtom
    return made(resolved, source, target)


def lowered(parameters, *constraints, with_=()):
    [body] = library(*with_, pattern("p", parameters, list(constraints))).lowered_pattern("p").bodies
    return body


def atoms(parameters, *constraints, with_=()):
    return list(lowered(parameters, *constraints, with_=with_).goals)


# --- variables


def test_parameters_come_first_and_keep_their_order():
    body = lowered("b : Cell, a : Cell", path("Cell.right", "a", "c"), path("Cell.right", "c", "b"))
    assert body.names == ("b", "a", "c")
    assert body.goals == (step("right", 1, 2), step("right", 2, 0))
    assert body.types == (ObjectType("Cell"),) * 3


def test_anonymous_variables_are_all_different():
    body = lowered("a : Cell", path("Cell.right", "a", "_"), path("Cell.left", "a", "_"))
    assert body.names == ("a", "#1", "#2")
    assert body.goals == (step("right", 0, 1), step("left", 0, 2))


def test_constants_become_fixed_variables():
    body = lowered("c : Cell", path("Cell.x", "c", 7), path("Cell.y", "c", "y"), eq("y", 3))
    assert body.constants == ((1, 7), (2, 3))
    assert body.names == ("c", "#1", "y")


def test_an_int_for_a_float_variable_is_converted():
    body = lowered("d : Door", path("Door.weight", "d", 3), path("Door.weight", "d", "w"), eq("w", 4))
    assert [repr(value) for _, value in body.constants] == ["3.0", "4.0"]


def test_enum_literals_become_strings_of_the_enum():
    body = lowered("k : Key", path("Key.colour", "k", "::red"))
    assert body.constants == ((1, "red"),)
    assert body.types[1] == COLOUR


def test_equated_variables_are_united():
    body = lowered("a : Cell", path("Cell.right", "a", "b"), path("Cell.left", "c", "a"), eq("b", "c"))
    assert body.names == ("a", "b")
    assert body.goals == (step("right", 0, 1), step("left", 1, 0))


def test_a_parameter_represents_the_variables_equal_to_it():
    body = lowered("a : Cell", path("Cell.right", "z", "y"), eq("z", "a"), eq("y", "z"))
    assert body.names == ("a",)
    assert body.goals == (step("right", 0, 0),)


def test_equal_parameters_are_aliases():
    body = lowered("a : Cell, b : Cell", eq("a", "b"), path("Cell.right", "a", "_"))
    assert body.parameters == (0, 0)
    assert body.names == ("a", "b", "#2")
    assert body.goals == (step("right", 0, 2),)


def test_a_parameter_may_be_a_constant():
    body = lowered("a : Cell, c : Colour", isa("Cell", "a"), eq("c", "::red"))
    assert body.constants == ((1, "red"),)


def test_equality_is_transitive_over_constants():
    body = lowered("a : Cell, n : int, m : int", path("Cell.x", "a", "n"), eq("n", "m"), eq("m", 4))
    assert (body.constants, body.parameters) == (((1, 4),), (0, 1, 1))


@pytest.mark.parametrize(
    "constraint",
    [
        [eq("n", 3), eq("n", 4)],
        [eq(3, 4)],
        [ne("n", "n")],
        [ne(3, 3)],
        [eq("n", "m"), ne("m", "n"), path("Cell.y", "a", "m")],
        [check(False)],
        [check(op(1, ">", 2))],
        [check(op("a.x", "==", 3)), eq("n", 4)],
        [eq("n", ev(op(1, "/", op(1, "-", 1))))],
    ],
)
def test_unsatisfiable_bodies_are_dropped(constraint):
    made = pattern("p", "a : Cell", [path("Cell.x", "a", "n"), *constraint], [isa("Wall", "a")])
    assert [body.goals for body in library(made).lowered_pattern("p").bodies] == [(InstanceAtom("Wall", 0),)]


# --- classes


def test_a_class_that_no_other_atom_implies_is_tested():
    assert atoms("a : Floor", path("Cell.right", "a", "_")) == [InstanceAtom("Floor", 0), step("right", 0, 1)]


def test_a_class_that_a_link_implies_is_not_tested():
    assert atoms("a : Cell", isa("Cell", "a"), path("Cell.right", "_", "a")) == [step("right", 1, 0)]


def test_a_class_that_a_call_implies_is_not_tested():
    called = pattern("q", "a : Floor", [isa("Door", "a")])
    assert atoms("a : Cell", find("q", "a"), with_=[called]) == [CallAtom("q", (0,))]


def test_a_class_that_a_negated_call_mentions_is_tested():
    called = pattern("q", "a : Cell", [isa("Door", "a")])
    assert atoms("a : Cell", neg(find("q", "a")), with_=[called]) == [
        InstanceAtom("Cell", 0),
        negation(CallAtom("q", (0,))),
    ]


def test_only_the_narrowest_class_is_tested():
    assert atoms("a : Cell", isa("Door", "a"), isa("Floor", "a")) == [InstanceAtom("Door", 0)]


def test_unrelated_classes_are_all_tested():
    assert atoms("a : Swims", isa("Walks", "a")) == [InstanceAtom("Swims", 0), InstanceAtom("Walks", 0)]


def test_an_exact_class_stays_exact():
    assert atoms("a : Floor", isa("Floor", "a", exact=True)) == [InstanceAtom("Floor", 0, exact=True)]


def test_a_path_written_on_a_subclass_tests_it():
    assert atoms("w", path("Planet.cells", "w", "_")) == [
        InstanceAtom("Planet", 0),
        step("cells", 0, 1, "World"),
    ]


def test_type_constraints_of_data_types_are_not_goals():
    assert atoms("a : Cell, n : int", path("Cell.x", "a", "n"), isa("int", "n")) == [step("x", 0, 1)]


# --- paths


def test_a_path_is_split_into_steps():
    body = lowered("a : Cell, n : int", path("Cell.right.left.x", "a", "n"))
    assert body.names == ("a", "n", "#2", "#3")
    assert body.goals == (step("right", 0, 2), step("left", 2, 3), step("x", 3, 1))


def test_arrows_are_resolved_on_the_class_of_their_source():
    body = lowered("k : Key", isa("Hero", "h"), path(".at", "h", "c"), path(".items", "c", "k"))
    assert step("items", 2, 0) in body.goals


def test_a_closure_of_a_path_calls_a_generated_pattern():
    made = library(pattern("p", "a : Floor, b : Cell", [path("Floor.right.right", "a", "b", "+")]))
    [body] = made.lowered_pattern("p").bodies
    assert body.goals == (ClosureAtom("#path.Floor.right.right", Closure.PLUS, 0, 1),)
    generated = made.lowered_pattern("#path.Floor.right.right")
    assert generated.types == (ObjectType("Floor"), ObjectType("Cell"))
    assert generated.bodies[0].goals == (InstanceAtom("Floor", 0), step("right", 0, 2), step("right", 2, 1))
    assert made.names() == ("p",)


def test_a_reflexive_closure_implies_the_class_of_its_source_only():
    both = atoms("a : Floor, b : Floor", path("Floor.right", "a", "b", "*"))
    assert both == [InstanceAtom("Floor", 1), ClosureAtom("#path.Floor.right", Closure.STAR, 0, 1)]


def test_a_closure_of_a_call_names_the_pattern():
    called = pattern("q", "a : Cell, b : Cell", [path("Cell.right", "a", "b")], package="other")
    assert atoms("a : Cell, b : Cell", find("q", "a", "b", closure="*"), with_=[called]) == [
        ClosureAtom("other.q", Closure.STAR, 0, 1)
    ]


# --- negations and aggregates


def test_variables_only_in_a_negation_are_local():
    body = lowered("a : Cell", neg(path("Cell.right", "a", "_")), neg(path("Cell.items", "a", "k")))
    assert body.goals == (
        InstanceAtom("Cell", 0),
        negation(step("right", 0, 1), 1),
        negation(step("items", 0, 2), 2),
    )


def test_variables_used_elsewhere_are_not_local():
    found = atoms("a : Cell", path("Cell.right", "a", "b"), neg(path("Cell.left", "a", "b")))
    assert found == [step("right", 0, 1), negation(step("left", 0, 1))]


def test_a_local_variable_may_occur_twice():
    found = atoms("a : Cell", isa("Cell", "a"), neg(path("Cell.right", "b", "b")))
    assert found[-1] == negation(step("right", 1, 1), 1)


def test_a_variable_equal_to_another_is_not_local():
    found = atoms("a : Cell", path("Cell.right", "a", "b"), eq("b", "c"), neg(path("Cell.left", "a", "c")))
    assert found[-1] == negation(step("left", 0, 1))


def test_a_negated_chain_calls_a_generated_pattern():
    found = atoms("a : Cell", neg(path("Cell.right.right", "a", "_")))
    assert found[-1] == negation(CallAtom("#path.Cell.right.right", (0, 1)), 1)


def test_a_negated_path_of_a_narrower_class_is_not_widened():
    found = atoms("w : World", neg(path("Planet.cells", "w", "_")))
    assert found[-1] == negation(CallAtom("#path.Planet.cells", (0, 1)), 1)
    found = atoms("w : Planet", neg(path("Planet.cells", "w", "_")))
    assert found[-1] == negation(step("cells", 0, 1, "World"), 1)
    found = atoms("c : Cell", neg(path("Planet.cells", "_", "c")))
    assert found[-1] == negation(CallAtom("#path.Planet.cells", (1, 0)), 1)


def test_a_negation_that_cannot_match_is_dropped():
    number = pattern("number", "n : int", [path("Cell.x", "_", "n")])
    found = atoms("k : Key", path("Key.label", "k", "_"), neg(find("number", "k")), with_=[number])
    assert found == [step("label", 0, 1, "Key")]


def test_a_negation_may_compare_an_int_with_a_float():
    found = atoms("d : Door", neg(path("Door.weight", "d", ev(op("d.x", "+", 1)))))
    assert negation(step("weight", 0, 1, "Door")) in found


def test_an_aggregate_names_its_column_and_result():
    body = lowered("n : int, c : Cell", eq("n", agg("sum", path("Cell.x", "c", "#"))))
    assert body.goals[-1] == AggregateAtom("sum", step("x", 1, 2), frozenset({2}), 0, 2)
    body = lowered("n : int", eq("n", agg("count", isa("Floor", "_"))))
    assert body.goals == (AggregateAtom("count", InstanceAtom("Floor", 1), frozenset({1}), 0),)


def test_aggregates_may_stand_in_arguments_and_comparisons():
    body = lowered("c : Cell", path("Cell.x", "c", agg("count", isa("Wall", "_"))))
    assert body.goals == (
        AggregateAtom("count", InstanceAtom("Wall", 2), frozenset({2}), 1),
        step("x", 0, 1),
    )
    body = lowered("c : Cell", eq(0, agg("count", path("Cell.items", "c", "_"))))
    assert body.constants == ((1, 0),)
    body = lowered("c : Cell", ne(agg("count", path("Cell.items", "c", "_")), agg("count", isa("Wall", "_"))))
    assert body.goals[-1] == UnequalAtom(1, 3)


def test_an_aggregate_over_an_impossible_relation_is_zero_or_fails():
    number = pattern("number", "n : int, m : int", [path("Cell.x", "_", "n"), path("Cell.y", "_", "m")])
    over = find("number", "k", "_")
    counted = pattern("p", "k : Key, n : int", [isa("Key", "k"), eq("n", agg("count", over))])
    assert library(number, counted).lowered_pattern("p").bodies[0].constants == ((1, 0),)
    largest = pattern("p", "k : Key, n : int", [isa("Key", "k"), eq("n", agg("max", find("number", "k", "#")))])
    assert library(number, largest).lowered_pattern("p").bodies == ()


# --- expressions


def test_paths_in_a_check_become_atoms():
    body = lowered("a : Cell", check(op("a.right.x", ">", op("a.right.y", "+", 1))))
    assert body.names == ("a", "#1", "#2", "#3")
    assert body.goals == (
        step("right", 0, 1),
        step("x", 1, 2),
        step("y", 1, 3),
        condition(Binary(">", Variable("#2"), Binary("+", Variable("#3"), Constant(1))), (2, 3)),
    )


def test_paths_reuse_variables_of_constraints_on_the_same_feature():
    body = lowered(
        "a : Cell", check(op("a.x", ">", "n")), path("Cell.x", "a", "n"), path("Cell.y", "a", "m"), ne("m", 1)
    )
    assert [atom for atom in body.goals if isinstance(atom, AttributeAtom)] == [
        step("x", 0, 1),
        step("y", 0, 2),
    ]
    assert body.goals[0] == condition(Binary(">", Variable("n"), Variable("n")), (1,))


def test_conjunctions_in_checks_are_split():
    body = lowered("a : Cell", check(op(op("a.x", ">", 1), "&&", op(op("a.y", ">", 2), "&&", op("a.x", "<", 9)))))
    assert [required_variables(goal) for goal in body.goals if isinstance(goal, ConditionAtom)] == [
        (1,),
        (2,),
        (1,),
    ]


def test_equations_in_a_check_unite_variables():
    body = lowered("a : Cell", check(op(op("a.x", "==", "a.y"), "&&", op("a.x", "==", 3))))
    assert body.goals == (step("x", 0, 1), step("y", 0, 1))
    assert body.constants == ((1, 3),)


def test_an_equation_of_an_int_and_a_float_stays_a_check():
    body = lowered("d : Door", check(op("d.x", "==", "d.weight")))
    assert isinstance(body.goals[-1], ConditionAtom)
    body = lowered("d : Door", check(op("d.x", "==", 1.5)))
    assert isinstance(body.goals[-1], ConditionAtom)


def test_an_int_constant_equal_to_a_float_variable_is_fixed():
    body = lowered("d : Door", check(op("d.weight", "==", 3)))
    assert not any(isinstance(goal, ConditionAtom) for goal in body.goals)
    assert [repr(value) for _, value in body.constants] == ["3.0"]


def test_enum_literals_in_an_expression_become_strings():
    body = lowered("k : Key, d : Door", check(op(op("k.colour", "!=", "::red"), "||", op("d.open", "==", "d.open"))))
    assert isinstance(body.goals[-1], ConditionAtom)
    assert Constant("red") in (body.goals[-1].expression.left.left, body.goals[-1].expression.left.right)


def test_comparing_a_path_with_none_becomes_a_negation():
    assert atoms("a : Cell", check(op("a.right", "==", NONE)))[-1] == negation(step("right", 0, 1), 1)
    assert atoms("a : Cell", check(op(NONE, "!=", "a.right"))) == [step("right", 0, 1)]


def test_none_tests_inside_expressions_become_counts():
    body = lowered("a : Cell", check(op(op("a.right.left", "==", NONE), "||", op("a.x", ">", 2))))
    count = AggregateAtom("count", CallAtom("#path.Cell.right.left", (0, 1)), frozenset({1}), 2)
    assert body.goals == (
        count,
        step("x", 0, 3),
        condition(Binary("||", Binary("==", Variable("#2"), Constant(0)), op("#3", ">", 2)), (2, 3)),
    )


def test_an_eval_names_its_result():
    body = lowered("n : int, c : Cell", eq("n", ev(op("c.x", "*", 2))))
    assert body.goals == (step("x", 1, 2), valuation(Binary("*", Variable("#2"), Constant(2)), (2,), 0))


def test_an_eval_of_a_path_becomes_path_goals():
    body = lowered("c : Cell, n : int, d : Cell", eq("n", ev("c.x")), eq("d", ev("c.right")))
    assert body.goals == (step("x", 0, 1), step("right", 0, 2))


def test_an_eval_without_variables_is_a_constant():
    body = lowered("c : Cell, n : int", isa("Cell", "c"), eq("n", ev(op(2, "*", 3))))
    assert body.constants == ((1, 6),)


def test_an_eval_may_stand_in_an_argument():
    body = lowered("a : Cell, b : Cell", path("Cell.x", "a", "n"), path("Cell.x", "b", ev(op("n", "+", 1))))
    assert body.goals[-1] == valuation(op("n", "+", 1), (2,), 3)


def test_checks_that_are_always_true_are_dropped():
    assert lowered("", check(True)).goals == ()


def test_united_variables_have_one_name_in_expressions():
    body = lowered("a : Cell, n : int", path("Cell.x", "a", "m"), eq("m", "n"), check(op("m", ">", 2)))
    assert body.goals[-1] == condition(op("n", ">", 2), (1,))


def test_a_path_may_start_at_a_computed_object():
    start = cond(op("a.x", ">", 1), "a.right", "a.left")
    body = lowered("a : Cell, n : int", eq("n", ev(Navigation(start, "y"))))
    assert body.names == ("a", "n", "#2", "#3", "#4", "#5")
    assert body.goals == (
        step("x", 0, 3),
        step("right", 0, 4),
        step("left", 0, 5),
        valuation(cond(op("#3", ">", 1), "#4", "#5"), (3, 4, 5), 2),
        step("y", 2, 1),
    )


def test_conditional_expressions_keep_their_branches():
    body = lowered("a : Cell", check(cond(op("a.x", ">", 1), op("a.y", ">", 1), False)))
    assert body.goals[-1] == condition(cond(op("#1", ">", 1), op("#2", ">", 1), False), (1, 2))


# --- patterns


def test_values_that_only_callers_bind_are_inputs():
    above = pattern("above", "c : Cell, in n : int", [check(op("c.x", ">", "n"))])
    made = library(above, pattern("p", "c : Cell", [path("Cell.y", "c", "m"), find("above", "c", "m")]))
    assert made.lowered_pattern("above").inputs == made.inputs("above") == (1,)
    assert made.lowered_pattern("p").inputs == ()


def test_enumerated_values_are_not_inputs():
    assert library(pattern("p", "c : Cell, in n : int", [path("Cell.x", "c", "n")])).inputs("p") == ()


def test_the_types_of_a_pattern_hold_in_every_body():
    made = library(
        pattern("p", "a, b", [path("Cell.right", "a", "b"), isa("Door", "a")], [path("Floor.left", "a", "b")])
    )
    assert made.lowered_pattern("p").types == made.parameter_types("p") == (ObjectType("Floor"), ObjectType("Cell"))
    assert [body.types[0].cls for body in made.lowered_pattern("p").bodies] == ["Door", "Floor"]


def test_types_of_recursive_patterns_are_inferred():
    far = pattern("far", "a, b", [path("Floor.right", "a", "b")], [find("far", "a", "c"), find("near", "c", "b")])
    near = pattern("near", "a, b", [path("Cell.left", "a", "b"), find("far", "_", "a")])
    assert library(far, near).parameter_types("far") == (ObjectType("Floor"), ObjectType("Cell"))


def test_names_of_variables_are_unique():
    body = lowered(
        "a : Cell",
        path("Cell.right", "a", "b"),
        path("Cell.x", "b", 3),
        path("Cell.y", "b", "_c"),
        text_of("b"),
    )
    assert len(set(body.names)) == len(body.names)


def text_of(name):
    return neg(path("Cell.items.label", name, text("x")))


def test_lowering_is_repeatable():
    made = [
        library(
            pattern("p", "a : Cell", [check(op("a.x", ">", "a.y")), neg(path("Cell.right.x", "a", "_"))])
        ).lowered_pattern("p")
        for _ in range(2)
    ]
    assert made[0] == made[1]
