"""The rules of the four example domains do what their comments say."""

from __future__ import annotations

import pytest

from envgraph.errors import RuleError
from envgraph.rewrite import Engine
from tests.unit.rewrite.domains import domain
from tests.unit.rewrite.graphs import snapshot


def put(made: Engine, mover: str, attribute: str, x: int, y: int) -> None:
    """Stand an object on the cell of a grid."""
    (cell,) = [node for node in made.model.nodes() if getattr(node, "x", None) == x and node.y == y]
    setattr(made.model[mover], attribute, cell)


# --- burning forest


def test_both_spellings_of_a_retyping_do_the_same() -> None:
    made = domain("burning_forest", "target_8x8")
    fire = made.first("changeBurningToRoad")
    assert fire is not None and fire.names == ("tile",)
    before = snapshot(made.model)
    made.apply("changeBurningToRoad", fire)
    back = made.first("changeRoadToBurning", tile=fire.tile)
    assert back is not None and back.names == ("forest", "tile")
    assert back.tile.cls == "RoadTile"
    made.apply("changeRoadToBurning", back)
    assert snapshot(made.model)[-1] == before[-1]


def test_fire_spreads_until_water_stops_it() -> None:
    made = domain("burning_forest", "target_8x8")
    spread = made.prepare("spread")
    assert spread.weight == 2.0
    with made.recording() as trace:
        made.run("burnDown")
    assert len(trace) > 5 and {firing.rule for firing in trace} == {"burning_forest.spread"}
    assert not spread.exists()
    for tile in made.model.nodes("VegetationTile"):
        around = [tile.right, tile.left, tile.down, tile.up]
        assert any(other is not None and other.cls == "WaterTile" for other in around) or not any(
            other is not None and other.cls == "BurningTile" for other in around
        )


def test_retypings_exchange_the_mutable_states() -> None:
    made = domain("burning_forest", "target_8x8")
    names = [name.rsplit(".", 2)[1:] for name in made.group("retypings")]
    assert len(names) == 6 and ["RoadTile", "BurningTile"] in names
    sizes = {cls: len(made.model.nodes(cls)) for cls in ("RoadTile", "VegetationTile", "BurningTile")}
    for before, after in names:
        assert made.count(f"retypings.{before}.{after}") == sizes[before]


def test_the_truck_moves_along_the_references_and_not_into_the_border() -> None:
    made = domain("burning_forest", "target_8x8")
    truck = made.model["truck"]
    assert made.apply("moveLeft", truck=truck) is None and made.apply("moveUp", truck=truck) is None
    places = []
    for rule in ("moveDown", "moveRight", "moveUp", "moveLeft"):
        links = truck.currentState.right.left, truck.currentState.down.up
        made.apply(rule, truck=truck)
        assert links == (links[0], links[0])
        places.append((truck.currentState.x, truck.currentState.y))
    assert places == [(0, 1), (1, 1), (1, 0), (0, 0)]


def test_water_is_collected_once() -> None:
    made = domain("burning_forest", "target_8x8")
    assert made.apply("collect") is not None
    assert made.apply("collect") is None


# --- key and door


def test_the_hero_takes_the_key_and_unlocks_the_door_with_it() -> None:
    made = domain("keydoor", "two_rooms")
    hero = made.model["hero"]
    (key,) = made.model.nodes("Key")
    (door,) = made.model.nodes("Door")
    assert made.apply("take", hero=hero) is None
    put(made, "hero", "at", 2, 2)
    made.apply("take", hero=hero)
    assert list(hero.inventory) == [key] and hero.at.item is None
    put(made, "hero", "at", door.x, door.y - 1)
    assert hero.at.cls == "Wall"
    put(made, "hero", "at", door.x - 1, door.y)
    assert made.apply("walk", hero=hero, way="east") is None
    made.apply("unlock", hero=hero, way="east")
    assert door.open and key not in made.model
    made.apply("walk", hero=hero, way="east")
    assert hero.at == door


def test_a_door_is_a_floor_and_is_left_alone() -> None:
    made = domain("keydoor", "two_rooms")
    matched = {match.object.cls for name in made.group("terrain") for match in made.matches(name)}
    assert matched == {"Floor", "Wall"}


def test_a_key_moves_to_a_floor_without_one_and_is_painted_with_its_door() -> None:
    made = domain("keydoor", "two_rooms")
    application = made.apply("moveKey")
    assert application is not None
    assert application.match.there.item == application.match.key
    assert application.match.here.item is None
    made.apply("repaint")
    assert [node.colour for node in (*made.model.nodes("Door"), *made.model.nodes("Key"))] == ["blue", "blue"]


# --- network


