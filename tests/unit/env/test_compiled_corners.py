"""What behaviours may say, construct by construct: the compiled environment does what the live one does."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.env import Behaviour, KeyIndex, Simulator
from envgraph.env.compiled import Batch, NotCompiled, program_of
from envgraph.env.compiled.kernels import add_exactly, sum_exactly
from envgraph.errors import EvaluationError
from envgraph.rewrite import Engine
from tests.profile import NIGHTLY
from tests.unit.env.side_by_side import mutants, opened, step_side_by_side

STEPS = 2_000 if NIGHTLY else 150

METAMODEL = """
metamodel yard

enum Kind { zebra, ant, mole }
enum Way { west, east }

class Yard {
    contains Spot[*] spots
    contains Box[*] boxes
    contains Man[*] men
    contains Item[*] items
}

@key(x) class Spot {
    int x
    int n = 0
    float f = 0.5
    bool lit = false
    Kind kind = zebra
    string tag
    int[0..1] maybe
    refers Spot[0..1] east opposite west
    refers Spot[0..1] west opposite east
    refers Man[0..2] men opposite at
    refers Spot[0..1] mark
    refers Spot[0..3] near opposite near
    string[*] marks
}
class Pit extends Spot

@key(name) class Man {
    string name
    int hunger = 3
    float power = 1.5
    bool awake = true
    Kind kind = ant
    refers Spot[0..1] at opposite men
    contains Item[0..2] bag
    refers Item[0..1] wants
    refers Man[0..1] friend opposite friend
    refers Spot[*] visited
    refers Item[0..2] likes opposite fans
}

@key(id) class Item {
    int id
    float weight = 0.25
    Kind kind = mole
    string tag
    refers Spot[0..1] at
    refers Item[0..1] pair opposite paired
    refers Item[0..1] paired opposite pair
    refers Man[*] fans opposite likes
}
class Heavy extends Item

abstract class Crate {}
class Plain extends Crate { int size = 7 }
class Box extends Crate { contains Item[0..1] item contains Box[0..3] inner opposite outer
    refers Box[0..1] outer opposite inner contains Box[0..1] lid opposite under refers Box[0..1] under opposite lid
    refers Spot[*] likes int size = 1 }
class Chest extends Box { int depth = 0 refers Man[0..1] lock }
"""

MODEL = """
import "yard.metamodel"

