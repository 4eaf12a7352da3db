"""Windows: `observe around`, with cells that change, move, come and go, and objects on them."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

RULES = """
rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); } modify { set m.at = there; } }
rule off(m : Man) { lhs { m -at-> s : Spot; } modify { set m.at = none; } }
rule jump(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { set m.at = s; } }
rule put { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
rule flip { lhs { s : Spot; } modify { set s.lit = !s.lit; } }
rule sink { lhs { s : Spot; } modify { retype s : Pit; } }
rule gain { lhs { i : Item; } modify { retype i : Heavy; } }
"""
MOVED = """
rule lift { lhs { s : Spot; check s.n < 2; } modify { set s.n += 1; } }
rule lower { lhs { s : Spot; check s.n > -1; } modify { set s.n -= 1; } }
@semantics(spo) rule dig { lhs { s : Spot; check s.x > 1; } modify { delete s; } }
rule grow { lhs { y : Yard; last == max Spot.x(_, #); check last < 5; }
    modify { create y -spots-> t : Spot { x = last + 1, n = 1 }; } }
"""
DEATH = """
@semantics(spo) rule die(m : Man) { lhs { m : Man; } modify { delete m; } }
@semantics(spo) rule lose { lhs { i : Item; } modify { delete i; } }
"""
ACTIONS = """
action walk(way : Way) = walk(adam, way)
action off = off(adam)
action jump(s : Spot) = jump(adam, s)
action put = put()
action flip = 0.5: flip() | 0.2: sink() | 0.2: gain()
"""
GRID = "draw grid Spot at (x, n) with i : Item at i.at, m : Man at m.at"

CORNERS = {
    "a window around a man": Yard(
        RULES,
        f"{ACTIONS} observe adam.hunger in 2..3 observe around adam 3 x 3 observe find step(_, _, _) {GRID}",
    ),
    "cells of a window that move, come and go": Yard(
        RULES + MOVED,
        f"{ACTIONS} action move = 0.4: lift() | 0.3: lower() | 0.1: dig() | 0.2: grow()\n"
        f"observe around adam 3 x 3 {GRID}",
    ),
    "a window with cells out of sight": Yard(
        RULES + MOVED + DEATH,
        f"{ACTIONS} action move = 0.4: lift() | 0.2: dig() | 0.1: die(eve) | 0.1: lose() | 0.1: die(adam)\n"
        f'observe around adam 3 x 3 if find sees(adam, cell, eve) {GRID}, eve as "E" at eve.at',
        """
        pattern sees(m : Man, s : Spot, other : Man) { Man.at(m, s); Man(other); } or {
            Man.at(m, here); find step(here, _, s); Man.at(other, _); Spot.lit(s, false); }
        """,
        head="adam : Man, eve : Man",
    ),
    "a window beside floats, patterns for each object, and refusals": Yard(
        RULES + DEATH,
        f"""{ACTIONS} action lose = 0.5: lose() | 0.1: die(eve)
        on refused reward -0.5
        observe around adam 3 x 3 if find near(adam, spot)
        observe s.f in 0.0..0.6 for s : Spot if find near(adam, s)
        observe find lies(s, _) for s : Spot if find near(adam, s)
        observe count find lies(_, _) up to 2 if find near(eve, _)
        observe around eve 1 x 3 {GRID}""",
        """
        pattern lies(s : Spot, i : Item) { Item.at(i, s); }
        pattern near(m : Man, s : Spot) { Man.at(m, s); } or { Man.at(m, a); find step(a, _, s); }
        """,
        head="adam : Man, eve : Man",
    ),
    "windows around a cell and around a pit": Yard(
        RULES,
        f"{ACTIONS} observe around s1 3 x 1 observe around i0 1 x 5 {GRID}, i0 at i0.at",
        head="adam : Man, s1 : Spot, i0 : Item",
    ),
    "windows of agents that take turns": Yard(
        RULES + DEATH,
        """
        action flip = flip()
        agent m : Man {
            action walk(way : Way) = walk(m, way)
            action off = off(m)
            action die = 0.3: die(m)
            observe around m 3 x 1 if find step(_, _, spot)
        }
        observe around i0 3 x 1
        """
        + GRID,
        head="i0 : Item",
    ),
    "windows of agents that act together": Yard(
        RULES + DEATH,
        """
        agents together
        agent m : Man {
            action walk(way : Way) = walk(m, way)
            action jump(s : Spot) = jump(m, s)
            action die = 0.3: die(m)
            observe around m 3 x 1
        }
        each step apply 0.5: flip() | 0.3: put()
        """
        + GRID,
        head="",
    ),
}
