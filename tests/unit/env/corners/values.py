"""Values of attributes: enums, strings, floats, missing ones, arithmetic."""

from __future__ import annotations

from tests.unit.env.corners.yard import MODEL, Yard, wrong

CORNERS = {
    "attributes with many values": Yard(
        """
        rule mark(s : Spot) { lhs { s : Spot; } modify { set s.marks += s.tag; } }
        rule wipe { lhs { s : Spot; t : Spot; Spot.marks(t, m); } modify { set s.marks -= m; } }
        rule name { lhs { s : Spot; } modify { set s.marks = ["x", s.x > 1 ? "y" : "x", s.tag]; } }
        rule clear { lhs { s : Spot; } modify { set s.marks = none; } }
        rule count(m : Man) { lhs { m : Man; i : Item; } modify { set m.codes += i.id; } }
        rule recount { lhs { m : Man; i : Item; check i.id != 2; } modify { set m.codes = [i.id, 7]; } }
        rule forget(m : Man) { lhs { m : Man; i : Item; } modify { set m.codes -= i.id; } }
        rule see { lhs { m : Man; n : Man; } modify { set m.kinds += n.kind; set m.kind = ::zebra; } }
        rule unsee { lhs { m : Man; n : Man; } modify { set m.kinds -= n.kind; } }
        rule turn { lhs { m : Man; } modify { set m.ways += m.hunger > 2 ? Way::west : Way::east; } }
        rule back { lhs { m : Man; Man.ways(m, w); } modify { set m.ways -= w; set m.hunger = 3; } }
        rule face { lhs { m : Man; } modify { set m.ways = [::east, ::west, ::east]; set m.hunger = 1; } }
        rule roll { lhs { m : Man; } modify { set m.rolls += m.hunger > 3 ? 2 : m.awake ? 1 : 0; set m.hunger += 1; } }
        rule flip { lhs { m : Man; } modify { set m.flips += m.awake; set m.awake = !m.awake; } }
        rule rest { lhs { m : Man; } modify { set m.flips = [true]; } }
        rule add { lhs { m : Man; i : Item; } modify { set m.sums += i.weight; set m.sums -= 1; } }
        rule one { lhs { m : Man; } modify { set m.sums += 1; } }
        """,
        """
        action mark(s : Spot) = mark(s) reward 1
        action wipe = wipe() reward 2
        action name = 0.5: name() | 0.2: clear()
        action count(m : Man) = count(m) reward 3 else reward -3
        action recount = recount()
        action forget(m : Man) = forget(m)
        action see = see()
        action unsee = unsee()
        action turn = 0.5: turn() | 0.2: face() reward 4 else reward -4
        action back = back()
        action roll = roll()
        action flip = 0.7: flip() | 0.3: rest()
        action add = 0.5: add() | 0.5: one()
        on find marked(_, t) reward t == "a" ? 0.1 : 0.2
        on find same(_, _) reward 0.01
        on find total(n) reward n
        on find heavy(w) reward w
        on find twice(m) reward m.power
        observe count find marked(_, _) up to 9
        observe find coded(adam, 1)
        observe count find seen(_, ::ant) up to 3
        """,
        """
        pattern marked(s : Spot, t : string) { Spot.marks(s, t); }
        pattern same(s : Spot, t : Spot) { Spot.marks(s, m); Spot.marks(t, m); check s.x < t.x; }
        pattern total(n : int) { n == sum Man.codes(_, #); }
        pattern heavy(w : float) { w == sum Man.sums(_, #); }
        pattern twice(m : Man) { Man.ways(m, ::east); Man.flips(m, true); neg Man.rolls(m, 2); }
        pattern coded(m : Man, n : int) { Man.codes(m, n); }
        pattern seen(m : Man, k : Kind) { Man.kinds(m, k); }
        """,
    ),
    "attributes with many values, of objects that come and go": Yard(
        """
        rule mark { lhs { s : Spot; t : Spot; } modify { set s.marks += t.tag; } }
        rule dig { lhs { y : Yard; s : Spot; most == max Spot.x(_, #); neg Spot.east(s, _); check most < 7; }
            modify { create y -spots-> t : Spot { x = most + 1, west = s, tag = "d", marks = ["b"] }; } }
        @semantics(spo) rule fill { lhs { s : Spot; Spot.marks(s, "b"); } modify { delete s; } }
        rule harden { lhs { b : Box; } modify { retype b : Chest; set b.labels = ["x", "y"]; } }
        @semantics(spo) rule soften { lhs { b : Chest; } modify { retype b : Box; } }
        rule label { lhs { b : Chest; s : Spot; } modify { set b.labels += s.tag; } }
        @semantics(spo) rule smash { lhs { b : Chest; Chest.labels(b, "a"); } modify { delete b; } }
        rule pack { lhs { b : Box; c : Box; } modify { move c to b.inner; } }
        @semantics(spo) rule kill { lhs { m : Man; } modify { delete m; } }
        rule all { lhs { y : Yard; } forall { lhs { s : Spot; } modify { set s.marks += s.tag; } } modify { } }
        """,
        """
        action mark = mark() reward 1
        action dig = dig() reward 2
        action fill = 0.3: fill() reward 3
        action harden = harden()
        action soften = 0.3: soften()
        action label = label()
        action smash = 0.3: smash()
        action pack = pack() reward 5 else reward -5
        action kill = 0.05: kill()
        action all = 0.2: all()
        on find marked(_, t) reward t == "b" ? 0.1 : 0.2
        on find labelled(_, t) reward t == "x" ? 0.01 : 0.02
        on find coded(_, n) reward n
        observe count find marked(_, _) up to 9
        observe count find labelled(_, _) up to 9
        """,
        """
        pattern marked(s : Spot, t : string) { Spot.marks(s, t); }
        pattern labelled(s : Chest, t : string) { Chest.labels(s, t); }
        pattern coded(m : Man, n : int) { Man.codes(m, n); }
        """,
        head="",
    ),
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
    "functions of numbers": Yard(
        """
        rule more(s : Spot, by : float) { lhs { s : Spot; } modify { set s.f = s.f * by - 0.25; } }
        rule round(s : Spot) { lhs { s : Spot; } modify { set s.n = round(s.f) - ceil(-s.f) * 2 + toInt(s.f / 3); } }
        rule power(s : Spot) { lhs { s : Spot; } modify { set s.f = pow(s.f, 2) - exp(floatValue(s.f) / 7); } }
        rule exp(s : Spot) { lhs { s : Spot; } modify { set s.f = pow(2.0, s.n); } }
        rule root(s : Spot) { lhs { s : Spot; } modify { set s.f = sqrt(s.f) + log(s.x) + log(s.n + 1); } }
        rule wrap(s : Spot) { lhs { s : Spot; }
            modify { set s.n = mod(s.n * 7 - 3, 5 - s.x); set s.f = mod(s.f, -1.5); } }
        rule huge(s : Spot) { lhs { s : Spot; } modify { set s.n = floor(s.f * 1e18); set s.f = s.f * 1e3; } }
        """,
        """
        action more(s : Spot) = more(s, 1.5)
        action less(s : Spot) = more(s, -1.5) reward mod(s.n, 3) + floor(s.f) * 0.25
        action round(s : Spot) = round(s) reward exp(s.f)
        action power(s : Spot) = power(s) reward min(s.n, s.f, 3) - max(1, s.n) else reward sqrt(s.x)
        action exp(s : Spot) = exp(s)
        action root(s : Spot) = root(s) reward log(s.x + 1)
        action wrap(s : Spot) = wrap(s) reward pow(s.f, 0.5)
        action huge(s : Spot) = huge(s)
        action half(s : Spot) = nothing() reward toFloat(s.n) / 3 + doubleValue(s.n) + intValue(s.f) + abs(s.f)
        on find low(s, k) reward k * 0.5
        observe count find small(_) up to 3
        """,
        """
        pattern low(s : Spot, k : int) { Spot.f(s, f);
            k == eval(round(sqrt(f)) + floor(log(f)) - toInt(exp(min(f, 40)))); }
        pattern small(s : Spot) { Spot(s); check(pow(s.f, s.n) < 2 && mod(s.n, s.x) >= 0 || ceil(s.f) == 1); }
        """,
    ),
    "ints of 64 bits": Yard(
        """
        rule square(s : Spot) { lhs { s : Spot; } modify { set s.n = (s.n + 3) * (s.n - s.x); } }
        rule cube(s : Spot) { lhs { s : Spot; } modify { set s.maybe = s.n * s.n * s.n; } }
        rule add(s : Spot) { lhs { s : Spot; } modify { set s.n += 4611686018427387904; } }
        rule take(s : Spot) { lhs { s : Spot; } modify { set s.n -= s.maybe; } }
        rule neg(s : Spot) { lhs { s : Spot; } modify { set s.n = -s.n / 3 % 5000000007; } }
        rule lowest(s : Spot) { lhs { s : Spot; } modify { set s.n = -2147483648; set s.maybe = -2147483648; } }
        rule best(s : Spot) { lhs { s : Spot; top == max Spot.n(_, #); all == sum Spot.n(_, #); }
            modify { set s.n = all - top; } }
        rule mean(s : Spot) { lhs { s : Spot; m == avg Spot.n(_, #); } modify { set s.f = m; } }
        rule float(s : Spot) { lhs { s : Spot; } modify { set s.f = s.n; set s.n = s.n / 2 * 3; } }
        """,
        """
        action square(s : Spot) = square(s)
        action cube(s : Spot) = cube(s)
        action add(s : Spot) = add(s)
        action take(s : Spot) = take(s)
        action neg(s : Spot) = neg(s)
        action lowest(s : Spot) = lowest(s) reward s.maybe == none ? 1 : (s.n < 0 ? 2 : 3)
        action best(s : Spot) = best(s) reward s.n * 0.5
        action mean(s : Spot) = mean(s)
        action float(s : Spot) = float(s) reward s.n == s.f ? 0.1 : (s.n < s.f ? 0.2 : 0.3)
        on find twice(s, k) reward k * 0.01
        on find large(s) reward s.maybe > s.n ? 0.01 : 0.02
        on find wide(s, t) reward 0.001
        observe count find large(_) up to 3
        observe adam.at.n in -1..2000000000000000000
        """,
        """
        pattern twice(s : Spot, k : int) { Spot.n(s, n); k == eval(n + n); }
        pattern large(s : Spot) { Spot(s); check(s.n / 2 > 2000000000 || s.n > s.f || s.maybe == -2147483648); }
        pattern wide(s : Spot, t : Spot) { Spot.n(s, n); Spot.maybe(t, n); } or { Spot.n(s, n); Spot.n(t, n); s != t; }
        """,
        head="adam : Man",
        model=MODEL.replace("n = 2", "n = 5000000000").replace("maybe = 4", "maybe = -9000000000"),
    ),
    "tables of ints of 64 bits": Yard(
        "rule feed(m : Man) { lhs { m : Man; } modify { set m.hunger += 1; } }",
        """
        action feed(m : Man) = feed(m) reward m.at.n * 0.1
        action ask(s : Spot) = nothing() reward s.maybe == none ? 5 : s.maybe
        on find same(m, n) reward n * 0.5
        on find many(n, k) reward n - k
        """,
        """
        pattern same(m : Man, n : int) { Man.at(m, s); Spot.n(s, n); Man.hunger(m, h); check(h * 2000000000 > n); }
        pattern many(n : int, k : int) { Spot.near(_, s); Spot.n(s, n); k == count Spot.n(_, n); }
        """,
        model=MODEL.replace("n = 2", "n = 9223372036854775807")
        .replace("maybe = 4", "maybe = -9223372036854775807")
        .replace("f = 0.1", "f = 0.1 n = -2147483648 near = [s0, s2]"),
    ),
    "operations on strings": Yard(
        """
        rule copy(s : Spot, t : Spot) { lhs { s : Spot; t : Spot; check s.tag + "a" != t.tag + s.kind; }
            modify { set s.tag = t.tag; set s.n = length(s.tag + t.tag) + t.tag.length; } }
        rule upper(s : Spot) { lhs { s : Spot; }
            modify { set s.n = s.tag.toUpper == "B" ? 1 : s.tag.toUpper < "B" ? 2 : 3; } }
        rule mark(s : Spot) { lhs { s : Spot; } modify { set s.tag = "a long one"; } }
        rule cut(s : Spot) { lhs { s : Spot; }
            modify { set s.lit = substring(s.tag, 2) == "long one"; set s.kind = ::ant; } }
        rule clear(s : Spot) { lhs { s : Spot; check startsWith(s.tag, "a"); } modify { set s.tag = none; } }
        """,
        """
        action copy(s : Spot, t : Spot) = copy(s, t)
        action upper(s : Spot) = upper(s)
        action mark(s : Spot) = mark(s)
        action cut(s : Spot) = cut(s)
        action clear(s : Spot) = clear(s) reward indexOf(s.tag, "o") else reward -1
        action compare(s : Spot) = nothing() reward toUpper("c") == s.tag ? 1 : ("c" + s.kind != s.tag ? 2 : 3)
        action ask(s : Spot) = nothing() reward s.tag.contains("o") ? s.tag.length : (s.lit ? 5 : 7)
        on find long(s, t) reward toUpper(t) == "OLD" ? 0.1 : (toString(s.kind) < t ? 0.2 : 0.3)
        on find pair(s, t) reward length(toString(s.kind == ::ant) + t.tag)
        observe count find pair(_, _) up to 12
        """,
        """
        pattern long(s : Spot, t : string) { Spot.tag(s, u); t == eval(u == "a" ? "OLD" : u);
            check(toLower(t) != "c"); }
        pattern pair(a : Spot, b : Spot) { Spot(a); Spot(b);
            check(a.tag + "B" == toUpper(b.tag + "b") || a.tag.isEmpty); }
        """,
    ),
    "enums of branches": Yard(
        "rule turn(s : Spot) { lhs { s : Spot; check (s.lit ? ::ant : s.kind) == s.kind; } "
        "modify { set s.kind = s.kind == (s.n == 0 ? s.kind : ::mole) ? ::mole : ::ant; set s.n -= 1; } }",
        "action turn(s : Spot) = turn(s) reward (s.n < 0 ? ::ant : s.kind) == ::ant ? 1 : 2\n"
        "observe s.kind for s : Spot",
    ),
}

REFUSED = {
    "strings that change": wrong('lhs { s : Spot; } modify { set s.tag = [[s.tag + "x"]]; }'),
    "strings that change | of a rule that adds": wrong('lhs { s : Spot; } modify { [[set s.tag += "x";]] }'),
    "strings that change | of a query": wrong(
        "lhs { s : Spot; t == eval([[s.tag.toUpper]]); } modify { set s.tag = t; }"
    ),
    "a string made of a number": wrong('lhs { s : Spot; check toString([[s.n]]) == "5"; } modify { set s.n = 6; }'),
    "a rule that changes a key (`Spot.x`)": wrong("lhs { s : Spot; } modify { [[set s.x += 1;]] }"),
    "values of `Man.codes` that are not known before they are set": wrong(
        "lhs { m : Man; n == eval(m.hunger + 1); } modify { [[set m.codes += n;]] }"
    ),
    "values of `Man.codes` that are not known before they are set | of an attribute that changes": wrong(
        "lhs { m : Man; } modify { [[set m.codes += m.hunger;]] set m.hunger += 1; }"
    ),
}
