"""Models as JSON."""

import copy
import json
import pickle
import subprocess
import sys

import pytest

from envgraph.errors import LoadError
from envgraph.graph import Model, model_from_json, model_to_json
from tests.property.snapshots import snapshot
from tests.unit.graph.domain import FOREST, PEOPLE, forest, people

PERSON = {"id": 0, "class": "Person"}


def document(*objects, **more):
    """A file of people."""
    return {"format": "envgraph-model-1", "objects": list(objects), **more}


def test_models_are_written_in_the_documented_json_format():
    model = forest(1)
    model["t00"].retype("WaterTile")
    model["t00"].y = None
    assert model_to_json(model) == {
        "format": "envgraph-model-1",
        "name": "square",
        "metamodel": "burning_forest",
        "next_id": 3,
        "objects": [
            {"id": 0, "class": "Forest", "name": "forest", "features": {"states": [1], "agent": 2}},
            {
                "id": 1,
                "class": "WaterTile",
                "name": "t00",
                "features": {"x": 0, "y": None, "collected": False},
            },
            {"id": 2, "class": "FireTruck", "name": "truck", "features": {"currentState": 1}},
        ],
    }


def test_opposite_pairs_are_written_once():
    model = forest(2)
    features = {entry["name"]: entry["features"] for entry in model_to_json(model)["objects"] if "name" in entry}
    assert features["t00"] == {"x": 0, "y": 0, "right": 2, "down": 3}
    assert features["t11"] == {"x": 1, "y": 1}


def test_reading_restores_ids_orders_and_hash():
    model = forest()
    model["t00"].delete("spo")
    model["t20"].retype("BurningTile")
    model["t12"].delete("spo")
    model.create("FireTruck", currentState=model["t11"])
    model.create("FireTruck").delete()
    text = json.dumps(model_to_json(model))
    again = model_from_json(text, FOREST)
    assert snapshot(again) == snapshot(model)
    assert again.name == model.name
    assert json.dumps(model_to_json(again)) == text
    again.check_integrity()


def test_orders_are_written_only_where_reading_would_differ():
    model, (ann, ben, eve) = people("ann", "ben", "eve")
    ben.likes.append(ann)
    eve.likes.append(ann)
    assert "orders" not in model_to_json(model)
    ben.likes.remove(ann)
    ben.likes.append(ann)
    data = model_to_json(model)
    assert data["orders"] == [{"node": 0, "reference": "Person.likes", "sources": [2, 1]}]
    assert snapshot(model_from_json(data, PEOPLE)) == snapshot(model)


