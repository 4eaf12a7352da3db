"""Random models through JSON and networkx; hashes; conformance."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given, strategies as st

from envgraph.graph import (
    Model,
    check_conformance,
    from_networkx,
    model_from_json,
    model_to_json,
    to_networkx,
)
from envgraph.metamodel import Attribute
from tests.property.snapshots import snapshot
from tests.property.strategies import EDITS, edit, models


@given(models())
def test_json_restores_ids_and_every_order(model: Model) -> None:
    text = json.dumps(model_to_json(model))
    again = model_from_json(text, model.metamodel)
    again.check_integrity()
    assert snapshot(again) == snapshot(model)
    assert json.dumps(model_to_json(again)) == text


@given(models(), st.data())
def test_model_read_from_json_accepts_edits_like_the_original(model: Model, data: st.DataObject) -> None:
    again = model_from_json(model_to_json(model), model.metamodel)
    drawn: list[Any] = []

    def draw(strategy: st.SearchStrategy[Any]) -> Any:
        drawn.append(data.draw(strategy))
        return drawn[-1]

    for kind in data.draw(st.lists(st.sampled_from(EDITS), max_size=10)):
        drawn.clear()
        edit(draw, model, kind)
        choices = iter(drawn)
        edit(lambda _, choices=choices: next(choices), again, kind)
        assert snapshot(again) == snapshot(model)


@given(models())
def test_networkx_keeps_all_facts(model: Model) -> None:
    again = from_networkx(to_networkx(model), model.metamodel)
    again.check_integrity()
    assert again.state_hash() == model.state_hash()
    assert again.canonical_hash() == model.canonical_hash()


@given(models(), st.randoms(use_true_random=False))
def test_the_canonical_hash_ignores_ids_and_orders(model: Model, dice) -> None:
    data = model_to_json(model)
    data.pop("orders", None)
    new = dict(zip((entry["id"] for entry in data["objects"]), _shuffled(range(len(model)), dice), strict=True))
    for entry in data["objects"]:
        for feature in model.metamodel.features(entry["class"]).values():
            if feature.name in entry["features"] and not isinstance(feature, Attribute):
                value = entry["features"][feature.name]
                moved = [new[id] for id in value] if isinstance(value, list) else new[value]
                entry["features"][feature.name] = _shuffled(moved, dice) if isinstance(moved, list) else moved
        entry["id"] = new[entry["id"]]
    data["objects"] = _shuffled(data["objects"], dice)
    del data["next_id"]
    again = model_from_json(data, model.metamodel)
    assert again.canonical_hash() == model.canonical_hash()


def _shuffled(items, dice) -> list:
    items = list(items)
    dice.shuffle(items)
    return items


@given(models())
def test_conformance_violations_equal_counted_bounds(model: Model) -> None:
    expected = []
    for node in model.graph.store.nodes():
        for feature in model.metamodel.features(model.graph.class_of(node)).values():
            held = (model.graph.values if isinstance(feature, Attribute) else model.graph.targets)(node, feature)  # type: ignore[operator]
            wrong = not feature.lower <= len(held) <= (feature.upper or 10**9)
            if wrong:
                expected.append((node, feature.name))
    assert [(violation.node, violation.feature.name) for violation in check_conformance(model)] == expected
