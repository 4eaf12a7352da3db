"""Changes that are taken back and made again."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.errors import TransactionError
from envgraph.graph import Model
from tests.unit.rewrite.graphs import METAMODEL, chain, snapshot


def scramble(model: Model, random: Random) -> None:
    """Some changes of every kind."""
    for _ in range(12):
        nodes = model.nodes("Item")
        one, other = random.choice(nodes), random.choice(nodes)
        match random.randrange(7):
            case 0:
                model.create("Item", n=random.randrange(9))
            case 1 if len(nodes) > 3:
                one.delete("spo")
            case 2:
                one.next = other
            case 3:
                one.retype("Special" if one.cls == "Item" else "Item") if not one.is_a("Special") else None
            case 4:
                one.links = random.sample(nodes, min(len(nodes), random.randrange(40)))
            case 5:
                one.label = f"l{random.randrange(9)}"
            case _:
                model.graph.set_object_name(one.id, f"name{random.random()}")


@pytest.mark.parametrize("seed", range(15))
def test_shelved_changes_can_be_redone_exactly_and_repeatedly(seed: int) -> None:
    random, model = Random(seed), chain(40)
    states, shelves = [snapshot(model)], []
    for _ in range(4):
        savepoint = model.graph.history.savepoint()
        scramble(model, random)
        states.append(snapshot(model))
        shelves.append((savepoint, model.graph.store.next_id))
    kept = [model.graph.history.undo_to(savepoint) for savepoint, _ in reversed(shelves)][::-1]
    assert snapshot(model) == states[0] and not model.graph.history.savepoint_depth
    for depth in (4, 2, 3):
        marks = []
        for shelf, state in zip(kept[:depth], states[1:], strict=False):
            marks.append(model.graph.history.redo(shelf))
            assert snapshot(model) == state
        assert model.graph.store.next_id == shelves[depth - 1][1]
        model.check_integrity()
        while marks:
            model.graph.history.rollback(marks.pop())
            assert snapshot(model) == states[len(marks)]
    for shelf in kept:
        model.graph.history.release(model.graph.history.redo(shelf))
    assert snapshot(model) == states[4]


def test_only_the_innermost_savepoint_can_be_shelved() -> None:
    model = Model(METAMODEL)
    outer, inner = model.graph.history.savepoint(), model.graph.history.savepoint()
    with pytest.raises(TransactionError):
        model.graph.history.undo_to(outer)
    model.graph.history.rollback(inner)
    model.graph.history.undo_to(outer)
    with pytest.raises(TransactionError):
        model.graph.history.undo_to(outer)


def test_resumed_changes_can_be_committed() -> None:
    model = chain(3)
    start = model.commit()
    savepoint = model.graph.history.savepoint()
    model.node(0).n = 7
    shelf = model.graph.history.undo_to(savepoint)
    assert model.version is start
    model.graph.history.release(model.graph.history.redo(shelf))
    later = model.commit()
    model.checkout(start)
    assert model.node(0).n == 0
    model.checkout(later)
    assert model.node(0).n == 7
    model.check_integrity()
