"""Objects that change their class or are deleted, and what is observed of them."""

from __future__ import annotations

from tests.unit.env.corners.yard import MODEL, Yard

GO = "rule go(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { set m.at = s; } }"
GONE = "action go(s : Spot) = go(adam, s)\n"
OTHERS = "observe m.at among Pit or none for m : Man\nobserve i.pair among Heavy or none for i : Item"

CORNERS = {
    "several that may have one index": Yard(
        """
        rule harden { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
        rule soften(i : Item) { lhs { i : Heavy; } modify { retype i : Item; } }
        rule want(m : Man) { lhs { m : Man; i : Heavy; } modify { set m.wants = i; } }
        rule grow(i : Item) { lhs { check i.weight < 4.0; } modify { set i.weight += 1.0; } }
        """,
        """
        action harden = harden() reward 1
        action soften(h : Heavy) = soften(h) reward h.weight
        action grow(h : Heavy) = grow(h)
        action want = want(adam)
        observe h.kind for h : Heavy
        observe adam.wants among Heavy or none
        observe h.at among Spot or none for h : Heavy
        """,
        model=MODEL.replace("{ id = 2 at", "{ id = 1 at").replace("{ id = 3 tag", "{ id = 1 tag"),
        members=1,
    ),
    "objects that are merged, among other changes": Yard(
        """
        rule new1 { lhs { y : Yard; i : Item; }
            modify { create y -boxes-> b : Box; create b -item-> j : Item { id = i.id + 9 }; merge j <- i; } }
        rule crate { lhs { b : Box; c : Box; } modify { create c -inner-> d : Box { size = 2 }; merge d <- b; } }
        @semantics(spo) rule gone { lhs { b : Box -item-> i : Item; j : Item; } modify { delete b; merge j <- i; } }
        rule heavy { lhs { i : Item; j : Item; check i.id < j.id; } modify { retype i : Heavy; merge i <- j; } }
        rule bag { lhs { m : Man; i : Item; j : Item; } modify { move i to m.bag; merge i <- j; } }
        rule each { lhs { y : Yard; }
            forall { lhs { m : Man -bag-> i : Item; }
                forall { lhs { j : Item; check j.id > i.id; } modify { merge i <- j; } } modify { set m.hunger += 1; } }
            modify { } }
        rule two { lhs { i : Item; j : Item; k : Item; check i.id < j.id && j.id < k.id; }
            modify { merge i <- j; merge i <- k; } }
        rule hold { lhs { b : Box; c : Box; d : Box; } modify { merge b <- c; set b.inner += d; set d.lid = none; } }
        rule wed { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        rule put { lhs { b : Box; i : Item; } modify { set b.item = i; } }
        rule nest { lhs { b : Box; c : Box; } modify { set b.inner += c; } }
        rule item { lhs { y : Yard; most == max Item.id(_, #); n == count Item(_); check n < 5; }
            modify { create y -items-> i : Item { id = most + 1 }; } }
        rule box { lhs { y : Yard; n == count Box(_); check n < 4; } modify { create y -boxes-> b : Box; } }
        """,
        """
        action new1 = new1() reward 1
        action crate = crate() reward 2
        action gone = gone() reward 3
        action heavy = heavy() reward 4
        action bag = 0.3: bag() | 0.2: hold() reward 5
        action each = 0.2: each() | 0.2: two() reward 6
        action wed = wed()
        action put = put()
        action nest = nest()
        action item = item()
        action box = box()
        on find boxed(i) reward i.id
        on find paired(i, j) reward j.id * 0.1
        on find within(_, c) reward c.size
        observe count find boxed(_) up to 9
        observe count find within(_, _) up to 9
        """,
        """
        pattern boxed(i : Item) { Box.item(_, i); }
        pattern paired(i : Item, j : Item) { Item.pair(i, j); }
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        """,
        head="",
        spare=40,
    ),
    "objects that are merged": Yard(
        """
        rule join { lhs { i : Item; j : Item; check i.id < j.id; } modify { merge i <- j; } }
        @semantics(spo) rule box { lhs { b : Box; c : Box; check b.size < 4; }
            modify { merge b <- c; set b.size += 1; } }
        rule stack { lhs { b : Box -inner-> c : Box; } modify { merge b <- c; } }
        rule rise { lhs { b : Box -inner-> c : Box; d : Box; } modify { merge c <- b; set c.lid = d; } }
        rule men { lhs { m : Man; n : Man; } modify { merge m <- n; set m.wants = n.wants; } }
        @semantics(spo) rule spots { lhs { s : Spot; t : Spot -east-> u : Spot; v : Spot; }
            modify { merge s <- t; merge v <- u; } }
        rule meet { lhs { s : Spot -near-> t : Spot; } modify { merge s <- t; create s -near-> s; } }
        @semantics(spo) rule chest { lhs { b : Chest; c : Box; } modify { merge c <- b; } }
        rule strict { lhs { b : Chest; c : Box; } modify { merge c <- b; } }
        rule lids { lhs { b : Box; c : Box; d : Box; } modify { merge b <- c; move d to b.inner; } }
        rule all { lhs { i : Item; }
            forall { lhs { j : Item; check j.id > 2; i != j; } modify { merge i <- j; } }
            modify { set i.weight += 1; } }
        rule pairs { lhs { y : Yard; }
            forall { lhs { i : Item -pair-> j : Item; } modify { merge i <- j; } } modify { } }
        @match(homomorphic) rule same { lhs { i : Item; j : Item; k : Item; check i.id < 2 && k.id > 1; }
            modify { merge i <- j; set k.at = i.at; } }
        rule wed { lhs { i : Item; j : Item; } modify { set i.pair = j; } }
        rule near { lhs { s : Spot; t : Spot; } modify { set s.near += t; } }
        rule like { lhs { m : Man; i : Item; s : Spot; } modify { set m.likes += i; set m.visited += s; } }
        rule friend { lhs { m : Man; n : Man; s : Spot; } modify { set m.friend = n; set s.men += m; } }
        rule nest { lhs { b : Box; c : Box; } modify { move c to b.inner; } }
        rule pack { lhs { b : Box; c : Box; i : Item; } modify { set b.item = i; set c.lid = b; } }
        rule harden { lhs { b : Box; s : Spot; m : Man; }
            modify { retype b : Chest; set b.labels = ["x"]; create b -likes-> s; } }
        rule lock { lhs { b : Chest; m : Man; } modify { set b.lock = m; } }
        rule make { lhs { y : Yard; c == count Box(_); check c < 4; } modify { create y -boxes-> b : Box; } }
        rule newItem2 { lhs { y : Yard; s : Spot; last == max Item.id(_, #); c == count Item(_); check c < 4; }
            modify { create y -items-> i : Item { id = last + 1, at = s }; } }
        """,
        """
        action join = 0.5: join() | 0.1: all()
        action box = box() reward 2
        action stack = stack() reward 3
        action rise = rise() reward 3.5
        action men = 0.1: men() reward 4
        action spots = 0.1: spots() reward 5
        action meet = 0.2: meet() reward 6
        action chest = 0.4: chest() | 0.4: strict() reward 7
        action lids = lids() reward 8
        action pairs = 0.5: pairs() | 0.3: same()
        action wed = wed()
        action near = near()
        action like = like()
        action friend = friend()
        action nest = nest()
        action pack = pack()
        action harden = 0.5: harden() | 0.5: lock()
        action make = make()
        action newItem2 = newItem2()
        on find within(_, c) reward c.size * 0.1
        on find packed(i) reward i.weight
        on find paired(i, j) reward i.id * 0.01
        on find liked(m, i) reward i.id
        on find close(s, t) reward s.x
        on find labelled(_, t) reward t == "x" ? 0.01 : 0.02
        observe count find within(_, _) up to 9
        observe count find liked(_, _) up to 5
        """,
        """
        pattern within(b : Box, c : Box) { Box.inner(b, c); }
        pattern packed(i : Item) { Box.item(_, i); }
        pattern paired(i : Item, j : Item) { Item.pair(i, j); }
        pattern liked(m : Man, i : Item) { Man.likes(m, i); }
        pattern close(s : Spot, t : Spot) { Spot.near(s, t); } or { Man.at(m, s); Man.visited(m, t); }
        pattern labelled(s : Chest, t : string) { Chest.labels(s, t); }
        """,
        head="",
    ),
    "classes that change, and with them what objects have": Yard(
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
    "what only a goal says of an object, and what a called pattern is given": Yard(
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
    "one that is deleted is gone by all of its classes": Yard(
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
    "deletion under dpo": Yard(
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
    "deletion under spo": Yard(
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
    "parameters whose object goes": Yard(
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
    "parameters of the environment that go": Yard(
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
    "what is observed of one that goes": Yard(
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
    "a reward reads what an object loses with its class": Yard(
        """
        @semantics(spo) rule flatten(b : Crate) { lhs { b : Box; } modify { retype b : Plain; } }
        rule lit(s : Spot) { lhs { s : Spot; } modify { set s.lit = !s.lit; } }
        """,
        """
        action flatten(b : Box) = flatten(b)
        action lit(s : Spot) = lit(s)
        each step reward b1.item.weight
        observe b1.size in 0..3
        """,
        head="b1 : Box",
    ),
    "retyping within a family of classes": Yard(
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
    "observed among a class that objects leave": Yard(
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
    "observed among a class that objects are not of": Yard(GO, GONE + OTHERS),
    "observed among a class that an object is not of": Yard(GO, GONE + "observe adam.at among Pit"),
}

REFUSED = {}
