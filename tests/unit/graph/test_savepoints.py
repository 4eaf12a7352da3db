"""Savepoints and transactions."""

import pytest

from envgraph.errors import RuleError, TransactionError
from envgraph.graph import Model
from tests.property.snapshots import snapshot
from tests.unit.graph.domain import FOREST, feature, forest, people


def test_rollback_restores_ids_order_and_hash():
    model = forest()
    before = snapshot(model)
    savepoint = model.graph.history.savepoint()
    model["t11"].delete("spo")
    model.create("WaterTile", object_name="lake", x=9)
    model["t00"].retype("BurningTile")
    model["truck"].currentState = model["t22"]
    model.graph.history.rollback(savepoint)
    assert snapshot(model) == before
    assert model.graph.new("RoadTile") == before["next_id"]


def test_savepoints_nest():
    model = forest()
    states = [snapshot(model)]
    outer = model.graph.history.savepoint()
    model["t00"].x = 5
    states.append(snapshot(model))
    inner = model.graph.history.savepoint()
    model["t00"].x = 6
    model.graph.history.rollback(inner)
    assert snapshot(model) == states[1]
    model.graph.history.rollback(outer)
    assert snapshot(model) == states[0]


def test_released_changes_are_undone_with_the_outer_savepoint():
    model = forest()
    before = snapshot(model)
    outer = model.graph.history.savepoint()
    inner = model.graph.history.savepoint()
    model["t00"].x = 6
    model.graph.history.release(inner)
    assert model["t00"].x == 6
    model.graph.history.rollback(outer)
    assert snapshot(model) == before


@pytest.mark.parametrize("close", ["rollback", "release"])
def test_closing_out_of_order_is_an_error(close):
    model = forest()
    outer = model.graph.history.savepoint()
    inner = model.graph.history.savepoint()
    with pytest.raises(TransactionError, match="inside this one is still open"):
        getattr(model.graph.history, close)(outer)
    getattr(model.graph.history, close)(inner)
    with pytest.raises(TransactionError, match="closed already"):
        getattr(model.graph.history, close)(inner)
    with pytest.raises(TransactionError, match="another model"):
        getattr(forest().graph.history, close)(outer)
    getattr(model.graph.history, close)(outer)
    assert not model.graph.history.savepoint_depth


def test_a_transaction_keeps_its_changes():
    model = forest()
    with model.transaction():
        assert model.graph.history.savepoint_depth
        model["t00"].x = 5
    assert not model.graph.history.savepoint_depth
    assert model["t00"].x == 5


def test_an_exception_rolls_a_transaction_back():
    model = forest()
    before = snapshot(model)
    with pytest.raises(RuleError), model.transaction():
        model["t00"].x = 5
        with model.transaction():
            model["t10"].x = 5
        model["t11"].delete()
    assert snapshot(model) == before


def test_a_refused_write_leaves_the_model_as_it_was():
    model, (ann, ben) = people("ann", "ben")
    groups = [model.create("Group") for _ in range(3)]
    ann.groups = groups[:2]
    before = snapshot(model)
    with pytest.raises(RuleError):
        model.graph.set_targets(groups[2].id, feature(model, "Group", "members"), [ben.id, ann.id])
    assert snapshot(model) == before


def test_nothing_is_journalled_without_savepoints_or_versions():
    model = forest()
    assert model.graph.store.journal == []
    savepoint = model.graph.history.savepoint()
    model["t00"].x = 5
    assert len(model.graph.store.journal) == 4
    model.graph.history.release(savepoint)
    assert model.graph.store.journal == []


def test_loading_is_refused_with_open_savepoints_or_versions():
    model = forest()
    savepoint = model.graph.history.savepoint()
    with pytest.raises(TransactionError, match="cannot load inside a transaction"), model.loading():
        pass
    model.graph.history.release(savepoint)
    version = model.commit()
    with pytest.raises(TransactionError, match="load before the first commit"), model.loading():
        pass
    assert version is model.version


def test_savepoints_and_versions_are_refused_while_loading():
    model = Model(FOREST)
    with model.loading():
        with pytest.raises(TransactionError, match="loading"):
            model.graph.history.savepoint()
        with pytest.raises(TransactionError, match="cannot commit while the model is loading"):
            model.commit()
        with pytest.raises(TransactionError, match="cannot load"), model.loading():
            pass
        model.graph.new("RoadTile")
    with model.transaction():
        model.graph.new("RoadTile")
    assert len(model) == 2


def test_loading_ends_after_an_exception():
    model = Model(FOREST)
    with pytest.raises(KeyError), model.loading():
        raise KeyError
    with model.transaction():
        pass


def test_a_failed_transaction_closes_inner_savepoints():
    model = forest()
    before = snapshot(model)
    with pytest.raises(KeyboardInterrupt), model.transaction():
        model["t00"].x = 5
        model.graph.history.savepoint()  # as if Ctrl-C had come before anybody could hold it
        model["t00"].x = 6
        raise KeyboardInterrupt
    assert snapshot(model) == before
    with pytest.raises(TransactionError, match="still open"), model.transaction():
        model["t00"].x = 5
        model.graph.history.savepoint()
    assert snapshot(model) == before
    assert not model.graph.history.savepoint_depth


@pytest.mark.parametrize("opened", [0, 1])
def test_ctrl_c_while_a_transaction_begins_or_ends_leaves_none_open(opened, monkeypatch):
    model = forest()
    before = snapshot(model)
    history = model.graph.history
    savepoint = history.savepoint

    def interrupted(*arguments):
        if not opened:
            savepoint()
        raise KeyboardInterrupt

    monkeypatch.setattr(history, "release" if opened else "savepoint", interrupted)
    with pytest.raises(KeyboardInterrupt), model.transaction():
        model["t00"].x = 5
    assert snapshot(model) == before
    assert not model.graph.history.savepoint_depth
