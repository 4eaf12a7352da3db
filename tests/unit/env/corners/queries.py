"""Queries: aggregates, closures, counts, conditions."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

LOOPS = "".join(f"Man.at(m{n}, s); Man.hunger(m{n}, h{n}); " for n in range(13))
ORDERED = "".join(f"check(h{n} <= h{n + 1}); " for n in range(12))
MARKS = "".join(f"Spot.mark(s{n}, s{n + 1}); " for n in range(40))
"""More loops, and more bindings, than one function may have inside each other."""

CORNERS = {
    "sums, means and extremes": Yard(
        """
        rule put(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
        rule feed(m : Man) { lhs { m : Man; } modify { set m.hunger += 1; } }
        rule starve { lhs { m : Man; h == max Man.hunger(_, #); check m.hunger == h && h > 0; }
            modify { set m.hunger = 0; } }
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule gain(m : Man) { lhs { m : Man; } modify { set m.power = m.power * -3.3 + 0.1; } }
        """,
        """
        action put(i : Item, s : Spot) = put(i, s)
        action feed(m : Man) = feed(m)
        action starve = starve() else reward 1
        action kill(i : Item) = kill(i)
        on find hungry(n, low, high) reward n * 100 + low * 10 + high
        on find fed(mean) reward mean
        on find held(s, n) reward n * 0.01
        on find least(f) reward f
        on find ids(n, mean) reward n + mean
        on find heavy(w, mean) reward w + mean
        on find load(s, w) reward w * s.x
        on find power(p) reward p
        action gain(m : Man) = gain(m)
        """,
        """
        pattern heavy(w : float, mean : float) { w == sum Item.weight(_, #); mean == avg Item.weight(_, #); }
        pattern weighs(s : Spot, i : Item, w : float) { Item.at(i, s); Item.weight(i, w); }
        pattern load(s : Spot, w : float) { Spot(s); w == sum find weighs(s, _, #); check(w > 0.0); }
        pattern power(p : float) { p == avg Man.power(_, #); }
        pattern hungry(n : int, low : int, high : int) {
            n == sum Man.hunger(_, #);
            low == min Man.hunger(_, #);
            high == max Man.hunger(_, #);
        }
        pattern ids(n : int, mean : float) { n == sum Item.id(_, #); mean == avg Item.id(_, #); }
        pattern fed(mean : float) { mean == avg Man.hunger(_, #); }
        pattern at(s : Spot, x : int) { Item.at(i, s); Item.id(i, x); } or { Item.at(_, s); Spot.x(s, x); }
        pattern held(s : Spot, n : int) { Spot(s); n == sum find at(s, #); check(n > 0); }
        pattern least(f : float) { f == min find lit(_, #); }
        pattern lit(s : Spot, f : float) { Item.at(_, s); Spot.f(s, f); }
        """,
    ),
    "closures over links that change": Yard(
        """
        rule mark(s : Spot, t : Spot) { lhs { s : Spot; t : Spot; } modify { set s.mark = t; } }
        rule self(s : Spot) { lhs { s : Spot; } modify { set s.mark = s; } }
        rule clear(s : Spot) { lhs { s : Spot; } modify { set s.mark = none; } }
        rule go(m : Man, s : Spot) { lhs { m -at-> here : Spot; s : Spot; find leads+(here, s); }
            modify { set m.at = s; } }
        rule fall(s : Spot) { lhs { s : Spot; } modify { retype s : Pit; } }
        rule rise(s : Pit) { lhs { s : Pit; } modify { retype s : Spot; } }
        """,
        """
        action mark(s : Spot, t : Spot) = mark(s, t)
        action self(s : Spot) = self(s)
        action clear(s : Spot) = clear(s)
        action go(s : Spot) = go(adam, s) reward 1 else reward -1
        action fall(s : Spot) = fall(s)
        action rise(s : Spot) = rise(s)
        on find reached(s) reward 0.1
        on find circle(_) reward 0.5
        on find into(n) reward n
        on find deep(_, _) reward 0.01
        observe adam.at among Spot or none
        observe count find onward(adam, _) up to 4
        """,
        """
        pattern leads(a : Spot, b : Spot) { Spot.mark(a, b); }
        pattern down(a : Pit, b : Pit) { Spot.mark(a, b); }
        pattern reached(s : Spot) { Man.at(m, here); Man.name(m, "adam"); find leads*(here, s); }
        pattern circle(s : Spot) { find leads+(s, s); }
        pattern leadsOn(a : Spot, b : Spot) { find leads+(a, b); }
        pattern onward(m : Man, s : Spot) { Man.at(m, here); find leads+(here, s); }
        pattern into(n : int) { n == count find leadsOn(_, _); }
        pattern deep(a : Pit, b : Pit) { find down*(a, b); neg find leadsOn(b, a); }
        """,
    ),
    "counts in patterns": Yard(
        """
        rule put(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
        rule lone { lhs { s : Spot; n == count Item.at(_, s); check n == 0; i : Item; } modify { set i.at = s; } }
        rule kind { lhs { i : Item; k == count find sameKind(i, _); check k > 1; }
            modify { set i.kind = i.kind == ::mole ? ::ant : ::mole; } }
        """,
        """
        action put(i : Item, s : Spot) = put(i, s)
        action lone = lone() else reward 1
        action kind = kind() else reward 2
        on find most(s, n) reward n * 0.1
        on find kinds(k, n) reward n * (k == ::ant ? 2 : 3)
        on find two(s) reward 0.3
        on find none() reward 5
        observe count find sameKind(_, _) up to 7
        observe count find most(_, 1) up to 7
        """,
        """
        pattern most(s : Spot, n : int) { Spot(s); n == count Item.at(_, s); check(n >= 1); }
        pattern sameKind(i : Item, j : Item) { Item.kind(i, k); Item.kind(j, k); }
        pattern kinds(k : Kind, n : int) { n == count Item.kind(_, k); Spot.kind(_, k); }
        pattern two(s : Spot) { Spot(s); 2 == count Item.at(_, s); }
        or { Spot(s); Spot.n(s, n); n == count find most(s, _); }
        pattern none() { 0 == count find most(_, _); } or { neg find two(_); }
        """,
    ),
    "loops nested too deep for one function": Yard(
        """
        rule go(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { set m.at = s; } }
        rule feed(m : Man) { lhs { m : Man; check m.hunger < 6; } modify { set m.hunger += 1; } }
        rule mark(s : Spot, t : Spot) { lhs { s : Spot; t : Spot; } modify { set s.mark = t; } }
        rule light { lhs { find far(s, t); } modify { set s.lit = !t.lit; } }
        """,
        """
        action go(m : Man, s : Spot) = go(m, s)
        action feed(m : Man) = feed(m)
        action mark(s : Spot, t : Spot) = mark(s, t)
        action light = light() else reward -3
        on find queue(_, n, _, h) reward n.hunger + 0.01 * h
        """,
        f"""
        pattern queue(m0 : Man, m12 : Man, s : Spot, h7 : int) {{ {LOOPS}{ORDERED}}}
        pattern far(s0 : Spot, s40 : Spot) {{ {MARKS}}}
        """,
    ),
    "conditions on rules": Yard(
        """
        rule light(m : Man) {
            lhs { m -at-> s : Spot; }
            not { s -east-> t : Spot; check t.lit; }
            require { other : Man; check other.hunger > m.hunger - 1; not { other -at-> s; } }
            modify { set s.lit = !s.lit; set m.hunger -= 1; }
        }
        rule eat(m : Man) { lhs { m -bag-> i : Item; neg find heavy(i); }
            modify { set m.hunger += 2; set i.weight += 1.0; } }
        rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); }
            modify { set m.at = there; } }
        """,
        """
        action light(m : Man) = light(m) reward 1 else reward -1
        action eat(m : Man) = eat(m) reward 1 else reward -1
        action walk(m : Man, way : Way) = walk(m, way)
        on find heavy(i) reward i.weight
        """,
        "pattern heavy(i : Item) { Item(i); check(i.weight > 2.0); neg Man.wants(_, i); }",
    ),
    "queries that compute strings": Yard(
        """
        rule read(out t : string) { lhs { find long(t); } modify { } }
        rule copy(m : Man, i : Item, t : string) { lhs { m : Man; i : Item; find long(t); } modify { set i.tag = t; } }
        """,
        """
        action read = read(t) reward t == "bx" ? 1 : (t < "c" ? 2 : 3)
        action copy(i : Item) = copy(adam, i, "ax")
        on find known(i, t) reward t == "ax" ? 0.5 : 0.25
        """,
        """
        pattern long(t : string) { Spot.tag(_, u); t == eval(u + "x"); } or { Spot.x(s, n); t == eval("p" + (n + 1)); }
        pattern known(i : Item, t : string) { Item.tag(i, t); find long(t); }
        """,
    ),
}

REFUSED = {
    "a recursive pattern whose matches change (`yard.after`)": Yard(
        "rule wed(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.pair = j; } }",
        "action wed(i : Item, j : Item) = wed(i, j)\non find after(i, j) reward 1",
        "pattern [[after]](i : Item, j : Item) { Item.pair(i, j); } or { Item.pair(i, k); find after(k, j); }",
    ),
}
