"""Nodes and their many-references."""

import copy
import pickle

import pytest

from envgraph.errors import InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import Model, Node
from envgraph.metamodel import Class, Metamodel, Reference
from tests.unit.graph.domain import FOREST, forest, people


def test_handles_are_equal_by_model_and_id():
    model = forest()
    assert model["t00"] == model.node(1) == model.nodes("RoadTile")[0]
    assert model["t00"] != model["t10"]
    assert model["t00"] != forest()["t00"]
    assert len({model["t00"], model.node(1), model["t10"]}) == 2
    assert model["t00"] != 1


def test_handles_to_missing_objects_are_refused():
    with pytest.raises(InvalidArgument, match="`square` has no object 99"):
        forest().node(99)
    with pytest.raises(InvalidArgument, match=r"`square` has no object `Xyz123`; .*`model.nodes"):
        forest()["Xyz123"]


def test_repr_shows_class_id_name_and_key():
    model = forest()
    tile = model["t21"]
    assert repr(tile) == "<RoadTile#6 t21 y=1 x=2>"
    assert repr(model["forest"]) == "<Forest#0 forest>"
    assert repr(model.create("FireTruck")) == "<FireTruck#11>"
    tile.delete("spo")
    assert repr(tile) == "<no object 6>"


def test_objects_are_found_by_name_only():
    with pytest.raises(InvalidArgument, match=r"write `model.node\(id\)`"):
        forest()[3]


def test_iterating_over_a_model_gives_handles():
    model = forest(1)
    seen = []
    for node in model:
        seen.append(repr(node))
        model.create("RoadTile")
    assert seen == ["<Forest#0 forest>", "<RoadTile#1 t00 y=0 x=0>", "<FireTruck#2 truck>"]


def test_features_can_be_read_and_written_by_handles():
    model = forest()
    tile = model["t00"]
    tile.x = 7
    tile["y"] = 8
    assert (tile["x"], tile.y) == (7, 8)
    tile.right = None
    assert tile.right is None
    tile.right = model["t11"]
    assert model["t11"].left == tile


def test_unknown_features_are_attribute_errors_with_a_hint():
    tile = forest()["t00"]
    with pytest.raises(AttributeError, match=r"`RoadTile` has no feature `rigth`; did you mean `right`?"):
        getattr(tile, "rigth")  # noqa: B009
    with pytest.raises(AttributeError, match=r"did you mean `right`?"):
        tile.rigth = None
    with pytest.raises(AttributeError, match="no feature `colour`"):
        tile["colour"] = 1


def test_handle_attributes_hide_features_except_for_item_access():
    _, (ann,) = people("ann")
    ann["id"] = 12
    assert (ann.id, ann["id"]) == (0, 12)
    with pytest.raises(AttributeError, match=r'write `node\["id"\] = ...`'):
        ann.id = 3


def test_links_take_nodes_of_the_same_model_only():
    model = forest()
    with pytest.raises(TypeMismatch, match=r"`Tile.right` leads to `Tile`, not to 3 \(int\)"):
        model["t00"].right = 3
    with pytest.raises(TypeMismatch, match="object of another model"):
        model["t00"].right = forest()["t22"]
    with pytest.raises(TypeMismatch, match="takes several objects: write a list"):
        model["forest"].states = model["t00"]
    with pytest.raises(TypeMismatch, match="takes several objects"):
        model["forest"].states = "t00"
    with pytest.raises(TypeMismatch, match="takes several objects"):
        model["forest"].states = None


def test_every_use_of_a_handle_to_a_deleted_object_is_an_error():
    model, (ann, ben) = people("ann", "ben")
    likes = ann.likes
    ann.delete()
    uses = [
        lambda: ann.cls,
        lambda: ann.nick,
        lambda: ann.object_name,
        lambda: ann.container,
        lambda: ann.is_a("Person"),
        lambda: setattr(ann, "nick", "a"),
        lambda: setattr(ann, "object_name", "a"),
        ann.delete,
        lambda: ann.retype("Group"),
        lambda: len(likes),
        lambda: list(likes),
        lambda: likes.append(ben),
        lambda: setattr(ben, "spouse", ann),
    ]
    for use in uses:
        with pytest.raises(InvalidArgument, match="`people` has no object 0"):
            use()
    assert ann not in model
    assert ben in model


def test_many_references_are_live_views():
    _, (ann, ben, eve, dan) = people("ann", "ben", "eve", "dan")
    likes = ann.likes
    assert len(likes) == 0
    assert not likes
    likes.append(ben)
    likes.extend([eve, dan])
    likes.append(ben)
    assert likes == [ben, eve, dan] == ann.likes
    assert (likes[0], likes[-1], likes[1:]) == (ben, dan, [eve, dan])
    assert likes.index(eve) == 1
    assert eve in likes
    assert ann not in likes
    assert "eve" not in likes
    assert repr(likes[:1]) == "[<Person#1 ben>]"
    likes.remove(ben)
    assert likes == (eve, dan)
    assert likes != [dan, eve]
    assert likes != 3
    with pytest.raises(InvalidArgument, match="is not among the targets of `likes`"):
        likes.remove(ben)
    with pytest.raises(TypeMismatch, match="leads to `Person`"):
        likes.append("ben")
    with pytest.raises(IndexError):
        likes[2]
    likes.clear()
    assert ann.likes == []


def test_writing_while_iterating_over_a_many_reference_is_safe():
    _, (ann, *others) = people("ann", "b", "c", "d")
    ann.likes = others
    seen = [other for other in ann.likes if ann.likes.remove(other) is None]
    assert seen == others
    assert ann.likes == []


