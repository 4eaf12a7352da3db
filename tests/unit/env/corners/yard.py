"""A yard with spots, boxes, men and items."""

from __future__ import annotations

from dataclasses import dataclass

from envgraph.env import Behaviour
from envgraph.lang import TextFiles, load_workspace
from envgraph.rewrite import Engine

METAMODEL = """
metamodel yard

enum Kind { zebra, ant, mole }
enum Way { west, east }

class Yard {
    contains Spot[*] spots
    contains Box[*] boxes
    contains Man[*] men
    contains Item[*] items
}

@key(x) class Spot {
    int x
    int n = 0
    float f = 0.5
    @glyph("*") bool lit = false
    Kind kind = zebra
    string tag
    int[0..1] maybe
    refers Spot[0..1] east opposite west
    refers Spot[0..1] west opposite east
    refers Man[0..2] men opposite at
    refers Spot[0..1] mark
    refers Spot[0..3] near opposite near
    string[*] marks
}
class Pit extends Spot

@key(name) class Man {
    string name
    int hunger = 3
    float power = 1.5
    bool awake = true
    Kind kind = ant
    refers Spot[0..1] at opposite men
    contains Item[0..2] bag
    refers Item[0..1] wants
    refers Man[0..1] friend opposite friend
    refers Spot[*] visited
    refers Item[0..2] likes opposite fans
    int[0..2] codes
    Kind[*] kinds
    @nonunique Way[0..3] ways
    int[*] rolls
    @nonunique bool[*] flips
    float[*] sums
}

@key(id) class Item {
    int id
    float weight = 0.25
    Kind kind = mole
    string tag
    refers Spot[0..1] at
    refers Item[0..1] pair opposite paired
    refers Item[0..1] paired opposite pair
    refers Man[*] fans opposite likes
}
class Heavy extends Item

abstract class Crate {}
class Plain extends Crate { int size = 7 }
class Box extends Crate { contains Item[0..1] item contains Box[0..3] inner opposite outer
    refers Box[0..1] outer opposite inner contains Box[0..1] lid opposite under refers Box[0..1] under opposite lid
    refers Spot[*] likes int size = 1 }
class Chest extends Box { int depth = 0 refers Man[0..1] lock string[*] labels }
"""

MODEL = """
import "yard.metamodel"

model small : yard {
    yard : Yard {
        spots = [
            s0 : Spot { x = 0 tag = "b" kind = ::zebra east = s1 maybe = 4 marks = ["m", "a"] },
            s1 : Spot { x = 1 tag = "a" kind = ::ant east = s2 f = 0.1 },
            s2 : Pit { x = 2 tag = "c" kind = ::mole east = s3 n = 2 f = 0.7 },
            s3 : Spot { x = 3 tag = "a" kind = ::ant lit = true f = 0.3 },
        ]
        boxes = [ b0 : Box { size = 2 }, b1 : Box { item = i3 : Item { id = 3 tag = "q" } } ]
        men = [
            adam : Man { name = "adam" at = s0 wants = i1 bag = [i4 : Item { id = 4 weight = 1.1 kind = ::ant }] },
            eve : Man { name = "eve" at = s3 hunger = 1 kind = ::mole codes = [7] ways = [::east, ::east] },
            seth : Man { name = "seth" },
        ]
        items = [
            i0 : Item { id = 0 at = s1 tag = "z" pair = i1 },
            i1 : Heavy { id = 1 at = s1 weight = 2.5 kind = ::zebra },
            i2 : Item { id = 2 at = s2 tag = "b" },
        ]
    }
}
"""

STEP = """
pattern step(a : Spot, way : Way, b : Spot) {
    Spot.east(a, b);
    way == Way::east;
} or {
    Spot.west(a, b);
    way == Way::west;
}
"""

MUTATIONS = """
rule newItem {
    lhs { y : Yard; s : Spot; last == max Item.id(_, #); }
    modify { create y -items-> i : Item { id = last + 1, at = s }; }
}
rule newHeavy {
    lhs { m : Man; last == max Item.id(_, #); }
    modify { create m -bag-> i : Heavy { id = last + 1, tag = "b" }; }
}
rule newSpot {
    lhs { y : Yard; s : Spot; last == max Spot.x(_, #); neg Spot.east(s, _); }
    modify { create y -spots-> t : Spot { x = last + 1, kind = ::mole, west = s }; }
}
rule newBox { lhs { y : Yard; } modify { create y -boxes-> b : Box { size = 3 }; } }
@semantics(spo) rule noItem { lhs { i : Item; check i.id == 0 || i.id > 3; } modify { delete i; } }
rule moved { lhs { m : Man; s : Spot; } modify { set m.at = s; } }
rule changed { lhs { s : Spot; }
    modify { set s.kind = ::zebra; set s.n = s.x; set s.maybe = none; set s.tag = "d"; } }
"""
"""What members of a family differ by."""


@dataclass(frozen=True)
class Yard:
    """A small environment of the yard that exercises one construct.

    Attributes:
        rules, behaviour, query: what its files say, besides what all have.
        head: the parameters of the environment.
        members: how many models its family has: this one, and others that `MUTATIONS` make of it.
        spare: how many new objects a state of its program has space for.
    """

    rules: str
    behaviour: str
    query: str = ""
    head: str = "adam : Man"
    model: str = MODEL
    members: int = 3
    spare: int = 12

    def opened(self) -> tuple[Engine, Behaviour]:
        """Return a new engine of the model, and the behaviour."""
        files = {
            "yard.metamodel": METAMODEL,
            "yard.query": f'package yard\nimport "yard.metamodel"\n{STEP}{self.query}',
            "yard.rules": f'package yard\nimport "yard.query"\n{self.rules}\n{MUTATIONS}',
            "yard.model": self.model,
            "yard.environment": 'import "yard.query"\nimport "yard.rules"\n\n'
            f"environment Corner({self.head}) {{\n{self.behaviour}\n}}\n",
        }
        workspace = load_workspace(["yard.model", "yard.environment"], files=TextFiles(files))
        return workspace.engine(), workspace.behaviour()


def wrong(rule: str) -> Yard:
    """Return an environment whose only action applies a rule."""
    return Yard(f"rule wrong {{ {rule} }}", "action wrong = wrong()\nobserve adam.at among Spot or none")
