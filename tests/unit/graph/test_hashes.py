"""The state hash, and the one that isomorphic models share."""

import subprocess
import sys
from pathlib import Path

from envgraph.graph import Model
from tests.unit.graph.domain import PEOPLE, forest, people


def test_the_hash_depends_only_on_the_facts():
    model, other = forest(), forest()
    assert model.state_hash() == other.state_hash()
    model["t00"].x = 5
    assert model.state_hash() != other.state_hash()
    model["t00"].x = 0
    assert model.state_hash() == other.state_hash()


def test_every_kind_of_fact_changes_the_hash():
    hashes = [forest().state_hash()]
    for change in (
        lambda m: m["t00"].retype("BurningTile"),
        lambda m: m["t10"].retype("BurningTile"),
        lambda m: setattr(m["t00"], "x", 1),
        lambda m: setattr(m["t00"], "y", 1),
        lambda m: setattr(m["t00"], "x", None),
        lambda m: setattr(m["truck"], "currentState", m["t22"]),
        lambda m: setattr(m["t00"], "right", None),
        lambda m: setattr(m["t00"], "down", None),
        lambda m: m.create("RoadTile"),
    ):
        model = forest()
        change(model)
        hashes.append(model.state_hash())
    assert len(set(hashes)) == len(hashes)


def test_exchanging_values_between_objects_changes_the_hash():
    # Sums over facts must not cancel out: swapped classes, swapped values, swapped ends, reversed cycles.
    def cycle(*order):
        model, nodes = people("a", "b", "c")
        for one, other in zip(order, (*order[1:], order[0]), strict=True):
            nodes[one].likes.append(nodes[other])
        return model

    assert cycle(0, 1, 2).state_hash() != cycle(2, 1, 0).state_hash()
    one, (a, b) = people("a", "b")
    other, (c, d) = people("a", "b")
    a.likes, b.likes = [a], [b]
    c.likes, d.likes = [d], [c]
    assert one.state_hash() != other.state_hash()
    one, (a, b) = people("a", "b")
    other, (c, d) = people("a", "b")
    a["id"], b["id"], c["id"], d["id"] = 1, 2, 2, 1
    assert one.state_hash() != other.state_hash()


def test_order_and_names_do_not_change_the_hash():
    model, (ann, ben, eve) = people("ann", "ben", "eve")
    other, (ann2, ben2, eve2) = people("x", "y", "z")
    ann.likes = [ben, eve]
    ann2.likes = [eve2, ben2]
    assert model.state_hash() == other.state_hash()


def test_the_hash_can_ignore_gaps_between_ids():
    model, (ann, ben, eve, tom) = people("ann", "ben", "eve", "tom")
    other, (ann2, eve2, tom2) = people("ann", "eve", "tom")
    eve.likes, eve2.likes = [tom, ann], [tom2, ann2]
    tom.friends, tom2.friends = [eve], [eve2]
    ben.delete()
    assert model.state_hash() != other.state_hash()
    assert model.state_hash(since=0) == model.state_hash(since=ben.id) == other.state_hash(since=0)
    assert other.state_hash(since=0) == other.state_hash()
    assert model.state_hash(since=eve.id) != other.state_hash()
    tom.likes, eve.likes = [eve, ann], []  # other objects: their order counts
    assert model.state_hash(since=0) != other.state_hash()


def test_equal_floats_have_equal_hashes():
    one, (ann,) = people("ann")
    other, (ben,) = people("ben")
    ann.height, ben.height = 0.0, -0.0
    assert one.state_hash() == other.state_hash()


def test_the_hash_is_the_same_in_every_process_and_fits_64_bits():
    program = "from tests.unit.graph.domain import forest; m = forest(); print(m.state_hash(), m.canonical_hash())"
    hashes = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed},
            cwd=Path(__file__).parents[3],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    model = forest()
    assert hashes == {f"{model.state_hash()} {model.canonical_hash()}\n"}
    assert 0 <= model.state_hash() < 2**64
    assert 0 <= model.canonical_hash() < 2**64


def test_isomorphic_models_share_the_canonical_hash():
    one, (a, b, c) = people("a", "b", "c")
    a.likes, b.likes = [b], [c]
    other, (x, y, z) = people("x", "y", "z")
    z.likes, x.likes = [x], [y]
    assert one.state_hash() != other.state_hash()
    assert one.canonical_hash() == other.canonical_hash()
    y["id"] = 1
    assert one.canonical_hash() != other.canonical_hash()


def test_direction_reference_and_class_change_the_canonical_hash():
    hashes = set()
    for change in (
        lambda a, b: None,
        lambda a, b: a.likes.append(b),
        lambda a, b: a.likes.append(a),
        lambda a, b: a.friends.append(b),
        lambda a, b: setattr(a, "spouse", b),
        lambda a, b: a.retype("Stone"),
        lambda a, b: setattr(a, "nick", None),
    ):
        model, (a, b) = people("a", "b")
        b["id"] = 7
        change(a, b)
        hashes.add(model.canonical_hash())
    assert len(hashes) == 7


def test_an_empty_model_has_hashes():
    assert Model(PEOPLE).state_hash() == Model(PEOPLE).state_hash()
    assert Model(PEOPLE).canonical_hash() == Model(PEOPLE).canonical_hash()