@pytest.mark.parametrize("duplicate", [Model.copy, copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_a_copy_is_another_model_in_the_same_state(duplicate):
    model = forest()
    model["t00"].delete("spo")
    version = model.commit()
    again = duplicate(model)
    assert snapshot(again) == snapshot(model)
    again["t11"].x = 9
    assert model["t11"].x == 1
    assert model.version is version
    assert again.version is None


def test_infinite_floats_are_written_and_read():
    model, (ann, ben) = people("ann", "ben")
    ann.height, ben.height = float("inf"), float("-inf")
    data = json.loads(json.dumps(model_to_json(model), allow_nan=False))
    again = model_from_json(data, PEOPLE)
    assert (again["ann"].height, again["ben"].height) == (float("inf"), float("-inf"))


def test_missing_json_keys_have_defaults():
    model = model_from_json(document(PERSON), PEOPLE)
    assert model.name == "model"
    assert model.node(0).nick == "?"
    assert model.graph.new("Stone") == 1


def test_both_ends_of_an_opposite_may_be_written():
    group = {"id": 1, "class": "Group", "features": {"members": [0]}}
    model = model_from_json(document({**PERSON, "features": {"groups": [1]}}, group), PEOPLE)
    assert model.node(1).members == [model.node(0)]
    model.check_integrity()


def test_a_link_may_be_null():
    model = model_from_json(document({**PERSON, "features": {"spouse": None}}), PEOPLE)
    assert model.node(0).spouse is None


DOG = {"id": 1, "class": "Dog"}


@pytest.mark.parametrize(
    ("data", "messages"),
    [
        ([], ["expected an object in braces"]),
        (document(format="ecore"), ["`format`: expected 'envgraph-model-1', not 'ecore'"]),
        ({}, ["`format`: expected 'envgraph-model-1', not None"]),
        (document(metamodel="forest"), ["`metamodel`: the model is of metamodel 'forest', not of 'people'"]),
        (document(name=3), ["`name`: expected a text, not 3"]),
        (document(nam="x"), ["`nam`: unknown key"]),
        ({"format": "envgraph-model-1"}, ["`objects`: expected a list of objects"]),
        (document(3), ["`objects[0]`: expected an object in braces"]),
        (document({"class": "Person"}), ["`objects[0].id`: expected an int from 0, not None"]),
        (document({**PERSON, "id": True}), ["`objects[0].id`: expected an int from 0, not True"]),
        (
            document({**PERSON, "id": 10**12}),
            ["`objects[0].id`: id 1000000000000 is too large: at most 1001000 is allowed here"],
        ),
        (document(PERSON, PERSON), ["`objects[1].id`: two objects have the id 0"]),
        (document({"id": 0}), ["`objects[0].class`: expected the name of a class, not None"]),
        (
            document({"id": 0, "class": "Persn"}),
            ["`objects[0].class`: unknown class `Persn`"],
        ),
        (document({**PERSON, "name": 1}), ["`objects[0].name`: expected a text, not 1"]),
        (
            document({**PERSON, "name": "a"}, {**DOG, "name": "a"}),
            ["`objects[1].name`: another object has the name `a` too"],
        ),
        (document({**PERSON, "feature": {}}), ["`objects[0].feature`: unknown key"]),
        (document({**PERSON, "features": []}), ["`objects[0].features`: expected an object in braces"]),
        (
            document({**PERSON, "features": {"nik": 1}}),
            ["`objects[0].features.nik`: `Person` has no feature `nik`"],
        ),
        (
            document({**PERSON, "features": {"nick": 1}}),
            ["`objects[0].features.nick`: `Person.nick` takes string, not 1 (int)"],
        ),
        (
            document({**PERSON, "features": {"nick": [1]}}),
            ["`objects[0].features.nick`: `Person.nick` takes string, not [1] (list)"],
        ),
        (
            document({**PERSON, "features": {"mood": ["sad"]}}),
            ["`objects[0].features.mood`: `Person.mood` takes Mood, not ['sad'] (list)"],
        ),
        (
            document({**PERSON, "features": {"spouse": 7}}),
            ["`objects[0].features.spouse`: there is no object 7"],
        ),
        (
            document({**PERSON, "features": {"likes": [0, "a"]}}),
            ["`objects[0].features.likes[1]`: there is no object 'a'"],
        ),
        (
            document({**PERSON, "features": {"spouse": 1}}, DOG),
            ["`objects[0].features.spouse`: `Person.spouse` leads to `Person`, but `Dog#1` is of class `Dog`"],
        ),
        (
            document({**PERSON, "features": {"spouse": [0, 1]}}, {"id": 1, "class": "Person"}),
            ["`objects[0].features.spouse[1]`: `Person#0` has 1 of at most 1 targets of `spouse` already"],
        ),
        (
            document(
                {**PERSON, "features": {"animals": [1]}},
                DOG,
                {"id": 2, "class": "Group", "features": {"pet": 1}},
            ),
            ["`objects[2].features.pet`: `Dog#1` is in another container already"],
        ),
        (
            document(
                {"id": 0, "class": "Group", "features": {"parts": [1]}},
                {"id": 1, "class": "Group", "features": {"parts": [0]}},
            ),
            ["`objects[1].features.parts[0]`: `Group#0` cannot be put into `Group#1`, which is inside it"],
        ),
        (document(PERSON, next_id=0), ["`next_id`: 0 is not greater than all ids of objects"]),
        (document(PERSON, next_id="1"), ["`next_id`: expected an int from 0, not '1'"]),
        (
            document(next_id=10**12),
            ["`next_id`: id 1000000000000 is too large: at most 1000000 is allowed here"],
        ),
        (document(orders=3), ["`orders`: expected a list"]),
        (document(orders=[3]), ["`orders[0]`: expected an object in braces"]),
        (
            document(PERSON, orders=[{"node": 0, "reference": "x", "sources": []}]),
            ["`orders[0].reference`: unknown reference 'x'"],
        ),
        (
            document(PERSON, orders=[{"node": 0, "reference": ["x"], "sources": []}]),
            ["`orders[0].reference`: unknown reference ['x']"],
        ),
        (
            document(PERSON, orders=[{"node": 4, "reference": "Person.likes", "sources": []}]),
            ["`orders[0].node`: there is no object 4"],
        ),
        (
            document(PERSON, orders=[{"node": 0, "reference": "Person.likes", "sources": [0]}]),
            ["`orders[0].sources`: expected the ids [] in some order"],
        ),
        (
            document({**PERSON, "features": {"nik": 1, "nick": 2}}, 3, {"id": 1, "class": "Stone", "x": 1}),
            [
                "`objects[1]`: expected an object in braces",
                "`objects[2].x`: unknown key",
                "`objects[0].features.nik`: `Person` has no feature `nik`",
                "`objects[0].features.nick`: `Person.nick` takes string, not 2 (int)",
            ],
        ),
    ],
)
def test_every_problem_is_named_with_its_place(data, messages):
    with pytest.raises(LoadError) as caught:
        model_from_json(data, PEOPLE)
    assert [diagnostic.message for diagnostic in caught.value.diagnostics] == messages
    assert all(diagnostic.hint for diagnostic in caught.value.diagnostics)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"a": 1,\n  b}', "m.json:2:3: expecting property name"),
        ("", "m.json:1:1: expecting value"),
        ("[" * 100_000, "m.json"),
    ],
)
def test_text_that_is_not_json_is_a_diagnostic(text, expected):
    with pytest.raises(LoadError) as caught:
        model_from_json(text, PEOPLE, file="m.json")
    assert expected in str(caught.value)


def test_nan_is_refused():
    with pytest.raises(LoadError, match="takes float, not nan"):
        model_from_json(json.dumps(document({**PERSON, "features": {"height": float("nan")}})), PEOPLE)


def test_models_can_be_copied_before_the_json_module_is_imported() -> None:
    code = (
        "import sys, copy, pickle\n"
        "from envgraph.graph import Model\n"
        "from envgraph.metamodel import Attribute, Class, Metamodel, Scalar\n"
        "model = Model(Metamodel('m', [Class('A', features=(Attribute('x', Scalar.INT),))]))\n"
        "one = model.create('A', x=1)\n"
        "assert 'envgraph.graph.interchange._model_json' not in sys.modules\n"
        "others = [model.copy(), copy.copy(model), copy.deepcopy(model), pickle.loads(pickle.dumps(model))]\n"
        "one.x = 2\n"
        "print(*[other.node(one.id).x for other in others])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1"] * 4
