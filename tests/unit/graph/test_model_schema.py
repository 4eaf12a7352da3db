"""The published JSON Schema of models."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from jsonschema import Draft202012Validator

import envgraph
from envgraph.errors import LoadError
from envgraph.graph import Model, model_from_json, model_schema, model_to_json
from tests.property.strategies import models
from tests.unit.graph.domain import PEOPLE, forest, people

VALIDATOR = Draft202012Validator(model_schema())
PERSON = {"id": 0, "class": "Person"}


def test_the_model_schema_is_a_valid_json_schema() -> None:
    Draft202012Validator.check_schema(model_schema())
    file = Path(envgraph.__file__).parent / "graph" / "interchange" / "model.schema.json"
    assert json.loads(file.read_text("utf-8")) == model_schema()


@given(models())
def test_exported_models_are_valid(model: Model) -> None:
    VALIDATOR.validate(json.loads(json.dumps(model_to_json(model))))


def test_named_objects_and_orders_are_valid() -> None:
    VALIDATOR.validate(model_to_json(forest()))
    model, (ann, ben, cyd) = people("ann", "ben", "cyd")
    for one in (cyd, ann):
        one.likes.append(ben)
    data = model_to_json(model)
    assert data["orders"]
    VALIDATOR.validate(data)


@pytest.mark.parametrize(
    "objects",
    [
        [{"id": 0}],
        [{"class": "Person"}],
        [{**PERSON, "id": -1}],
        [{**PERSON, "id": "0"}],
        [{**PERSON, "nmae": "a"}],
        [{**PERSON, "name": 3}],
        [{**PERSON, "features": [1]}],
        [{**PERSON, "features": {"knows": {"id": 0}}}],
        {"0": PERSON},
    ],
)
def test_models_that_violate_the_schema_are_refused_on_reading(objects: object) -> None:
    data = {"format": "envgraph-model-1", "objects": objects}
    assert not VALIDATOR.is_valid(data)
    with pytest.raises(LoadError):
        model_from_json(data, PEOPLE)


@pytest.mark.parametrize("data", [{"objects": []}, {"format": "envgraph-model-2", "objects": []}, []])
def test_other_formats_are_refused(data: object) -> None:
    assert not VALIDATOR.is_valid(data)
    with pytest.raises(LoadError):
        model_from_json(data, PEOPLE)  # type: ignore[arg-type]


def test_after_a_hundred_mistakes_the_rest_is_not_read() -> None:
    data = {"format": "envgraph-model-1", "objects": [{"id": id, "class": "Nobody"} for id in range(5_000)]}
    with pytest.raises(LoadError) as caught:
        model_from_json(data, PEOPLE)
    codes = [one.code for one in caught.value.diagnostics]
    assert len(codes) == 101 and codes[-1] == "too-many-errors"
