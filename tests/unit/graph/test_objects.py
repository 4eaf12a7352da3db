"""Creating, deleting and retyping objects; extents and names."""

from itertools import pairwise

import pytest

from envgraph.errors import InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import Model
from tests.unit.graph.domain import FOREST, PEOPLE, feature, forest, people


def test_ids_count_up_from_zero_and_are_not_used_again():
    model = Model(FOREST)
    assert [model.graph.new("RoadTile"), model.graph.new("Forest")] == [0, 1]
    model.graph.delete(1)
    assert model.graph.new("RoadTile") == 2
    assert [model.graph.alive(id) for id in (-1, 0, 1, 2, 3)] == [False, True, False, True, False]


def test_created_objects_have_default_values():
    _, (ann,) = people("ann")
    assert (ann.height, ann.nick, ann.mood, ann.adult) == (1.0, "?", "sad", False)
    assert type(ann.height) is float


def test_abstract_class_is_refused_with_its_concrete_subclasses():
    with pytest.raises(TypeMismatch, match=r"`Tile` is abstract; .* `RoadTile`, `BurningTile`, `WaterTile`"):
        Model(FOREST).graph.new("Tile")


def test_unknown_class_is_refused_with_a_hint():
    with pytest.raises(TypeMismatch, match=r"unknown class `RoadTyle`; did you mean `RoadTile`?"):
        Model(FOREST).graph.new("RoadTyle")
    with pytest.raises(TypeMismatch, match="unknown class `Bush`"):
        Model(FOREST).graph.extent("Bush")
    with pytest.raises(TypeMismatch, match="unknown class `Bush`"):
        Model(FOREST).graph.exact_extent("Bush")


def test_failed_creation_leaves_nothing_behind():
    model, (ann,) = people("ann")
    for wrong in ({"height": "tall"}, {"hight": 2.0}, {"spouse": 3}, {"friends": ann}):
        with pytest.raises(TypeMismatch):
            model.create("Person", object_name="ben", **wrong)
    with pytest.raises(RuleError, match="at most 2"):
        model.create("Person", groups=[model.create("Group") for _ in range(3)])
    assert [node.object_name for node in model.nodes("Person")] == ["ann"]
    assert "ben" not in model
    model.check_integrity()


def test_extent_lists_subclasses_class_by_class():
    model = Model(FOREST)
    water, road, forest_, fire = (model.graph.new(c) for c in ("WaterTile", "RoadTile", "Forest", "BurningTile"))
    assert list(model.graph.extent("Tile")) == [road, fire, water]
    assert list(model.graph.extent("State")) == [road, fire, water]
    assert list(model.graph.extent("RoadTile")) == list(model.graph.exact_extent("RoadTile")) == [road]
    assert list(model.graph.exact_extent("Tile")) == []
    assert [node.id for node in model.nodes()] == [forest_, road, fire, water]
    assert len(model) == 4


def test_removal_moves_the_last_object_into_the_gap():
    model = Model(FOREST)
    a, b, c, d = (model.graph.new("RoadTile") for _ in range(4))
    model.graph.delete(b)
    assert list(model.graph.extent("RoadTile")) == [a, d, c]


def test_names_are_unique_and_reusable_after_deletion():
    model, (ann,) = people("ann")
    with pytest.raises(InvalidArgument, match="has an object `ann` already"):
        model.graph.new("Person", "ann")
    ann.delete()
    assert model.graph.find_object("ann") is None
    assert model.graph.new("Person", "ann") == model.graph.find_object("ann") == 1


def test_objects_can_be_renamed():
    model, (ann, ben) = people("ann", "ben")
    ann.object_name = "eve"
    assert model["eve"] == ann
    assert "ann" not in model
    with pytest.raises(InvalidArgument):
        ben.object_name = "eve"
    ben.object_name = None
    assert ben.object_name is None
    assert "ben" not in model
    eve = ann
    eve.object_name = "eve"
    model.check_integrity()


def test_unknown_name_is_refused_with_a_hint():
    model, _ = people("annabel")
    with pytest.raises(InvalidArgument, match=r"no object `anabel`; did you mean `annabel`?"):
        model["anabel"]


def test_dpo_deletion_refuses_and_names_every_dangling_link():
    model = forest()
    with pytest.raises(RuleError) as caught:
        model["t00"].delete()
    assert caught.value.reason == "dangling"
    assert caught.value.details == (
        "`truck` -currentState-> `t00`",
        "`t00` -right-> `t10`",
        "`t00` -down-> `t01`",
    )
    assert "3 links would be left dangling" in str(caught.value)
    assert model["t00"].right == model["t10"]


def test_link_from_the_container_does_not_dangle():
    model, (ann,) = people("ann")
    dog = model.create("Dog", owner=ann)
    dog.delete(semantics="dpo")
    assert ann.animals == []
    model.check_integrity()


def test_spo_deletion_deletes_dangling_links():
    model = forest()
    model["t11"].delete(semantics="spo")
    assert model["t01"].right is None
    assert model["t10"].down is None
    assert len(model["forest"].states) == 8
    model.check_integrity()


def test_contents_are_deleted_with_their_container_and_inner_links_do_not_dangle():
    model = forest()
    model["forest"].delete()
    assert len(model) == 0
    model.check_integrity()


def test_links_of_contents_to_the_outside_dangle():
    model, (ann,) = people("ann")
    group = model.create("Group", object_name="group", pet=model.create("Dog", object_name="rex"))
    cat = model.create("Animal", object_name="cat")
    group.pet.chases = cat
    with pytest.raises(RuleError) as caught:
        group.delete()
    assert caught.value.details == ("`rex` -chases-> `cat`",)
    group.delete("spo")
    assert model.nodes() == [ann, cat]


