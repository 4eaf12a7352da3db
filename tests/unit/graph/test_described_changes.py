"""Texts about what changed in a model."""

from __future__ import annotations

from envgraph.graph import DescribedObjects, Model
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar


def test_changes_of_objects_are_described() -> None:
    box = Class(
        "Box", features=(Attribute("size", Scalar.INT), Reference("on", "Box"), Reference("near", "Box", 0, None))
    )
    model = Model(Metamodel("boxes", [box, Class("Crate", supertypes=("Box",))]))
    a, b, c = (model.create("Box", object_name=name, size=1) for name in "abc")
    before = DescribedObjects.of(model.graph, [a.id, b.id, c.id])
    assert before.changes(model.graph) == []
    a.size, a.on = 2, b
    a.near.append(b)
    b.retype("Crate")
    c.delete()
    model.create("Box", object_name="d")
    assert before.changes(model.graph) == [
        "a.size = 2 (was 1)",
        "a.on = b",
        "b is now Crate",
        "c is deleted",
        "d is created",
    ]
