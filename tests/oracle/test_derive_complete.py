"""Derived operators reach every valid model of small metamodels from the empty one."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import HealthCheck, assume, given, settings

from envgraph.errors import Severity
from envgraph.graph import Model, check_conformance
from envgraph.metamodel import Annotation, Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import Derivation
from envgraph.rewrite import (
    Engine,
)
from tests.oracle.all_models import Form, all_models, form_of
from tests.profile import NIGHTLY
from tests.property.strategies import bounded_metamodels

EXAMPLES = max(6, settings().max_examples // 10)

BOUNDS = [(0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (0, None), (1, None), (2, None)]
FEW = BOUNDS[:5] if NIGHTLY else [(0, 1), (1, 1), (1, 2), (2, 2)]
"""Those that both ends of a reference have in turn."""

Bounds = tuple[int, int | None]


def reached(metamodel: Metamodel, most: int, limit: int = 20_000) -> set[Form]:
    """The forms of the models with at most `most` objects that the operators lead to, through no larger ones."""
    model = Model(metamodel)
    engine = Engine(model)
    classes = [cls.name for cls in metamodel.class_list if metamodel.concrete_classes(cls.name)]
    engine.add(*(Derivation(f"of{cls}", "operators", (cls,)) for cls in classes))
    runners = [engine.prepare(name) for name in engine.rules]
    start = model.commit()
    found = {form_of(model): start}
    queue = [start]
    for version in queue:
        model.checkout(version)
        for runner in runners:
            for row in list(runner.rows()):
                runner.fire(row)
                assert check_conformance(model) == [], runner.name
                form = form_of(model) if len(model) <= most else None
                if form is not None and form not in found:
                    found[form] = model.commit()
                    queue.append(found[form])
                    assert len(queue) < limit
                model.checkout(version, discard=True)
    return set(found)


def assert_complete(metamodel: Metamodel, most: int = 3) -> None:
    wanted = all_models(metamodel, most)
    found = reached(metamodel, most)
    assert sorted(wanted - found, key=repr)[:1] == []
    assert found == wanted


def one_class(*features: Reference) -> Metamodel:
    return Metamodel("tiny", [Class("A", features=features)])


def two_classes(reference: Reference, *opposite: Reference) -> Metamodel:
    return Metamodel("tiny", [Class("A", features=(reference,)), Class("B", features=opposite)])


@pytest.mark.parametrize("bounds", BOUNDS, ids=str)
def test_derived_operators_reach_all_models_of_a_reference(bounds: Bounds) -> None:
    assert_complete(two_classes(Reference("e", "B", *bounds)))


@pytest.mark.parametrize("bounds", BOUNDS, ids=str)
def test_derived_operators_reach_all_models_of_a_reference_to_its_own_class(bounds: Bounds) -> None:
    assert_complete(one_class(Reference("e", "A", *bounds)), most=3 if bounds[0] else 2)


@pytest.mark.parametrize("bounds", BOUNDS, ids=str)
def test_derived_operators_reach_all_models_of_a_symmetric_reference(bounds: Bounds) -> None:
    assert_complete(one_class(Reference("e", "A", *bounds, opposite="e")))


@pytest.mark.parametrize(("bounds", "back"), list(product(BOUNDS, [(0, 1), (1, 1)])), ids=str)
def test_derived_operators_reach_all_models_of_a_containment(bounds: Bounds, back: Bounds) -> None:
    parts = Reference("parts", "B", *bounds, containment=True, opposite="whole")
    assert_complete(two_classes(parts, Reference("whole", "A", *back, opposite="parts")))


@pytest.mark.parametrize("bounds", BOUNDS, ids=str)
def test_derived_operators_reach_all_models_of_a_containment_tree(bounds: Bounds) -> None:
    assert_complete(one_class(Reference("parts", "A", *bounds, containment=True)))


@pytest.mark.parametrize(("bounds", "back"), list(product(FEW, FEW)), ids=str)
def test_derived_operators_reach_all_models_of_opposite_references(bounds: Bounds, back: Bounds) -> None:
    e = Reference("e", "B", *bounds, opposite="f")
    assert_complete(two_classes(e, Reference("f", "A", *back, opposite="e")))


@pytest.mark.parametrize(
    ("bounds", "back"),
    [(a, b) for a in FEW for b in FEW if BOUNDS.index(a) >= BOUNDS.index(b)],
    ids=str,
)
def test_derived_operators_reach_all_models_of_opposites_in_one_class(bounds: Bounds, back: Bounds) -> None:
    e = Reference("e", "A", *bounds, opposite="f")
    assert_complete(one_class(e, Reference("f", "A", *back, opposite="e")), most=3 if bounds[0] else 2)


@pytest.mark.skipif(EXAMPLES < 100, reason="only in `make nightly`")
@pytest.mark.parametrize(("bounds", "back"), list(product(BOUNDS, BOUNDS)), ids=str)
def test_derived_operators_reach_all_models_of_opposites_with_any_bounds(bounds: Bounds, back: Bounds) -> None:
    e = Reference("e", "B", *bounds, opposite="f")
    assert_complete(two_classes(e, Reference("f", "A", *back, opposite="e")))
    e = Reference("e", "A", *bounds, opposite="f")
    assert_complete(one_class(e, Reference("f", "A", *back, opposite="e")), most=2)


def test_derived_operators_reach_all_models_of_attributes_and_subclasses() -> None:
    colour = EnumType("Colour", ("red", "green"))
    n = Attribute("n", Scalar.INT, annotations=(Annotation("range", (0, 2)),))
    classes = [
        Class("Cell", abstract=True, features=(Attribute("c", colour),)),
        Class("Floor", supertypes=("Cell",), features=(n,)),
        Class("Door", supertypes=("Cell",), features=(Attribute("open", Scalar.BOOL), Reference("key", "Key"))),
        Class("Key"),
    ]
    assert_complete(Metamodel("tiny", classes, [colour]), most=2)


def test_derived_operators_reach_all_models_of_mutually_dependent_parts() -> None:
    classes = [
        Class("Net", features=(Reference("nodes", "Node", 1, None, True), Reference("first", "Node"))),
        Class(
            "Node",
            features=(
                Reference("next", "Node", opposite="before"),
                Reference("before", "Node", opposite="next"),
            ),
        ),
    ]
    assert_complete(Metamodel("tiny", classes))


def test_derived_operators_reach_all_models_of_a_whole_that_requires_its_own_part() -> None:
    parts = Reference("parts", "Part", 0, 1, containment=True)
    classes = [
        Class("Whole", features=(parts, Reference("first", "Part", opposite="of"))),
        Class("Part", features=(Reference("of", "Whole", 0, 1, opposite="first"),)),
    ]
    assert_complete(Metamodel("tiny", classes))


def test_derived_operators_reach_all_models_of_a_child_of_an_abstract_class() -> None:
    classes = [
        Class("Box", features=(Reference("lid", "Lid", containment=True),)),
        Class("Lid", abstract=True),
        Class("Wood", supertypes=("Lid",), features=(Reference("nail", "Nail", containment=True),)),
        Class("Glass", supertypes=("Lid",)),
        Class("Nail"),
    ]
    assert_complete(Metamodel("tiny", classes))


def _needs(metamodel: Metamodel, cls: str) -> int:
    """How many links an object must have; two objects that need each other then need no more than 12."""
    features = metamodel.features(cls).values()
    return sum(feature.lower for feature in features if isinstance(feature, Reference))


@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
@given(bounded_metamodels())
def test_derived_operators_reach_all_models_of_random_metamodels(metamodel: Metamodel) -> None:
    marks = [a.name for cls in metamodel.class_list for feature in cls.features for a in feature.annotations]
    assume("frozen" not in marks and not any(cls.frozen for cls in metamodel.class_list))
    assume(len(metamodel.class_list) <= 3)
    assume(all(_needs(metamodel, cls.name) <= 5 for cls in metamodel.class_list))
    wanted = all_models(metamodel, 2)
    assume(1 < len(wanted) <= 150)
    derivations = [
        Derivation("d", "operators", (cls.name,))
        for cls in metamodel.class_list
        if metamodel.concrete_classes(cls.name)
    ]
    said = [problem for one in derivations for problem in Engine(Model(metamodel)).check(one)]
    assume(not said)
    assert wanted <= reached(metamodel, 2)


# --- where it ends


def test_object_with_too_many_required_links_is_not_created_but_reported() -> None:
    many = one_class(Reference("e", "A", 7, 7, opposite="f"), Reference("f", "A", 7, 7, opposite="e"))
    (problem,) = Engine(Model(many)).check(Derivation("d", "operators", ("A",)))
    assert problem.severity is Severity.WARNING
    reason = "a new one needs links to objects of `@frozen` classes, or too many objects or links"
    assert problem.message == f"no operator creates a `A`: {reason}"
    assert len(reached(many, 3)) == 1
