"""Units that have nothing to undo."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

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

CORNERS = {
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

OTHERS = """
derive climb = retype among { Spot, Pit };
unit flatten(s : Pit) { flat(s); }
"""
REFUSED = {
    construct: Yard(f"{RULES}{OTHERS}unit wrong(s : Spot) {{ {body} }}", "action wrong(s : Spot) = wrong(s)", QUERY)
    for construct, body in {
        "a step of a unit that may fail after other steps (`wrong`)": "up(s); [[down(s)]];",
        "`alap` in a unit (`wrong`)": "[[alap { up(s); }]]",
        "`repeat` in a unit (`wrong`)": "[[repeat 2 { up(s); }]]",
        "`all` in a unit (`wrong`)": "[[all up]];",
        "`where` in a unit (`wrong`)": "up(s) | { [[light where check s.x > 1]]; }",
        "an `if` in a unit that asks whether a rule can be applied (`wrong`)": "[[if up(s) { down(s); }]]",
        "the group `climb` in a unit": "[[climb]];",
        "the unit `wrong`, which calls itself": "try { [[wrong(s)]]; } else { up(s); }",
        "an argument of a unit whose class is not certain (`flatten`)": "[[flatten(s)]];",
    }.items()
}
