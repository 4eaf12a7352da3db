"""The queries of the Burning Forest on the 8x8 target."""

from __future__ import annotations

import pytest

from envgraph.match import FREE
from tests.unit.match.forest import forest, library
from tests.unit.match.kinds import KINDS, Kind, assert_sound

MATCHES = {
    "burningTile": 20,
    "startTileFixedLocation": 1,
    "goalTileFixedLocation": 1,
    "waterTileFixedLocation": 1,
    "neighbour": 224,
    "solvable": 1,
    "fireDensity": 1,
    "onFire": 0,
    "onFreshWater": 0,
    "truckOnStart": 1,
    "collectedWater": 0,
    "changeBurningToRoad": 20,
}


@pytest.fixture(params=KINDS.values(), ids=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    found: Kind = request.param
    return found


@pytest.mark.parametrize("name", MATCHES)
def test_the_target_has_the_expected_matches(kind: Kind, name: str) -> None:
    queries = library()
    matcher = kind(forest(), queries)
    arguments = (FREE,) * len(queries.parameter_types(name))
    assert matcher.count(name, arguments) == len(matcher.rows(name, arguments)) == MATCHES[name]


def test_density_counts_tiles(kind: Kind) -> None:
    [(_, burning, tiles)] = kind(forest(), library()).rows("fireDensity", (FREE, FREE, FREE))
    assert (burning, tiles) == (20, 64)


def test_the_target_is_solvable_until_its_only_passage_burns(
    kind: Kind,
) -> None:
    model = forest()
    matcher = kind(model, library())
    start, goal = model.graph.extent("StartTile")[0], model.graph.extent("GoalTile")[0]
    assert matcher.exists("solvable", (start, goal))
    savepoint = model.graph.history.savepoint()
    for tile in model.nodes("Tile"):
        if (tile.x == 7 and tile.y in (5, 6)) or (tile.x == 6 and tile.y == 7):
            tile.retype("BurningTile")
    assert not matcher.exists("solvable", (start, goal))
    assert not matcher.exists("solvable", (FREE, FREE))
    assert_sound(matcher)
    model.graph.history.rollback(savepoint)
    assert matcher.rows("solvable", (FREE, FREE)) == [(start, goal)]
    assert_sound(matcher)
