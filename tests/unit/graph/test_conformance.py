"""What a model lacks."""

from envgraph.graph import check_conformance
from tests.unit.graph.domain import feature, forest, people


def test_a_complete_model_conforms():
    assert check_conformance(forest()) == []


def test_missing_targets_are_violations():
    model = forest(1)
    model["truck"].currentState = None
    model["forest"].states.clear()
    first, second = check_conformance(model)
    assert (second.kind, second.node, second.feature.name) == ("too-few", model["truck"].id, "currentState")
    assert [str(violation) for violation in (first, second)] == [
        "`forest` has no target of `states`, which needs 1..*",
        "`truck` has no target of `currentState`, which needs 1",
    ]


def test_missing_values_are_violations():
    model = forest(1)
    model["t00"].x = None
    (violation,) = check_conformance(model)
    assert violation.kind == "missing-value"
    assert violation.node == model["t00"].id
    assert violation.feature is feature(model, "Tile", "x")
    assert violation.message == "`t00` has no value of `x`"


def test_objects_without_a_container_conform():
    model, (ann,) = people("ann")
    model.create("Dog")
    model.create("Animal", owner=ann)
    assert check_conformance(model) == []


def test_violations_are_ordered_by_class_then_by_object():
    model = forest(2)
    model.create("FireTruck")
    for name in ("t11", "t00"):
        model[name].retype("BurningTile")
        model[name].y = None
    model["t01"].y = None
    assert [violation.message for violation in check_conformance(model)] == [
        "`t01` has no value of `y`",
        "`t11` has no value of `y`",
        "`t00` has no value of `y`",
        "`FireTruck#6` has no target of `currentState`, which needs 1",
    ]