def test_a_reference_can_be_set_to_its_own_targets():
    _, (ann, *others) = people("ann", "b", "c", "d")
    ann.likes = others
    ann.likes = (other for other in ann.likes if other != others[0])
    assert ann.likes == others[1:]


def test_created_objects_take_features_and_names():
    model = Model(FOREST)
    tiles = [model.create("RoadTile", x=x, object_name=f"t{x}") for x in range(3)]
    ground = model.create("Forest", states=tiles, agent=model.create("FireTruck", currentState=tiles[0]))
    assert ground.states == tiles
    assert ground.agent.currentState.x == 0
    with pytest.raises(TypeMismatch, match="`RoadTile` has no feature `z`"):
        model.create("RoadTile", z=1)


def test_creation_works_while_loading():
    model = Model(FOREST)
    with model.loading():
        model.create("Forest", states=[model.create("RoadTile"), model.create("RoadTile")])
    assert len(model) == 3


def test_is_a_includes_superclasses():
    tile = forest()["t00"]
    assert tile.is_a("State")
    assert not tile.is_a("Agent")


def test_dir_lists_features():
    names = dir(forest()["t00"])
    assert {"right", "x", "delete", "cls"} <= set(names)


def test_copies_of_a_handle_stand_for_the_same_object():
    tile = forest()["t00"]
    assert copy.copy(tile) == tile
    assert copy.deepcopy([tile]) == [tile]


def test_handles_are_pickled_with_one_copy_of_their_model():
    tile = forest()["t00"]
    one, other, model = pickle.loads(pickle.dumps((tile, tile.right, tile.model)))
    assert one.model is other.model is model is not tile.model
    assert (one.right, other) == (other, model["t10"])


def test_membership_and_names():
    model = forest()
    assert "t00" in model
    assert model["t00"] in model
    assert "t99" not in model
    assert 1 not in model
    assert forest()["t00"] not in model
    assert isinstance(model["t00"], Node)


# --- targets at a place


def _people() -> tuple[Model, Node, list[Node]]:
    metamodel = Metamodel(
        "teams",
        (
            Class(
                "Team",
                features=(
                    Reference("members", "Person", 0, 40, opposite="team"),
                    Reference("rooms", "Team", 0, None, containment=True),
                    Reference("likes", "Person", 0, None),
                ),
            ),
            Class("Person", features=(Reference("team", "Team", 0, 1, opposite="members"),)),
        ),
    )
    model = Model(metamodel)
    return model, model.create("Team"), [model.create("Person") for _ in range(50)]


def test_targets_are_inserted_at_list_positions():
    model, team, people = _people()
    for reference in ("members", "likes"):
        expected = []
        for number, index in enumerate((0, 0, 1, -1, 99, -99, 3)):
            before = model.state_hash()
            savepoint = model.graph.history.savepoint()
            team[reference].insert(index, people[number])
            model.graph.history.rollback(savepoint)
            assert model.state_hash() == before and team[reference] == expected
            team[reference].insert(index, people[number])
            expected.insert(index, people[number])
            assert team[reference] == expected
        team[reference].insert(0, expected[-1])  # moves
        assert team[reference] == [expected[-1], *expected[:-1]]
        with pytest.raises(InvalidArgument, match="a position must be an int"):
            team[reference].insert("0", people[0])
    team.likes = people
    team.likes.insert(20, people[40])
    assert [*team.likes][20] == people[40] and len(team.likes) == 50
    model.check_integrity()


def test_adding_a_target_unlinks_its_previous_source():
    model, team, people = _people()
    other, inner = model.create("Team"), model.create("Team")
    team.members = people[:3]
    team.rooms.append(inner)
    other.members.append(people[0])
    other.members.insert(0, people[1])
    other.rooms.append(inner)
    assert (team.members, other.members) == ([people[2]], [people[1], people[0]])
    assert (team.rooms, other.rooms) == ([], [inner])
    team.rooms.insert(0, inner)
    other.members.append(people[0])  # is there
    assert inner.container == team and other.members == [people[1], people[0]]
    model.check_integrity()


def test_appending_to_a_full_reference_is_refused_without_changes():
    model, team, people = _people()
    other = model.create("Team")
    team.members, other.members = people[:40], people[40:]
    before = model.state_hash()
    for add in (team.members.append, lambda one: team.members.insert(0, one)):
        with pytest.raises(RuleError, match="at most 40"):
            add(people[45])
    assert model.state_hash() == before and people[45].team == other
    model.check_integrity()


def test_retained_targets_get_the_assigned_order():
    model = forest()
    wood = model.nodes("Forest")[0]
    tiles = [model.create("RoadTile") for _ in range(40)]
    wood.states = tiles
    savepoint = model.graph.history.savepoint()
    wood.states = [tiles[6], tiles[38]]
    assert wood.states == [tiles[6], tiles[38]]
    model.graph.history.rollback(savepoint)
    assert wood.states == tiles
    wood.states = [*tiles[20:], tiles[3]]
    assert wood.states == [*tiles[20:], tiles[3]]
    model.check_integrity()


def test_removing_some_of_many_targets_keeps_the_order_at_both_ends():
    ends = (
        Reference("to", "Place", 0, None, opposite="of"),
        Reference("of", "Place", 0, None, opposite="to"),
    )
    model = Model(Metamodel("places", [Class("Place", features=ends)]))
    hub, other, *places = (model.create("Place") for _ in range(42))
    hub.to = places
    other.to = places
    hub.to = places[::2]
    assert hub.to == places[::2]
    assert all(place.of == ([hub, other] if place in places[::2] else [other]) for place in places)
    model.check_integrity()
