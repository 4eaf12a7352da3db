"""Look-ups in a metamodel, and values of its attributes."""

import pytest

from envgraph.metamodel import (
    Attribute,
    Class,
    EnumType,
    Metamodel,
    Reference,
    Scalar,
    accepts,
    default_value,
    type_name,
)

WAY = EnumType("Way", ("west", "east"))
MODEL = Metamodel(
    "m",
    [
        Class(
            "Cell",
            abstract=True,
            key=("y", "x"),
            features=(
                Attribute("x", Scalar.INT),
                Attribute("y", Scalar.INT),
                Reference("east", "Cell", 0, 1, opposite="west"),
                Reference("west", "Cell", 0, 1, opposite="east"),
                Reference("beside", "Cell", 0, None, opposite="beside"),
            ),
        ),
        Class("Floor", supertypes=("Cell",)),
        Class("Door", supertypes=("Floor",), features=(Attribute("way", WAY), Attribute("open", Scalar.BOOL))),
        Class("Wall", supertypes=("Cell",), key=("x",)),
        Class("Key", features=(Reference("at", "Floor"),)),
        Class("Both", abstract=True, supertypes=("Door", "Key")),
    ],
    [WAY],
)


def test_supertypes_come_nearest_first():
    assert MODEL.supertypes("Door") == ("Door", "Floor", "Cell")
    assert MODEL.supertypes("Both") == ("Both", "Door", "Key", "Floor", "Cell")


def test_concrete_classes_come_in_order_of_declaration():
    assert MODEL.concrete_classes("Cell") == ("Floor", "Door", "Wall")
    assert MODEL.concrete_classes("Floor") == ("Floor", "Door")
    assert MODEL.concrete_classes("Both") == ()


def test_is_a_and_overlap():
    assert MODEL.is_a("Door", "Cell")
    assert MODEL.is_a("Door", "Door")
    assert not MODEL.is_a("Cell", "Door")
    assert MODEL.may_overlap("Floor", "Cell")
    assert MODEL.may_overlap("Door", "Floor")
    assert not MODEL.may_overlap("Door", "Wall")
    assert not MODEL.may_overlap("Door", "Key")


def test_inherited_features_precede_own_features():
    assert list(MODEL.features("Door")) == ["x", "y", "east", "west", "beside", "way", "open"]
    assert MODEL.feature("Door", "x") is MODEL.feature("Cell", "x")
    assert MODEL.feature("Key", "x") is None


def test_features_have_an_index_and_their_owner():
    assert [attribute.index for attribute in MODEL.attributes] == [0, 1, 2, 3]
    assert [str(attribute) for attribute in MODEL.attributes] == ["Cell.x", "Cell.y", "Door.way", "Door.open"]
    assert [str(reference) for reference in MODEL.references] == [
        "Cell.east", "Cell.west", "Cell.beside", "Key.at",
    ]  # fmt: skip
    assert [reference.index for reference in MODEL.references] == [0, 1, 2, 3]


def test_opposite_references_are_each_others_opposites():
    east, west, beside, at = MODEL.references
    assert MODEL.opposite(east) is west
    assert MODEL.opposite(west) is east
    assert MODEL.opposite(beside) is beside
    assert MODEL.opposite(at) is None


def test_the_key_is_that_of_the_nearest_class_that_has_one():
    assert MODEL.key("Door") == ("y", "x")
    assert MODEL.key("Wall") == ("x",)
    assert MODEL.key("Key") == ()


def test_multiplicities_are_printed_as_in_files():
    def written(lower, upper):
        return Reference("r", "A", lower, upper).multiplicity

    assert [written(1, 1), written(0, 1), written(0, None), written(2, 5)] == ["1", "0..1", "0..*", "2..5"]
    assert [Reference("r", "A", 0, upper).many for upper in (1, 2, None)] == [False, True, True]


@pytest.mark.parametrize(
    ("type_", "yes", "no"),
    [
        (Scalar.INT, [0, -5, 2**63 - 1], [True, 1.0, "1", None, 2**63, -(2**63) - 1]),
        (Scalar.FLOAT, [1.5, 2, float("inf")], [True, float("nan"), "1", None, 10**400]),
        (Scalar.BOOL, [True, False], [0, 1, "true", None]),
        (Scalar.STRING, ["", "a"], [1, None, b"a"]),
        (WAY, ["west", "east"], ["north", 0, None, ["west"]]),
    ],
)
def test_types_accept_their_values(type_, yes, no):
    assert [value for value in [*yes, *no] if accepts(type_, value)] == yes


def test_initial_values():
    assert [default_value(scalar) for scalar in Scalar] == [0, 0.0, False, ""]
    assert default_value(WAY) == "west"
    assert Attribute("x", WAY, "east").initial == "east"
    assert Attribute("x", Scalar.BOOL, True).initial is True


def test_an_int_default_of_a_float_attribute_is_a_float():
    initial = Attribute("x", Scalar.FLOAT, 1).initial
    assert (initial, type(initial)) == (1.0, float)


def test_type_names_are_those_of_metamodel_files():
    assert [type_name(type_) for type_ in (*Scalar, WAY)] == ["int", "float", "bool", "string", "Way"]


def test_repr_is_short():
    assert repr(MODEL) == "<Metamodel m: 6 classes>"
