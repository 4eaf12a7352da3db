"""Models as text: read again they are the same, but for ids."""

from __future__ import annotations

import pytest
from hypothesis import given

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.lang import TextFiles, bundled_domain, load_workspace, model_to_text
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from tests.property.strategies import models


def read(text: str, metamodel: Metamodel) -> Model:
    workspace = load_workspace(["a.model"], files=TextFiles({"a.model": text}), metamodel=metamodel)
    assert not [one for one in workspace.errors if one.code != "conformance"], workspace.errors[:3]
    return workspace.model()


@given(models())
def test_model_read_from_its_text_is_isomorphic(model: Model) -> None:
    try:
        text = model_to_text(model)
    except InvalidArgument as error:
        assert "inf" in str(error)
        return
    again = read(text, model.metamodel)
    assert len(again) == len(model)
    assert again.canonical_hash() == model.canonical_hash()
    assert model_to_text(again) == text


@pytest.mark.parametrize("domain", ["keydoor", "network", "railway", "warehouse"])
def test_bundled_models_are_restored_from_their_text(domain: str) -> None:
    metamodel = bundled_domain(domain) / f"{domain}.metamodel"
    source = metamodel.read_text("utf-8")
    for file in [*bundled_domain(domain).glob("*.model")] or [metamodel]:
        read_back(load_workspace([file]).model(), source)


def read_back(model: Model, metamodel: str) -> None:
    text = model_to_text(model, ["m.metamodel"])
    again = load_workspace(["a.model"], files=TextFiles({"a.model": text, "m.metamodel": metamodel}))
    assert not again.errors
    assert again.model().canonical_hash() == model.canonical_hash()


def test_model_text_keeps_valid_object_names_and_replaces_others() -> None:
    place = Class("Place", False, (), (Attribute("label", Scalar.STRING), Reference("to", "Place", 0, None)))
    model = Model(Metamodel("map", (place,)), "m")
    home = model.create("Place", object_name="grid", label='a "b"\\\n\u00e9\x07')
    corner = model.create("Place", object_name="plot[3, 1]")
    other = model.create("Place")
    home.to = [corner, other, home]
    text = model_to_text(model)
    assert "^grid : Place" in text and "to = [plot_3_1, place, ^grid]" in text
    assert 'label = "a \\"b\\"\\\\\\n\u00e9\\u0007"' in text
    assert read(text, model.metamodel)["grid"].label == home.label
