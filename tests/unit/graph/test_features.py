"""Attribute values and links."""

import pytest

from envgraph.errors import InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import Model, model_from_json, model_to_json
from tests.unit.graph.domain import PEOPLE, feature, forest, people


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("id", 1.0, "`Person.id` takes int, not 1.0 (float)"),
        ("id", True, "`Person.id` takes int, not True (bool)"),
        ("height", "1", "`Person.height` takes float, not '1' (str)"),
        ("height", float("nan"), "`Person.height` takes float, not nan (float)"),
        ("height", True, "takes float, not True"),
        ("height", 10**400, "takes float"),
        ("adult", 1, "`Person.adult` takes bool, not 1 (int)"),
        ("nick", 3, "`Person.nick` takes string, not 3 (int)"),
        ("mood", "gald", "`Person.mood` takes Mood, not 'gald' (str); did you mean `glad`?"),
        ("mood", "angry", "its literals: `glad`, `sad`"),
        ("mood", 0, "takes Mood, not 0 (int)"),
    ],
)
def test_wrong_values_are_refused(name, value, text):
    _, (ann,) = people("ann")
    before = ann[name]
    with pytest.raises(TypeMismatch) as caught:
        ann[name] = value
    assert text in str(caught.value)
    assert ann[name] == before


def test_an_int_becomes_a_float_in_a_float_attribute():
    _, (ann,) = people("ann")
    ann.height = 2
    assert (ann.height, type(ann.height)) == (2.0, float)


def test_attributes_can_be_cleared():
    model, (ann,) = people("ann")
    ann.nick = None
    assert ann.nick is None
    ann.nick = "a"
    assert ann.nick == "a"
    model.check_integrity()


def test_writing_an_equal_value_changes_nothing():
    model, (ann,) = people("ann")
    revision = model.graph.store.revision
    ann.height = 1
    ann.mood = "sad"
    assert model.graph.store.revision == revision


def test_features_of_other_classes_are_refused():
    model, (ann,) = people("ann")
    group = model.create("Group", object_name="group")
    stone = model.create("Stone", object_name="stone")
    with pytest.raises(TypeMismatch, match="`Group` has no feature `id`; only `Person` has it"):
        model.graph.set_value(group.id, feature(model, "Person", "id"), 3)
    spouse = feature(model, "Person", "spouse")
    with pytest.raises(TypeMismatch, match="`Group` has no feature `spouse`"):
        model.graph.link(group.id, spouse, ann.id)
    for write in (model.graph.link, model.graph.set_target):
        with pytest.raises(TypeMismatch, match=r"`Person.spouse` leads to `Person`, but `stone` is of class `Stone`"):
            write(ann.id, spouse, stone.id)
    with pytest.raises(TypeMismatch, match="has no feature"):
        model.graph.set_targets(stone.id, spouse, [])


def test_missing_objects_are_refused():
    model, (ann,) = people("ann")
    spouse = feature(model, "Person", "spouse")
    for source, target in ((ann.id, 9), (9, ann.id), (-1, ann.id), (ann.id, -1)):
        for write in (model.graph.link, model.graph.set_target):
            with pytest.raises(InvalidArgument, match="has no object"):
                write(source, spouse, target)
    with pytest.raises(InvalidArgument, match="has no object"):
        model.graph.set_value(9, feature(model, "Person", "id"), 1)


def test_opposites_are_one_set_of_links():
    model = forest(2)
    right, left = feature(model, "Tile", "right"), feature(model, "Tile", "left")
    a, b = model["t00"].id, model["t10"].id
    assert model.graph.has_link(a, right, b)
    assert model.graph.has_link(b, left, a)
    assert list(model.graph.sources(b, right)) == list(model.graph.targets(b, left)) == [a]
    assert model.graph.unlink(b, left, a)
    assert not model.graph.has_link(a, right, b)
    assert not model.graph.unlink(a, right, b)
    assert model.graph.link(b, left, a)
    assert model.graph.target(a, right) == b


def test_linking_twice_changes_nothing():
    model, (ann, ben) = people("ann", "ben")
    friends = feature(model, "Person", "friends")
    assert model.graph.link(ann.id, friends, ben.id)
    assert not model.graph.link(ann.id, friends, ben.id)
    assert not model.graph.link(ben.id, friends, ann.id)


def test_symmetric_references_hold_in_both_directions():
    model, (ann, ben, eve) = people("ann", "ben", "eve")
    ann.friends = [ben, eve]
    assert (list(ben.friends), list(eve.friends)) == ([ann], [ann])
    ann.spouse = ben
    assert ben.spouse == ann
    eve.spouse = ben
    assert (ann.spouse, ben.spouse, eve.spouse) == (None, eve, ben)
    eve.spouse = eve
    assert (ben.spouse, eve.spouse) == (None, eve)
    model.check_integrity()


def test_link_into_a_full_single_reference_is_refused():
    model = forest(2)
    right = feature(model, "Tile", "right")
    with pytest.raises(RuleError) as caught:
        model.graph.link(model["t00"].id, right, model["t11"].id)
    assert caught.value.reason == "full"
    assert str(caught.value).startswith("`t00` has 1 of at most 1 targets of `right` already")
    assert caught.value.details == ("`t00` -right-> `t10`",)


def test_link_to_a_target_whose_opposite_is_full_is_refused():
    model = forest(2)
    with pytest.raises(RuleError) as caught:
        model.graph.link(model["t01"].id, feature(model, "Tile", "left"), model["t00"].id)
    assert caught.value.reason == "full"
    assert "`t00` has 1 of at most 1 targets of `right`" in str(caught.value)


