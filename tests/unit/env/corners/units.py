"""Units: all their steps, what they undo, and what ends them."""

from __future__ import annotations

from functools import partial

from envgraph.env import Behaviour
from envgraph.rewrite import Engine
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import Corner

RULES = """
@weight(3.0) rule up(s : Spot) { lhs { s : Spot; check s.n < 2; } modify { set s.n += 1; } }
rule down(s : Spot) { lhs { s : Spot; check s.n > 0; } modify { set s.n -= 1; } }
@weight(0.3) rule light { lhs { s : Spot; check s.lit == false; } modify { set s.lit = true; } }
@weight(0.1) rule dark { lhs { s : Spot; check s.lit; check s.x > 0; } modify { set s.lit = false; } }
@priority(2) rule urgent { lhs { s : Spot; check s.lit; check s.n > 1; } modify { set s.n = 0; } }
rule go(i : Item, s : Spot) { lhs { i : Item; s : Spot; i -at-> t : Spot; t != s; } modify { set i.at = s; } }
rule eat(m : Man, by : int) { lhs { m : Man; check m.hunger >= by; } modify { set m.hunger = m.hunger - by; } }
rule fast(m : Man, by : float) { lhs { m : Man; check m.power < by; } modify { set m.power = by; } }
rule read(m : Man, out tag : string, out s : Spot) {
    lhs { m -at-> s : Spot; Spot.tag(s, tag); } modify { set m.hunger = 5; }
}
@semantics(spo) rule dig { lhs { s : Spot; check s.x > 1; } modify { delete s; } }
rule sink(s : Spot) { lhs { s : Spot; neg Pit(s); } modify { retype s : Pit; } }
rule flat(s : Pit) { lhs { s : Pit; } modify { retype s : Spot; } }
"""
QUERY = """
pattern at(i : Item, s : Spot) { Item.at(i, s); }
pattern low(s : Spot) { Spot.n(s, 0); }
"""
SEEN = "observe count find low(_) up to 5\nobserve adam.at among Spot or none\nobserve count find lit(_) up to 5"
LIT = "pattern lit(s : Spot) { Spot.lit(s, true); }"