def test_link_of_a_contained_object_to_its_container_by_another_reference_dangles():
    model, (ann,) = people("ann")
    dog = model.create("Dog", owner=ann, object_name="rex")
    dog.chases = model.create("Animal", object_name="cat", owner=ann)
    with pytest.raises(RuleError, match="`rex` -chases-> `cat`"):
        dog.delete()
    dog.chases = None
    dog.delete()
    ann.delete()
    assert len(model) == 0


def test_deep_containment_trees_are_deleted_completely():
    model = Model(PEOPLE)
    groups = [model.create("Group") for _ in range(5)]
    for outer, inner in pairwise(groups):
        outer.parts.append(inner)
    groups[1].delete()
    assert model.nodes() == groups[:1]


def test_links_to_itself_are_deleted_once():
    model, (ann,) = people("ann")
    for name in ("spouse", "friends", "likes"):
        model.graph.link(ann.id, feature(model, "Person", name), ann.id)
    tile = forest()["t00"]
    tile.model.graph.unlink(tile.id, feature(tile.model, "Tile", "right"), tile.right.id)
    tile.right = tile
    assert tile.left == tile
    ann.delete("spo")
    tile.delete("spo")
    model.check_integrity()
    tile.model.check_integrity()


def test_a_link_to_itself_is_left_dangling_like_any_other():
    model, (ann,) = people("ann")
    model.graph.link(ann.id, feature(model, "Person", "spouse"), ann.id)
    with pytest.raises(RuleError) as caught:
        ann.delete()
    assert (caught.value.reason, len(caught.value.details)) == ("dangling", 1)
    ann.spouse = None
    ann.delete()
    assert not model.nodes()


def test_deleting_a_missing_object_is_an_error():
    model, (ann,) = people("ann")
    ann.delete()
    for id in (ann.id, 77, -1):
        with pytest.raises(InvalidArgument, match="has no object"):
            model.graph.delete(id)


def test_unknown_semantics_is_an_error():
    model, (ann,) = people("ann")
    with pytest.raises(InvalidArgument, match="semantics"):
        ann.delete("cascade")
    assert ann in model


def test_retyping_keeps_identity_name_values_and_links():
    model = forest()
    tile = model["t11"]
    tile.retype("BurningTile")
    assert (tile.id, tile.cls, tile.object_name, tile.x, tile.y) == (5, "BurningTile", "t11", 1, 1)
    assert tile.right == model["t21"]
    assert tile in model["forest"].states
    model.check_integrity()


def test_retyping_adds_initial_values_and_drops_others():
    model = forest()
    tile = model["t11"]
    tile.retype("WaterTile")
    assert tile.collected is False
    tile.collected = True
    tile.retype("RoadTile")
    assert model.graph.value(tile.id, feature(model, "WaterTile", "collected")) is None
    tile.retype("WaterTile")
    assert tile.collected is False


def test_retyping_refuses_to_lose_links():
    model, (ann,) = people("ann")
    dog = model.create("Dog", owner=ann, object_name="rex")
    dog.chases = dog
    cat = model.create("Animal", owner=ann, object_name="cat")
    with pytest.raises(RuleError) as caught:
        dog.retype("Animal")
    assert caught.value.reason == "lost-link"
    assert caught.value.details == ("`rex` -chases-> `rex`",)
    with pytest.raises(RuleError) as caught:
        cat.retype("Stone")
    assert caught.value.details == ("`cat` -owner-> `ann`",)
    assert (dog.cls, cat.cls) == ("Dog", "Animal")


def test_lossy_retyping_drops_links_in_both_directions():
    model, (ann,) = people("ann")
    dog = model.create("Dog", owner=ann)
    other = model.create("Dog", owner=ann, chases=dog)
    dog.chases = other
    dog.retype("Stone", lossy=True)
    assert ann.animals == [other]
    assert other.chases is None
    model.check_integrity()


def test_retyping_a_container_leaves_its_contents_as_roots():
    model, (ann,) = people("ann")
    dog = model.create("Dog", owner=ann)
    ann.retype("Stone", lossy=True)
    assert dog.container is None


def test_retyping_to_the_same_class_changes_nothing():
    model, (ann,) = people("ann")
    revision = model.graph.store.revision
    ann.retype("Person")
    assert model.graph.store.revision == revision


@pytest.mark.parametrize("cls", ["Tile", "Forrest"])
def test_retyping_to_abstract_or_unknown_classes_is_refused(cls):
    model = forest()
    with pytest.raises(TypeMismatch):
        model["t00"].retype(cls)


def test_retyping_a_missing_object_is_an_error():
    with pytest.raises(InvalidArgument, match="has no object"):
        forest().graph.retype(40, "RoadTile")


def test_given_ids_in_use_are_refused():
    model = Model(FOREST)
    assert model.graph.new_at(200, "RoadTile") == 200
    assert model.graph.new_at(7, "RoadTile") == 7
    assert model.graph.new("RoadTile") == 201
    for used in (7, -1):
        with pytest.raises(InvalidArgument, match="a new object cannot have the id"):
            model.graph.new_at(used, "RoadTile")
    model.check_integrity()


def test_an_empty_model_is_true():
    model = Model(FOREST, "nothing")
    assert model
    assert len(model) == 0
    assert repr(model) == "<Model nothing: 0 objects of burning_forest>"