def test_bounded_many_references_are_full_at_their_bound():
    model, (ann,) = people("ann")
    groups = [model.create("Group") for _ in range(3)]
    ann.groups = groups[:2]
    for write in (lambda: ann.groups.append(groups[2]), lambda: groups[2].members.append(ann)):
        with pytest.raises(RuleError, match="2 of at most 2 targets of `groups`"):
            write()
    with pytest.raises(RuleError, match="at most 2"):
        ann.groups = groups
    assert ann.groups == groups[:2]


def test_setting_replaces_and_releases_the_opposite():
    model = forest(2)
    a, b, c, d = (model[name] for name in ("t00", "t10", "t01", "t11"))
    a.right = d
    assert (a.right, b.left, d.left, c.right) == (d, None, a, None)
    a.right = None
    assert d.left is None
    model.check_integrity()


def test_setting_a_many_reference_keeps_the_given_order():
    model, (ann, *others) = people("ann", "b", "c", "d", "e")
    for order in ([0, 1, 2], [0, 1, 3], [2, 0], [2, 0, 3, 1], [], [1]):
        ann.likes = [others[i] for i in order]
        assert ann.likes == [others[i] for i in order]
        model.check_integrity()


def test_setting_duplicate_targets_is_refused():
    _, (ann, ben) = people("ann", "ben")
    with pytest.raises(InvalidArgument, match="given twice as a target"):
        ann.likes = [ben, ben]


def test_failed_setting_of_targets_changes_nothing():
    model, (ann, ben) = people("ann", "ben")
    groups = [model.create("Group") for _ in range(3)]
    ann.groups = groups[:2]
    groups[2].members.append(ben)
    with pytest.raises(RuleError, match="at most 2"):
        model.graph.set_targets(groups[2].id, feature(model, "Group", "members"), [ann.id])
    assert groups[2].members == [ben]


def test_set_target_of_a_many_reference_leaves_one_target():
    model, (ann, ben, eve) = people("ann", "ben", "eve")
    likes = feature(model, "Person", "likes")
    ann.likes = [ben, eve]
    model.graph.set_target(ann.id, likes, eve.id)
    assert ann.likes == [eve]
    model.graph.set_target(ann.id, likes, None)
    assert ann.likes == []
    assert model.graph.target(ann.id, likes) is None


def test_an_object_moves_when_it_is_put_into_another_container():
    model, (ann, ben) = people("ann", "ben")
    group = model.create("Group")
    dog = model.create("Dog", owner=ann)
    ben.animals.append(dog)
    assert (ann.animals, dog.owner, dog.container) == ([], ben, ben)
    group.pet = dog
    assert (ben.animals, dog.owner, dog.container) == ([], None, group)
    dog.owner = ann
    assert (group.pet, dog.container) == (None, ann)
    assert model.graph.container(dog.id) == (ann.id, feature(model, "Person", "animals"))
    assert model.graph.container(ann.id) is None
    model.check_integrity()


def test_full_containers_refuse_links_and_are_replaced_by_set():
    model, _ = people()
    group = model.create("Group", pet=model.create("Dog", object_name="rex"))
    cat = model.create("Animal", object_name="cat")
    with pytest.raises(RuleError, match="1 of at most 1 targets of `pet`"):
        model.graph.link(group.id, feature(model, "Group", "pet"), cat.id)
    group.pet = cat
    assert model["rex"].container is None


def test_cyclic_containment_is_refused_from_both_ends():
    model = Model(PEOPLE)
    outer, middle, inner = (model.create("Group", object_name=name) for name in ("outer", "middle", "inner"))
    outer.parts.append(middle)
    middle.parts.append(inner)
    for write in (
        lambda: inner.parts.append(outer),
        lambda: setattr(outer, "whole", inner),
        lambda: setattr(inner, "parts", [outer]),
    ):
        with pytest.raises(RuleError, match="`outer` cannot be put into `inner`, which is inside it") as caught:
            write()
        assert caught.value.reason == "containment"
    with pytest.raises(RuleError, match="`outer` cannot be put into `outer`, itself"):
        outer.parts.append(outer)
    assert (outer.whole, inner.parts) == (None, [])
    model.check_integrity()


def test_more_than_32_targets_keep_insertion_order_until_a_removal():
    model, (ann, *others) = people("ann", *(f"p{i}" for i in range(40)))
    for count in (31, 32, 33, 34, 40):
        ann.likes = others[:count]
        assert ann.likes == others[:count]
        model.check_integrity()
    ann.likes.remove(others[5])
    assert ann.likes[5] == others[39]
    for other in others[6:14]:
        ann.likes.remove(other)
        assert other not in ann.likes
        model.check_integrity()
    assert len(ann.likes) == 31


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1])
def test_ints_beyond_64_bits_are_refused(value: int) -> None:
    model = Model(PEOPLE)
    ann = model.create("Person", id=2**63 - 1)
    with pytest.raises(TypeMismatch, match="an int of 64 bits"):
        ann["id"] = value
    with pytest.raises(TypeMismatch, match="an int of 64 bits"):
        model.create("Person", id=value)
    ann["id"] = -(2**63)
    (again,) = model_from_json(model_to_json(model), PEOPLE).nodes("Person")
    assert again["id"] == -(2**63)
