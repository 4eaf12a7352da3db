"""Objects that rules create."""

from __future__ import annotations

from tests.unit.env.corners.links import LIKED, LIKES, MANY
from tests.unit.env.corners.yard import Yard

BORN = "rule born { lhs { y : Yard; } modify { create y -boxes-> b : Box { size = 4 }; } }\n"
MADE = """
rule make(m : Man, out i : Item) {
    lhs { m -at-> s : Spot; most == max Item.id(_, #); }
    modify { create m -bag-> i : Item { id = most + 1, at = s, weight = 0.5 * most }; }
}
"""
DROP = "@semantics(spo) rule drop { lhs { i : Item; } modify { delete i; } }\n"
GO = "rule go(m : Man, way : Way) { lhs { m -at-> s : Spot; find step(s, way, t); } modify { set m.at = t; } }\n"
SIZES = """
pattern size(b : Box, n : int) { Box.size(b, n); }
pattern sizes(n : int) { n == count Box(_); }
pattern carried(m : Man, i : Item, k : Kind) { Man.bag(m, i); Item.kind(i, k); }
pattern heavy(i : Item, w : float) { Item.weight(i, w); check w > 1.0; }
pattern near(i : Item, j : Item) { Item.at(i, s); Item.at(j, s); }
pattern any(i : Item) { Item(i); }
pattern wants(m : Man, i : Item) { Man.wants(m, i); }
"""
LOOK = "observe count find size(_, _) up to 9\nobserve count find any(_) up to 9\n"

CORNERS = {
    "boxes are made": Yard(
        BORN
        + """
        rule grow { lhs { b : Box; check b.size < 6; } modify { set b.size += 1; } }
        """,
        "action born = born() reward 1 else reward -1\naction grow = grow() reward 0.5 else reward -0.5\n"
        "on find size(b, n) reward n * 0.01\non find sizes(n) reward n\n" + LOOK,
        SIZES,
    ),
    "any object of a class that rules do not change": Yard(
        BORN,
        "action born = born()\non find beside(k, b, _) reward 1\non find beside(k, _, _) reward 10\n" + LOOK,
        SIZES + "pattern beside(k : Kind, b : Box, m : Man) { k == Kind::ant; Box(b); Man(m); }",
    ),
    "items are made and dropped": Yard(
        MADE + DROP + GO,
        "action make(m : Man) = make(m, i) reward i.weight else reward -1\naction drop = drop() reward 0.25\n"
        "action go(way : Way) = go(adam, way)\n"
        "on find carried(m, i, k) reward k == ::mole ? 0.1 : 0.2\non find heavy(_, w) reward w\n"
        "on find near(i, j) reward i.weight * 3.0 - j.weight\n"
        "observe adam.at among Spot or none\nobserve find carried(adam, _, _)\n" + LOOK,
        SIZES,
    ),
    "those that come last go first": Yard(
        MADE
        + """
        @semantics(spo) rule pop { lhs { m == max Item.id(_, #); Item.id(i, m); i : Item; } modify { delete i; } }
        @semantics(spo) rule shift { lhs { m == min Item.id(_, #); Item.id(i, m); i : Item; } modify { delete i; } }
        rule wed { lhs { i : Item; j : Item; check i.id < j.id; neg Item.pair(i, _); neg Item.paired(j, _); }
            modify { create i -pair-> j; } }
        """,
        "action make(m : Man) = make(m, _)\naction pop = pop() reward 1\naction shift = shift() reward 2\n"
        "action wed = wed() reward 4\non find weds(i, j) reward j.id - i.id\nobserve find weds(_, _)\n" + LOOK,
        SIZES + "pattern weds(i : Item, j : Item) { Item.pair(i, j); }",
    ),
    "several at once, one inside the other": Yard(
        """
        rule twin(n : Kind) { lhs { y : Yard; s : Spot; most == max Item.id(_, #); }
            modify {
                create y -boxes-> b : Box; create b -item-> i : Heavy { id = most + 1, kind = n };
                create y -items-> j : Item { id = most + 2, at = s, pair = i };
            } }
        rule empty { lhs { y : Yard; b : Box -item-> i : Item; } modify { move i to y.items; } }
        rule wrap { lhs { y : Yard -items-> i : Item; check i.id > 3; }
            modify { create y -boxes-> b : Box { size = i.id }; move i to b.item; } }
        """
        + DROP,
        "action twin(k : Kind) = twin(k) reward 1\naction empty = empty() reward 0.5\n"
        "action wrap = wrap() reward 0.1\naction drop = drop()\n"
        "on find heavies(i) reward i.kind == ::ant ? 1 : 2\n" + LOOK,
        SIZES + "pattern heavies(i : Heavy) { Heavy(i); }",
    ),
    "new objects change their class": Yard(
        MADE
        + DROP
        + """
        rule heavier { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
        rule lighter { lhs { i : Heavy; } modify { retype i : Item; } }
        """,
        "action make(m : Man) = make(m, _) reward 1\naction heavier = heavier() reward 2\n"
        "action lighter = lighter() reward 4\naction drop = drop() reward 8\n"
        "observe count find heavies(_) up to 8\n" + LOOK,
        SIZES + "pattern heavies(i : Heavy) { Heavy(i); }",
    ),
    "what is made is wanted, and refused where there is no room": Yard(
        MADE
        + """
        rule want(m : Man) { lhs { m : Man; i : Item; } modify { set m.wants = i; } }
        rule kill { lhs { i : Item; } modify { delete i; } }
        rule sell { lhs { m : Man -bag-> i : Item; y : Yard; } modify { move i to y.items; } }
        """,
        "action make(m : Man) = make(m, i) reward i.id\naction want(m : Man) = want(m)\naction kill = kill()\n"
        "action sell = sell() reward 2\non find wanted(m, i) reward i.weight + m.power\n" + LOOK,
        SIZES + "pattern wanted(m : Man, i : Item) { Man.wants(m, i); }",
    ),
    "arrivals by chance, and each that waits may leave": Yard(
        MADE + "@semantics(spo) rule leave(i : Item) { lhs { i : Item; check i.id > 3; } modify { delete i; } }\n",
        "action wait = nothing()\neach step apply 0.4: make(adam, _) | 0.3: make(eve, _)\n"
        "on find late(i) reward -1 apply leave(i)\non reset apply make(adam, _)\n" + LOOK,
        SIZES + "pattern late(i : Item) { Item.id(i, n); check n > 6 && n % 2 == 0; }",
        "adam : Man, eve : Man",
    ),
    "links with many at both ends, of new objects": Yard(
        MADE + DROP + MANY,
        "action make(m : Man) = make(m, _)\naction drop = drop() reward 0.25\n" + LIKES + LOOK,
        SIZES + LIKED,
    ),
    "men and spots that are new": Yard(
        """
        rule dig { lhs { y : Yard; s : Spot; most == max Spot.x(_, #); neg Spot.east(s, _); }
            modify { create y -spots-> t : Spot { x = most + 1, west = s }; } }
        @semantics(spo) rule fill { lhs { s : Spot; neg Spot.east(s, _); check s.x > 2; } modify { delete s; } }
        rule visit { lhs { m : Man; s : Spot; check (s.x + m.hunger) % 2 == 1; } modify { create m -visited-> s; } }
        """,
        "action dig = dig() reward 1\naction fill = fill() reward 2\naction visit = visit()\n"
        "on find seen(m, s) reward m.hunger * 0.1 + s.x\n" + LOOK,
        SIZES + LIKED,
    ),
    "new spots are reached along closures": Yard(
        """
        rule dig { lhs { y : Yard; s : Spot; most == max Spot.x(_, #); neg Spot.east(s, _); }
            modify { create y -spots-> t : Pit { x = most + 1, kind = ::mole, west = s, tag = "new" }; } }
        rule mend { lhs { p : Pit; neg Spot.east(p, _); } modify { retype p : Spot; } }
        """,
        "action dig = dig() reward 1\naction mend = mend() reward 2\n"
        'on find end(s) reward s.x * 0.1\non find named(_, t) reward t == "new" ? 0.01 : 0.02\n' + LOOK,
        SIZES
        + "pattern next(a : Spot, b : Spot) { Spot.east(a, b); }\n"
        + "pattern end(s : Spot) { find next+(_, s); neg find next(s, _); }\n"
        + "pattern named(s : Spot, t : string) { Spot.tag(s, t); }",
    ),
}

