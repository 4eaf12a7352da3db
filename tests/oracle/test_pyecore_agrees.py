"""`.ecore` and `.xmi` files against pyecore: what one side writes, the other reads as the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given

from envgraph.errors import InvalidArgument, Source
from envgraph.graph import Model, model_to_xmi
from envgraph.lang import load_workspace
from envgraph.metamodel import Class, Metamodel, Reference, metamodel_to_ecore
from tests.property.strategies import metamodels, models
from tests.reading import parse_ecore, parse_xmi

pyecore_side = pytest.importorskip("tests.oracle.pyecore_side", exc_type=ImportError)

DATA = Path(__file__).parents[1] / "data" / "emf"


def test_library_model_is_read_alike_by_pyecore_and_envgraph() -> None:
    model = load_workspace([DATA / "library.xmi"]).model()
    package = pyecore_side.read_package((DATA / "library.ecore").read_text("utf-8"))
    roots = pyecore_side.read_objects((DATA / "library.xmi").read_text("utf-8"), package)
    assert pyecore_side.objects_in_words(roots, model.metamodel) == pyecore_side.model_in_words(model)
    again = parse_xmi(Source("library.xmi", pyecore_side.write(*roots)), model.metamodel)
    assert again.canonical_hash() == model.canonical_hash()


def test_pyecore_reads_the_library_metamodel_written_by_envgraph() -> None:
    metamodel = load_workspace([DATA / "library.ecore"]).metamodel
    assert metamodel is not None
    package = pyecore_side.read_package(metamodel_to_ecore(metamodel))
    before = pyecore_side.read_package((DATA / "library.ecore").read_text("utf-8"))
    assert pyecore_side.package_in_words(package) == pyecore_side.package_in_words(before)
    people = package.eSubpackages[0]
    assert (people.name, people.nsURI, people.nsPrefix) == (
        "people",
        "http://example.org/library/people",
        "people",
    )


@given(metamodels())
def test_pyecore_reads_metamodels_written_by_envgraph(metamodel: Metamodel) -> None:
    package = pyecore_side.read_package(_ecore(metamodel))
    assert pyecore_side.package_in_words(package) == pyecore_side.metamodel_in_words(metamodel)


@given(metamodels())
def test_envgraph_reads_metamodels_written_by_pyecore(metamodel: Metamodel) -> None:
    text = pyecore_side.write(pyecore_side.read_package(_ecore(metamodel)))
    again = parse_ecore(Source("m.ecore", text))
    # pyecore 0.15 leaves opposites out when it writes.
    assert (
        again.class_list
        == Metamodel("m", map(_without_opposites, metamodel.class_list), metamodel.enum_types).class_list
    )


@given(models())
def test_pyecore_reads_models_written_by_envgraph(model: Model) -> None:
    assume(not _own_opposites(model.metamodel))
    package = pyecore_side.read_package(_ecore(model.metamodel))
    roots = pyecore_side.read_objects(_xmi(model), package)
    assert pyecore_side.objects_in_words(roots, model.metamodel) == pyecore_side.model_in_words(model)


@given(models())
def test_envgraph_reads_models_written_by_pyecore(model: Model) -> None:
    assume(len(model) and not _own_opposites(model.metamodel))
    package = pyecore_side.read_package(_ecore(model.metamodel))
    ours = _xmi(model)
    assume("xsi:nil" not in ours)  # pyecore does not write that a value is missing
    text = pyecore_side.write(*pyecore_side.read_objects(ours, package))
    again = parse_xmi(Source("m.xmi", text), model.metamodel)
    again.check_integrity()
    assert pyecore_side.model_in_words(again) == pyecore_side.model_in_words(model)


def _ecore(metamodel: Metamodel) -> str:
    text = metamodel_to_ecore(metamodel)
    assume("\ud800" not in text)
    return text


def _xmi(model: Model) -> str:
    try:
        return model_to_xmi(model)
    except InvalidArgument:  # a string that XML does not have
        assume(False)
        raise


def _own_opposites(metamodel: Metamodel) -> bool:
    """pyecore cannot hold a reference that is its own opposite."""
    return any(one.opposite == one.name and one.target == one.owner for one in metamodel.references)


def _without_opposites(cls: Class) -> Class:
    return replace(
        cls,
        features=tuple(replace(one, opposite=None) if isinstance(one, Reference) else one for one in cls.features),
    )
