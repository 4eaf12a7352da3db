"""Sequences with exact undo."""

import pytest

from envgraph.errors import RuleError
from envgraph.graph import EXCHANGE, IN, OUT, SET, IndexedSet
from envgraph.graph.store._journal import MOVE, Journal, invert, take_back
from tests.facts import Notified
from tests.unit.graph.domain import forest


def test_a_removal_moves_the_last_element_into_the_gap():
    items = IndexedSet("abcd")
    assert items.take("b") == 1
    assert items == ["a", "d", "c"]
    assert "b" not in items
    assert items.where("d") == 1


def test_putting_back_is_exact():
    for letter in "abcd":
        items = IndexedSet("abcd")
        items.put(letter, items.take(letter))
        assert items == list("abcd")
        assert items.position == {"a": 0, "b": 1, "c": 2, "d": 3}


def test_other_structures_can_use_the_journal():
    # As a view above the model would: its own entries between those of the model.
    class Counter:
        def __init__(self):
            self.counts = {}

        def exchange(self, key, state):
            before = self.counts.get(key)
            self.counts[key] = state
            return before

    matches, counter, index = IndexedSet(()), Counter(), {}
    journal = []
    journal.extend((matches, (1, 2), None, OUT))
    matches.add((1, 2))
    journal.extend((counter, "p", counter.exchange("p", 1), EXCHANGE))
    journal.extend((index, 1, index.get(1), SET))
    index[1] = (1, 2)
    mark = len(journal)
    journal.extend((matches, (1, 2), matches.take((1, 2)), IN))
    take_back(journal, mark)
    assert matches == [(1, 2)]
    back: Journal = []
    invert(reversed(journal), back)
    assert (matches, counter.counts, index) == ([], {"p": None}, {1: None})
    invert(reversed(back), [])
    assert (matches, counter.counts, index) == ([(1, 2)], {"p": 1}, {1: (1, 2)})


def test_what_follows_the_model_is_rolled_back_with_it():
    model = forest()
    index: dict[str, int | None] = {"burning": 0}

    def count(number):
        model.graph.store.record(index, "burning", index["burning"], SET)
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


def test_a_move_updates_indices_and_can_be_undone():
    items = IndexedSet(tuple(range(300)))
    journal: Journal = []
    for item, index in ((299, 0), (5, 200), (0, 299), (150, 150), (299, 298)):
        journal.extend((items, item, items.where(item), MOVE))
        items.move(item, index)
        assert items[index] == item and [items.where(one) for one in items] == [*range(300)]
    after = list(items)
    back: Journal = []
    invert(reversed(journal), back)
    assert items == [*range(300)]
    invert(reversed(back), [])
    assert items == after
    assert items.take(299) == 298 and items.take(1) == after.index(1)
    assert [items.where(one) for one in items] == [*range(298)]


def test_a_target_that_moves_changes_no_fact():
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
