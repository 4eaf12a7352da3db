"""Two small metamodels: the Burning Forest, and people with every kind of reference."""

from __future__ import annotations

from envgraph.graph import Model, Node
from envgraph.metamodel import Attribute, Class, EnumType, Feature, Metamodel, Reference, Scalar


def _neighbour(name: str, opposite: str) -> Reference:
    return Reference(name, "Tile", 0, 1, opposite=opposite)


FOREST = Metamodel(
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
                _neighbour("right", "left"),
                _neighbour("left", "right"),
                _neighbour("down", "up"),
                _neighbour("up", "down"),
            ),
        ),
        Class("RoadTile", supertypes=("Tile",)),
        Class("BurningTile", supertypes=("Tile",)),
        Class("WaterTile", supertypes=("Tile",), features=(Attribute("collected", Scalar.BOOL),)),
        Class("FireTruck", supertypes=("Agent",)),
    ),
)

MOOD = EnumType("Mood", ("glad", "sad"))

PEOPLE = Metamodel(
    "people",
    (
        Class("Group", features=(Reference("parts", "Group", 0, None, containment=True, opposite="whole"),
                                 Reference("whole", "Group", 0, 1, opposite="parts"),
                                 Reference("members", "Person", 0, None, opposite="groups"),
                                 Reference("pet", "Animal", 0, 1, containment=True))),
        Class(
            "Person",
            features=(
                Attribute("height", Scalar.FLOAT, 1),
                Attribute("nick", Scalar.STRING, "?"),
                Attribute("mood", MOOD, "sad"),
                Attribute("adult", Scalar.BOOL),
                Attribute("id", Scalar.INT),
                Reference("groups", "Group", 0, 2, opposite="members"),
                Reference("spouse", "Person", 0, 1, opposite="spouse"),
                Reference("friends", "Person", 0, None, opposite="friends"),
                Reference("likes", "Person", 0, None),
                Reference("animals", "Animal", 0, 2, containment=True, opposite="owner"),
            ),
        ),
        Class("Animal", features=(Reference("owner", "Person", 0, 1, opposite="animals"),)),
        Class("Dog", supertypes=("Animal",), features=(Reference("chases", "Animal", 0, 1),)),
        Class("Stone"),
    ),
    (MOOD,),
)  # fmt: skip


def forest(size: int = 3) -> Model:
    """A square of road tiles named `t<x><y>` with a truck on the first; ids: forest, tiles row by row, truck."""
    model = Model(FOREST, "square")
    ground = model.create("Forest", object_name="forest")
    for y in range(size):
        for x in range(size):
            tile = model.create("RoadTile", x=x, y=y, object_name=f"t{x}{y}")
            ground.states.append(tile)
            if x:
                tile.left = model[f"t{x - 1}{y}"]
            if y:
                tile.up = model[f"t{x}{y - 1}"]
    ground.agent = model.create("FireTruck", currentState=model["t00"], object_name="truck")
    return model


def people(*names: str) -> tuple[Model, list[Node]]:
    """A model of persons with these names."""
    model = Model(PEOPLE, "people")
    return model, [model.create("Person", object_name=name) for name in names]


def feature(model: Model, cls: str, name: str) -> Feature:
    """A feature that is there."""
    found = model.metamodel.feature(cls, name)
    assert found is not None
    return found
