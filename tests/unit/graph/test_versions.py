"""Commits, checkouts, and what is freed."""

import gc

import pytest

from envgraph.errors import InvalidArgument, TransactionError
from envgraph.graph import Version
from tests.property.snapshots import snapshot
from tests.unit.graph.domain import forest


def burn(model, name):
    """Commit one more burning tile."""
    model[name].retype("BurningTile")
    return model.commit()


def vertices(model):
    """Every vertex of the model's version tree."""
    top = model.graph.history.versions.current
    while top.parent is not None:
        top = top.parent
    found = [top]
    for vertex in found:
        found.extend(vertex.children)
    return found


def test_checkout_moves_between_branches():
    model = forest()
    root = model.commit()
    states = {root: snapshot(model)}
    for names in (["t00", "t10", "t20"], ["t11", "t21"], ["t02"]):
        model.checkout(root)
        for name in names:
            version = burn(model, name)
            states[version] = snapshot(model)
    versions = list(states)
    for version in versions[::2] + versions[::-1] + versions[1::2]:
        model.checkout(version)
        assert snapshot(model) == states[version]
        model.check_integrity()


def test_sibling_versions_can_use_the_same_ids():
    model = forest()
    root = model.commit()
    first = model.create("RoadTile", x=1).id
    one = model.commit()
    model.checkout(root)
    assert model.create("WaterTile", x=2).id == first
    two = model.commit()
    model.checkout(one)
    assert model.node(first).cls == "RoadTile"
    model.checkout(two)
    assert model.node(first).cls == "WaterTile"


def test_commit_without_changes_is_the_same_version():
    model = forest()
    version = model.commit()
    assert model.commit() is version
    with model.transaction():
        pass
    savepoint = model.graph.history.savepoint()
    model["t00"].x = 9
    model.graph.history.rollback(savepoint)
    assert model.commit() is version is model.version


def test_version_is_none_after_changes():
    model = forest()
    assert model.version is None
    version = model.commit()
    model["t00"].x = 9
    assert model.version is None
    model.checkout(version, discard=True)
    assert model.version is version
    savepoint = model.graph.history.savepoint()
    assert model.version is None
    model.graph.history.release(savepoint)


def test_versions_are_numbered():
    model = forest()
    versions = [burn(model, name) for name in ("t00", "t10")]
    assert [version.number for version in versions] == [1, 2]
    assert repr(versions[1]) == "<Version 2 of square>"


def test_checkout_refuses_to_discard_uncommitted_changes():
    model = forest()
    root = model.commit()
    later = burn(model, "t00")
    model["t00"].x = 9
    for version in (root, later):
        with pytest.raises(TransactionError, match="uncommitted changes"):
            model.checkout(version)
        assert model["t00"].x == 9
    model.checkout(later, discard=True)
    assert (model["t00"].x, model["t00"].cls) == (0, "BurningTile")


def test_versions_belong_to_one_model():
    with pytest.raises(TransactionError, match="version of another model"):
        forest().checkout(forest().commit())
    with pytest.raises(InvalidArgument, match="`version` is None, but must be"):
        forest().checkout(None)


def test_commit_and_checkout_are_refused_inside_a_transaction():
    model = forest()
    version = model.commit()
    with model.transaction():
        with pytest.raises(TransactionError, match="cannot commit inside a transaction"):
            model.commit()
        with pytest.raises(TransactionError, match="cannot check out inside a transaction"):
            model.checkout(version)


def test_a_version_keeps_its_model_alive():
    version = forest().commit()
    gc.collect()
    version.model.checkout(version)
    assert len(version.model) == 11


def test_unused_versions_are_freed():
    model = forest()
    root = model.commit()
    for _ in range(10):
        burn(model, "t00")
        model.checkout(root)
        model["t00"].x = 3
        model.checkout(root, discard=True)
    assert len(vertices(model)) == 1


def test_chains_of_unused_versions_are_merged():
    model = forest()
    root = model.commit()
    before = snapshot(model)
    for x in range(50):
        model["t00"].x = x + 1
        last = model.commit()
    assert model.commit() is last
    assert len(vertices(model)) == 2
    after = snapshot(model)
    model.checkout(root)
    assert snapshot(model) == before
    model.checkout(last)
    assert snapshot(model) == after


