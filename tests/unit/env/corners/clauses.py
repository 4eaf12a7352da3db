"""Clauses of behaviours: branches, chance, rewards, ends, blocks of agents."""

from __future__ import annotations

from tests.unit.env.corners.yard import MODEL, Yard

CORNERS = {
    "a clause without names holds once": Yard(
        "rule weigh { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }\n"
        "rule light { lhs { h : Heavy; } modify { retype h : Item; } }",
        """
        action weigh = weigh()
        action light = light()
        on find both(_, _) reward 0.1
        on find both(s0, _) reward 0.01
        on find both(_, _) apply 0.5: light()
        """,
        "pattern both(s : Spot, h : Heavy) { Spot(s); Heavy(h); }",
        head="s0 : Spot",
    ),
    "branches that do not add up to 1": Yard(
        """
        rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); }
            modify { set m.at = there; } }
        rule jump(m : Man) { lhs { s : Spot; neg Man.at(m, s); } modify { set m.at = s; } }
        rule light { lhs { s : Spot; check !s.lit; } modify { set s.lit = true; } }
        rule dark { lhs { s : Spot; check s.lit; } modify { set s.lit = false; } }
        rule start(m : Man) { lhs { s : Spot; } modify { set m.at = s; } }
        rule fill { lhs { s : Spot; i : Item; } modify { set i.at = s; } }
        """,
        """
        action walk(m : Man, way : Way) = 0.6: walk(m, way) | 0.1: jump(m) | 0.1: nothing() reward 1 else reward -1
        action third = 0.3: light() | 0.3: dark() | 0.4: jump(adam) reward 2
        action tenth = 0.1: light() | 0.1: dark() | 0.1: light() | 0.1: dark() | 0.1: light()
            | 0.1: dark() | 0.1: light() | 0.1: dark() | 0.1: light() | 0.1: nothing() reward 2
        each step reward -0.01 apply 0.2: light() | 0.7: jump(adam)
        each step apply dark()
        each step apply 0.05: nothing()
        on reset apply start(adam)
        on reset apply fill()
        on reset apply fill()
        on find lit(s) reward s.f apply dark()
        observe m.at among Spot or none for m : Man
        observe s.lit for s : Spot
        observe i.at among Spot or none for i : Item
        """,
        "pattern lit(s : Spot) { Spot.lit(s, true); Spot.men(s, _); }",
    ),
    "a chance for each match": Yard(
        """
        rule light(s : Spot) { lhs { s : Spot; check !s.lit; } modify { set s.lit = true; } }
        rule dark(s : Spot) { lhs { s : Spot; } modify { set s.lit = false; } }
        rule spread(s : Spot, out n : int) { lhs { t : Spot; check !t.lit; Spot.n(t, n); }
            modify { set t.lit = true; } }
        rule away(m : Man) { lhs { s : Spot; neg Man.at(m, s); } modify { set m.at = s; } }
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        """,
        """
        action light(s : Spot) = 0.8: light(s)
        action rest = nothing()
        on find unlit(s) apply 0.1: light(s)
        on find lit(s) reward 1 apply 0.2: dark(s) | 0.3: spread(s, _) | 0.1: nothing()
        on find near(i, j) apply 0.05: kill(i) | 0.05: kill(j)
        on neg find lit(_) apply 0.5: away(adam)
        observe adam.at among Spot or none
        observe s.lit for s : Spot
        observe count find item(_) up to 5
        """,
        """
        pattern lit(s : Spot) { Spot.lit(s, true); }
        pattern unlit(s : Spot) { Spot.lit(s, false); }
        pattern item(i : Item) { Item(i); }
        pattern near(i : Item, j : Item) { Item(i); Item(j); i != j; }
        """,
    ),
    "probabilities that the state has": Yard(
        """
        rule light(s : Spot) { lhs { s : Spot; } modify { set s.lit = true; set s.f = s.f * 0.5; } }
        rule dark(s : Spot) { lhs { s : Spot; } modify { set s.lit = false; set s.f = 0.5; } }
        rule walk(m : Man, s : Spot) { lhs { s : Spot; m : Man; } modify { set m.at = s; set m.power = 0.75; } }
        rule tire(m : Man) { lhs { check m.power > 0.1; } modify { set m.power -= 0.25; } }
        rule madden(m : Man) { lhs { m : Man; } modify { set m.power = m.power * 2.0; } }
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule grow(i : Item) { lhs { i : Item; } modify { set i.weight = 0.25; } }
        """,
        """
        action walk(s : Spot) = s.f: walk(adam, s) | 0.25: nothing() reward s.f else reward -1
        action light(s : Spot) = (adam.at.f / 2.0): light(s) | (s.lit ? 0.1 : 0.2): dark(s)
        action tire = (adam.power <= 1.0 ? adam.power : 1.0): tire(adam)
        action madden = adam.power: madden(adam)
        action kill(i : Item) = i.weight: kill(i) | 0.125: grow(i) reward 1 else reward -0.5
        each step apply adam.at.f: light(adam.at) | (0.5 - adam.at.f): dark(adam.at)
        on find lit(s) reward 1 apply s.f: dark(s) | s.f: light(s)
        on reset apply (adam.power - 1.0): walk(adam, adam.at) | adam.at.f: light(adam.at)
        observe adam.at among Spot or none
        observe s.lit for s : Spot
        observe count find item(_) up to 5
        """,
        "pattern lit(s : Spot) { Spot.lit(s, true); } pattern item(i : Item) { Item(i); }",
    ),
    "matches that each other's `apply` takes away": Yard(
        """
        rule eat(i : Item) { lhs { i : Item -pair-> j : Item; }
            modify { delete i -pair-> j; set i.pair = none; set i.weight += 1.0; } }
        rule mate(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; check i.weight > 3.0; } modify { delete i; } }
        rule steal(s : Spot, t : Spot) { lhs { s -men-> m : Man; t : Spot; } modify { set m.at = t; } }
        rule light(s : Spot) { lhs { s : Spot; } modify { set s.lit = true; } }
        rule dark { lhs { s : Spot -men-> m : Man; } modify { set s.lit = false; } }
        """,
        """
        action mate(i : Item, j : Item) = mate(i, j)
        action steal(s : Spot, t : Spot) = steal(s, t)
        on find pairs(i, j) reward j.weight apply eat(i)
        on find pairs(i, j) reward i.weight * 0.1 apply mate(j, i)
        on find pairs(i, j) apply kill(j)
        on find full(s) apply steal(s, adam.at)
        on neg find lit(_) apply light(adam.at)
        on neg find full(_) reward 0.3 apply dark()
        on find full(s) reward 0.4 terminate success
        on neg find pairs(_, _) reward 0.4 terminate failure
        observe i.pair among Item or none for i : Item
        observe s.lit for s : Spot
        """,
        """
        pattern pairs(i : Item, j : Item) { Item.pair(i, j); }
        pattern full(s : Spot) { n == count Spot.men(s, _); check(n > 1); Spot(s); }
        pattern lit(s : Spot) { Spot.lit(s, true); }
        """,
    ),
    "two clauses and the order of rewards": Yard(
        """
        rule up(s : Spot) { lhs { s : Spot; } modify { set s.f = s.f * 1.1 + 0.1; } }
        """,
        """
        on find spots(s) reward s.f
        each step reward 0.1
        action up(s : Spot) = up(s) reward 1e16
        on find spots(s) reward 0.1 + s.f
        each step reward -1e16
        action down = nothing() reward 0.3
        on find spots(s) reward s.f * 3
        """,
        "pattern spots(s : Spot) { Spot(s); }",
    ),
    "success and failure at once": Yard(
        """
        rule up(s : Spot) { lhs { s : Spot; } modify { set s.n += 1; } }
        rule wild(s : Spot) { lhs { s : Spot; } modify { set s.n += 10; } }
        """,
        """
        action up(s : Spot) = up(s)
        on find over(s, 3) terminate success reward 1 apply wild(s)
        on find over(s, 2) terminate failure
        on find over(_, n) reward n
        on find over(s0, _) reward 0.125
        observe find over(s0, _)
        observe find over(_, 4)
        observe s.n in -1..3 for s : Spot
        limit 13 steps
        """,
        "pattern over(s : Spot, n : int) { Spot.n(s, n); check(n > 0); }",
        head="s0 : Spot",
    ),
    "agents with blocks of their own": Yard(
        """
        rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); }
            modify { set m.at = there; } }
        rule light(s : Spot) { lhs { s : Spot; } modify { set s.lit = true; } }
        rule dark { lhs { s : Spot; } modify { set s.lit = false; } }
        rule grow(b : Box) { lhs { b : Box; check b.size < 4; } modify { set b.size += 1; } }
        rule land(m : Man) { lhs { s : Spot; } modify { set m.at = s; } }
        """,
        """
        action rest = nothing() reward 0.5
        agent man : Man {
            action walk(way : Way) = walk(man, way) reward man.hunger else reward -0.1
            action both = land(man) reward 3
            action take(s : Spot) = light(s)
            each step reward man.power * 0.1
            on find here(man) reward -1.0
            on find far(man, x) reward x.n
            observe man.at among Spot or none
            observe find here(man)
            observe man.kind
        }
        action dark = 0.5: dark()
        agent box : Box {
            action grow = grow(box) reward box.size
            action both = grow(box) reward 4
            observe box.size in 0..3
            on neg find big(box) reward 0.7
        }
        each step reward -0.01 apply 0.2: dark()
        on find here(_) reward 0.25
        observe s.lit for s : Spot
        observe count find here(_) up to 2
        """,
        """
        pattern here(m : Man) { Man.at(m, s); Spot.lit(s, true); }
        pattern far(m : Man, s : Spot) { Man.at(m, t); Spot.east+(t, s); neg Spot.men(s, _); }
        pattern big(b : Box) { Box.size(b, n); check(n > 2); }
        """,
        head="",
    ),
    "a block whose agents some members lack": Yard(
        """
        rule up(s : Spot) { lhs { s : Spot; check s.n < 4; } modify { set s.n += 1; } }
        rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); }
            modify { set m.at = there; } }
        rule dug { lhs { s : Spot; neg Pit(s); check s.x > 0; } modify { retype s : Pit; } }
        """,
        """
        agent p : Pit {
            action up = up(p) reward p.n else reward -0.5
            action rest = nothing() reward 0.25
            on find deep(p) reward 2
            observe p.n in 0..4
            observe p.kind
        }
        agent m : Man {
            action walk(way : Way) = walk(m, way) reward 0.1
            action rest = nothing()
            observe m.at among Spot or none
        }
        each step reward -0.01
        on find deep(_) reward 0.5
        """,
        "pattern deep(s : Spot) { Spot.n(s, n); check(n > 2); }",
        head="",
        model=MODEL.replace("s2 : Pit", "s2 : Spot"),
        members=4,
    ),
    "agents that go, or change their class": Yard(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule harden(i : Item) { lhs { i : Item; } modify { retype i : Heavy; } }
        rule soften { lhs { i : Heavy; } modify { retype i : Item; } }
        @semantics(spo) rule rob(m : Man) { lhs { m : Man -bag-> i : Item; } modify { delete i; } }
        """,
        """
        action soften = soften() reward 1
        agent h : Heavy {
            action kill = 0.5: kill(h) reward h.id else reward -1
            action rest = nothing() reward 0.5
            on find light(h) reward 2
            on neg find light(h) reward 0.1
            each step apply 0.1: kill(h)
            observe h.kind
            observe find light(h)
        }
        agent m : Man { action rob = rob(m) reward 4 observe m.hunger in 0..4 }
        action harden(i : Item) = harden(i)
        each step apply 0.2: soften()
        on find light(i) reward i.weight
        """,
        "pattern light(i : Item) { Item.weight(i, w); check(w < 1.0); }",
        head="",
    ),
} | {
    f"agents all of which may go, {how}": Yard(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; check i.weight > 2.0; } modify { delete i; } }
        rule soften(i : Item) { lhs { Heavy(i); } modify { retype i : Item; } }
        rule harden(i : Item) { lhs { Item(i); neg Heavy(i); check i.weight > 2.0; } modify { retype i : Heavy; } }
        rule grow(i : Item) { lhs { check i.weight < 5.0; } modify { set i.weight += 1.0; } }
        unit more(i : Item) { grow(i); try { grow(i); } }
        """,
        f"""
        {together}
        agent h : Heavy {{
            action soften = soften(h) reward 2 else reward -2
            action grow = grow(h) reward 1 else reward -1
            action more = more(h) reward h.weight else reward -3
            action weigh = (0.1 * h.weight): kill(h)
            on find heavy(h) reward 0.5
            observe h.kind
            observe h.id in 0..4
        }}
        action harden(i : Item) = harden(i)
        each step apply 0.05: kill(i1)
        on find heavy(i) reward i.weight
        observe count find heavy(_) up to 3
        """,
        "pattern heavy(i : Item) { Item.weight(i, w); check(w > 2.0); }",
        head="i1 : Item",
        model=MODEL.replace("i2 : Item {", "i2 : Heavy { weight = 2.25"),
        members=members,
    )
    for how, together, members in (("which take turns", "", 3), ("which act together", "agents together", 1))
}
