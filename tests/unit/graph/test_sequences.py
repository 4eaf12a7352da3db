"""Sequences with exact undo."""

import pytest

from envgraph.errors import RuleError
from envgraph.graph import ASSIGNED, IndexedSet
from tests.facts import Notified
from tests.unit.graph.domain import forest


def test_a_removal_moves_the_last_element_into_the_gap():
    items = IndexedSet("abcd")
    assert items.take("b") == 1
    assert items == ["a", "d", "c"]
    assert "b" not in items
    assert items.where("d") == 1


def test_undoing_a_removal_restores_the_order():
    for letter in "abcd":
        items = IndexedSet("abcd")
        items.put(letter, items.take(letter))
        assert items == list("abcd")
        assert items.position == {"a": 0, "b": 1, "c": 2, "d": 3}


def test_data_of_followers_is_rolled_back_with_the_model():
    model = forest()
    index: dict[str, int | None] = {"burning": 0}

    def count(number):
        model.graph.store.record_change(index, "burning", index["burning"], ASSIGNED)
        index["burning"] = number

    root = model.commit()
    model["t00"].retype("BurningTile")
    count(1)
    later = model.commit()
    with pytest.raises(RuleError), model.transaction():
        model["t10"].retype("BurningTile")
        count(2)
        model["t10"].delete()
    assert index == {"burning": 1}
    model.checkout(root)
    assert index == {"burning": 0}
    model.checkout(later)
    assert index == {"burning": 1}


def test_moving_a_target_notifies_no_fact():
    model = forest()
    heard = []

    class Ear:
        def inserted(self, fact):
            heard.append(fact)

        removing = restored = inserted

    targets = model.nodes("Forest")[0].states
    before = list(targets)
    Notified(model, Ear())
    digest = model.state_hash()
    with model.transaction():
        targets.insert(0, targets[-1])
    assert list(targets) == [before[-1], *before[:-1]]
    assert not heard and model.state_hash() == digest
    model.check_integrity()
