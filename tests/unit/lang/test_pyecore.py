"""Packages and objects of pyecore become metamodels and models, and the other way."""

import sys
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.lang import (
    load_workspace,
    metamodel_from_pyecore,
    metamodel_to_pyecore,
    model_from_pyecore,
    model_to_pyecore,
)
from envgraph.metamodel import Metamodel

ecore = pytest.importorskip("pyecore.ecore")

DATA = Path(__file__).parents[2] / "data" / "emf"


@pytest.fixture
def society():
    """A package, two people who know each other, and their group."""
    package = ecore.EPackage("society", "http://example.org/society", "s")
    person, group = ecore.EClass("Person"), ecore.EClass("Group")
    person.eStructuralFeatures.append(ecore.EAttribute("name", ecore.EString))
    person.eStructuralFeatures.append(ecore.EReference("knows", person, upper=-1))
    members = ecore.EReference("members", person, upper=-1, containment=True)
    group.eStructuralFeatures.append(members)
    person.eStructuralFeatures.append(ecore.EReference("group", group, eOpposite=members))
    package.eClassifiers.extend([person, group])
    ann, ben, both = person(name="Ann"), person(name="Ben"), group()
    both.members.extend([ann, ben])
    ann.knows.append(ben)
    return package, both


def test_a_package_becomes_a_metamodel_with_its_opposites(society) -> None:
    metamodel = metamodel_from_pyecore(society[0])
    assert (metamodel.name, metamodel.uri) == ("society", "http://example.org/society")
    members = metamodel.feature("Group", "members")
    assert members is not None and members.opposite == "group"


def test_packages_that_a_package_refers_to_are_converted_with_it() -> None:
    people = ecore.EPackage("people", "http://example.org/people", "p")
    inner = ecore.EPackage("inner", "http://example.org/people/inner", "i")
    people.eSubpackages.append(inner)
    person = ecore.EClass("Person")
    inner.eClassifiers.append(person)
    hotel = ecore.EPackage("hotel", "http://example.org/hotel", "h")
    room, guest = ecore.EClass("Room"), ecore.EClass("Guest", superclass=(person,))
    room.eStructuralFeatures.append(ecore.EReference("host", person))
    guests = ecore.EReference("guests", person, upper=-1, containment=True)
    room.eStructuralFeatures.append(guests)
    person.eStructuralFeatures.append(ecore.EReference("room", room, eOpposite=guests))
    hotel.eClassifiers.extend([room, guest])

    metamodel = metamodel_from_pyecore(hotel)
    assert [(one.name, one.package) for one in metamodel.class_list] == [
        ("Room", ""),
        ("Guest", ""),
        ("Person", "people.inner"),
    ]
    assert metamodel.classes["Guest"].supertypes == ("Person",)
    opposite = metamodel.feature("Room", "guests")
    assert opposite is not None and opposite.opposite == "room"

    suite, visitor = room(), guest()
    suite.guests.append(visitor)
    model = model_from_pyecore(suite, metamodel=metamodel)
    assert model.nodes("Guest")[0].room == model.nodes("Room")[0]
    (again,) = model_to_pyecore(model, hotel)
    assert isinstance(again.guests[0], person)


def test_unrelated_packages_can_be_converted_together() -> None:
    first, second = (ecore.EPackage("same", f"http://example.org/{name}", name) for name in "ab")
    first.eClassifiers.append(ecore.EClass("A"))
    second.eClassifiers.append(ecore.EClass("B"))
    assert list(metamodel_from_pyecore(first, second).classes) == ["A", "B"]


def test_objects_become_a_model(society) -> None:
    package, group = society
    model = model_from_pyecore(group, metamodel=metamodel_from_pyecore(package))
    people = model.nodes("Person")
    assert [person["name"] for person in people] == ["Ann", "Ben"]
    assert list(people[0].knows) == [people[1]]
    assert people[1].group == model.nodes("Group")[0]
    assert group.eResource is None


def test_a_model_converted_to_pyecore_and_back_is_equal() -> None:
    model = load_workspace([DATA / "library.xmi"]).model()
    (library,) = model_to_pyecore(model)
    assert library.director.name == "Cora"
    assert [item.name for shelf in library.shelves for item in shelf.items] == [
        "Emma",
        "Amélie",
        "Momo",
        "Ran",
    ]
    assert library.shelves[0].items[1].lentTo is library.members[2]
    again = model_from_pyecore(library, metamodel=model.metamodel)
    assert again.canonical_hash() == model.canonical_hash()


def test_a_metamodel_converted_to_pyecore_and_back_is_equal() -> None:
    metamodel = load_workspace([DATA / "library.ecore"]).metamodel
    assert metamodel is not None
    again = metamodel_from_pyecore(metamodel_to_pyecore(metamodel))
    assert again.class_list == metamodel.class_list
    assert again.packages == metamodel.packages


def test_features_that_cannot_be_converted_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    package = ecore.EPackage("p", "http://p", "p")
    tagged = ecore.EClass("Tagged")
    tagged.eStructuralFeatures.append(ecore.EAttribute("size", ecore.EInt, transient=True))
    tagged.eStructuralFeatures.append(ecore.EAttribute("name", ecore.EString))
    package.eClassifiers.append(tagged)
    with caplog.at_level("WARNING", "envgraph"):
        found = metamodel_from_pyecore(package)
    assert caplog.messages == ["the transient feature `size` is left out"]
    assert list(found.features("Tagged")) == ["name"]
    assert found.left_out_reason("Tagged", "size") == "it is transient, and was left out of the metamodel"


def test_packages_can_use_classes_of_ecore() -> None:
    package = ecore.EPackage("p", "http://p", "p")
    tagged = ecore.EClass("Tagged", superclass=(ecore.ENamedElement.eClass,))
    tagged.eStructuralFeatures.append(ecore.EReference("anything", ecore.EObject))
    package.eClassifiers.append(tagged)
    found = metamodel_from_pyecore(package)
    assert str(found.feature("Tagged", "anything").target) == "EObject"
    assert found.is_a("Tagged", "EModelElement") and "name" in found.features("Tagged")
    both = metamodel_from_pyecore(package, ecore.eClass)
    assert both.class_list == found.class_list and both.name == "p"
    alone = metamodel_from_pyecore(ecore.eClass)
    assert alone.name == "ecore" and alone.is_a("EReference", "ETypedElement")
    assert metamodel_from_pyecore(ecore).class_list == alone.class_list  # a package as a module
    assert {cls.name for cls in alone.class_list} == {cls.name for cls in found.class_list} - {"Tagged"}
    assert metamodel_from_pyecore(metamodel_to_pyecore(found)).class_list == found.class_list


def test_arguments_other_than_packages_and_objects_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="EPackage"):
        metamodel_from_pyecore("society")
    with pytest.raises(InvalidArgument, match="EPackage"):
        metamodel_from_pyecore(pytest)
    with pytest.raises(InvalidArgument, match="a model needs at least one"):
        model_from_pyecore(metamodel=Metamodel("m", []))


def test_without_pyecore_conversions_name_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyecore.ecore", None)
    monkeypatch.setitem(sys.modules, "pyecore.resources", None)
    metamodel = load_workspace([DATA / "library.ecore"]).metamodel  # files need no pyecore
    assert metamodel is not None
    for call in (
        lambda: metamodel_from_pyecore(None),
        lambda: metamodel_to_pyecore(metamodel),
        lambda: model_from_pyecore(metamodel=metamodel),
    ):
        with pytest.raises(InvalidArgument, match=r"pip install 'envgraph\[emf\]'"):
            call()
