"""The Burning Forest built in Python: metamodel, 8x8 target and queries."""

from __future__ import annotations

from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import Aggregate, Binary, Check, Comparison, Constant, Library, Negation
from tests.unit.match.writing import find, is_a, path, pattern, v

METAMODEL = Metamodel(
    "burning_forest",
    (
        Class(
            "Environment",
            abstract=True,
            features=(
                Reference("states", "State", 1, None, containment=True),
                Reference("agent", "Agent", 0, 1, containment=True),
            ),
        ),
        Class("State", abstract=True),
        Class("Agent", abstract=True, features=(Reference("currentState", "State"),)),
        Class("Forest", supertypes=("Environment",)),
        Class(
            "Tile",
            abstract=True,
            supertypes=("State",),
            key=("y", "x"),
            features=(
                Attribute("x", Scalar.INT),
                Attribute("y", Scalar.INT),
                Reference("right", "Tile", 0, 1, opposite="left"),
                Reference("left", "Tile", 0, 1, opposite="right"),
                Reference("down", "Tile", 0, 1, opposite="up"),
                Reference("up", "Tile", 0, 1, opposite="down"),
            ),
        ),
        Class("StartTile", supertypes=("Tile",)),
        Class("GoalTile", supertypes=("Tile",)),
        Class("RoadTile", supertypes=("Tile",)),
        Class("VegetationTile", supertypes=("Tile",)),
        Class("BurningTile", supertypes=("Tile",)),
        Class("WaterTile", supertypes=("Tile",), features=(Attribute("collected", Scalar.BOOL),)),
        Class("FireTruck", supertypes=("Agent",)),
    ),
)

LETTERS = {
    "S": "StartTile",
    "G": "GoalTile",
    "R": "RoadTile",
    "V": "VegetationTile",
    "B": "BurningTile",
    "W": "WaterTile",
}

TARGET = ["SVVVRVRV", "BRRRRBVB", "BVBRRRBV", "RVRBVVVB", "VRRBBBRB", "BBVWRBVR", "VVRBBBVB", "VBRVRVVG"]


def forest(rows: list[str] = TARGET) -> Model:
    """A forest of the given rows, with the truck at its first tile."""
    model = Model(METAMODEL)
    environment = model.create("Forest")
    tiles = {}
    for y, row in enumerate(rows):
        for x, letter in enumerate(row):
            tiles[x, y] = tile = model.create(LETTERS[letter], x=x, y=y)
            environment.states.append(tile)
            if x:
                tiles[x - 1, y].right = tile
            if y:
                tiles[x, y - 1].down = tile
    environment.agent = model.create("FireTruck", currentState=tiles[0, 0])
    return model


def equals(left: str, right: int) -> Binary:
    """`left == right`."""
    return Binary("==", v(left), Constant(right))


PATTERNS = (
    pattern("burningTile(forest : Forest, tile : BurningTile)", [path("Forest.states", "forest", "tile")]),
    pattern(
        "startTileFixedLocation(forest : Forest, tile : StartTile)",
        [
            path("Forest.states", "forest", "tile"),
            path("Tile.x", "tile", "x"),
            path("Tile.y", "tile", "y"),
            Check(Binary("&&", equals("x", 0), equals("y", 0))),
        ],
    ),
    pattern(
        "goalTileFixedLocation(forest : Forest, tile : GoalTile)",
        [path("Forest.states", "forest", "tile"), path("Tile.x", "tile", 7), path("Tile.y", "tile", 7)],
    ),
    pattern(
        "waterTileFixedLocation(forest : Forest, tile : WaterTile)",
        [path("Forest.states", "forest", "tile"), path("Tile.x", "tile", 3), path("Tile.y", "tile", 5)],
    ),
    pattern(
        "neighbour(from : Tile, to : Tile)",
        [path("Tile.right", "from", "to")],
        [path("Tile.left", "from", "to")],
        [path("Tile.down", "from", "to")],
        [path("Tile.up", "from", "to")],
    ),
    pattern(
        "passage(from : Tile, to : Tile)",
        [
            find("neighbour", "from", "to"),
            Negation(is_a("BurningTile", "from")),
            Negation(is_a("BurningTile", "to")),
        ],
    ),
    pattern("solvable(start : StartTile, goal : GoalTile)", [find("passage+", "start", "goal")]),
    pattern(
        "fireDensity(forest : Forest, burning : int, tiles : int)",
        [
            Comparison("==", v("burning"), Aggregate("count", find("burningTile", "forest", "_"))),
            Comparison("==", v("tiles"), Aggregate("count", path("Forest.states", "forest", "_"))),
        ],
    ),
    pattern(
        "onFire(truck : FireTruck)",
        [path("FireTruck.currentState", "truck", "tile"), is_a("BurningTile", "tile")],
    ),
    pattern(
        "onFreshWater(truck : FireTruck, water : WaterTile)",
        [path("FireTruck.currentState", "truck", "water"), path("WaterTile.collected", "water", False)],
    ),
    pattern(
        "truckOnStart(truck : FireTruck, start : StartTile)",
        [path("FireTruck.currentState", "truck", "start")],
    ),
    pattern("collectedWater(water : WaterTile)", [path("WaterTile.collected", "water", True)]),
    pattern("changeBurningToRoad(tile : BurningTile)", [find("burningTile", "_", "tile")]),
    pattern(
        "spread(fire : BurningTile, tile : VegetationTile)",
        [find("neighbour", "fire", "tile"), Negation(find("wet", "tile"))],
    ),
    pattern("wet(tile : Tile)", [find("neighbour", "tile", "water"), is_a("WaterTile", "water")]),
)


def library() -> Library:
    """A library with the queries of the forest."""
    found = Library(METAMODEL)
    found.add(*PATTERNS)
    return found
