"""Constructs that meet: units, merges, attributes with many values, blocks, strings, and states that grow."""

from __future__ import annotations

from functools import partial

from tests.unit.env.corners.units import with_step_limit
from tests.unit.env.corners.yard import MODEL, Yard
from tests.unit.env.side_by_side import Corner

PLAIN = {
    "units that merge objects": Yard(
        """
        rule join(i : Item, j : Item) { lhs { i : Item; j : Item; check i.id < j.id; } modify { merge i <- j; } }
        rule stack { lhs { b : Box -inner-> c : Box; } modify { merge b <- c; } }
        rule rise { lhs { b : Box; c : Box; } modify { merge c <- b; set c.size += 1; } }
        rule nest { lhs { b : Box; c : Box; } modify { move c to b.inner; } }
        rule strict { lhs { b : Chest; c : Box; } modify { merge c <- b; } }
        rule open { lhs { b : Box; m : Man; } modify { retype b : Chest; set b.lock = m; set b.labels = ["x"]; } }
        rule wed { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        rule absorb(i : Item) { lhs { i : Item; } forall { lhs { j : Item; check j.id > i.id; }
            modify { merge i <- j; } } modify { set i.weight += 1; } }
        rule item(out i : Item) { lhs { y : Yard; most == max Item.id(_, #); n == count Item(_); check n < 6; }
            modify { create y -items-> i : Item { id = most + 1 }; } }
        rule box { lhs { y : Yard; n == count Box(_); check n < 5; } modify { create y -boxes-> b : Box; } }
        rule fat(i : Item) { lhs { i : Item; check i.weight > 2.0; } modify { set i.weight = 0.5; } }
        unit joins(i : Item) { item(j); try { join(i, j); fat(j); } else { join(i, j); } }
        unit fail(i : Item) { try { absorb(i); fat(i); never; } else { wed; } }
        rule never { lhs { b : Box; check b.size > 90; } modify { set b.size = 0; } }
        unit loop { alap { stack | strict; } try { rise; never; } }
        unit eachone { all join where check i.id != 2 by j.weight; try { top 1 rise by b.size + c.size; } }
        unit asks { if strict { nest; strict; } else { if stack { rise; } else { open; nest; } } }
        unit firsts { first join(_, _); try { first strict; } }
        """,
        """
        action joins(i : Item) = joins(i) reward 1 else reward -1
        action fail(i : Item) = fail(i) reward 2 else reward -2
        action loop = loop() reward 3 else reward -3
        action eachone = 0.3: eachone() | 0.2: firsts() reward 4
        action asks = asks() reward 5 else reward -5
        action wed = wed()
        action open = open()
        action nest = nest()
        action item = item(_)
        action box = box()
        on find paired(i, j) reward i.id * 0.1 + j.id
        on find within(_, c) reward c.size * 0.01
        on find locked(m) reward m.hunger
        observe count find boxes(_) up to 9
        observe count find items(_) up to 9
        """,
        """
        pattern boxes(b : Box) { Box(b); }
        pattern items(i : Item) { Item(i); }
        pattern paired(i : Item, j : Item) { Item.pair(i, j); }
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        pattern locked(m : Man) { Chest.lock(_, m); }
        """,
        head="",
        spare=40,
    ),
    "units that change attributes with many values": Yard(
        """
        rule mark(s : Spot) { lhs { s : Spot; } modify { set s.marks += s.tag; } }
        rule unmark(s : Spot, t : string) { lhs { s : Spot; } modify { set s.marks -= t; } }
        rule clear(s : Spot) { lhs { s : Spot; } modify { set s.marks = none; } }
        rule score(m : Man, i : Item) { lhs { m : Man; i : Item; } modify { set m.codes += i.id; } }
        rule turn(m : Man) { lhs { m : Man; } modify { set m.ways += m.hunger > 2 ? Way::west : Way::east;
            set m.hunger -= 1; } }
        rule back(m : Man, out w : Way) { lhs { Man.ways(m, w); } modify { set m.ways -= w; set m.hunger = 3; } }
        rule see(m : Man) { lhs { m : Man; n : Man; neg Man.kinds(m, ::ant); } modify { set m.kinds += n.kind; } }
        rule tag(s : Spot, out t : string) { lhs { Spot.marks(s, t); } modify { set s.n += 1; } }
        rule add(m : Man) { lhs { m : Man; i : Item; } modify { set m.sums += i.weight; } }
        rule sub(m : Man) { lhs { m : Man; i : Item; } modify { set m.sums -= i.weight; } }
        rule low(s : Spot) { lhs { s : Spot; check s.n > 2; } modify { set s.n = 0; } }
        unit marks(s : Spot) { mark(s); tag(s, t); try { unmark(s, t); low(s); } else { clear(s); } }
        unit counts(m : Man) { score(m, _); score(m, _); try { score(m, _); back(m, _); } }
        unit turns(m : Man) { alap { turn(m); } try { back(m, w); back(m, w); } else { see(m); } }
        unit sums(m : Man) { all add; try { top 2 sub by i.weight; never; } }
        rule never { lhs { b : Box; check b.size > 90; } modify { set b.size = 0; } }
        unit asks(m : Man, s : Spot) { if score(m, _) { score(m, _) | mark(s); } else { if neg turn(m) {
            back(m, _); } else { turn(m); } } }
        unit where1(s : Spot) { mark where find marked(s, "a"); first score where check i.id > 1;
            all mark where check s.x > 0; }
        """,
        """
        action marks(s : Spot) = marks(s) reward 1 else reward -1
        action counts(m : Man) = counts(m) reward 2 else reward -2
        action turns(m : Man) = turns(m) reward 3 else reward -3
        action sums(m : Man) = 0.5: sums(m) reward 4 else reward -4
        action asks(m : Man, s : Spot) = asks(m, s) reward 5 else reward -5
        action where1(s : Spot) = 0.5: where1(s) reward 6 else reward -6
        action tag(s : Spot) = tag(s, t) reward t == "a" ? 1 : 2
        on find total(n) reward n
        on find heavy(w) reward w
        observe count find marked(_, _) up to 9
        observe find seen(adam, ::ant)
        """,
        """
        pattern marked(s : Spot, t : string) { Spot.marks(s, t); }
        pattern total(n : int) { n == sum Man.codes(_, #); }
        pattern heavy(w : float) { w == sum Man.sums(_, #); }
        pattern seen(m : Man, k : Kind) { Man.kinds(m, k); }
        """,
        head="adam : Man",
    ),
    "blocks that change attributes with many values": Yard(
        """
        rule all { lhs { y : Yard; } forall { lhs { s : Spot; } modify { set s.marks += s.tag; } } modify { } }
        rule pass { lhs { s : Spot; } forall { lhs { t : Spot; check t.x > s.x; Spot.marks(t, m); }
            modify { set s.marks += m; set t.marks -= m; } } modify { set s.n += 1; } }
        rule codes { lhs { m : Man; } forall { lhs { i : Item; check i.id > m.hunger - 3; }
            modify { set m.codes += i.id; } } modify { } }
        rule uncodes { lhs { m : Man; } forall { lhs { Man.codes(m, n); } modify { set m.codes -= n; } } modify { } }
        rule kinds { lhs { y : Yard; } forall { lhs { m : Man; n : Man; } modify { set m.kinds += n.kind; } }
            modify { } }
        rule rekind { lhs { y : Yard; } forall { lhs { m : Man; } modify { set m.kinds = [m.kind, ::ant];
            set m.kind = ::mole; } } modify { } }
        rule ways { lhs { y : Yard; } forall { lhs { m : Man -at-> s : Spot; i : Item -at-> t : Spot; }
            modify { set m.ways += i.id > 0 ? Way::west : Way::east; } } modify { } }
        rule noways { lhs { y : Yard; } forall { lhs { m : Man; } modify { set m.ways = none; } } modify { } }
        rule sums { lhs { m : Man; } forall { lhs { i : Item; } modify { set m.sums += i.weight; } } modify { } }
        rule nosums { lhs { m : Man; } forall { lhs { Man.sums(m, w); check w > 1.0; } modify { set m.sums -= w; }
            } modify { } }
        rule opt { lhs { m : Man; } optional { lhs { i : Item; neg Man.codes(m, 2); } modify { set m.codes += 2; }
            } modify { set m.rolls += 3; } }
        rule label { lhs { y : Yard; } forall { lhs { b : Box; neg Chest(b); } modify { retype b : Chest;
            set b.labels = ["x", "b"]; } } modify { } }
        @semantics(spo) rule unlabel { lhs { y : Yard; } forall { lhs { b : Chest; } modify { retype b : Box; } }
            modify { } }
        rule labels { lhs { y : Yard; } forall { lhs { b : Chest; s : Spot; } modify { set b.labels += s.tag; } }
            modify { } }
        """,
        """
        action all = 0.5: all() | 0.5: pass() reward 1
        action codes = 0.6: codes() | 0.4: uncodes() reward 2 else reward -2
        action kinds = kinds() reward 3
        action rekind = rekind()
        action ways = ways() reward 4 else reward -4
        action noways = noways()
        action sums = 0.3: sums() | 0.5: nosums()
        action opt = opt() reward 5
        action label = label() reward 6
        action unlabel = unlabel() reward 7
        action labels = labels() reward 8
        on find total(n) reward n
        on find heavy(w) reward w
        on find labelled(_, t) reward t == "x" ? 0.01 : 0.02
        observe count find marked(_, _) up to 9
        observe find seen(adam, ::ant)
        """,
        """
        pattern marked(s : Spot, t : string) { Spot.marks(s, t); }
        pattern total(n : int) { n == sum Man.codes(_, #); }
        pattern heavy(w : float) { w == sum Man.sums(_, #); }
        pattern seen(m : Man, k : Kind) { Man.kinds(m, k); }
        pattern labelled(s : Chest, t : string) { Chest.labels(s, t); }
        """,
        head="adam : Man",
    ),
    "strings of objects that are merged": Yard(
        """
        rule join { lhs { i : Item; j : Item; check i.id < j.id; } modify { merge i <- j; set i.tag = j.tag; } }
        rule keep { lhs { i : Item; j : Item; check i.tag + "x" != j.tag.toUpper + "x"; } modify { merge i <- j; } }
        rule chests { lhs { b : Chest; c : Chest; } modify { merge b <- c; } }
        rule harden { lhs { b : Box; s : Spot; } modify { retype b : Chest; set b.labels = ["x", s.tag]; } }
        rule label { lhs { b : Chest; Chest.labels(b, t); s : Spot; } modify { set b.labels -= t; set s.tag = t; } }
        @semantics(spo) rule spots { lhs { s : Spot; t : Spot; Spot.marks(t, m); } modify { merge s <- t;
            set s.marks += m; set s.tag = m; } }
        rule mark { lhs { s : Spot; } modify { set s.marks += s.tag; } }
        rule each { lhs { i : Item; } forall { lhs { j : Item; check j.tag != none && j.id > i.id; }
            modify { merge i <- j; } } modify { set i.tag = "joined"; } }
        rule item { lhs { y : Yard; s : Spot; most == max Item.id(_, #); n == count Item(_); check n < 6; }
            modify { create y -items-> i : Item { id = most + 1, tag = s.tag }; } }
        """,
        """
        action join = join() reward 1
        action keep = keep() reward 2
        action chests = chests() reward 3
        action harden = harden()
        action label = label()
        action spots = 0.1: spots() reward 4
        action mark = mark()
        action each = 0.3: each() reward 5
        action item = item()
        on find named(i, t) reward t == "joined" ? 0.1 : (t.length * 0.3)
        on find labelled(_, t) reward t == "x" ? 0.01 : 0.02
        on find marked(_, t) reward t == "A" ? 0.5 : 0.7
        observe count find named(_, _) up to 9
        """,
        """
        pattern named(i : Item, t : string) { Item.tag(i, t); }
        pattern labelled(s : Chest, t : string) { Chest.labels(s, t); }
        pattern marked(s : Spot, t : string) { Spot.marks(s, t); }
        """,
        head="",
        spare=40,
    ),
}

