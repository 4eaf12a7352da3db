"""Observations of floats, of values of queries, and of patterns for each object of a class or literal of an enum."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

RULES = """
rule tire(m : Man) { lhs { m : Man; } modify { set m.power = m.power * -0.7 + 0.1; } }
rule grow(i : Item) { lhs { i : Item; check i.weight < 400.0; } modify { set i.weight = i.weight * 1.7; } }
rule dim { lhs { s : Spot; } modify { set s.f = s.f / 3.0; set s.lit = !s.lit; } }
rule put(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
rule walk(m : Man) { lhs { m : Man; Man.at(m, a); Spot.east(a, b); } modify { set m.at = b; } }
rule harden { lhs { Item(i); neg Heavy(i); } modify { retype i : Heavy; } }
@semantics(spo) rule lose(i : Item) { lhs { i : Item; check i.weight > 3.0; } modify { delete i; } }
"""
PATTERNS = """
pattern lies(s : Spot, i : Item) { Item.at(i, s); }
pattern near(m : Man, s : Spot) { Man.at(m, s); } or { Man.at(m, a); Spot.east(a, s); }
pattern big(i : Item) { Item.weight(i, w); check(w > 1.0); }
pattern load(s : Spot, i : Item, w : float) { Item.at(i, s); Item.weight(i, w); }
pattern label(s : Spot, n : int) { Item.at(i, s); Item.id(i, n); }
pattern gap(m : Man, s : Spot, n : int) { Man.at(m, a); n == eval(abs(a.x - s.x)); Spot(s); }
pattern open(s : Spot, in way : Way) { find step(s, way, t); Spot.lit(t, false); }
pattern looks(i : Item, kind : Kind, s : Spot) { Item.kind(i, kind); Item.at(i, s); }
"""
CLAUSES = """
action put(i : Item, s : Spot) = put(i, s)
action dim = dim()
action grow(i : Item) = 0.7: grow(i) | 0.2: lose(i) reward 1
action harden = harden()
"""

CORNERS = {
    "floats, and patterns for each object": Yard(
        RULES,
        CLAUSES
        + """
        action walk = walk(adam)
        action tire = tire(adam)
        observe adam.power in -1.5..1.5
        observe adam.at.f in 0..1
        observe i.weight in 0.25..100.5 for i : Item
        observe s.f in 0.1..0.6 for s : Spot if find near(adam, s)
        observe find lies(s, _) for s : Spot
        observe count find lies(s, _) up to 2 for s : Spot if find near(adam, s)
        observe find lies(s, _) for s : Spot if find near(_, s)
        observe find big(h) for h : Heavy
        observe find near(adam, _) if find lies(_, i0)
        observe s.lit for s : Spot
        """,
        PATTERNS,
        head="adam : Man, i0 : Item",
    ),
    "values of queries, ints as numbers, and literals": Yard(
        RULES,
        CLAUSES
        + """
        action walk = walk(adam)
        observe sum find load(_, _, #) in 0.25..30.0
        observe avg find load(s, _, #) in -1.0..9.0 for s : Spot if find near(adam, s)
        observe max find load(s, i, #) in 1..9.5 for i : Item
        observe sum find label(s, #) in 1..5 for s : Spot
        observe min find label(_, #) in -1..9 if find near(adam, _)
        observe max find label(s, #) in -1..2 for s : Spot if find near(_, s)
        observe avg find label(_, #) in 0.0..4.0
        observe max find gap(adam, s, #) in 1..2 for s : Spot
        observe sum find gap(adam, _, #) in -2.5..8.0
        observe sum find gap(_, _, #) in 0..1000
        observe adam.hunger in 0.0..2.5
        observe i.id in 0..3.0 for i : Item if find big(i)
        observe find open(s, way) for s : Spot, way : Way
        observe find step(_, way, _) for way : Way if find open(s0, way)
        observe count find looks(_, kind, _) up to 2 for kind : Kind
        """,
        PATTERNS,
        head="adam : Man, s0 : Spot",
    ),
    "floats of agents that take turns": Yard(
        RULES,
        CLAUSES
        + """
        agent m : Man {
            action tire = tire(m)
            action walk = walk(m)
            observe m.power in -1.5..2.5
            observe sum find gap(m, _, #) in 0.5..6
            observe find near(m, s) for s : Spot
            observe i.weight in 0.0..9.0 for i : Item if find big(i)
        }
        agent h : Heavy {
            action fatten = grow(h)
            observe h.weight in -1.5..2.5
            observe max find load(_, h, #) in 0.5..6
            observe find lies(s, h) for s : Spot
        }
        """,
        PATTERNS,
    ),
    "floats of agents that act together": Yard(
        RULES,
        """
        agents together
        agent m : Man {
            action tire = tire(m)
            action walk = walk(m)
            observe m.power in -1.5..2.5 if find near(m, _)
            observe count find near(m, s) up to 1 for s : Spot
            observe min find gap(m, s, #) in 0.0..2.0 for s : Spot if find near(m, s)
            observe find open(s, way) for way : Way, s : Spot if find near(m, s)
        }
        agent p : Pit {
            action dim = dim()
            observe p.lit
            observe p.f in 0.0..2.0
        }
        each step apply 0.5: dim()
        observe s.f in 0.0..0.5 for s : Spot
        observe find lies(s, _) for s : Spot
        """,
        PATTERNS,
    ),
}
