"""Texts about what changed in a model."""

from __future__ import annotations

from envgraph.graph import Model, ModelSnapshot
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar


def test_changes_of_objects_are_described() -> None:
    box = Class(
        "Box", features=(Attribute("size", Scalar.INT), Reference("on", "Box"), Reference("near", "Box", 0, None))
    )
    model = Model(Metamodel("boxes", [box, Class("Crate", supertypes=("Box",))]))
    a, b, c = (model.create("Box", object_name=name, size=1) for name in "abc")
    before = ModelSnapshot.of(model.graph)
    assert before.changes(model.graph) == []
    a.size, a.on = 2, b
    a.near.append(b)
    b.retype("Crate")
    c.delete()
    model.create("Box", object_name="d")
    assert before.changes(model.graph) == [
        "c is deleted",
        "a.size = 2 (was 1)",
        "a.on = b",
        "a.near: b added",
        "b is now Crate",
        "d is created",
    ]


def test_a_link_of_opposites_is_described_once() -> None:
    shelf = Class("Shelf", features=(Reference("books", "Book", 0, None, opposite="shelf"),))
    book = Class("Book", features=(Reference("shelf", "Shelf", opposite="books"), *_kin("kin", "kin_of")))
    model = Model(Metamodel("library", [shelf, book]))
    high, low = (model.create("Shelf", object_name=name) for name in ("high", "low"))
    first, second = (model.create("Book", object_name=name, shelf=high) for name in ("first", "second"))
    before = ModelSnapshot.of(model.graph)
    low.books.append(first)
    first.kin.append(second)
    assert before.changes(model.graph) == ["first.shelf = low", "first.kin: second added"]
    before = ModelSnapshot.of(model.graph)
    second.delete("spo")
    assert before.changes(model.graph) == ["second is deleted", "first.kin: second removed"]


def _kin(name: str, opposite: str) -> tuple[Reference, Reference]:
    return Reference(name, "Book", 0, None, opposite=opposite), Reference(opposite, "Book", 0, None, opposite=name)