PLAIN = {
    "alternatives by weight and by priority": Yard(
        RULES
        + """
        unit any { light | dark | urgent; }
        unit all3(s : Spot) { up(s) | down(s) | { light; } | { dark; }; }
        unit one(s : Spot) { down(s); }
        unit nested(s : Spot) { one(s) | any; }
        """,
        f"""
        action any = any() reward 1 else reward -1
        action three(s : Spot) = all3(s) reward 2
        action nested(s : Spot) = 0.7: nested(s) | 0.2: any() reward 3
        each step apply 0.3: any()
        on find lit(s) reward s.x apply 0.2: nested(s)
        on find at(i1, s) apply one(s)
        on reset apply any()
        {SEEN}
        """,
        QUERY + LIT,
        head="adam : Man, i1 : Item",
    ),
    "attempts and conditions": Yard(
        RULES
        + """
        unit attempt(i : Item, s : Spot) { try { go(i, s); } else { up(s); } }
        unit gently(s : Spot) { try { down(s); } }
        unit asked(i : Item, s : Spot) {
            if find at(i, s) { light; }
            else { if neg find low(s) { down(s); } else { if check s.n == 0 { go(i, s); } } }
        }
        unit checked(m : Man, s : Spot) {
            if check 6 / m.hunger > s.n || s.n > 5 { eat(m, s.n); }
            else { if check s.maybe > 3 { up(s); } else { dark; } }
        }
        unit whole(i : Item, s : Spot) { atomic { go(i, s); } }
        unit then(i : Item, s : Spot) { go(i, s); try { up(s); } if find low(s) { try { light; } } try { dark; } }
        unit nothing { }
        """,
        f"""
        action attempt(i : Item, s : Spot) = attempt(i, s) reward 1 else reward -1
        action gently(s : Spot) = gently(s) reward 2 else reward -2
        action asked(i : Item, s : Spot) = asked(i, s) reward 3 else reward -3
        action checked(m : Man, s : Spot) = checked(m, s) reward 4 else reward -4
        action whole(s : Spot) = whole(i1, s) reward 5 else reward -5
        action then(s : Spot) = then(i1, s) reward 6 else reward -6
        action nothing = nothing() reward 7 else reward -7
        {SEEN}
        """,
        QUERY + LIT,
        head="adam : Man, i1 : Item",
    ),
    "arguments and outputs": Yard(
        RULES
        + """
        unit read1(m : Man, out tag : string) { read(m, tag, _); }
        unit read2(m : Man, out t : string, out s : Spot) { read(m, t, s); try { up(s); } }
        unit read3(m : Man, out t : string) { read1(m, t); try { light; } }
        unit same(m : Man, s : Spot) { read(m, _, s); }
        unit there(i : Item) { go(i, i.at.east); }
        unit eats(m : Man, s : Spot) { eat(m, 6 / s.n) | eat(m, s.maybe); }
        unit hurry(m : Man, s : Spot, by : int) { fast(m, by + s.f); }
        unit free(i : Item) { go(i, _); }
        """,
        f"""
        action read1(m : Man) = read1(m, t) reward t == "a" ? 1 : 2
        action read2(m : Man) = read2(m, t, s) reward t == "a" ? s.x + 0.5 : -1.0
        action read3(m : Man) = read3(m, t) reward t == "b" ? 1 : 2 else reward -1
        action same(s : Spot) = same(adam, s) reward 1
        action there(i : Item) = there(i) reward 1
        action eats(s : Spot) = 0.1: eats(adam, s) reward 1
        action hurry(s : Spot, by : 0..3) = hurry(adam, s, by) reward 1
        action free(i : Item) = free(i) reward 1
        each step apply 0.3: light() | 0.3: dark()
        {SEEN}
        """,
        QUERY + LIT,
        head="adam : Man, i1 : Item",
    ),
    "rules that are refused at some matches": Yard(
        RULES
        + """
        rule enter(s : Spot, out who : Man) { lhs { who : Man; s : Spot; }
            modify { set who.hunger = s.x; set who.at = s; } }
        rule stuff(m : Man) { lhs { m : Man; i : Item; } modify { move i to m.bag; set m.hunger += 1; } }
        rule box { lhs { y : Yard -items-> i : Item; b : Box; } modify { move i to b.item; } }
        rule unbox { lhs { y : Yard; b : Box -item-> i : Item; } modify { move i to y.items; } }
        rule empty { lhs { y : Yard; m : Man -bag-> i : Item; } modify { move i to y.items; } }
        rule lose { lhs { i : Item; check i.id > 2; } modify { delete i; } }
        rule find1 { lhs { y : Yard; most == max Item.id(_, #); n == count Item(_); check n < 6; }
            modify { create y -items-> i : Item { id = most + 1 }; } }
        unit come(s : Spot, out who : Man) { enter(s, who); }
        unit visit(s : Spot) { come(s, m); try { up(s); }
            if find at(_, s) { try { light; } } else { try { stuff(m) | dark; } } }
        rule grab(m : Man) { lhs { m : Man; y : Yard -items-> i : Item; }
            modify { set m.hunger += 1; move i to m.bag; } }
        unit grasp(m : Man) { grab(m); }
        unit reach(m : Man, s : Spot) { grasp(m) | down(s); }
        unit pack { box | unbox; }
        unit fill(m : Man) { try { stuff(m); } else { empty; } }
        unit either(m : Man, s : Spot) { stuff(m) | { box; } | down(s); }
        unit late(m : Man) { stuff(m) | light; }
        unit gone { try { lose; } else { find1; } }
        unit more(m : Man, s : Spot) { either(m, s) | fill(m); }
        """,
        f"""
        action visit(s : Spot) = visit(s) reward 1 else reward -1
        action reach(m : Man) = 0.9: reach(m, m.at) | 0.1: grasp(m) reward 9 else reward -9
        action pack = pack() reward 2 else reward -2
        action fill(m : Man) = fill(m) reward 3 else reward -3
        action either(s : Spot) = either(adam, s) reward 4 else reward -4
        action late(m : Man) = late(m) reward 5 else reward -5
        action gone = 0.5: gone() reward 6
        action more(m : Man) = 0.5: more(m, m.at) reward 7
        action come(s : Spot) = come(s, who) reward who.hunger
        observe m.at among Spot or none for m : Man
        observe count find inside(_) up to 5
        {SEEN}
        """,
        QUERY + LIT + "\npattern inside(i : Item) { Box.item(_, i); } or { Man.bag(_, i); }",
        head="adam : Man, i1 : Item",
    ),
    "objects that come and go": Yard(
        RULES
        + """
        unit change(s : Spot) { sink(s) | { try { down(s); } } }
        unit deep(s : Pit) { flat(s); try { up(s); } }
        unit gone(s : Spot) { dig; try { up(s); } if find low(s) { try { light; } } else { try { dark; } } }
        unit later(s : Spot) { try { sink(s); } if neg find low(s) { try { down(s); } } }
        """,
        """
        action change(s : Spot) = change(s) reward 1 else reward -1
        action deep(s : Pit) = deep(s) reward 2 else reward -2
        action gone(s : Spot) = 0.2: gone(s) reward 3
        action later(s : Spot) = later(s) reward 4 else reward -4
        action up(s : Spot) = up(s)
        on find pit(s) reward 0.1 apply 0.3: deep(s)
        observe count find pit(_) up to 4
        observe count find low(_) up to 5
        """,
        QUERY + "pattern pit(s : Pit) { Pit(s); }",
        head="",
    ),
}

