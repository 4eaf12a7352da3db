"""Indices of objects: ranks of keys over a family, creation order without keys."""

from __future__ import annotations

import json

import pytest

from envgraph.env import KeyIndex, indexed_classes
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import key_patterns
from envgraph.rewrite import Engine
from tests.unit.env import forest
from tests.unit.env.coins import loaded

SIZE = EnumType("Size", ("small", "large", "huge"))


def metamodel() -> Metamodel:
    box = Class(
        "Box",
        features=(Attribute("size", SIZE), Attribute("number", Scalar.INT), Reference("on", "Box", 0, 1)),
        key=("size", "number"),
    )
    return Metamodel("boxes", (box, Class("Crate", supertypes=("Box",)), Class("Loose")), (SIZE,))


def boxes(*keys: tuple[str, int], loose: int = 0) -> Model:
    model = Model(metamodel())
    for place, (size, number) in enumerate(keys):
        model.create("Crate" if place % 2 else "Box", size=size, number=number)
    for _ in range(loose):
        model.create("Loose")
    return model


def remove_number(model: Model) -> None:
    """Of the first box."""
    attribute = model.metamodel.feature("Box", "number")
    assert isinstance(attribute, Attribute)
    model.graph.set_value(0, attribute, None)


def distinct(engine: Engine) -> list[str]:
    """The classes whose objects have keys of their own, as a search asks for it."""
    return [name for name in ("Box", "Crate") if not engine.exists(f"conformance.{name}")]


def with_keys(model: Model) -> Engine:
    engine = Engine(model)
    engine.add(*key_patterns(model.metamodel, ["Box", "Crate", "Loose"]))
    return engine


def test_keys_sort_by_their_attributes_in_order_and_enums_by_their_literals() -> None:
    model = boxes(("small", 10), ("huge", 1), ("large", 2), ("small", 9))
    index = KeyIndex.of_model(model, ["Box"])
    assert index.keys["Box"] == (("small", 9), ("small", 10), ("large", 2), ("huge", 1))
    assert [index.index(model, "Box", node) for node in range(4)] == [1, 3, 2, 0]
    assert index.objects(model, "Box") == [3, 0, 2, 1]


def test_a_subclass_has_an_index_of_its_own_by_the_inherited_key() -> None:
    model = boxes(("small", 10), ("huge", 1), ("large", 2), ("small", 9))
    assert KeyIndex.of_model(model, ["Crate"]).keys == {"Crate": (("small", 9), ("huge", 1))}


def test_the_index_of_a_family_is_the_sorted_union() -> None:
    one, other = boxes(("small", 1), ("huge", 1)), boxes(("large", 5), ("small", 1))
    merged = KeyIndex.of_model(one, ["Box"]).merge(KeyIndex.of_model(other, ["Box"]), metamodel())
    assert merged.keys["Box"] == (("small", 1), ("large", 5), ("huge", 1))
    assert merged.size("Box") == 3
    assert merged.objects(one, "Box") == [0, None, 1]
    assert merged.index(other, "Box", 0) == 1


def test_objects_without_a_key_are_indexed_in_creation_order() -> None:
    model = boxes(("small", 1), loose=2)
    first = KeyIndex.of_model(model, ["Loose"])
    model.graph.delete(1)
    model.create("Loose")
    later = KeyIndex.of_model(model, ["Loose"])
    assert first.merge(later, metamodel()).keys == later.merge(first, metamodel()).keys == {"Loose": ((1,), (2,), (3,))}


def test_two_objects_with_equal_keys_are_an_error() -> None:
    model = boxes(("small", 1), ("small", 1))
    with pytest.raises(EvaluationError, match="the same key"):
        KeyIndex.of_model(model, ["Box"])
    assert distinct(with_keys(model)) == ["Crate"]


def test_an_object_without_a_value_in_its_key_is_an_error() -> None:
    model = boxes(("small", 1))
    remove_number(model)
    with pytest.raises(EvaluationError, match="no `number`, which is part of its key"):
        KeyIndex.of_model(model, ["Box"])
    assert distinct(with_keys(model)) == ["Crate"]


def test_objects_and_classes_outside_the_key_index_are_refused() -> None:
    index = KeyIndex.of_model(boxes(("small", 1)), ["Box"])
    with pytest.raises(EvaluationError, match="no index among `Box`"):
        index.index(boxes(("small", 2)), "Box", 0)
    with pytest.raises(InvalidArgument, match="the index has no class `Loose`; it has Box"):
        index.size("Loose")


def test_distinctness_of_keys_is_updated_after_edits_and_rollbacks() -> None:
    model = boxes(("small", 1), ("small", 2), ("large", 1), loose=2)
    engine = with_keys(model)
    assert distinct(engine) == ["Box", "Crate"]
    assert engine.watched == ("conformance.Box", "conformance.Crate")
    savepoint = model.graph.history.savepoint()
    model.create("Crate", size="large", number=1)
    assert distinct(engine) == ["Crate"]
    model.create("Crate", size="large", number=1)
    assert distinct(engine) == []
    model.graph.history.rollback(savepoint)
    assert distinct(engine) == ["Box", "Crate"]
    savepoint = model.graph.history.savepoint()
    remove_number(model)
    assert distinct(engine) == ["Crate"]
    model.graph.history.rollback(savepoint)
    assert distinct(engine) == ["Box", "Crate"]


def test_key_index_is_restored_from_its_json() -> None:
    index = KeyIndex.of_model(boxes(("small", 10), ("huge", 1), loose=2), ["Box", "Loose"])
    data = json.loads(json.dumps(index.to_json()))
    assert data == {"Box": [["small", 10], ["huge", 1]], "Loose": [[2], [3]]}
    assert KeyIndex.from_json(data, metamodel()) == index


@pytest.mark.parametrize(
    "data",
    [
        [],
        {"Bax": []},
        {"Box": {}},
        {"Box": [["small"]]},
        {"Box": [["tiny", 1]]},
        {"Box": [["small", 1.5]]},
        {"Box": ["small"]},
        {"Loose": [["a"]]},
        {"Loose": [[True]]},
    ],
)
def test_malformed_json_of_a_key_index_is_refused(data: object) -> None:
    with pytest.raises(InvalidArgument):
        KeyIndex.from_json(data, metamodel())


def test_behaviour_indexes_the_classes_that_it_names() -> None:
    assert indexed_classes(forest.behaviour(), forest.metamodel()) == ("Tile",)
    engine, behaviour = loaded(
        "action a(side : Side) = nothing()\naction b(coin : Coin) = nothing()\nobserve hand.holds among Coin or none\n"
        "observe mark.by among Hand for mark : Mark"
    )
    assert indexed_classes(behaviour, engine.model.metamodel) == ("Coin", "Hand", "Mark")


def test_tiles_are_indexed_row_by_row() -> None:
    model = forest.model(["SRR", "RRG"])
    index = KeyIndex.of_model(model, ["Tile"])
    assert index.keys["Tile"] == ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2))
