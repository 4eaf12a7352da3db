"""Observations of floats, and of patterns for each object of a class."""

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
    "floats of agents that take turns": Yard(
        RULES,
        CLAUSES
        + """
        agent m : Man {
            action tire = tire(m)
            action walk = walk(m)
            observe m.power in -1.5..2.5
            observe find near(m, s) for s : Spot
            observe i.weight in 0.0..9.0 for i : Item if find big(i)
        }
        agent h : Heavy {
            action fatten = grow(h)
            observe h.weight in -1.5..2.5
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
        }
        each step apply 0.5: dim()
        observe s.f in 0.0..0.5 for s : Spot
        observe find lies(s, _) for s : Spot
        """,
        PATTERNS,
    ),
}