LIMITED = {
    "units that undo the growth of a state": Yard(
        """
        rule born(out b : Box) { lhs { y : Yard; } modify { create y -boxes-> b : Box { size = 4 }; } }
        rule item(b : Box, out i : Item) { lhs { b : Box; most == max Item.id(_, #); neg Box.item(b, _); }
            modify { create b -item-> i : Item { id = most + 1 }; } }
        rule big(b : Box) { lhs { b : Box; check b.size > 6; } modify { set b.size = 1; } }
        rule grow(b : Box) { lhs { b : Box; check b.size < 8; } modify { set b.size += 1; } }
        @semantics(spo) rule burn { lhs { b : Box; check b.size < 3; } modify { delete b; } }
        rule lid(b : Box) { lhs { b : Box; } modify { create b -lid-> c : Box { size = 5 }; } }
        rule marks { lhs { s : Spot; b : Box; } modify { set b.likes += s; } }
        unit many { repeat 2 { born(b); try { item(b, i); big(b); } } }
        unit undo { try { born(b); born(c); item(c, _); born(d); big(d); } else { try { born(b); grow(b); atomic {
            born(d); big(b); } } else { born(b); grow(b); } } }
        unit all1 { all grow; try { all marks; born(b); lid(b); big(b); } }
        unit asks { if born { born(b); if big(b) { burn; } else { lid(b); } } }
        unit merges { try { fold; fold; } }
        rule fold { lhs { b : Box; c : Box; d : Box; check b.size > c.size; } modify { merge b <- c; } }
        unit wide { repeat 0..3 { born(_) | burn; } alap { burn; } }
        """,
        """
        action many = many() reward 1 else reward -1
        action undo = undo() reward 2 else reward -2
        action all1 = 0.5: all1() reward 3 else reward -3
        action asks = asks() reward 4 else reward -4
        action merges = 0.7: merges() reward 5 else reward -5
        action wide = 0.5: wide() reward 6 else reward -6
        action burn = burn() reward 7
        on find size(b, n) reward n * 0.01
        observe count find boxes(_) up to 40
        observe count find items(_) up to 9
        """,
        """
        pattern boxes(b : Box) { Box(b); }
        pattern items(i : Item) { Item(i); }
        pattern size(b : Box, n : int) { Box.size(b, n); }
        """,
        head="",
        spare=3,
    ),
    "bounds and orders that overflow or divide by 0": Yard(
        """
        rule up(s : Spot) { lhs { s : Spot; check s.x < 99; check s.n < 5; } modify { set s.n += 1; } }
        rule back(s : Spot) { lhs { s : Spot; } modify { set s.n = s.maybe; } }
        rule lit(s : Spot) { lhs { s : Spot; } modify { set s.lit = !s.lit; set s.maybe = 9223372036854775807; } }
        unit r(s : Spot, t : Spot) { repeat 0..s.n { up(t); } try { lit(t) | up(t); } }
        unit q(s : Spot) { repeat s.maybe..s.n { lit(s); } }
        unit k(s : Spot) { repeat s.n { lit(s); } }
        unit b { top 2 up by 6 / s.n; try { top 1 back by 6 / s.x + s.maybe; } try {
            all lit where check 6 / s.n > 1 by s.f / s.n; } }
        unit w(s : Spot) { up(s) where check 7 / s.n > 0; }
        """,
        """
        action r(s : Spot, t : Spot) = r(s, t) reward 1 else reward -1
        action q(s : Spot) = 0.5: q(s) | 0.5: k(s) reward 2 else reward -2
        action b = b() reward 3 else reward -3
        action w(s : Spot) = w(s) reward 4 else reward -4
        action back(s : Spot) = back(s)
        observe s.n in 0..5 for s : Spot
        """,
        head="adam : Man",
        model=MODEL.replace("n = 2 ", "n = 9223372036854775807 ")
        .replace("maybe = 4", "maybe = -9223372036854775807 n = -9223372036854775807")
        .replace("f = 0.1", "f = 0.1 n = 9007199254740993"),
    ),
}

CORNERS: dict[str, Yard | Corner] = {**PLAIN} | {
    name: Corner(partial(with_step_limit, yard, 40), yard.members, yard.spare) for name, yard in LIMITED.items()
}