OBSERVED = {
    f"objects with a key that a rule creates, {name}": Yard(
        MADE.replace("most + 1", "(m.hunger + most) % 8")
        + DROP
        + GO
        + """
        rule harden { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
        rule soften { lhs { i : Heavy; } modify { retype i : Item; } }
        rule want(m : Man, i : Item) { lhs { Man(m); Item(i); } modify { set m.wants = i; } }
        rule wish(m : Man) { lhs { m : Man; i : Item; } modify { set m.wants = i; } }
        rule sleep(m : Man) { lhs { check m.hunger < 6; } modify { set m.hunger += 1; } }
        """,
        "action make(m : Man) = make(m, i) reward i.id else reward -1\naction drop = drop() reward 0.25\n"
        "action harden = harden()\naction soften = soften()\naction sleep = sleep(adam)\n" + observed,
        SIZES,
        members=4,
    )
    for name, observed in (
        ("observed one by one", "observe i.kind for i : Item\nobserve h.id in 0..8 for h : Heavy"),
        (
            "among which one is observed",
            "observe adam.wants among Item or none\naction want(i : Item) = want(adam, i)\naction wish = wish(adam)",
        ),
        ("counted through", "action want(i : Heavy) = want(adam, i) reward i.id\nobserve find wants(_, _)"),
    )
}

CORNERS |= OBSERVED | {
    "men with the names of others, or without": Yard(
        """
        @semantics(spo) rule leave(m : Man) { lhs { Man(m); } modify { delete m; } }
        rule come(m : Man) { lhs { y : Yard; Man.name(m, n); } modify { create y -men-> o : Man { name = n }; } }
        rule eve { lhs { y : Yard; } modify { create y -men-> o : Man { name = "eve", hunger = 2 }; } }
        rule nobody { lhs { y : Yard; } modify { create y -men-> o : Man { hunger = 4 }; } }
        """,
        """
        action leave(m : Man) = leave(m) reward 1 else reward -1
        action come(m : Man) = come(m)
        action eve = eve()
        action nobody = nobody()
        observe m.kind for m : Man
        observe m.hunger in 1..4 for m : Man
        observe count find men(_) up to 9
        """,
        "pattern men(m : Man) { Man(m); }",
        head="",
    ),
    "boxes are made and observed one by one": Yard(
        BORN
        + """
        rule lid(b : Box) { lhs { Box(b); } modify { create b -lid-> c : Box { size = 5 }; } }
        @semantics(spo) rule burn(b : Box) { lhs { Box(b); } modify { delete b; } }
        """,
        """
        action born = born()
        action burn(b : Box) = burn(b) reward 1 else reward -1
        action lid(b : Box) = 0.5: lid(b)
        observe b.size in 0..6 for b : Box
        observe b.under among Box or none for b : Box
        observe count find size(_, _) up to 9
        """,
        SIZES,
        members=4,
    ),
}
