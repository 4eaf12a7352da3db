"""Values of attributes: enums, strings, floats, missing ones, arithmetic."""

from __future__ import annotations

from tests.unit.env.corners.yard import Yard, wrong

CORNERS = {
    "enums": Yard(
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
    "strings": Yard(
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
    "floats": Yard(
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
    "division by zero in rewards": Yard(
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
    "division by zero in queries": Yard(
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
    "division by zero in rules": Yard(
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
    "no value": Yard(
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
    "outputs": Yard(
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
    "bool parameters": Yard(
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
    "arithmetic of ints and floats": Yard(
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
    "values shared between objects": Yard(
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

REFUSED = {
    "a concatenation of strings": wrong('lhs { s : Spot; } modify { set s.tag = [[s.tag + "x"]]; }'),
    "a rule that concatenates strings (`yard.wrong`)": wrong('lhs { s : Spot; } modify { [[set s.tag += "x";]] }'),
    "a rule that changes a key (`Spot.x`)": wrong("lhs { s : Spot; } modify { [[set s.x += 1;]] }"),
    "a rule that sets a multi-valued attribute (`yard.wrong`)": wrong(
        'lhs { s : Spot; } modify { [[set s.marks = ["x"];]] }'
    ),
    "a product of ints that may exceed 64 bits": wrong("lhs { s : Spot; } modify { set s.n = [[s.n * s.n * s.n]]; }"),
    "the function `ceil`": wrong("lhs { s : Spot; } modify { set s.n = [[ceil(s.f)]]; }"),
    "an int outside of the 32-bit range (5000000000)": wrong("[[lhs]] { s : Spot; } modify { set s.n = 5000000000; }"),
}
