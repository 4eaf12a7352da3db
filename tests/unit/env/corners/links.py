"""Links: many at both ends, opposites, ends that are full."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard

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
    "links with many at both ends": Yard(MANY, LIKES + "on find seen(adam, _) reward 5\n" + SEEN, LIKED),
    "links with many at both ends, of what is deleted": Yard(
        MANY
        + """
        @semantics(spo) rule drop { lhs { i : Item; check i.id > 2; } modify { delete i; } }
        rule kill { lhs { i : Item; } modify { delete i; } }
        """,
        LIKES + "action drop = drop() reward 6\naction kill = kill() reward 7 else reward -7\n" + SEEN,
        LIKED,
    ),
    "all targets are replaced": Yard(
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
    "all targets are replaced, among other changes": Yard(
        """
        rule both { lhs { m : Man; n : Man; s : Spot; } modify { set m.visited = none; set n.visited = [s, m.at]; } }
        rule pick(m : Man) { lhs { m : Man; i : Item; n : Man; }
            modify { set m.likes = [i, n.wants]; set n.likes += i; } }
        rule go { lhs { m : Man; n : Man; s : Spot; } modify { set s.men = [m, n]; create m -visited-> s; } }
        rule near { lhs { s : Spot; t : Spot; check s.x < t.x; } modify { set s.near = [t, s.mark]; set t.mark = s; } }
        rule want(m : Man) { lhs { m : Man; i : Item; } modify { set m.wants = i; } }
        rule tour { lhs { s : Spot; t : Spot; }
            forall { lhs { m : Man; check m.hunger > 1; } modify { set m.visited = [s, t]; } }
            forall { lhs { m : Man; check m.hunger < 5; } modify { set m.visited = [s, m.at]; } } modify { } }
        rule fans { lhs { i : Item; }
            forall { lhs { m : Man; neg Man.likes(m, i); } modify { set m.likes = i; } } modify { } }
        @match(homomorphic) rule same { lhs { m : Man; n : Man; s : Spot; t : Spot; check m.hunger >= n.hunger; }
            modify { set m.visited = [s, t]; set n.visited = [t, s]; } }
        rule eat { lhs { m : Man; } modify { set m.hunger += 1; } }
        """,
        """
        action both = both() reward 1
        action pick(m : Man) = pick(m) reward 2 else reward -2
        action go = go() reward 3 else reward -3
        action near = near() reward 4 else reward -4
        action want(m : Man) = want(m)
        action tour = 0.3: tour()
        action fans = 0.3: fans() reward 5 else reward -5
        action same = 0.3: same()
        action eat = 0.2: eat()
        observe count find seen(_, _) up to 9
        observe m.at among Spot or none for m : Man
        on find liked(m, i) reward 0.1
        on find close(s, t) reward s.x
        """,
        """
        pattern close(s : Spot, t : Spot) { Spot.near(s, t); }
        pattern seen(m : Man, s : Spot) { Man.visited(m, s); }
        pattern liked(m : Man, i : Item) { Man.likes(m, i); }
        """,
    ),
    "references that are their own opposites": Yard(
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
    "targets that are added and taken away": Yard(
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
    "two that are linked are deleted": Yard(
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
    "one to one": Yard(
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
    "ends that are full": Yard(
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
    "opposites asked from both ends": Yard(
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
}

REFUSED: dict[str, Yard] = {}
