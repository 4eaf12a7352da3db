"""Sizes that the metamodel suggests."""

from __future__ import annotations

import pytest

from envgraph.match._match_costs import PLAN
from envgraph.match.plan._size_estimates import SizeEstimates
from envgraph.metamodel import Class, Metamodel, Reference


def part(name: str, target: str, upper: int | None = None) -> Reference:
    return Reference(name, target, 0, upper, containment=True)


def sizes(*classes: Class) -> SizeEstimates:
    return SizeEstimates(Metamodel("m", classes))


def test_estimates_of_parts_follow_from_their_owners() -> None:
    found = sizes(
        Class("Root", features=(part("rooms", "Room"), part("lamps", "Lamp", 2))),
        Class("Room", features=(part("lamps", "Lamp", 3),)),
        Class("Lamp"),
        Class("Free"),
    )
    assert [found.extent_size(name) for name in ("Root", "Room", "Lamp", "Free")] == [
        1.0,
        50.0,
        152.0,
        PLAN.unknown,
    ]


def test_references_back_into_a_cycle_add_no_objects() -> None:
    found = sizes(
        Class("Root", features=(part("one", "A", 4),)),
        Class("A", features=(part("parts", "B"),)),
        Class("B", features=(part("back", "A"), part("inside", "B"))),
    )
    assert [found.extent_size(name) for name in ("A", "B")] == [4.0, 200.0]


def test_size_estimates_include_outside_subclasses_of_contained_types() -> None:
    found = sizes(
        Class("Text", abstract=True, features=(part("answers", "Answer"),)),
        Class("Question", supertypes=("Text",)),
        Class("Answer", supertypes=("Text",)),
    )
    assert [found.extent_size(name) for name in ("Question", "Answer")] == [1.0, 50.0]


def test_size_estimates_count_shared_supertypes_once() -> None:
    found = sizes(
        Class("Root", features=(part("parts", "Part", 6),)),
        Class("Part"),
        Class("Left", supertypes=("Part",)),
        Class("Right", supertypes=("Part",)),
        Class("Both", supertypes=("Left", "Right"), features=(part("tips", "Tip", 2),)),
        Class("Tip"),
    )
    assert [found.extent_size(name) for name in ("Both", "Part", "Tip")] == [1.5, 6.0, 3.0]


@pytest.mark.parametrize("number", [20, 2_000])
def test_hundreds_of_classes_that_contain_each_other_are_estimated_fast(number: int) -> None:
    leaves = [Class(f"C{i}", supertypes=("Element",)) for i in range(number)]
    found = sizes(Class("Element", abstract=True, features=(part("parts", "Element"),)), *leaves)
    assert found.extent_size("Element") == number * PLAN.unknown
    found = sizes(
        Class("Root", features=(part("all", "Element"),)),
        Class("Element", abstract=True, features=(part("parts", "Element"),)),
        *leaves,
    )
    assert (
        found.extent_size("Element") == pytest.approx(max(50.0, number))
        and found.extent_size("C0") <= PLAN.most_contained
    )
