"""Registering patterns and looking them up."""

from copy import copy

import pytest

from envgraph.errors import InvalidArgument, ResolutionError
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    ConditionAtom,
    InstanceAtom,
    Library,
    LinkAtom,
    ObjectType,
    _library,
    conformance_patterns,
)
from envgraph.pattern.check._patterns import check_patterns
from tests.unit.pattern.building import METAMODEL, agg, eq, find, isa, library, neg, path, pattern

WALLS = pattern("walls", "a : Wall", [isa("Wall", "a")])


def named(name, package="", **features):
    return pattern(name, "a : Cell", [isa("Cell", "a")], package=package, **features)


def test_patterns_keep_the_order_in_which_they_were_added():
    made = library(named("b"), named("a"))
    made.add(named("c"))
    assert made.names() == ("b", "a", "c")
    assert [p.name for p in made.patterns] == ["b", "a", "c"]


def test_nothing_is_added_when_one_pattern_is_wrong():
    made = library(WALLS)
    with pytest.raises(ResolutionError):
        made.add(named("good"), pattern("bad", "a : Cel", [isa("Cell", "a")]))
    assert made.names() == ("walls",)
    made.add(named("good"))
    assert made.names() == ("walls", "good")


def test_patterns_added_later_may_call_earlier_ones():
    made = library(WALLS)
    made.add(pattern("p", "a : Cell", [find("walls", "a")]))
    assert made.callee("p", "walls") == WALLS


def test_duplicate_pattern_names_are_errors():
    made = library(WALLS)
    with pytest.raises(ResolutionError, match="defined twice"):
        made.add(WALLS)


def test_names_resolve_first_in_the_callers_package():
    made = library(named("p", "one"), named("p", "two"), named("p"), named("q", "two"))
    assert made.resolve("p", "one").package == "one"
    assert made.resolve("p", "two").package == "two"
    assert made.resolve("p", "three").package == ""
    assert made.resolve("two.p", "one").package == "two"
    assert made.resolve("q", "one").package == "two"
    assert made.resolve("r") is None


def test_ambiguous_names_are_not_resolved():
    made = library(named("p", "one"), named("p", "two"))
    assert made.resolve("p") is None
    assert made.resolve("one.p") is not None


def test_private_patterns_resolve_in_their_package_only():
    made = library(named("p", "one", private=True))
    assert made.resolve("p", "one") is not None
    assert made.resolve("p") is None
    assert made.resolve("one.p") is None


def test_a_private_pattern_does_not_make_a_name_ambiguous():
    made = library(named("p", "one", private=True), named("p", "two"))
    assert made.resolve("p").package == "two"


def test_added_patterns_do_not_change_resolved_calls():
    made = library(named("p", "one"), pattern("user", "a : Cell", [find("p", "a")], package="x"))
    made.add(named("p", "two"))
    assert made.callee("x.user", "p").package == "one"
    assert made.lowered_pattern("x.user").bodies[0].goals[0].pattern == "one.p"


def test_unknown_names_are_invalid_arguments_with_a_hint():
    made = library(WALLS)
    for ask in (made.get, made.lowered_pattern, made.parameter_types, made.inputs):
        with pytest.raises(InvalidArgument, match="did you mean `walls`"):
            ask("wals")
    with pytest.raises(InvalidArgument, match="does not call"):
        made.callee("walls", "p")


def test_generated_patterns_are_not_listed_but_can_be_retrieved():
    made = library(pattern("p", "a : Cell", [isa("Cell", "a"), neg(path("Cell.right.right", "a", "_"))]))
    made.lowered_pattern("p")
    assert made.names() == ("p",)
    assert made.parameter_types("#path.Cell.right.right") == (ObjectType("Cell"), ObjectType("Cell"))
    assert made.get("#path.Cell.right.right").private