model small : yard {
    yard : Yard {
        spots = [
            s0 : Spot { x = 0 tag = "b" kind = ::zebra east = s1 maybe = 4 },
            s1 : Spot { x = 1 tag = "a" kind = ::ant east = s2 f = 0.1 },
            s2 : Pit { x = 2 tag = "c" kind = ::mole east = s3 n = 2 f = 0.7 },
            s3 : Spot { x = 3 tag = "a" kind = ::ant lit = true f = 0.3 },
        ]
        boxes = [ b0 : Box { size = 2 }, b1 : Box { item = i3 : Item { id = 3 tag = "q" } } ]
        men = [
            adam : Man { name = "adam" at = s0 wants = i1 bag = [i4 : Item { id = 4 weight = 1.1 kind = ::ant }] },
            eve : Man { name = "eve" at = s3 hunger = 1 kind = ::mole },
            seth : Man { name = "seth" },
        ]
        items = [
            i0 : Item { id = 0 at = s1 tag = "z" pair = i1 },
            i1 : Heavy { id = 1 at = s1 weight = 2.5 kind = ::zebra },
            i2 : Item { id = 2 at = s2 tag = "b" },
        ]
    }
}
"""

STEP = """
pattern step(a : Spot, way : Way, b : Spot) {
    Spot.east(a, b);
    way == Way::east;
} or {
    Spot.west(a, b);
    way == Way::west;
}
"""

MUTATIONS = """
rule newItem {
    lhs { y : Yard; s : Spot; last == max Item.id(_, #); }
    modify { create y -items-> i : Item { id = last + 1, at = s }; }
}
rule newHeavy {
    lhs { m : Man; last == max Item.id(_, #); }
    modify { create m -bag-> i : Heavy { id = last + 1, tag = "b" }; }
}
rule newSpot {
    lhs { y : Yard; s : Spot; last == max Spot.x(_, #); neg Spot.east(s, _); }
    modify { create y -spots-> t : Spot { x = last + 1, kind = ::mole, west = s }; }
}
rule newBox { lhs { y : Yard; } modify { create y -boxes-> b : Box { size = 3 }; } }
@semantics(spo) rule noItem { lhs { i : Item; check i.id == 0 || i.id > 3; } modify { delete i; } }
rule moved { lhs { m : Man; s : Spot; } modify { set m.at = s; } }
rule changed { lhs { s : Spot; }
    modify { set s.kind = ::zebra; set s.n = s.x; set s.maybe = none; set s.tag = "d"; } }
"""
"""What members of a family differ by."""


@dataclass(frozen=True)
class Corner:
    """A behaviour of the yard, with its rules and queries."""

    rules: str
    behaviour: str
    query: str = ""
    head: str = "adam : Man"
    model: str = MODEL


def written(folder: Path, corner: Corner) -> tuple[Engine, Behaviour]:
    """The engine and the behaviour of a corner."""
    texts = {
        "yard.metamodel": METAMODEL,
        "yard.query": f'package yard\nimport "yard.metamodel"\n{STEP}{corner.query}',
        "yard.rules": f'package yard\nimport "yard.query"\n{corner.rules}\n{MUTATIONS}',
        "yard.model": corner.model,
        "yard.environment": 'import "yard.query"\nimport "yard.rules"\n\n'
        f"environment Corner({corner.head}) {{\n{corner.behaviour}\n}}\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return opened(folder / "yard.model", folder / "yard.environment")


GO = "rule go(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { set m.at = s; } }"
GONE = "action go(s : Spot) = go(adam, s)\n"
OTHERS = "observe m.at among Pit or none for m : Man\nobserve i.pair among Heavy or none for i : Item"

MANY = """
rule visit(m : Man) { lhs { m : Man; s : Spot; neg Man.visited(m, s); } modify { create m -visited-> s; } }
rule forget { lhs { m : Man -visited-> s : Spot; } modify { delete m -visited-> s; } }
rule like(m : Man) { lhs { m : Man; i : Item; } modify { create m -likes-> i; } }
rule fan { lhs { i : Item; m : Man; check i.id < 3; } modify { create i -fans-> m; } }
rule unlike { lhs { i : Item -fans-> m : Man; } modify { delete i -fans-> m; } }
rule trade { lhs { m : Man -likes-> i : Item; n : Man; } modify { delete m -likes-> i; create n -likes-> i; } }
rule tour { lhs { m : Man; }
    forall { lhs { s : Spot; check s.x > 0; neg Man.visited(m, s); } modify { create m -visited-> s; } }
    forall { lhs { m -visited-> t : Spot; check t.x < 1; } modify { delete m -visited-> t; } } modify { } }
"""
LIKED = """
pattern shared(m : Man, n : Man, i : Item) { Man.likes(m, i); Item.fans(i, n); m != n; }
pattern seen(m : Man, s : Spot) { Man.visited(m, s); Spot.n(s, n); check(n < 3); }
pattern everywhere(m : Man) { Man(m); neg find unseen(m, _); }
pattern unseen(m : Man, s : Spot) { Man(m); Spot(s); neg Man.visited(m, s); }
"""
LIKES = (
    "action visit(m : Man) = visit(m) reward 1 else reward -1\naction forget = forget() reward 2\n"
    "action like(m : Man) = like(m) reward 3\naction fan = fan()\naction unlike = unlike()\n"
    "action trade = trade() reward 4\naction tour = tour()\n"
    "on find shared(_, _, i) reward i.id * 0.1\non find everywhere(adam) terminate success\n"
)
SEEN = (
    "observe count find shared(_, _, _) up to 9\nobserve count find seen(adam, _) up to 5\n"
    "observe find unseen(adam, _)\nobserve adam.at among Spot or none"
)

CORNERS = {
    "links with many at both ends": Corner(MANY, LIKES + "on find seen(adam, _) reward 5\n" + SEEN, LIKED),
    "links with many at both ends, of what is deleted": Corner(
        MANY
        + """
        @semantics(spo) rule drop { lhs { i : Item; check i.id > 2; } modify { delete i; } }
        rule kill { lhs { i : Item; } modify { delete i; } }
        """,
        LIKES + "action drop = drop() reward 6\naction kill = kill() reward 7 else reward -7\n" + SEEN,
        LIKED,
    ),
    "things that are in one container, and in another": Corner(
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
    "all targets are replaced": Corner(
        """
        rule net { lhs { s : Spot; t : Spot; u : Spot; check t.x < u.x; } modify { set s.near = [u, t]; } }
        rule one { lhs { s : Spot; t : Spot; } modify { set s.near = t; } }
        rule tour(m : Man) { lhs { m : Man; s : Spot; t : Spot; } modify { set m.visited = [s, t]; } }
        rule stay(m : Man) { lhs { m : Man; } modify { set m.visited = m.at; } }
        rule pick(m : Man) { lhs { m : Man; i : Item; j : Item; } modify { set m.likes = [j, i]; } }
        rule cheer(i : Item) { lhs { i : Item; m : Man; n : Man; } modify { set i.fans = [m, n]; } }
        rule call { lhs { s : Spot; m : Man; n : Man; } modify { set s.men = [n, m]; } }
        rule crowd { lhs { s : Spot; l : Man; m : Man; n : Man; } modify { set s.men = [l, m, n]; } }
        rule none1 { lhs { s : Spot -men-> _; s -near-> t : Spot; } modify { set s.men = none; set t.near = none; } }
        """,
        """
        action net = net() reward 1 else reward -1
        action one = one() reward 2
        action tour(m : Man) = tour(m) reward 3 else reward -3
        action stay(m : Man) = stay(m) reward 4
        action pick(m : Man) = pick(m) reward 5 else reward -5
        action cheer(i : Item) = cheer(i) reward 6
        action call = 0.9: call() | 0.05: crowd() reward 7 else reward -7
        action none1 = none1() reward 8 else reward -8
        observe count find near(_, _) up to 9
        observe count find seen(_, _) up to 9
        observe m.at among Spot or none for m : Man
        on find liked(m, i) reward 0.1
        """,
        """
        pattern near(s : Spot, t : Spot) { Spot.near(s, t); }
        pattern seen(m : Man, s : Spot) { Man.visited(m, s); }
        pattern liked(m : Man, i : Item) { Man.likes(m, i); }
        """,
    ),
    "references that are their own opposites": Corner(
        """
        rule befriend(m : Man, n : Man) { lhs { m : Man; n : Man; } modify { set m.friend = n; } }
        rule alone(m : Man) { lhs { m : Man; } modify { set m.friend = none; } }
        rule join { lhs { m : Man; n : Man; } modify { create m -friend-> n; } }
        rule part { lhs { m : Man -friend-> n : Man; } modify { delete m -friend-> n; } }
        rule touch { lhs { s : Spot; t : Spot; neg Spot.near(t, s); } modify { create s -near-> t; } }
        rule away { lhs { s : Spot -near-> t : Spot; check s.x <= t.x; } modify { delete s -near-> t; } }
        rule hop { lhs { s : Spot -near-> t : Spot; u : Spot; } modify { delete s -near-> t; create u -near-> s; } }
        @semantics(spo) rule kill { lhs { s : Spot -near-> t : Spot; check s.x > 1; } modify { delete t; } }
        rule kiss { lhs { y : Yard; }
            forall { lhs { m : Man; n : Man; check m.name < n.name; neg Man.friend(m, _); neg Man.friend(n, _); }
                modify { set n.friend = m; } } modify { } }
        rule web { lhs { s : Spot; }
            forall { lhs { t : Spot; neg Spot.near(s, t); check t.x < 3; } modify { create t -near-> s; } }
            forall { lhs { s -near-> t : Spot; check t.x > 1; } modify { delete t -near-> s; } } modify { } }
        """,
        """
        action befriend(m : Man, n : Man) = befriend(m, n) reward 1
        action alone(m : Man) = alone(m)
        action join = join() reward 2
        action part = part() reward 3 else reward -1
        action touch = touch() reward 4
        action away = away() reward 5
        action hop = hop() reward 6
        action kill = 0.1: kill()
        action kiss = kiss() reward 7
        action web = web() reward 8
        on find friends(m, n) reward 0.1
        on find loop(s) reward s.x
        on find far(s, t) reward 0.01
        observe m.friend among Man or none for m : Man
        observe count find touching(s) up to 9
        """,
        """
        pattern friends(m : Man, n : Man) { Man.friend(m, n); check(m.hunger > 0); }
        pattern loop(s : Spot) { Spot.near(s, s); }
        pattern touching(s : Spot) { Spot.near(_, s); }
        pattern close(s : Spot, t : Spot) { Spot.near(s, t); }
        pattern far(s : Spot, t : Spot) { find close+(s, t); k == count Spot.near(s, _); check(k > 1); }
        """,
        head="",
    ),
    "containers that are set": Corner(
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
    "targets that are added and taken away": Corner(
        """
        rule like(m : Man) { lhs { m : Man; i : Item; } modify { set m.likes += i; } }
        rule unlike(m : Man) { lhs { m : Man; i : Item; } modify { set m.likes -= i; } }
        rule fan { lhs { i : Item; m : Man; } modify { set i.fans += m; } }
        rule visit { lhs { m : Man; } modify { set m.visited += m.at; } }
        rule invite { lhs { s : Spot; m : Man; check s.x > 0; } modify { set s.men += m; } }
        rule dismiss { lhs { s : Spot -men-> m : Man; } modify { set s.men -= m; } }
        rule near { lhs { s : Spot; t : Spot; } modify { set s.near += t; } }
        rule far { lhs { s : Spot; t : Spot; } modify { set s.near -= t; } }
        rule both { lhs { m : Man; i : Item; j : Item; } modify { set m.likes -= i; set m.likes += j; } }
        rule wants { lhs { m : Man; } modify { set m.likes += m.wants; set m.wants = none; } }
        rule all { lhs { m : Man; } forall { lhs { s : Spot; } modify { set m.visited += s; } } modify { } }
        rule none { lhs { m : Man; }
            forall { lhs { m -visited-> s : Spot; } modify { set m.visited -= s; } } modify { } }
        """,
        """
        action like(m : Man) = like(m) reward 1
        action unlike(m : Man) = unlike(m) reward 2
        action fan = fan() reward 3
        action visit = visit() reward 4
        action invite = invite() reward 5
        action dismiss = dismiss() reward 6
        action near = near() reward 7
        action far = far() reward 8
        action both = both() reward 9
        action wants = wants() reward 10
        action all = 0.2: all() | 0.3: none()
        on find liked(_, i) reward i.id * 0.1
        on find seen(_, s) reward s.x
        observe m.at among Spot or none for m : Man
        observe count find seen(_, _) up to 9
        """,
        "pattern liked(m : Man, i : Item) { Man.likes(m, i); } pattern seen(m : Man, s : Spot) { Man.visited(m, s); }",
        head="",
    ),
    "containers that go with what they contain": Corner(
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
    "classes that change, and with them what objects have": Corner(
        """
        rule harden { lhs { b : Box; } modify { retype b : Chest; } }
        @semantics(spo) rule force { lhs { b : Box; } modify { retype b : Chest; } }
        rule soften { lhs { b : Chest; check b.depth > 1; } modify { retype b : Box; } }
        rule deepen { lhs { b : Chest; } modify { set b.depth += 1; } }
        rule lock { lhs { b : Chest; m : Man; } modify { set b.lock = m; } }
        rule seal { lhs { b : Box; } modify { retype b : Chest; set b.depth = 5; } }
        rule like { lhs { b : Box; s : Spot; neg Box.likes(b, s); } modify { create b -likes-> s; } }
        rule grow { lhs { b : Plain; } modify { set b.size += 1; } }
        @semantics(spo) rule flatten { lhs { b : Crate; } modify { retype b : Plain; } }
        rule make { lhs { y : Yard; c == count Box(_); check c < 5; }
            modify { create y -boxes-> b : Chest { depth = 2 }; } }
        @semantics(spo) rule drop { lhs { b : Chest; check b.depth > 4; } modify { delete b; } }
        """,
        """
        action harden = harden() reward 1 else reward -1
        action force = force() reward 2
        action soften = soften() reward 3
        action deepen = deepen() reward 4
        action lock = lock() reward 5
        action like = 0.3: like()
        action grow = grow() reward 6
        action flatten = 0.3: flatten() reward 7
        action make = make()
        action drop = drop() reward 8
        on find deep(_, n) reward n * 0.1
        on find sized(_, n) reward n
        on find locked(m) reward 10
        observe count find deep(_, _) up to 5
        observe count find liked(_) up to 5
        """,
        """
        pattern deep(b : Chest, n : int) { Chest.depth(b, n); }
        pattern sized(b : Box, n : int) { Box.size(b, n); }
        pattern locked(m : Man) { Chest.lock(_, m); }
        pattern liked(s : Spot) { Box.likes(_, s); }
        """,
        head="",
    ),
    "what only a goal says of an object, and what a called pattern is given": Corner(
        """
        rule deepen { lhs { find deep(c, n); check n < 6; } modify { } }
        rule sink { lhs { b : Chest; check b.depth < 6; } modify { set b.depth += 2; } }
        rule swell { lhs { find sized(c, n); c : Plain; check n < 9; } modify { set c.size += 1; } }
        @semantics(spo) rule turn { lhs { c : Crate; } modify { retype c : Chest; } }
        @semantics(spo) rule flatten { lhs { c : Chest; find deep(c, 4); } modify { retype c : Plain; } }
        rule make { lhs { y : Yard; n == count Crate(_); check n < 6; } modify { create p : Plain; } }
        """,
        """
        action deepen = deepen() reward 1 else reward -1
        action sink = sink() reward 2
        action swell = swell() reward 3 else reward -3
        action turn = 0.5: turn() reward 4
        action flatten = flatten() reward 5
        action make = make() reward 6
        on find anyDeep(c, n) reward n * 0.1
        on find notDeep(_) reward 0.01
        observe count find sized(_, _) up to 9
        observe count find anyDeep(_, 0) up to 4
        """,
        """
        pattern deep(c : Crate, n : int) { Chest.depth(c, n); }
        pattern sized(c : Crate, n : int) { Plain.size(c, n); } or { Box.size(c, n); }
        pattern anyDeep(c : Crate, n : int) { Crate(c); find deep(c, n); }
        pattern notDeep(c : Crate) { Crate(c); neg find deep(c, _); }
        """,
    ),
    "a clause without names holds once": Corner(
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
    "one that is deleted is gone by all of its classes": Corner(
        """
        @semantics(spo) rule killHeavy { lhs { h : Heavy; } modify { delete h; } }
        @semantics(spo) rule killItem { lhs { i : Item; check i.id > 1; } modify { delete i; } }
        rule light { lhs { h : Heavy; } modify { retype h : Item; } }
        rule weigh { lhs { i : Item; neg Heavy(i); check i.id < 3; } modify { retype i : Heavy; } }
        """,
        """
        action killHeavy = 0.2: killHeavy() reward 1 else reward -1
        action killItem = 0.2: killItem() reward 2 else reward -2
        action light = light() reward 3 else reward -3
        action weigh = weigh() reward 4 else reward -4
        on find item(i) reward i.id * 0.1
        on find heavy(h) reward h.weight
        observe count find item(_) up to 6
        observe count find heavy(_) up to 6
        """,
        "pattern item(i : Item) { Item(i); } pattern heavy(h : Heavy) { Heavy(h); }",
    ),
    "agents that go, or change their class": Corner(
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
    "deletion under dpo": Corner(
        """
        rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        """,
        """
        action kill(i : Item) = kill(i) reward 1.0 else reward -1.0
        on find items(k) reward k * 0.1
        observe count find alive(_) up to 9
        observe i.at among Spot or none for i : Item
        """,
        """
        pattern alive(i : Item) { Item(i); }
        pattern items(k : int) { k == count Item(_); }
        """,
    ),
    "deletion under spo": Corner(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        """,
        """
        action kill(i : Item) = kill(i) reward 1.0 else reward -1.0
        observe count find alive(_) up to 9
        observe i.at among Spot or none for i : Item
        observe i.kind for i : Item
        observe adam.wants among Item or none
        """,
        "pattern alive(i : Item) { Item(i); }",
    ),
    "two that are linked are deleted": Corner(
        """
        @semantics(spo) rule kill { lhs { i : Item -pair-> j : Item; } modify { delete i; delete j; } }
        rule killWhole { lhs { i : Item -pair-> j : Item; } modify { delete i; delete j; } }
        rule wed(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        rule lift { lhs { i : Item -at-> s : Spot; } modify { set i.at = none; } }
        rule forget { lhs { m : Man -wants-> i : Item; } modify { set m.wants = none; } }
        """,
        """
        action kill = kill()
        action killWhole = killWhole() reward 1
        action wed(i : Item, j : Item) = wed(i, j) reward 0.5 else reward 0.1
        action lift = lift()
        action forget = forget()
        observe i.pair among Item or none for i : Item
        """,
    ),
    "one to one": Corner(
        """
        rule wed(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        rule back(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.paired = j; } }
        rule part(i : Item) { lhs { i : Item; } modify { set i.pair = none; } }
        rule partBack(i : Item) { lhs { i : Item; } modify { set i.paired = none; } }
        @hom(i, j) rule add(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { create i -pair-> j; } }
        rule other { lhs { i : Item -pair-> j : Item; k : Item; } modify { redirect i -pair-> j to k; } }
        """,
        """
        action wed(i : Item, j : Item) = wed(i, j) reward 0.5 else reward 0.1
        action back(i : Item, j : Item) = back(i, j) reward 0.5 else reward 0.1
        action part(i : Item) = part(i)
        action partBack(i : Item) = partBack(i)
        action add(i : Item, j : Item) = add(i, j) reward 1 else reward -1
        action other = other()
        observe i.pair among Item or none for i : Item
        observe i.paired among Item or none for i : Item
        """,
    ),
    "ends that are full": Corner(
        """
        rule enter(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { create s -men-> m; } }
        rule leave(m : Man) { lhs { m -at-> s : Spot; } modify { delete m -at-> s; } }
        rule go(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { set m.at = s; } }
        rule give(m : Man, i : Item) { lhs { m : Man; i : Item; } modify { move i to m.bag; } }
        rule store(b : Box, i : Item) { lhs { b : Box; i : Item; } modify { move i to b.item; } }
        rule out { lhs { y : Yard; b : Box -item-> i : Item; } modify { move i to y.items; } }
        """,
        """
        action enter(m : Man, s : Spot) = enter(m, s) reward 1 else reward -1
        action leave(m : Man) = leave(m)
        action go(m : Man, s : Spot) = go(m, s) reward 1 else reward -1
        action give(m : Man, i : Item) = give(m, i) reward 1 else reward -1
        action store(b : Box, i : Item) = store(b, i) reward 2
        action out = out()
        observe m.at among Spot or none for m : Man
        """,
    ),
    "enums": Corner(
        """
        rule paint(s : Spot, k : Kind) { lhs { s : Spot; } modify { set s.kind = k; } }
        rule ant(s : Spot) { lhs { s : Spot; } modify { set s.kind = ::ant; } }
        rule turn(s : Spot) {
            lhs { s : Spot; check s.n < 3; }
            modify { set s.kind = s.kind == ::ant ? ::mole : Kind::zebra; }
        }
        rule copy { lhs { s : Spot; t : Spot; check s.kind != t.kind; } modify { set s.kind = t.kind; } }
        rule seen(out k : Kind) { lhs { s : Spot; Spot.kind(s, k); } modify { } }
        """,
        """
        action paint(s : Spot, k : Kind) = paint(s, k)
        action ant(s : Spot) = ant(s)
        action turn(s : Spot) = turn(s)
        action mole(s : Spot) = paint(s, ::mole)
        action zebra(s : Spot) = paint(s, Kind::zebra)
        action ofHis(s : Spot) = paint(s, adam.awake ? ::mole : ::ant)
        action copy = copy()
        action seen = seen(k) reward k == ::ant ? 1.0 : (k == Kind::mole ? 2.0 : 3.0)
        on find ants(n) reward n
        on find painted(s, k) reward k == ::zebra ? 0.1 : 0.7
        on find painted(s, k) reward k == (s.lit ? Kind::ant : Kind::mole) ? 0.1 : 0.7
        on find other(k, n) reward n * (k == ::ant ? 0.1 : 0.3)
        observe s.kind for s : Spot
        observe count find painted(_, Kind::ant) up to 3
        observe find painted(_, Kind::mole)
        """,
        """
        pattern painted(s : Spot, k : Kind) { Spot.kind(s, k); }
        pattern ants(n : int) { n == count find painted(_, Kind::ant); }
        pattern other(k : Kind, n : int) {
            Spot.kind(s, now);
            k == eval(now == Kind::ant ? Kind::mole : Kind::ant);
            Spot.n(s, n);
        }
        """,
    ),
    "strings": Corner(
        """
        rule copy(s : Spot, t : Spot) { lhs { find less(s, t); } modify { set s.tag = t.tag; } }
        rule mark(s : Spot) { lhs { find isA(s); } modify { set s.tag = "zz"; } }
        rule seen(out t : string) { lhs { s : Spot; Spot.tag(s, t); } modify { } }
        rule given(s : Spot, t : string) { lhs { s : Spot; } modify { set s.tag = t; } }
        """,
        """
        action copy(s : Spot, t : Spot) = copy(s, t)
        action mark(s : Spot) = mark(s)
        action given(s : Spot) = given(s, "new")
        action seen = seen(t) reward t == "a" ? 1.0 : (t < "c" ? 2.0 : 3.0)
        on find same(a, b) reward a.tag == "zz" ? 0.1 : 0.2
        observe count find same(_, _) up to 12
        """,
        """
        pattern same(a : Spot, b : Spot) { Spot.tag(a, t); Spot.tag(b, t); a != b; }
        pattern less(a : Spot, b : Spot) { Spot(a); Spot(b); check(a.tag < b.tag); }
        pattern isA(a : Spot) { Spot.tag(a, "a"); } or { Spot.tag(a, "nowhere"); }
        """,
    ),
    "floats": Corner(
        """
        rule more(i : Item) { lhs { i : Item; } modify { set i.weight += 0.1; } }
        rule third(i : Item) { lhs { i : Item; } modify { set i.weight = i.weight / 3; } }
        rule whole(i : Item) { lhs { i : Item; } modify { set i.weight = i.id; } }
        rule add(i : Item) { lhs { i : Item; } modify { set i.weight += i.id; } }
        rule huge(i : Item) { lhs { i : Item; } modify { set i.weight = i.weight * 1e200; } }
        rule given(i : Item, w : float) { lhs { i : Item; } modify { set i.weight = w; } }
        rule seen(out w : float) { lhs { find heavy(_, w); } modify { } }
        """,
        """
        action more(i : Item) = more(i)
        action third(i : Item) = third(i)
        action whole(i : Item) = whole(i)
        action add(i : Item) = add(i)
        action huge(i : Item) = huge(i)
        action given(i : Item, n : -2..2) = given(i, n)
        action half(i : Item, n : -2..2) = given(i, n * 0.3 - i.weight)
        action seen = seen(w) reward w * 0.1 + 0.2
        on find heavy(i, w) reward w * 0.1
        on find heavy(i, w) reward i.weight % 0.3
        on find heavy(i, w) reward min(w, 1) - max(i.id, w) + abs(w - 2)
        """,
        """
        pattern heavy(i : Item, w : float) { Item.weight(i, w); check(w > 0.3); }
        """,
    ),
    "division by zero in rewards": Corner(
        """
        rule up(s : Spot) { lhs { s : Spot; } modify { set s.n += 1; } }
        rule down(s : Spot) { lhs { s : Spot; } modify { set s.n -= 1; } }
        """,
        """
        action up(s : Spot) = up(s) reward 6 / s.n
        action down(s : Spot) = down(s) reward 6.0 / s.n
        action other(s : Spot) = nothing() reward s.n == 0 || 7 % s.n == 1 ? -7 / 2 : 2
        action both(s : Spot) = nothing() reward s.n != 0 && -7 / s.n < 3 ? 1 : 7 % s.n
        """,
    ),
    "division by zero in queries": Corner(
        """
        rule up(s : Spot) { lhs { s : Spot; } modify { set s.n += 1; } }
        rule down(s : Spot) { lhs { s : Spot; } modify { set s.n -= 1; } }
        """,
        """
        action up(s : Spot) = up(s)
        action down(s : Spot) = down(s)
        on find share(s, w) reward w
        on find check(s) reward s.n * 0.01
        on find guarded(s) reward 12 / s.n
        """,
        """
        pattern share(s : Spot, w : float) { Spot.n(s, n); w == eval(10 / n * 0.1); }
        pattern check(s : Spot) { Spot(s); check(7 / s.n > 2); }
        pattern guarded(s : Spot) { Spot(s); check(s.n != 0 && 7 % s.n == 1); }
        """,
    ),
    "division by zero in rules": Corner(
        """
        rule down(s : Spot) { lhs { s : Spot; } modify { set s.n -= 1; } }
        rule up(s : Spot) { lhs { s : Spot; } modify { set s.n += 1; } }
        rule divide(s : Spot) { lhs { s : Spot; } modify { set s.n = 5 / s.n; } }
        """,
        """
        action up(s : Spot) = up(s)
        action down(s : Spot) = down(s)
        action divide(s : Spot) = divide(s)
        observe s.n in -1..2 for s : Spot
        """,
    ),
    "no value": Corner(
        """
        rule give(s : Spot) { lhs { s : Spot; } modify { set s.maybe = s.n + s.x; } }
        rule take(s : Spot) { lhs { s : Spot; } modify { set s.maybe = none; } }
        rule copy(s : Spot, t : Spot) { lhs { s : Spot; t : Spot; } modify { set s.maybe = t.maybe; } }
        rule more(s : Spot) { lhs { s : Spot; } modify { set s.maybe += 1; } }
        """,
        """
        action give(s : Spot) = give(s)
        action take(s : Spot) = take(s)
        action copy(s : Spot, t : Spot) = copy(s, t) reward s.maybe == none ? 0.5 : s.maybe * 1.0
        action more(s : Spot) = more(s)
        action ask(s : Spot) = nothing() reward s.maybe
        on find no(s) reward s.maybe == none ? 1.0 : 2.0
        on find yes(s) reward s.maybe
        on find checked(s) reward s.maybe
        observe find no(_)
        """,
        """
        pattern no(s : Spot) { Spot(s); check(s.maybe == none); }
        pattern yes(s : Spot) { Spot(s); check(s.maybe != none && s.maybe > 2); }
        pattern checked(s : Spot) { Spot(s); check(s.maybe > 2); }
        """,
    ),
    "moves between containers": Corner(
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
    "opposites asked from both ends": Corner(
        """
        rule walk(m : Man, way : Way) { lhs { m -at-> here : Spot; find step(here, way, there); }
            modify { set m.at = there; } }
        rule fetch(s : Spot) { lhs { s -men-> m : Man; t : Spot; neg Spot.men(t, _); } modify { set m.at = t; } }
        rule link(s : Spot, t : Spot) { lhs { s : Spot; t : Spot; } modify { set s.east = t; } }
        rule cut(s : Spot) { lhs { s -west-> t : Spot; } modify { delete s -west-> t; } }
        """,
        """
        action walk(m : Man, way : Way) = walk(m, way) reward m.at.x else reward -1
        action fetch(s : Spot) = fetch(s)
        action link(s : Spot, t : Spot) = link(s, t)
        action cut(s : Spot) = cut(s) reward s.west == none ? 0.1 : 0.2
        on find together(a, b) reward a.hunger * 0.1
        on find crowd(s, n) reward n * s.x
        on find between(a, b) reward a.x - b.x
        observe m.at among Spot or none for m : Man
        observe s.east among Spot or none for s : Spot
        observe s.west among Spot or none for s : Spot
        """,
        """
        pattern together(a : Man, b : Man) { Spot.men(s, a); Man.at(b, s); a != b; }
        pattern crowd(s : Spot, n : int) { Spot(s); n == count Spot.men(s, _); }
        pattern between(a : Spot, b : Spot) { Spot.east.east(a, b); neg Spot.men(b, _); }
        or { Spot.west(a, m); Man.at(_, b); m == b; }
        """,
    ),
    "outputs": Corner(
        """
        rule bool(m : Man, out b : bool) { lhs { Man.awake(m, b); } modify { set m.awake = !b; } }
        rule made(m : Man, out k : int, out w : float, out s : Spot) {
            lhs { m -at-> s; k == eval(m.hunger * 2 + s.n); w == eval(m.power * k); }
            modify { set m.hunger -= 1; set m.power = w / 2; }
        }

        """,
        """
        action bool(m : Man) = bool(m, b) reward b ? 1.0 : 2.0 else reward -9
        action made(m : Man) = made(m, k, w, s) reward k * 0.1 + w + s.f else reward -0.2
        action mixed(m : Man) = 0.3: made(m, k, w, _) | 0.5: made(adam, k, w, _) reward k + w else reward 7
        observe adam.awake
        """,
    ),
    "bool parameters": Corner(
        """
        rule wake(m : Man, in b : bool) { lhs { m : Man; check m.awake != b; } modify { set m.awake = b; } }
        rule light(s : Spot, in b : bool) { lhs { s : Spot; Spot.lit(s, b); } modify { set s.lit = !b; } }
        """,
        """
        action wake(m : Man) = wake(m, true)
        action sleep(m : Man) = wake(m, m.hunger > 2) reward m.awake ? 1 : 2 else reward 3
        action light(s : Spot) = light(s, adam.awake)
        action dark(s : Spot) = light(s, !s.lit || s.n == 2)
        on find same(m, b) reward b ? 0.1 : 0.2
        on find same(m, true) reward 1
        observe s.lit for s : Spot
        """,
        "pattern same(m : Man, b : bool) { Man.awake(m, b); Spot.lit(s, b); check(b == s.lit || m.awake); }",
    ),
    "arithmetic of ints and floats": Corner(
        """
        rule calc(s : Spot, d : int) { lhs { s : Spot; }
            modify { set s.n = (s.n * 7 + d * s.x) % 23 - s.n / 2; set s.f = s.f * s.n - d / 3.0; } }
        rule big(s : Spot) { lhs { s : Spot; } modify { set s.n = s.n * 1000 + 7; } }
        rule neg(s : Spot) { lhs { s : Spot; check s.n * s.n > s.x - 1.5; } modify { set s.n = -s.n; } }
        """,
        """
        action calc(s : Spot, d : -2..2) = calc(s, d) reward s.f * d
        action neg(s : Spot) = neg(s) reward -s.n % 3 + abs(-s.n) - min(s.n, s.x)
        on find p(s, v) reward v
        """,
        """
        pattern p(s : Spot, v : float) { Spot.n(s, n); Spot.f(s, f); v == eval((n + 1) * f - n % 5 + n / 2);
            check(v < n || n <= 3 && -v < 2.5); }
        """,
    ),
    "branches that do not add up to 1": Corner(
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
    "a chance for each match": Corner(
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
    "probabilities that the state has": Corner(
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
    "matches that each other's `apply` takes away": Corner(
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
    "agents with blocks of their own": Corner(
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
    "parameters whose object goes": Corner(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule heavy(i : Item) { lhs { i : Item; } modify { retype i : Heavy; } }
        rule light(i : Heavy) { lhs { i : Heavy; } modify { retype i : Item; } }
        rule put(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
        rule lift(i : Item) { lhs { i : Item; } modify { set i.at = none; } }
        rule lit(s : Spot) { lhs { s : Spot; } modify { set s.lit = !s.lit; } }
        rule copy(w : float) { lhs { b : Box; check w > 0.3; } modify { set b.size += 1; } }
        rule kind(k : Kind) { lhs { m : Man; } modify { set m.kind = k; } }
        """,
        """
        action kill(i : Item) = 0.2: kill(i) | 0.1: nothing() reward i.weight == none ? 0.1 : 0.2 else reward 0.3
        action rest(i : Item) = nothing() reward i.at == none ? 0.1 : 0.2
        action heavy(i : Item) = heavy(i) reward i.weight else reward 5
        action light(i : Heavy) = light(i) reward i.weight else reward 4
        action put(i : Heavy, s : Spot) = put(i, s) reward 1 else reward -1
        action lift(i : Item) = lift(i) reward 1 else reward -1
        action lit(i : Item) = lit(i.at) reward 1 else reward -1
        action lit2(i : Heavy) = lit(i.at) reward 1 else reward -1
        action copy(i : Item) = copy(i.weight) reward 1 else reward -1
        action copy2(i : Item) = copy(i.weight + 1) reward 1 else reward -1
        action copy3(i : Heavy) = copy(i.pair.weight * 2) reward 1 else reward -1
        action kind(i : Heavy) = kind(i.kind) reward 1 else reward -1
        on find heavies(i) reward i.weight
        observe i.at among Spot or none for i : Item
        observe h.at among Spot or none for h : Heavy
        observe h.kind for h : Heavy
        observe i.pair among Heavy or none for i : Item
        observe count find heavies(_) up to 9
        """,
        "pattern heavies(i : Heavy) { Heavy(i); }",
    ),
    "parameters of the environment that go": Corner(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule light(i : Heavy) { lhs { i : Heavy; } modify { retype i : Item; } }
        rule weigh { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
        rule lit(s : Spot) { lhs { s : Spot; } modify { set s.lit = !s.lit; } }
        """,
        """
        action kill(i : Item) = kill(i) reward 1
        action light(i : Heavy) = light(i)
        action heavy = weigh()
        action lit = lit(i1.at) reward 2 else reward 3
        each step apply 0.3: kill(i2)
        on find there(i1) reward i1.weight
        on find there(i2) reward i2.weight
        on neg find there(i1) reward 7
        on neg find there(i2) reward 8 terminate failure
        on neg find heavy(i1) reward 9
        on find heavy(i1) reward 11
        on find near(i2, i) reward i.weight
        observe i2.at among Spot or none
        observe find there(i2)
        observe find heavy(i1)
        observe count find near(i2, _) up to 4
        """,
        """
        pattern there(i : Item) { Item(i); }
        pattern heavy(i : Heavy) { Heavy(i); }
        pattern near(i : Item, j : Item) { Item.at(i, s); Item.at(j, s); }
        """,
        head="i1 : Heavy, i2 : Item",
    ),
    "what is observed of one that goes": Corner(
        """
        @semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }
        rule light(i : Heavy) { lhs { i : Heavy; } modify { retype i : Item; } }
        rule lit(s : Spot) { lhs { s : Spot; } modify { set s.lit = !s.lit; } }
        """,
        """
        action kill(i : Item) = kill(i) reward 1
        action light = light(i1) reward i1.weight
        action lit(s : Spot) = lit(s)
        each step reward i1.weight
        observe i1.at among Spot or none
        observe i1.kind
        observe i2.kind
        """,
        head="i1 : Heavy, i2 : Item",
    ),
    "sums, means and extremes": Corner(
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
    "closures over links that change": Corner(
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
    "counts in patterns": Corner(
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
    "retyping within a family of classes": Corner(
        """
        rule dig(s : Spot) { lhs { s : Spot; } modify { retype s : Pit; } }
        rule fill { lhs { p : Pit; } modify { retype p : Spot; } }
        rule fall(m : Man) { lhs { m -at-> p : Pit; } modify { set m.hunger -= 1; } }
        """,
        """
        action dig(s : Spot) = dig(s) reward 1 else reward -1
        action fill = fill() reward 1 else reward -1
        action only(p : Pit) = dig(p) reward 0.5 else reward -0.5
        each step apply 0.5: fall(adam)
        on find pits(n) reward n * 0.1
        on find dry(s) reward s.f
        on neg find inPit(adam) reward 0.3
        observe p.kind for p : Pit
        observe count find dry(_) up to 3
        observe adam.at among Spot or none
        """,
        """
        pattern pits(n : int) { n == count Pit(_); }
        pattern dry(s : Spot) { Spot(s); neg Pit(s); }
        pattern inPit(m : Man) { Man.at(m, p); Pit(p); }
        """,
    ),
    "observed among a class that objects leave": Corner(
        """
        rule dig(s : Spot) { lhs { s : Spot; } modify { retype s : Pit; } }
        rule fill(p : Pit) { lhs { p : Pit; } modify { retype p : Spot; } }
        """,
        """
        action dig(s : Spot) = dig(s)
        action fill(p : Pit) = fill(p)
        observe m.at among Pit or none for m : Man
        observe s.east among Spot or none for s : Pit
        """,
    ),
    "observed among a class that objects are not of": Corner(GO, GONE + OTHERS),
    "observed among a class that an object is not of": Corner(GO, GONE + "observe adam.at among Pit"),
    "two clauses and the order of rewards": Corner(
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
    "success and failure at once": Corner(
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
    "conditions on rules": Corner(
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
    "values shared between objects": Corner(
        """
        rule copy(a : Spot, b : Spot) { lhs { a : Spot; b : Spot; neg find alike(a, b); }
            modify { set a.kind = b.kind; set a.n = b.n + a.n; set a.f = b.f; set a.lit = b.lit; } }
        rule swap(a : Spot, b : Spot) { lhs { a : Spot; b : Spot; }
            modify { set a.n = b.n; set b.n = a.n; set a.tag = b.tag; set b.tag = a.tag; } }
        """,
        """
        action copy(a : Spot, b : Spot) = copy(a, b) reward 1 else reward -1
        action swap(a : Spot, b : Spot) = swap(a, b)
        on find alike(a, b) reward a.x - b.x
        on find sameFloat(a, b, f) reward f
        on find numbers(n) reward n
        observe count find numbers(_) up to 3
        observe count find values(_, _, _) up to 5
        """,
        """
        pattern alike(a : Spot, b : Spot) { Spot.kind(a, k); Spot.kind(b, k); Spot.lit(a, l); Spot.lit(b, l);
            a != b; }
        pattern sameFloat(a : Spot, b : Spot, f : float) { Spot.f(a, f); Spot.f(b, f); a != b; }
        pattern numbers(n : int) { Spot.n(_, n); } or { Man.hunger(_, n); }
        pattern values(k : Kind, f : float, t : string) { Spot.kind(s, k); Spot.f(s, f); Spot.tag(s, t); }
        """,
    ),
}


@pytest.mark.parametrize("name", CORNERS)
def test_it_steps_as_the_live_engine_does(name: str, tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, CORNERS[name])
    step_side_by_side(mutants(engine, behaviour, 3), behaviour, STEPS, native=False)


@pytest.mark.parametrize("name", CORNERS if NIGHTLY else ["floats"])
def test_compiled_by_numba_too(name: str, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    engine, behaviour = written(tmp_path, CORNERS[name])
    step_side_by_side(mutants(engine, behaviour, 4), behaviour, 4 * STEPS, native=True)


def test_an_object_of_another_class_is_observed_as_none(tmp_path: Path) -> None:
    behaviour = GONE + "observe adam.at among Pit or none"
    seen = []
    first, _ = written(tmp_path, Corner(GO, behaviour))
    for model in (MODEL, MODEL.replace("s2 : Pit", "s2 : Spot")):  # the other one has no pit of the same key
        engine, read = written(tmp_path, Corner(GO, behaviour, model=model))
        live = Simulator(engine, read, KeyIndex.of(first.model, ["Pit", "Spot"]))
        rng = np.random.default_rng(0)
        seen += [[live.reset(rng), *(live.step(place, rng).observation for place in (1, 2, 3))]]
    assert seen == [[1, 1, 0, 1], [1, 1, 1, 1]]


def test_observing_an_object_of_another_class_is_an_error_that_says_so(tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, Corner(GO, GONE + "observe adam.at among Pit"))
    with pytest.raises(EvaluationError) as caught:
        Simulator(engine, behaviour).reset(np.random.default_rng(0))
    assert caught.value.message == "an observed path leads to `s0`, which is no `Pit`"
    assert caught.value.hint == "write `among Spot`, or `among Pit or none`"
    assert caught.value.span is not None and caught.value.span.text == "adam.at"


UP = "rule up(s : Spot) { lhs { s : Spot; } modify { set s.n += 1; } }\n"
WED = "rule wed(i : Item, j : Item) { lhs { i : Item; j : Item; } modify { set i.pair = j; } }\n"

REFUSED = {
    "objects that a rule merges": "lhs { s : Item; t : Item; } modify { merge s <- t; }",
    "strings that are put together": 'lhs { s : Spot; } modify { set s.tag = s.tag + "x"; }',
    "strings that a rule puts together": 'lhs { s : Spot; } modify { set s.tag += "x"; }',
    "keys that change": "lhs { s : Spot; } modify { set s.x += 1; }",
    "many values that a rule sets": 'lhs { s : Spot; } modify { set s.marks = ["x"]; }',
    "many targets that are set": "lhs { b : Box; c : Box; } modify { set b.inner = c; }",
    "many targets that are set among others": "lhs { m : Man; n : Man; } "
    "modify { set m.visited = none; set n.visited = none; }",
    "containers that blocks delete": "lhs { y : Yard; } forall { lhs { b : Box; i : Item; } "
    "modify { delete b; delete i; } } modify { }",
    "containers that are set among others": "lhs { b : Box; i : Item; } modify { set b.item = i; set i.pair = i; }",
    "a product of products": "lhs { s : Spot; } modify { set s.n = s.n * s.n * s.n; }",
    "the function `ceil`": "lhs { s : Spot; } modify { set s.n = ceil(s.f); }",
    "an int beyond 32 bits": "lhs { s : Spot; } modify { set s.n = 5000000000; }",
}


@pytest.mark.parametrize("construct", REFUSED)
def test_what_rules_have_and_is_not_compiled_is_named_with_its_place(construct: str, tmp_path: Path) -> None:
    rule = f"rule wrong {{ {REFUSED[construct]} }}"
    corner = Corner(rule, "action wrong = wrong()\nobserve adam.at among Spot or none")
    refused = refusal(tmp_path, corner)
    assert refused.construct.startswith(construct)
    assert refused.span is not None
    assert "yard.rules:3:" in str(refused.span)
    action = REFUSED[construct].partition("modify { ")[2].partition(";")[0]
    if action.startswith(("merge", "delete", "retype")) or "containers that are set" in construct:
        assert refused.span.text.rstrip(";") in action
        assert refused.span.start > refused.span.source.text.index("modify")


REFUSED_ELSEWHERE = {
    "recursion over what changes": (
        "yard.query",
        Corner(
            WED,
            "action wed(i : Item, j : Item) = wed(i, j)\non find after(i, j) reward 1",
            "pattern after(i : Item, j : Item) { Item.pair(i, j); } or { Item.pair(i, k); find after(k, j); }",
        ),
    ),
    "strings that a query makes": (
        "yard.query",
        Corner(
            UP + "rule read(out t : string) { lhs { find long(t); } modify { } }",
            'action read = read(t) reward t == "bx" ? 1 : 2',
            'pattern long(t : string) { Spot.tag(_, u); t == eval(u + "x"); }',
        ),
    ),
    "agents that a model has none of": (
        "yard.environment",
        Corner(
            UP,
            "action up(s : Spot) = up(s)\nagent p : Pit { }\nagent m : Man { observe m.kind }",
            head="",
            model=MODEL.replace("s2 : Pit", "s2 : Spot"),
        ),
    ),
}


@pytest.mark.parametrize("construct", REFUSED_ELSEWHERE)
def test_what_behaviours_have_and_is_not_compiled_is_named_with_its_place(
    construct: str, tmp_path: Path
) -> None:
    file, corner = REFUSED_ELSEWHERE[construct]
    refused = refusal(tmp_path, corner)
    assert refused.construct.startswith(construct)
    assert refused.span is not None
    assert file in str(refused.span)


def refusal(folder: Path, corner: Corner) -> NotCompiled:
    """What keeps a corner from being compiled."""
    engine, behaviour = written(folder, corner)
    with pytest.raises(NotCompiled) as caught:
        program_of(engine, behaviour, native=False)
    return caught.value


def test_what_becomes_of_the_models_later_changes_no_program(tmp_path: Path) -> None:
    rules = "@semantics(spo) rule kill { lhs { i : Item; check i.id > 0; } modify { delete i; } }"
    seen = "pattern item(i : Item) { Item(i); }\n"
    engine, behaviour = written(
        tmp_path, Corner(rules, "action kill = kill()\nobserve count find item(_) up to 9", seen)
    )
    program = program_of(engine, behaviour, native=False)
    while engine.apply("kill"):
        pass
    engine.apply("newSpot")
    batch = Batch(program, [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    counted = [batch.observation.item()]
    for _ in range(5):
        batch.step(np.zeros(1, dtype=np.int64), again=False)
        counted.append(batch.observation.item())
    assert counted == [5, 4, 3, 2, 1, 1]


@given(st.lists(st.floats(-1e300, 1e300) | st.sampled_from([1.0, 2.0**-53, -(2.0**-53), 2.0**-106, 0.1])))
def test_floats_are_added_as_the_live_engine_adds_them(values: list[float]) -> None:
    kept, parts = np.zeros((2_000, 1)), 0
    for value in values:
        parts = add_exactly(kept, 3, parts, value)
    assert sum_exactly(kept, 3, parts) == fsum(values)
