"""Rules with blocks, and those whose match does not tell what they change."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

SEEN = """
pattern any(i : Item) { Item(i); }
pattern boxed(b : Box, i : Item) { Box.item(b, i); }
pattern lit(s : Spot) { Spot.lit(s, true); }
pattern sum(n : int) { n == sum Spot.n(_, #); }
pattern weights(w : float) { Item.weight(_, w); }
"""
LOOK = (
    "observe count find any(_) up to 9\nobserve count find lit(_) up to 5\nobserve count find boxed(_, _) up to 5\n"
    "on find sum(n) reward n * 0.001\non find weights(w) reward w\n"
)
GO = "rule go(m : Man, way : Way) { lhs { m -at-> s : Spot; find step(s, way, t); } modify { set m.at = t; } }\n"
FORGET = "rule forget { lhs { m : Man -wants-> i : Item; } modify { set m.wants = none; } }\n"


def corner(rules: str, actions: str, query: str = "") -> Yard:
    """A corner with some rules that leave their matches to blocks, among others."""
    head = "action go(way : Way) = go(adam, way)\n"
    return Yard(GO + FORGET + rules, head + actions + LOOK, SEEN + query, spare=40)


CORNERS = {
    "all of them": corner(
        """
        rule light { lhs { s : Spot; }
            forall { lhs { find step(s, w, t); neg Spot.lit(t, true); } modify { set t.lit = true; set t.n += 1; } }
            modify { set s.lit = false; } }
        rule tick { lhs { y : Yard; }
            forall { lhs { i : Item; } modify { set i.weight += 0.1; } }
            forall { lhs { s : Spot; i : Item -at-> s; } modify { set s.n += i.id; } }
            modify { } }
        """,
        "action light = light() reward 1 else reward 2\naction tick = tick() reward 3\n",
    ),
    "what a block asks for cannot be": corner(
        """
        rule never { lhs { y : Yard; }
            forall { lhs { s : Spot; k == Kind::ant; k == Kind::mole; Spot.kind(s, k); } modify { set s.n += 1; } }
            modify { } }
        """,
        "action never = never() reward 1\n",
    ),
    "at least one, and the first": corner(
        """
        rule some { lhs { m : Man; }
            forall+ { lhs { m -at-> s : Spot; i : Item -at-> s; } modify { set i.weight = 2.0; delete i -at-> s; } }
            modify { set m.hunger -= 1; } }
        rule first(out n : int) { lhs { m : Man -at-> s : Spot; n == eval(m.hunger * 2); }
            optional { lhs { i : Item; } not { i -at-> _; } modify { create i -at-> s; } }
            optional { lhs { i : Item -at-> s; check i.id > 1; } modify { set i.kind = ::zebra; } }
            modify { set m.hunger += 1; } }
        """,
        "action some = some() reward 1 else reward 2\naction first = first(n) reward n\n",
    ),
    "each makes one": corner(
        """
        rule order { lhs { y : Yard; n == count Item(_); check n < 14; }
            forall { lhs { m : Man -at-> s : Spot; most == max Item.id(_, #); }
                modify { create y -items-> i : Item { id = most + m.hunger, at = s, weight = m.power }; } }
            modify { } }
        @semantics(spo) rule tidyUp { lhs { y : Yard; }
            forall { lhs { i : Item; check i.id > 5; } modify { delete i; } } modify { } }
        rule pack { lhs { y : Yard; s : Spot; n == count Box(_); check n < 12; }
            forall { lhs { y -items-> i : Item -at-> s; }
                modify { create y -boxes-> b : Box { size = i.id }; move i to b.item; } }
            modify { create y -boxes-> c : Box { size = s.n }; } }
        rule unpack { lhs { y : Yard; }
            forall { lhs { b : Box -item-> i : Item; } modify { move i to y.items; } } modify { } }
        """,
        "action order = order() reward 1\naction tidyUp = tidyUp() reward 2\naction pack = pack() reward 3\n"
        "action unpack = unpack() reward 4\n",
    ),
    "blocks in blocks": corner(
        """
        rule deep { lhs { y : Yard; n == count Box(_); check n < 9; }
            forall { lhs { s : Spot; check s.n < 40; }
                forall { lhs { i : Item -at-> s; }
                    modify { set i.weight += s.f; create y -boxes-> b : Box { size = s.x }; } }
                optional { lhs { find step(s, w, t); check t.n >= s.n; }
                    forall { lhs { m : Man -at-> t; } modify { set m.hunger += s.n; } }
                    modify { set s.lit = true; } }
                modify { set s.n += 1; } }
            modify { } }
        rule sweep { lhs { y : Yard; n == count Box(_); check n > 4; }
            forall { lhs { b : Box; neg Box.item(b, _); } modify { set b.size = n; } } modify { } }
        rule build { lhs { y : Yard; most == max Item.id(_, #); n == count Item(_); check n < 9; }
            forall { lhs { m : Man; }
                forall { lhs { s : Spot; check s.x < 1; neg Man.bag(m, _); }
                    modify { create b -item-> i : Item { id = most + s.x }; create m -bag-> j : Item; } }
                modify { create y -boxes-> b : Box; set m.kind = ::mole; } }
            modify { } }
        """,
        "action deep = deep() reward 1\naction sweep = sweep() reward 2\naction build = build() reward 3\n",
    ),
    "matches that contradict each other": corner(
        """
        rule name { lhs { y : Yard; }
            forall { lhs { i : Item -at-> s : Spot; } modify { set s.kind = i.kind; } } modify { } }
        rule meet { lhs { y : Yard; }
            forall { lhs { m : Man; i : Item; check i.id > 2; } modify { set m.wants = i; } } modify { } }
        rule both { lhs { i : Item; }
            forall { lhs { j : Item; check j.id <= 1; } modify { set j.pair = i; } } modify { } }
        rule put(s : Spot) { lhs { i : Item; } modify { set i.at = s; } }
        rule paint { lhs { i : Item; } modify { set i.kind = ::ant; } }
        rule lone { lhs { i : Item; }
            forall { lhs { j : Item -pair-> k : Item; } modify { delete j -pair-> k; } }
            modify { set i.weight = 4.0; } }
        """,
        "action name = name() reward 1\naction meet = meet()\naction both = both() reward 2\n"
        "action put(s : Spot) = put(s)\naction paint = paint()\naction lone = lone() reward 3\n",
    ),
    "what is deleted, and changed": corner(
        """
        @semantics(spo) rule cut { lhs { y : Yard; }
            forall { lhs { i : Item; check i.id > 1; } modify { delete i; } }
            forall { lhs { j : Item -at-> s : Spot; check s.n < 3; } modify { set j.weight = 3.0; } } modify { } }
        rule up { lhs { s : Spot; } modify { set s.n += 1; } }
        rule more { lhs { y : Yard; s : Spot; most == max Item.id(_, #); }
            modify { create y -items-> i : Item { id = most + 1, at = s }; } }
        @semantics(spo) rule swap { lhs { y : Yard; }
            forall { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
            forall { lhs { h : Heavy; check h.weight > 2.0; } modify { delete h; } } modify { } }
        """,
        "action cut = cut() reward 1\naction up = up()\naction more = more()\naction swap = swap() reward 2\n",
    ),
    "names that may be one object": corner(
        """
        @match(homomorphic) rule weigh { lhs { i : Item; j : Item; check i.id <= j.id; }
            modify { set i.weight = 1.0; set j.weight = 2.0; } }
        @hom(i, j) rule drop {
            lhs { i : Item -at-> s : Spot; j : Item -at-> t : Spot; check i.id + 1 >= j.id && i.id <= j.id; }
            modify { delete i -at-> s; set j.at = s; } }
        @hom(i, j) @semantics(spo) rule gone { lhs { i : Item; j : Item; check i.id > 2 && j.id > 2; }
            modify { delete i; delete j; } }
        rule pass { lhs { i : Item; j : Item; check i.pair != none; } modify { set j.pair = i.pair; } }
        rule hand { lhs { i : Item; j : Item; } modify { set i.pair = j.pair; set j.at = i.at; } }
        """,
        "action weigh = weigh() reward 1\naction drop = drop() reward 2\naction gone = gone() reward 3\n"
        "action pass = pass() reward 4\naction hand = hand() reward 5\n",
    ),
    "blocks that change the same": corner(
        """
        rule add { lhs { y : Yard; } forall { lhs { i : Item; } modify { set i.weight += 0.1; } }
            forall { lhs { i : Item; } modify { set i.weight += 0.7; } } modify { } }
        rule turns { lhs { y : Yard; }
            forall { lhs { m : Man -wants-> i : Item; }
                forall { lhs { j : Item; check j.id != i.id; } modify { set j.weight += m.power; } }
                forall { lhs { s : Spot; } modify { set s.f += i.weight; } }
                modify { set i.weight -= 0.3; } }
            forall { lhs { i : Item -at-> s : Spot; } modify { set i.weight += s.f; set s.f -= 0.1; } }
            modify { } }
        rule seats { lhs { y : Yard; }
            forall { lhs { m : Man -at-> s : Spot; check m.hunger > 2; find step(s, Way::east, t); }
                modify { set m.at = t; } }
            forall { lhs { m : Man -at-> s : Spot; check m.hunger <= 2; find step(s, Way::west, t); }
                modify { set m.at = t; set m.hunger += 1; } }
            modify { } }
        rule tastes { lhs { y : Yard; }
            forall { lhs { m : Man; check m.hunger > 1; }
                forall { lhs { m -likes-> i : Item; check i.id < 2; } modify { set m.likes -= i; } }
                forall { lhs { i : Item -at-> s : Spot; m -at-> s; } modify { set m.likes += i; } }
                modify { set m.hunger -= 1; } }
            forall { lhs { m : Man -bag-> i : Item; } modify { set m.likes += i; set m.wants = i; } }
            modify { } }
        rule ties { lhs { y : Yard; }
            forall { lhs { s : Spot; check s.x > 0; }
                forall { lhs { find step(s, w, t); } modify { set s.near += t; } }
                modify { set s.n += 1; } }
            forall { lhs { s : Spot; i : Item -at-> s; s -near-> t : Spot; } modify { set s.near -= t; } }
            modify { } }
        """,
        "action add = add() reward 1\naction turns = turns() reward 2\naction seats = seats() reward 3\n"
        "action tastes = 0.3: tastes() reward 4\naction ties = ties() reward 5\n"
        "on find near(s, t) reward s.x * 0.1 + t.x * 0.01\non find liked(m, i) reward i.id * 0.1\n",
        "pattern near(s : Spot, t : Spot) { Spot.near(s, t); }\n"
        "pattern liked(m : Man, i : Item) { Man.likes(m, i); }\n",
    ),
    "rules with blocks in units": corner(
        """
        @weight(2.0) rule meet(m : Man) { lhs { m : Man; }
            forall { lhs { i : Item -at-> s : Spot; check i.id != 1; } modify { set m.at = s; } } modify { } }
        rule crowd(s : Spot) { lhs { s : Spot; }
            forall { lhs { m : Man; } modify { set m.at = s; set m.hunger += 1; } } modify { set s.n += 1; } }
        rule seat { lhs { m : Man; s : Spot; }
            forall { lhs { n : Man -at-> s; check n.hunger > m.hunger; } modify { set n.wants = none; } }
            modify { set m.at = s; } }
        rule choose { lhs { m : Man; s : Spot; check m.awake; }
            forall { lhs { i : Item -at-> s; } modify { set m.wants = i; } }
            modify { set m.at = s; } }
        @hom(a, b) rule part { lhs { a : Item -at-> s : Spot; b : Item; check a.weight < 1.0; }
            modify { delete a -at-> s; set b.at = s; } }
        @hom(i, j) @semantics(spo) rule gone { lhs { i : Item; j : Item; check i.id > 2 && j.id > 0; }
            modify { delete i; set j.kind = ::ant; } }
        @match(homomorphic) rule weigh { lhs { i : Item; j : Item; check i.id <= j.id; j -at-> s : Spot; m : Man; }
            modify { set i.kind = ::ant; set j.kind = ::mole; set m.at = s; } }
        rule up { lhs { s : Spot; } modify { set s.n += 1; } }
        unit met(m : Man) { meet(m) | up; }
        unit crowded(s : Spot) { crowd(s) | up; }
        unit seated { try { seat; } else { up; } }
        unit chosen { choose | up; }
        unit parted { part | up; }
        unit lost { gone | up; }
        unit weighed { try { weigh; } }
        """,
        "action met(m : Man) = 0.4: met(m) reward 1\naction crowded(s : Spot) = crowded(s) reward 2\n"
        "action seated = seated() reward 3\naction chosen = 0.5: chosen() reward 4\n"
        "action parted = 0.5: parted() reward 5\naction lost = 0.2: lost() reward 6\n"
        "action weighed = 0.4: weighed() reward 7\n",
    ),
}

REFUSED = {
    "refusals of a rule whose blocks may delete an object that they keep (`yard.drop`)": Yard(
        """
        @hom(i, j) rule drop { lhs { y : Yard; }
            forall { lhs { i : Item; j : Item; } modify { delete i; set j.weight = 1.0; } } modify { } }
        unit wrong { [[drop]]; }
        """,
        "action wrong = wrong()\nobserve adam.kind",
    ),
    "refusals of a rule whose blocks may delete an object that they keep (`drop`)": Yard(
        """
        @hom(i, j) rule drop { lhs { y : Yard; }
            forall { lhs { i : Item; j : Item; } modify { delete i; set j.weight = 1.0; } } modify { } }
        """,
        "action wrong = [[drop()]]\non refused nothing()\nobserve adam.kind",
    ),
}