MORE = """
rule near(s : Spot, out t : Spot) { lhs { s -east-> t : Spot; } modify { set t.n += 1; } }
rule toggle(s : Spot) { lhs { s : Spot; check s.n < 4; } modify { set s.n = s.n == 0 ? 1 : 0; } }
rule born(out i : Item) { lhs { y : Yard; most == max Item.id(_, #); n == count Item(_); check n < 7; }
    modify { create y -items-> i : Item { id = most + 1 }; } }
@semantics(spo) rule lose { lhs { i : Item; check i.id > 2; } modify { delete i; } }
rule grab(m : Man) { lhs { m : Man; y : Yard -items-> i : Item; } modify { set m.hunger += 1; move i to m.bag; } }
rule drop(m : Man) { lhs { y : Yard; m : Man -bag-> i : Item; } modify { set m.hunger -= 1; move i to y.items; } }
@weight(2.0) rule box { lhs { y : Yard -items-> i : Item; b : Box; } modify { move i to b.item; } }
rule unbox { lhs { y : Yard; b : Box -item-> i : Item; } modify { move i to y.items; } }
derive climb = retype among { Spot, Pit };
rule visit { lhs { m : Man; s : Spot; check s.n > 0; }
    forall { lhs { i : Item -at-> s; } modify { set i.weight = m.power; move i to m.bag; } }
    modify { set m.at = s; } }
rule meet { lhs { y : Yard; } forall { lhs { m : Man; s : Spot; check s.n > m.hunger - 3; } modify { set m.at = s; } }
    modify { } }
rule sweep(s : Spot) { lhs { s : Spot; } forall+ { lhs { i : Item -at-> s; } modify { delete i -at-> s; } } modify { } }
"""
STANDS = "\npattern stands(m : Man, s : Spot) { Man.at(m, s); }\npattern pit(s : Spot) { Pit(s); }"
INSIDE = "\npattern inside(i : Item) { Box.item(_, i); } or { Man.bag(_, i); }"
"""Rules some of which are refused at some matches, or contradict themselves, for units that undo what they did."""

