"""The Burning Forest built from data, without any text; and its published maps."""

from __future__ import annotations

import json
from pathlib import Path

from envgraph.env import (
    Action,
    Behaviour,
    Branch,
    DrawGrid,
    ObserveFind,
    ObserveObject,
    OnFind,
    RuleCall,
    Token,
)
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Class, Glyph, Metamodel, Reference, Scalar
from envgraph.pattern import (
    Binary,
    Body,
    Check,
    Constant,
    LeftSide,
    Modification,
    Navigation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Rule,
    RuleEdge,
    RuleNode,
    SetAction,
    TypeConstraint,
    Unary,
    Variable,
)
from envgraph.rewrite import Engine

DATA = Path(__file__).parents[3] / "envgraph" / "report" / "reproduction" / "data"

GLYPHS = {
    "StartTile": Glyph("S", "#b0b0b0"),
    "GoalTile": Glyph("G", "#2f9e44"),
    "RoadTile": Glyph("R", "#d0d0d0"),
    "VegetationTile": Glyph("V", "#94d82d"),
    "BurningTile": Glyph("B", "#e8590c"),
    "WaterTile": Glyph("W", "#4dabf7"),
}


def published_maps() -> list[list[str]]:
    """The rows of E1 to E6."""
    data = json.loads((DATA / "environment-config.json").read_text())
    return [environment["desc"] for environment in data["environments"]]


def metamodel() -> Metamodel:
    ways = [("right", "left"), ("left", "right"), ("down", "up"), ("up", "down")]
    tile = Class(
        "Tile",
        abstract=True,
        features=(
            Attribute("x", Scalar.INT),
            Attribute("y", Scalar.INT),
            *(Reference(way, "Tile", 0, 1, opposite=back) for way, back in ways),
        ),
        key=("y", "x"),
    )
    water = (Attribute("collected", Scalar.BOOL),)
    tiles = (
        Class(name, supertypes=("Tile",), features=water if name == "WaterTile" else (), glyph=glyph)
        for name, glyph in GLYPHS.items()
    )
    truck = Class("FireTruck", features=(Reference("currentState", "Tile"),))
    return Metamodel("burning_forest", (tile, *tiles, truck))


def model(rows: list[str], start: tuple[int, int] = (0, 0)) -> Model:
    """A model of a map; the truck starts at a column and row."""
    mm = metamodel()
    by_letter = {glyph.letter: name for name, glyph in GLYPHS.items()}
    built = Model(mm, "forest")
    tiles = {}
    for y, row in enumerate(rows):
        for x, letter in enumerate(row):
            tiles[x, y] = built.create(by_letter[letter], x=x, y=y)
    for (x, y), tile in tiles.items():
        if (x + 1, y) in tiles:
            tile.right = tiles[x + 1, y]
        if (x, y + 1) in tiles:
            tile.down = tiles[x, y + 1]
    built.create("FireTruck", object_name="truck", currentState=tiles[start])
    return built


def patterns() -> list[Pattern]:
    truck = Parameter("truck", "FireTruck")

    def on(name: str, cls: str) -> Pattern:
        here = PathConstraint("FireTruck", ("currentState",), Variable("truck"), Variable("tile"))
        return Pattern(name, (truck,), (Body((here, TypeConstraint(cls, Variable("tile")))),))

    at_water = PathConstraint("FireTruck", ("currentState",), Variable("truck"), Variable("water"))
    fresh = PathConstraint("WaterTile", ("collected",), Variable("water"), Constant(False))
    taken = PathConstraint("WaterTile", ("collected",), Variable("water"), Constant(True))
    water = Parameter("water", "WaterTile")
    return [
        on("onGoal", "GoalTile"),
        on("onFire", "BurningTile"),
        on("onVegetation", "VegetationTile"),
        Pattern("onFreshWater", (truck, water), (Body((at_water, fresh)),)),
        Pattern("collectedWater", (water,), (Body((taken,)),)),
    ]


def move(name: str, way: str) -> Rule:
    nodes = (RuleNode("truck"), RuleNode("here", "Tile"), RuleNode("there", "Tile"))
    left = LeftSide(nodes, (RuleEdge("truck", "currentState", "here"), RuleEdge("here", way, "there")))
    right = Modification((SetAction(Variable("truck"), "currentState", "=", Variable("there")),))
    return Rule(name, (Parameter("truck", "FireTruck"),), left, right=right)


def rules() -> list[Rule]:
    ways = {"moveLeft": "left", "moveDown": "down", "moveRight": "right", "moveUp": "up"}
    fresh = Check(Unary("!", Navigation(Variable("water"), "collected")))
    take = Modification((SetAction(Variable("water"), "collected", "=", Constant(True)),))
    collect = Rule("collect", (Parameter("water", "WaterTile"),), LeftSide(constraints=(fresh,)), right=take)
    return [*(move(name, way) for name, way in ways.items()), collect]


def find(pattern: str, *arguments: str) -> PatternCall:
    return PatternCall(pattern, tuple(Variable(name) for name in arguments))


def call(rule: str | None, *arguments: str) -> RuleCall:
    return RuleCall(rule, tuple(Variable(name) for name in arguments))


def behaviour() -> Behaviour:
    moves = {"left": "moveLeft", "down": "moveDown", "right": "moveRight", "up": "moveUp"}
    return Behaviour(
        "BurningForest",
        (Parameter("truck", "FireTruck"),),
        tuple(Action(name, (Branch(1.0, call(rule, "truck")),)) for name, rule in moves.items()),
        (
            OnFind(find("onGoal", "truck"), Constant(10.0), "success"),
            OnFind(find("onFire", "truck"), Constant(-1.0), "failure"),
            OnFind(find("onVegetation", "truck"), Unary("-", Constant(0.1))),
            OnFind(
                find("onFreshWater", "truck", "water"),
                Constant(1.0),
                None,
                (Branch(1.0, call("collect", "water")),),
            ),
        ),
        observations=(
            ObserveObject(Navigation(Variable("truck"), "currentState"), "Tile"),
            ObserveFind(find("collectedWater", "_")),
        ),
        limit=200,
        draw=DrawGrid("Tile", "x", "y", (Token("truck", Navigation(Variable("truck"), "currentState")),)),
    )


def engine(rows: list[str], start: tuple[int, int] = (0, 0)) -> Engine:
    built = Engine(model(rows, start))
    built.add(*patterns(), *rules())
    return built


def less(left: str, right: int) -> Check:
    return Check(Binary("<", Variable(left), Constant(right)))
