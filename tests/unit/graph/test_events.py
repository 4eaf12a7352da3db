"""What followers are told."""

import pytest

from envgraph.errors import RuleError
from envgraph.graph import Model
from tests.facts import ClassFact, Fact, LinkFact, Notified, ValueFact
from tests.property.snapshots import Shadow
from tests.unit.graph.domain import FOREST, feature, forest, people


class Recorder:
    """Writes down what it hears."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, Fact] | str] = []

    def inserted(self, fact: Fact) -> None:
        self.heard.append(("+", fact))

    def removing(self, fact: Fact) -> None:
        self.heard.append(("-", fact))

    def restored(self) -> None:
        self.heard.append("restored")

    def take(self) -> list[tuple[str, Fact] | str]:
        """What was heard since the last time."""
        heard, self.heard = self.heard, []
        return heard


def recorded(model: Model) -> Recorder:
    recorder = Recorder()
    Notified(model, recorder)
    return recorder


def test_creating_an_object_notifies_its_class_and_values():
    model = Model(FOREST)
    recorder = recorded(model)
    model.graph.new("RoadTile")
    x, y = feature(model, "Tile", "x"), feature(model, "Tile", "y")
    assert recorder.take() == [
        ("+", ClassFact("RoadTile", 0)),
        ("+", ValueFact(x, 0, 0)),
        ("+", ValueFact(y, 0, 0)),
    ]


def test_setting_a_value_notifies_a_removal_and_an_insertion():
    model = forest()
    recorder, x = recorded(model), feature(model, "Tile", "x")
    model["t00"].x = 4
    assert recorder.take() == [("-", ValueFact(x, 1, 0)), ("+", ValueFact(x, 1, 4))]
    model["t00"].x = 4
    assert recorder.take() == []
    model["t00"].x = None
    assert recorder.take() == [("-", ValueFact(x, 1, 4))]


def test_a_link_of_an_opposite_pair_is_one_fact_of_the_first_reference():
    model = forest()
    recorder, right = recorded(model), feature(model, "Tile", "right")
    model["t10"].left = None
    model["t10"].left = model["t00"]
    assert recorder.take() == [("-", LinkFact(right, 1, 2)), ("+", LinkFact(right, 1, 2))]


def test_setting_a_reference_notifies_every_changed_link():
    model = forest()
    recorder, right = recorded(model), feature(model, "Tile", "right")
    model["t00"].right = model["t22"]
    assert recorder.take() == [
        ("-", LinkFact(right, 1, 2)),
        ("-", LinkFact(right, 8, 9)),
        ("+", LinkFact(right, 1, 9)),
    ]


def test_a_symmetric_link_is_one_fact_from_the_lower_id():
    model, (ann, ben) = people("ann", "ben")
    recorder, friends = recorded(model), feature(model, "Person", "friends")
    ben.friends.append(ann)
    assert recorder.take() == [("+", LinkFact(friends, ann.id, ben.id))]


def test_moving_an_object_notifies_a_removal_and_an_insertion():
    model, (ann, ben) = people("ann", "ben")
    dog = model.create("Dog", owner=ann)
    recorder, animals = recorded(model), feature(model, "Person", "animals")
    ben.animals.append(dog)
    assert recorder.take() == [
        ("-", LinkFact(animals, ann.id, dog.id)),
        ("+", LinkFact(animals, ben.id, dog.id)),
    ]


def test_retyping_notifies_changes_of_classes_and_values():
    model = forest()
    recorder, collected = recorded(model), feature(model, "WaterTile", "collected")
    model["t00"].retype("WaterTile")
    model["t00"].retype("RoadTile")
    assert recorder.take() == [
        ("-", ClassFact("RoadTile", 1)),
        ("+", ClassFact("WaterTile", 1)),
        ("+", ValueFact(collected, 1, False)),
        ("-", ValueFact(collected, 1, False)),
        ("-", ClassFact("WaterTile", 1)),
        ("+", ClassFact("RoadTile", 1)),
    ]


def test_deletion_notifies_links_then_values_then_classes():
    model = forest(1)
    recorder = recorded(model)
    model["forest"].delete()
    kinds = [type(fact) for sign, fact in recorder.take() if sign == "-"]
    assert kinds == [LinkFact, LinkFact, LinkFact, ClassFact, ValueFact, ValueFact, ClassFact, ClassFact]


def test_refused_writes_are_not_notified():
    model = forest()
    recorder = recorded(model)
    with pytest.raises(RuleError):
        model["t00"].delete()
    assert recorder.take() == []


def test_rollback_and_checkout_are_notified_as_a_whole():
    model = forest()
    version = model.commit()
    recorder = recorded(model)
    savepoint = model.graph.history.savepoint()
    model.graph.history.rollback(savepoint)
    assert recorder.take() == []
    savepoint = model.graph.history.savepoint()
    model["t00"].x = 4
    recorder.take()
    model.graph.history.rollback(savepoint)
    assert recorder.take() == ["restored"]
    model.checkout(version)
    assert recorder.take() == []
    model["t00"].x = 4
    recorder.take()
    model.checkout(version, discard=True)
    assert recorder.take() == ["restored"]


def test_loading_is_notified_at_its_end():
    model = Model(FOREST)
    recorder = recorded(model)
    shadow = Shadow(model)
    Notified(model, shadow)
    with model.loading():
        model.graph.new("RoadTile")
        assert recorder.heard == []
    assert recorder.take() == ["restored"]
    shadow.check()


def test_the_revision_changes_with_the_state():
    model = forest()
    savepoint = model.graph.history.savepoint()
    seen = [model.graph.store.revision]
    for change in (
        lambda: model.graph.new("RoadTile"),
        lambda: setattr(model["t00"], "x", 4),
        lambda: setattr(model["t00"], "right", None),
        lambda: model["t00"].retype("WaterTile"),
        lambda: setattr(model["t00"], "object_name", "start"),
        lambda: model.graph.history.rollback(savepoint),
    ):
        change()
        seen.append(model.graph.store.revision)
    assert len(set(seen)) == len(seen)