def test_a_copy_is_independent():
    made = library(WALLS)
    twin = copy(made)
    twin.add(named("p"))
    twin.lowered_pattern("p")
    assert (made.names(), twin.names()) == (("walls",), ("walls", "p"))
    made.add(pattern("p", "a : Wall", [find("walls", "a")]))
    assert made.lowered_pattern("p") != twin.lowered_pattern("p")


def test_checking_adds_nothing():
    made = Library(METAMODEL)
    assert made.check(WALLS) == []
    assert made.names() == ()


def test_mutually_recursive_patterns_are_added_together():
    far = pattern("far", "a : Cell", [isa("Door", "a")], [path("Cell.right", "a", "b"), find("near", "b")])
    near = pattern("near", "a : Cell", [isa("Wall", "a")], [path("Cell.left", "a", "b"), find("far", "b")])
    assert library(far, near).names() == ("far", "near")
    with pytest.raises(ResolutionError, match="unknown pattern `near`"):
        library(far)


def test_an_aggregate_may_count_an_earlier_pattern():
    made = library(WALLS)
    made.add(pattern("n", "n : int", [eq("n", agg("count", find("walls", "_")))]))
    [atom] = made.lowered_pattern("n").bodies[0].goals
    assert isinstance(atom, AggregateAtom)


# --- conformance


def test_conformance_patterns_cover_constraints_that_writes_do_not_enforce():
    names = [p.qualified_name for p in conformance_patterns(METAMODEL)]
    assert names[:4] == [
        "conformance.World.cells",
        "conformance.World.hero",
        "conformance.Cell.x",
        "conformance.Cell.y",
    ]
    assert "conformance.Cell.right" not in names
    assert "conformance.Hero.keys" in names


def test_conformance_patterns_have_no_diagnostics():
    assert Library(METAMODEL).check(*conformance_patterns(METAMODEL)) == []


def test_a_pattern_may_have_the_name_of_a_feature():
    made = library(named("hero", "maze"), *conformance_patterns(METAMODEL))
    found = made.resolve("hero")
    assert found is not None and found.qualified_name == "maze.hero"


def test_a_missing_value_a_missing_link_and_too_few_links_are_violations():
    made = library(*conformance_patterns(METAMODEL))
    x, hero, keys = (
        made.lowered_pattern(f"conformance.{name}").bodies[0].goals for name in ("Cell.x", "World.hero", "Hero.keys")
    )
    assert x[0] == InstanceAtom("Cell", 0)
    assert isinstance(x[1], AbsenceAtom)
    assert isinstance(x[1].alternatives[0][0], AttributeAtom)
    assert isinstance(hero[1].alternatives[0][0], LinkAtom)
    assert isinstance(keys[1], AggregateAtom)
    assert isinstance(keys[2], ConditionAtom)


def test_classes_without_instances_cannot_violate():
    empty = Metamodel(
        "m",
        (Class("Ghost", abstract=True, features=(Attribute("n", Scalar.INT), Reference("next", "Ghost"))),),
    )
    assert conformance_patterns(empty) == ()


def test_violations_are_constraints_with_a_message():
    [annotation] = conformance_patterns(METAMODEL)[0].annotations
    assert annotation.name == "Constraint"
    assert dict(annotation.named)["message"] == "`cells` of $object$ has no target"


def test_adding_checked_patterns_reuses_the_check(monkeypatch):
    looked_at = []

    def check(analysis, unchanged):
        looked_at.extend(one.name for one in analysis.patterns)
        return check_patterns(analysis, unchanged)

    monkeypatch.setattr(_library, "check_patterns", check)
    made = Library(METAMODEL)
    a, b = named("a"), named("b")
    made.check(a, b)
    twin = copy(made)
    twin.add(a, b)
    made.add(a, b)
    assert looked_at == ["a", "b"]
    assert twin.names() == made.names() == ("a", "b")
    assert [problem.code for problem in made.check(a)] == ["duplicate-definition"]
    twin.add(named("c"))
    assert made.names() == ("a", "b")
    assert [problem.code for problem in made.check(b, named("c"))] == ["duplicate-definition"]