def test_freeing_versions_keeps_other_versions_reachable():
    model = forest()
    root = model.commit()
    chain = [burn(model, name) for name in ("t00", "t10", "t20", "t01")]
    model["t20"].delete("spo")
    chain.append(model.commit())
    expected = snapshot(model)
    model.checkout(root)
    before = snapshot(model)
    del chain[:-1]
    other = burn(model, "t22")
    assert len(vertices(model)) == 3
    for _ in range(2):
        model.checkout(chain[0])
        assert snapshot(model) == expected
        model.checkout(root)
        assert snapshot(model) == before
    assert other.number == 7


def test_forks_are_kept_while_both_branches_are_in_use():
    model = forest()
    root = model.commit()
    fork = burn(model, "t00")
    one = burn(model, "t10")
    model.checkout(fork)
    two = burn(model, "t20")
    del fork, root
    model.commit()
    assert len(vertices(model)) == 3
    model.checkout(one)
    assert (model["t00"].cls, model["t20"].cls) == ("BurningTile", "RoadTile")
    model.checkout(two)
    assert (model["t10"].cls, model["t20"].cls) == ("RoadTile", "BurningTile")
    del one
    model.commit()
    assert len(vertices(model)) == 1


def test_journalling_stops_when_all_versions_are_freed():
    model = forest()
    version = model.commit()
    model["t00"].x = 9
    assert model.graph.store.journal
    del version
    with model.transaction():
        pass
    assert not model.graph.store.recording
    model["t00"].x = 10
    assert model.graph.store.journal == []
    assert model.version is None
    version = model.commit()
    model["t00"].x = 11
    model.checkout(version, discard=True)
    assert model["t00"].x == 10


def test_the_current_version_can_be_requested_again_after_its_release():
    model = forest()
    root = model.commit()
    number = burn(model, "t00").number
    again = model.version
    assert isinstance(again, Version)
    assert again.number == number
    model.checkout(root)
    model.checkout(again)
    assert model["t00"].cls == "BurningTile"


def test_long_runs_keep_the_version_tree_and_segments_small():
    # A genetic algorithm in small: six versions, the first one pinned, the others replaced all the time.
    model = forest()
    pinned = model.commit()
    population = [pinned]
    names = [f"t{x}{y}" for x in range(3) for y in range(3)]
    for generation in range(1000):
        model.checkout(population[generation % len(population)])
        tile = model[names[generation % 9]]
        tile.retype("BurningTile" if tile.cls == "RoadTile" else "RoadTile")
        population.append(model.commit())
        if len(population) > 6:
            del population[1 + generation % 3]
    model.commit()
    assert len(vertices(model)) <= 2 * len(population)
    assert sum(len(vertex.segment) for vertex in vertices(model)) < 20_000
    model.checkout(pinned)
    assert all(model[name].cls == "RoadTile" for name in names)


def test_segments_from_a_version_in_use_stay_short():
    model = forest()
    root = model.commit()
    before = snapshot(model)
    for step in range(5_000):
        model["t00"].x = step
        model[f"t{step % 3}{step % 2}"].retype("BurningTile" if step % 4 < 2 else "RoadTile")
        last = model.commit()
    after = snapshot(model)
    assert sum(len(vertex.segment) for vertex in vertices(model)) < 10_000
    model.checkout(root)
    assert snapshot(model) == before
    model.checkout(last)
    assert snapshot(model) == after
    model.check_integrity()


def test_dropping_a_model_frees_its_versions():
    model = forest()
    versions = [burn(model, name) for name in ("t00", "t10")]
    gc.collect()
    before = sum(type(item).__name__ == "VersionVertex" for item in gc.get_objects())
    del model, versions
    gc.collect()
    assert sum(type(item).__name__ == "VersionVertex" for item in gc.get_objects()) <= before - 2


def test_unused_fork_states_are_kept():
    model = forest()
    shared = model.commit()
    first = burn(model, "t00")
    model.checkout(shared)
    second = burn(model, "t10")
    del shared
    gc.collect()
    model.commit()
    model.check_integrity()
    for version, burning in ((first, "t00"), (second, "t10")):
        model.checkout(version)
        assert [name for name in ("t00", "t10") if model[name].cls == "BurningTile"] == [burning]
        model.check_integrity()