LIMITED = {
    "loops, and steps that fail after others": Yard(
        RULES
        + MORE
        + """
        unit fill(s : Spot) { alap { up(s); } light; }
        unit drain(s : Spot) { alap { if check s.n > 0 { down(s) | dark; } try { up(s); down(s); light; } } }
        unit often(s : Spot) { repeat 1..3 { up(s); light; } }
        unit hungry(m : Man, s : Spot) { repeat s.n..m.hunger { eat(m, 1); try { up(s); dark; } } }
        unit counted(s : Spot) { repeat s.maybe - 3 { go(_, s) | { up(s); go(_, s); down(s); } } }
        unit late(s : Spot) { up(s); light; down(s); dark; }
        unit undone(s : Spot) {
            try { up(s); try { light; atomic { up(s); dark; urgent; } } else { late(s); } down(s); }
            else { alap { down(s); } }
        }
        unit packed(m : Man) { alap { grab(m) | { box; light; }; } repeat 0..2 { drop(m); unbox; } }
        unit deep(s : Spot) { try { repeat 1 { try { alap { try { repeat 2 { try { { up(s); { light; } | dark; }
            | { dark; down(s); }; } } } else { alap { { down(s); light; } | dark; } } dark; } } light; } } }
        """,
        f"""
        action fill(s : Spot) = fill(s) reward 1 else reward -1
        action drain(s : Spot) = drain(s) reward 2 else reward -2
        action often(s : Spot) = often(s) reward 3 else reward -3
        action hungry(m : Man, s : Spot) = hungry(m, s) reward 4 else reward -4
        action counted(s : Spot) = counted(s) reward 5 else reward -5
        action undone(s : Spot) = 0.8: undone(s) | 0.2: late(s) reward 6 else reward -6
        action packed(m : Man) = 0.5: packed(m) reward 7 else reward -7
        action deep(s : Spot) = deep(s) reward 8 else reward -8
        observe count find inside(_) up to 5
        {SEEN}
        """,
        QUERY + LIT + INSIDE,
        head="adam : Man, i1 : Item",
    ),
    "matches that a unit chooses": Yard(
        RULES
        + MORE
        + """
        unit each { all up; all light where check s.x > 0 by s.f; }
        unit best(m : Man) { top 2 up where neg find stands(m, s) by s.maybe + m.hunger; top 1 down by -s.f; }
        unit first1(m : Man) { first grab(m); first go where find at(i, s); try { first stuff; } }
        rule stuff { lhs { y : Yard -items-> i : Item; m : Man; check i.id != 2; } modify { move i to m.bag; } }
        unit where2(m : Man, s : Spot) { go(_, s) where neg Heavy(i) | grab(m) where check i.id + m.hunger > 3; }
        unit stuffed { all stuff where check m.hunger > 1 by i.weight; try { all lose; light; } }
        unit some { climb; } unit every { try { all climb; } else { light; } climb; }
        unit noSuch(s : Spot) { up(s) where check s.n > 7 | first down(s); }
        """,
        f"""
        action each = each() reward 1 else reward -1
        action best(m : Man) = best(m) reward 2 else reward -2
        action first1(m : Man) = first1(m) reward 3 else reward -3
        action where2(m : Man, s : Spot) = where2(m, s) reward 4 else reward -4
        action stuffed = 0.3: stuffed() reward 5 else reward -5
        action some = 0.3: some() | 0.3: every() reward 6
        action noSuch(s : Spot) = noSuch(s) reward 7
        action drop(m : Man) = drop(m)
        observe count find inside(_) up to 5
        observe count find pit(_) up to 5
        {SEEN}
        """,
        QUERY + LIT + INSIDE + STANDS,
        head="adam : Man, i1 : Item",
    ),
    "units that ask for rules": Yard(
        RULES
        + MORE
        + """
        unit asks(m : Man, s : Spot) {
            if grab(m) { grab(m); } else { if neg drop(m) { up(s); } else { drop(m); light; } }
            if go(_, eval(s.east)) { light | dark; }
        }
        unit climbs(s : Spot) { if climb { if neg down(s) { climb; } } else { up(s); } }
        unit swept(s : Spot) { if sweep(s) { sweep(s); up(s); } else { if meet { down(s); } } }
        unit never(m : Man, s : Spot) { try { grab(m); grab(m); grab(m); } else {
            if eat(m, eval(s.maybe)) { eat(m, 1); } } }
        """,
        f"""
        action asks(m : Man, s : Spot) = asks(m, s) reward 1 else reward -1
        action climbs(s : Spot) = climbs(s) reward 2 else reward -2
        action swept(s : Spot) = swept(s) reward 3 else reward -3
        action never(m : Man, s : Spot) = never(m, s) reward 4 else reward -4
        observe count find inside(_) up to 5
        {SEEN}
        """,
        QUERY + LIT + INSIDE,
        head="adam : Man",
    ),
    "units of rules with blocks": Yard(
        RULES
        + MORE
        + """
        unit begins(s : Spot) { sweep(s); try { up(s); light; } }
        unit later(s : Spot) { up(s); sweep(s); visit; }
        unit may(s : Spot) { visit | { down(s); meet; }; }
        unit again { alap { visit where check s.x + m.hunger < 5; } all visit; }
        """,
        f"""
        action begins(s : Spot) = begins(s) reward 1 else reward -1
        action later(s : Spot) = later(s) reward 2 else reward -2
        action may(s : Spot) = may(s) reward 3 else reward -3
        action again = again() reward 4 else reward -4
        action drop(m : Man) = drop(m)
        action go(i : Item, s : Spot) = go(i, s)
        observe m.at among Spot or none for m : Man
        {SEEN}
        """,
        QUERY + LIT,
        head="adam : Man",
    ),
    "values that a unit passes on": Yard(
        RULES
        + MORE
        + """
        unit east2(s : Spot, out t : Spot) { near(s, m); atomic { near(m, t); } }
        unit back(s : Spot) { east2(s, t); try { east2(s, t); near(t, s); } else { down(t); } }
        unit made(out i : Item) { born(i); }
        unit both(m : Man) { made(i); try { made(i); } else { set1(i, m.at); } }
        rule set1(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
        unit flatten(s : Pit) { flat(s) | { sink1(s); up(s); }; }
        rule sink1(s : Spot) { lhs { s : Spot; } modify { retype s : Pit; } }
        unit weigh(h : Heavy) { if check h.weight > 1.0 { set1(h, h.at.east); } else { light; } }
        unit depth(c : Chest) { if check c.depth == none { dark; } else { light | deeper(c, c.depth); } }
        rule deeper(c : Chest, by : int) { lhs { c : Chest; check c.depth < 3; } modify { set c.depth += by + 1; } }
        rule open(b : Box) { lhs { b : Box; neg Chest(b); } modify { retype b : Chest; } }
        unit opens(b : Box) { open(b) | depth(b); }
        unit gone(s : Spot) { dig; if check s.maybe == none { light; } else { up(s); } }
        """,
        """
        action back(s : Spot) = back(s) reward 1 else reward -1
        action both(m : Man) = both(m) reward 2 else reward -2
        action flatten(s : Spot) = flatten(s) reward 3 else reward -3
        action weigh = 0.5: weigh(i1) | 0.3: weigh(i2) reward 4 else reward -4
        action open(b : Box) = opens(b) reward 5 else reward -5
        action gone(s : Spot) = 0.2: gone(s) reward 6 else reward -6
        action lose = 0.2: lose()
        observe count find inside(_) up to 5
        observe count find low(_) up to 5
        """,
        QUERY + LIT + INSIDE,
        head="i1 : Item, i2 : Item",
    ),
    "runs of too many steps": Yard(
        RULES
        + MORE
        + """
        unit endless(s : Spot) { alap { toggle(s); } }
        unit long(s : Spot) { repeat 4..9 { toggle(s) | light; } all up; }
        unit twice(s : Spot) { long(s); try { long(s); } }
        """,
        f"""
        action endless(s : Spot) = endless(s) reward 1
        action twice(s : Spot) = twice(s) reward 2
        action long(s : Spot) = long(s) reward 3
        action down(s : Spot) = down(s)
        {SEEN}
        """,
        QUERY + LIT,
        head="adam : Man",
    ),
}


def with_step_limit(yard: Yard, limit: int = 20) -> tuple[Engine, Behaviour]:
    """Return a new engine of the yard's model that limits the steps of a run, and the behaviour."""
    engine, behaviour = yard.opened()
    engine.step_limit = limit
    return engine, behaviour


CORNERS: dict[str, Yard | Corner] = {**PLAIN} | {
    name: Corner(partial(with_step_limit, yard), yard.members) for name, yard in LIMITED.items()
}

REFUSED = {
    construct: Yard(f"{RULES}unit wrong(s : Spot) {{ {body} }}", "action wrong(s : Spot) = wrong(s)", QUERY)
    for construct, body in {
        "the unit `wrong`, which calls itself": "try { [[wrong(s)]]; } else { up(s); }",
    }.items()
}
