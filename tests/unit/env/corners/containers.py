"""Containers: what is put into them, and goes with them."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

CORNERS = {
    "things that are in one container, and in another": Yard(
        """
        rule put { lhs { b : Box; i : Item; } modify { create b -item-> i; } }
        rule keep(m : Man) { lhs { m : Man; i : Item; } modify { create m -bag-> i; } }
        rule lose { lhs { m : Man -bag-> i : Item; } modify { delete m -bag-> i; } }
        """,
        """
        action put = put() reward 1
        action keep(m : Man) = keep(m) reward 2
        action lose = lose() reward 4
        observe count find kept(_, _) up to 9
        """,
        "pattern kept(m : Man, i : Item) { Man.bag(m, i); }",
    ),
    "containers that are set": Yard(
        """
        rule put(i : Item) { lhs { b : Box; i : Item; check b.size < 5; } modify { set b.item = i; } }
        rule empty { lhs { b : Box; } modify { set b.item = none; set b.size += 1; } }
        rule take { lhs { b : Box; m : Man; } modify { set b.item = m.wants; } }
        rule bag { lhs { m : Man; i : Item; } modify { create m -bag-> i; } }
        rule inside { lhs { b : Box; c : Box; } modify { set c.outer = b; } }
        rule out { lhs { b : Box; } modify { set b.outer = none; } }
        rule crate { lhs { b : Box; c : Box; check b.size > 1; } modify { set c.lid = b; } }
        rule lid { lhs { b : Box; c : Box; } modify { set c.under = b.outer; } }
        rule want(m : Man) { lhs { m : Man; i : Item; } modify { set m.wants = i; } }
        """,
        """
        action put(i : Item) = put(i) reward 1
        action empty = empty() reward 2
        action take = take() reward 3
        action bag = 0.2: bag() reward 4
        action inside = inside() reward 5
        action out = out() reward 6
        action crate = crate() reward 7
        action lid = lid() reward 8
        action want(m : Man) = want(m)
        on find within(_, c) reward c.size * 0.1
        on find packed(i) reward i.weight
        on find over(_, c) reward c.size
        observe count find within(_, _) up to 9
        observe count find packed(_) up to 5
        """,
        """
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        pattern packed(i : Item) { Box.item(_, i); }
        pattern over(b : Box, c : Box) { Box.lid(b, c); }
        """,
        head="",
    ),
    "containers that go with what they contain": Yard(
        """
        rule smash { lhs { b : Box; } modify { delete b; } }
        @semantics(spo) rule burn { lhs { b : Box; check b.size > 1; } modify { delete b; } }
        rule pack { lhs { b : Box; i : Item; neg Box.item(b, _); } modify { move i to b.item; } }
        rule nest { lhs { b : Box; c : Box; } modify { move c to b.inner; } }
        rule inside { lhs { b : Box -item-> i : Item; c : Box; } modify { delete b; set c.size += 1; } }
        @semantics(spo) rule rob { lhs { b : Box -item-> i : Item; } modify { delete b; set i.weight = 2.0; } }
        rule out { lhs { b : Box -inner-> c : Box; y : Yard; } modify { move c to y.boxes; } }
        rule like { lhs { b : Box; s : Spot; neg Box.likes(b, s); } modify { create b -likes-> s; } }
        @semantics(spo) rule sweep { lhs { y : Yard; }
            forall { lhs { b : Box; check b.size > 2; } modify { delete b; } } modify { } }
        @semantics(spo) rule kill(m : Man) { lhs { m : Man; check m.hunger < 3; } modify { delete m; } }
        rule both { lhs { b : Box; i : Item; } modify { delete i; delete b; } }
        rule two { lhs { b : Box; c : Box; } modify { delete b; delete c; } }
        rule wrap { lhs { y : Yard; b : Box; }
            modify { create y -boxes-> c : Box { size = 1 }; move b to c.inner; } }
        """,
        """
        action smash = 0.3: smash() reward 1
        action burn = 0.3: burn() reward 2
        action pack = pack() reward 3
        action nest = nest() reward 4
        action inside = 0.3: inside() reward 5
        action rob = 0.3: rob() reward 6
        action out = out() reward 7
        action like = 0.3: like() reward 8
        action sweep = 0.2: sweep() reward 9
        action kill(m : Man) = 0.1: kill(m)
        action wrap = wrap() reward 0.5
        action both = 0.1: both() | 0.1: two() reward 11
        on find within(_, c) reward c.size * 0.1
        on find packed(i) reward i.weight
        observe count find within(_, _) up to 9
        observe count find packed(_) up to 5
        """,
        """
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        pattern packed(i : Item) { Box.item(_, i); }
        """,
        head="",
    ),
    "containers that are set, among other changes": Yard(
        """
        rule fill { lhs { b : Box; i : Item; } modify { set b.item = i; set i.pair = i; } }
        rule swap { lhs { b : Box -item-> i : Item; c : Box; m : Man; }
            modify { set b.item = m.wants; set c.item = i; set m.wants = i; } }
        rule nest { lhs { b : Box; c : Box; d : Box; } modify { set b.inner = [c, d]; } }
        rule turn { lhs { b : Box -inner-> c : Box; d : Box; } modify { set c.inner = b; set d.inner = c; } }
        rule more { lhs { b : Box; c : Box; d : Box; } modify { set b.inner += c; set d.inner -= c; } }
        rule less { lhs { b : Box -inner-> c : Box; } modify { set b.inner -= c; set b.size += 1; } }
        rule only { lhs { b : Box; m : Man; } modify { set b.inner = none; set m.bag = b.item; } }
        rule pack(m : Man) { lhs { m : Man; i : Item; j : Item; } modify { set m.bag = [i, j]; } }
        rule add(m : Man) { lhs { m : Man; i : Item; } modify { set m.bag += i; set i.at = m.at; } }
        rule wrap { lhs { y : Yard; c : Box; n == count Box(_); check n < 6; }
            modify { create y -boxes-> b : Box; set b.inner += c; set c.lid = none; } }
        rule under { lhs { b : Box; c : Box; d : Box; } modify { set b.under = c; set c.under = d; } }
        rule ring { lhs { b : Box; c : Box; d : Box; } modify { set b.outer = c; set c.outer = d; set d.outer = b; } }
        rule gather { lhs { b : Box; }
            forall { lhs { c : Box; check c.size < 2; b != c; } modify { set b.inner += c; } } modify { } }
        rule lids { lhs { y : Yard; }
            forall { lhs { b : Box; c : Box; check b.size < c.size; } modify { set c.lid = b; } } modify { } }
        @match(homomorphic) rule same { lhs { b : Box; c : Box; d : Box; } modify { set b.lid = c; set d.inner += b; } }
        rule clear { lhs { y : Yard; } forall { lhs { b : Box; } modify { set b.inner = none; } }
            forall { lhs { i : Item; check i.id < 2; } modify { move i to y.items; } } modify { } }
        @semantics(spo) rule smash { lhs { b : Box; c : Box; check b.size > 1; }
            modify { set c.inner = b.lid; delete b; } }
        """,
        """
        action fill = fill() reward 1 else reward -1
        action swap = swap() reward 2 else reward -2
        action nest = nest() reward 3 else reward -3
        action turn = turn() reward 4 else reward -4
        action more = more() reward 5 else reward -5
        action less = less() reward 6 else reward -6
        action only = only() reward 7 else reward -7
        action pack(m : Man) = pack(m) reward 8 else reward -8
        action add(m : Man) = add(m) reward 9 else reward -9
        action wrap = wrap() reward 10 else reward -10
        action under = under() reward 11 else reward -11
        action ring = ring() reward 12 else reward -12
        action gather = gather() reward 13 else reward -13
        action lids = 0.3: lids() reward 14 else reward -14
        action same = same() reward 15 else reward -15
        action clear = 0.2: clear()
        action smash = 0.1: smash()
        on find within(_, c) reward c.size * 0.1
        on find packed(i) reward i.weight
        on find over(_, c) reward c.size
        on find bagged(m, i) reward i.id
        observe count find within(_, _) up to 9
        observe count find packed(_) up to 5
        """,
        """
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        pattern packed(i : Item) { Box.item(_, i); }
        pattern over(b : Box, c : Box) { Box.lid(b, c); }
        pattern bagged(m : Man, i : Item) { Man.bag(m, i); }
        """,
        head="",
    ),
    "moves between containers": Yard(
        """
        rule grab(m : Man) { lhs { m -at-> s : Spot <-at- i : Item; } modify { set i.at = none; move i to m.bag; } }
        rule drop(m : Man) {
            lhs { y : Yard; m -at-> s : Spot; m -bag-> i : Item; }
            modify { move i to y.items; set i.at = s; }
        }
        rule pack(m : Man) { lhs { m -bag-> i : Item; b : Box; neg Box.item(b, _); } modify { move i to b.item; } }
        rule swap { lhs { b : Box -item-> i : Item; m : Man -bag-> j : Item; }
            modify { move i to m.bag; move j to b.item; } }
        rule again(m : Man) { lhs { m -bag-> i : Item; } modify { move i to m.bag; } }
        """,
        """
        action grab(m : Man) = grab(m) reward 1 else reward -1
        action drop(m : Man) = drop(m) reward 1 else reward -1
        action pack(m : Man) = pack(m) reward 1 else reward -1
        action swap = swap() reward 3
        action again(m : Man) = again(m) reward 3
        on find loaded(m, n) reward n * 0.1 + m.hunger
        on find boxed(b, i) reward i.weight * b.size
        observe count find held(_) up to 5
        """,
        """
        pattern loaded(m : Man, n : int) { Man(m); n == count Man.bag(m, _); }
        pattern boxed(b : Box, i : Item) { Box.item(b, i); }
        pattern held(i : Item) { Man.bag(_, i); }
        """,
    ),
}

CORNERS["blocks that delete containers and contents"] = Yard(
    """
    rule both { lhs { y : Yard; }
        forall { lhs { b : Box -item-> i : Item; check i.id > 2; } modify { delete b; delete i; } } modify { } }
    rule apart { lhs { y : Yard; }
        forall { lhs { i : Item; neg Item.at(i, _); check i.id > 2; } modify { delete i; } }
        forall { lhs { b : Box; check b.size < 3; } modify { delete b; } } modify { } }
    rule deep { lhs { y : Yard; }
        forall { lhs { b : Box; check b.size == 2; }
            forall { lhs { b -inner-> c : Box; } modify { delete c; set b.size += 1; } }
            forall { lhs { m : Man; m -bag-> i : Item; } modify { set i.weight += 0.1; delete b; } }
            modify { } }
        modify { } }
    rule kept { lhs { i : Item; }
        forall { lhs { b : Box; check b.size > 1; } modify { delete b; } }
        modify { set i.weight = 2.0; } }
    @semantics(spo) rule spare { lhs { y : Yard; }
        forall { lhs { b : Box; check b.size > 1; } modify { delete b; } }
        forall { lhs { i : Item; check i.id > 1; } modify { set i.weight = i.id * 1.5; } }
        modify { } }
    @semantics(spo) rule point { lhs { m : Man; n : Man; }
        forall { lhs { b : Box; check b.size == 1; } modify { delete b; } }
        modify { set m.wants = n.wants; } }
    @semantics(spo) rule lead { lhs { c : Box; n : Man; }
        forall { lhs { b : Box; check b.size == 1; } modify { delete b; } }
        forall { lhs { m : Man; check m.hunger > 2; } modify { set m.wants = n.wants; } }
        modify { set c.size += 1; } }
    rule want(m : Man) { lhs { m : Man; b : Box -item-> i : Item; } modify { set m.wants = i; } }
    rule pack { lhs { b : Box; i : Item; neg Box.item(b, _); } modify { move i to b.item; } }
    rule nest { lhs { b : Box; c : Box; } modify { move c to b.inner; set b.size = 2; } }
    rule make { lhs { y : Yard; n == count Box(_); check n < 6; most == max Item.id(_, #); }
        modify { create y -boxes-> b : Box { size = 1 }; create b -item-> i : Item { id = most + 1 }; } }
    rule like { lhs { m : Man -wants-> i : Item; } modify { set m.wants = none; } }
    unit some { both | apart | point; }
    """,
    """
    action both = 0.3: both() reward 1
    action apart = 0.3: apart() reward 2
    action deep = 0.3: deep() reward 3
    action kept = 0.3: kept() reward 4
    action spare = 0.2: spare() reward 5
    action point = 0.3: point() reward 6
    action lead = 0.3: lead() reward 7
    action pack = pack() reward 8
    action nest = nest() reward 9
    action make = make() reward 10
    action like = like() reward 11
    action want(m : Man) = want(m)
    action some = 0.3: some() reward 12
    on find within(_, c) reward c.size * 0.1
    on find packed(i) reward i.weight
    observe count find within(_, _) up to 9
    observe count find packed(_) up to 5
    """,
    """
    pattern within(b : Box, c : Box) { Box.inner(b, c); }
    pattern packed(i : Item) { Box.item(_, i); }
    """,
    head="",
    spare=60,
)

REFUSED: dict[str, Yard] = {}