def test_a_packet_is_forwarded_over_links_that_are_up() -> None:
    made = domain("network", "backbone")
    parcel, gva = made.model["parcel"], made.model["gva"]
    application = made.apply("forward", packet=parcel, hop=gva)
    assert application is not None and application.outputs == {"latency": 8.2}
    assert (parcel.at, parcel.hops) == (gva, 1)
    made.apply("fail", link=next(link for link in made.model.nodes("Link") if link.to == made.model["lis"]))
    assert made.apply("forward", packet=parcel, hop=made.model["lis"]) is None
    assert made.apply("recover") is not None


def test_a_demand_is_one_match_for_each_ordered_pair() -> None:
    assert domain("network", "backbone").count("demand") == 5 * 4


def test_links_are_added_where_there_is_none_and_rewired() -> None:
    made = domain("network", "backbone")
    net, ams, bud = (made.model[name] for name in ("net", "ams", "bud"))
    application = made.apply("addLink", net=net, a=ams, b=bud)
    assert application is not None
    link = application.created["link"]
    assert (link.__getattr__("from"), link.to, link.latency, link.up) == (ams, bud, 5.0, True)
    assert link in net.links and made.count("addLink", a=ams, b=bud) == 0
    match = made.first("rewire", p=link)
    assert match is not None
    ends = match.p.to, match.q.to
    made.apply("rewire", match)
    assert (match.q.to, match.p.to) == ends


def test_dropping_a_link_is_refused_while_it_has_ends() -> None:
    made = domain("network", "backbone")
    with pytest.raises(RuleError) as caught:
        made.apply("dropLink")
    assert caught.value.reason == "dangling" and len(caught.value.details) == 2


def test_ageing_slows_links_down() -> None:
    made = domain("network", "backbone")
    with made.recording() as trace:
        assert made.run("age")
    assert {firing.rule for firing in trace} == {"network.slower", "network.addLink"}


# --- warehouse


def test_robots_drive_around_shelves_and_each_other() -> None:
    made = domain("warehouse", "small_hall")
    left = made.model["left"]
    assert made.apply("drive", robot=left, way="west") is None
    made.apply("drive", robot=left, way="south")
    assert (left.at.x, left.at.y, left.battery) == (0, 1, 49)
    assert made.apply("drive", robot=left, way="east") is None  # a shelf
    put(made, "right", "at", 0, 0)
    assert made.apply("drive", robot=left, way="north") is None  # the other robot
    left.battery = 0
    assert made.apply("drive", robot=left, way="south") is None


def test_robots_lift_a_parcel_and_ship_it_at_a_dock() -> None:
    made = domain("warehouse", "small_hall")
    left = made.model["left"]
    put(made, "left", "at", 0, 3)
    made.apply("lift", robot=left)
    (parcel,) = [node for node in made.model.nodes("Parcel") if node.label == "p1"]
    assert left.load == parcel and parcel.at is None
    assert made.apply("lift", robot=left) is None and made.apply("ship", robot=left) is None
    put(made, "left", "at", 3, 3)
    application = made.apply("ship", robot=left)
    assert application is not None and application.outputs == {"label": "p1"}
    assert parcel.shipped and left.load is None


def test_parcels_are_numbered() -> None:
    made = domain("warehouse", "small_hall")
    labels = []
    while (application := made.apply("addParcel")) is not None:
        labels.append(application.created["parcel"].label)
    assert labels == ["p3", "p4", "p5"]


def test_widen_removes_every_shelf_in_a_row() -> None:
    made = domain("warehouse", "small_hall")
    (cell,) = [node for node in made.model.nodes("Aisle") if (node.x, node.y) == (3, 1)]
    cell.retype("Shelf")  # now four shelves stand in row 1
    corner = next(node for node in made.model.nodes("Shelf") if (node.x, node.y) == (1, 1))
    made.apply("widen", corner=corner)
    assert all(node.cls == "Aisle" for node in made.model.nodes("Cell") if node.y == 1)
    assert sum(node.cls == "Shelf" for node in made.model.nodes("Cell")) == 3


def test_the_dock_changes_places_with_an_aisle_without_a_parcel() -> None:
    made = domain("warehouse", "small_hall")
    for match in made.matches("moveDock"):
        assert (match.aisle.x, match.aisle.y) not in ((0, 3), (5, 2))
    made.apply("moveDock")
    assert len(made.model.nodes("Dock")) == 1


# --- all of them


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("burning_forest", "target_8x8"),
        ("keydoor", "two_rooms"),
        ("network", "backbone"),
        ("warehouse", "small_hall"),
    ],
)
def test_applying_and_rolling_back_restores_everything(name: str, model: str) -> None:
    made = domain(name, model)
    before = snapshot(made.model)
    savepoint = made.model.graph.history.savepoint()
    for rule in made.rules:
        try:
            made.apply(rule)
        except RuleError as error:
            assert error.reason == "dangling"
    made.model.check_integrity()
    made.model.graph.history.rollback(savepoint)
    assert snapshot(made.model) == before
