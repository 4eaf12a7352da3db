"""Each family of derived operators: names, where they match, what they do.

The operators on a reference `A.e -> B` with bounds `n..m` and an opposite with `k..l` are compared with the scheme of
Burdusel, Zschaler and John (2021), written down here once more, on all models of three `A` and two `B`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain, combinations, permutations, product

import pytest

from envgraph.errors import has_errors
from envgraph.graph import Model, Node, check_conformance
from envgraph.metamodel import Annotation, Reference
from envgraph.pattern import Derivation
from envgraph.rewrite import (
    Engine,
    derived_rules,
)
from tests.unit.rewrite.test_derive_operators import engine, metamodel, names

Bounds = tuple[int, int | None]
Links = frozenset[tuple[int, int]]

BOUNDS: tuple[Bounds, ...] = ((0, 1), (1, 1), (0, None), (1, 2), (1, None), (2, 2))
SOURCES, TARGETS = (0, 1, 2), (3, 4)


def text_of(bounds: Bounds) -> str:
    lower, upper = bounds
    return f"[{lower}..{'*' if upper is None else upper}]"


# --- the scheme


class Scheme:
    """Who may do what, for a set of links from sources to targets."""

    def __init__(self, links: Links, outer: Bounds, inner: Bounds) -> None:
        self.links = links
        (self.n, self.m), (self.k, self.l) = outer, inner

    def out(self, source: int) -> int:
        return sum(one == source for one, _ in self.links)

    def into(self, target: int) -> int:
        return sum(one == target for _, one in self.links)

    @property
    def valid(self) -> bool:
        outer = all(self.n <= self.out(a) <= (self.m or 9) for a in SOURCES)
        return outer and all(self.k <= self.into(b) <= (self.l or 9) for b in TARGETS)

    def room(self, a: int) -> bool:
        return self.m is None or self.out(a) < self.m

    def welcome(self, b: int) -> bool:
        return self.l is None or self.into(b) < self.l

    def add(self) -> Iterator[tuple[int, ...]]:
        for a, b in product(SOURCES, TARGETS):
            if (a, b) not in self.links and self.room(a) and self.welcome(b):
                yield a, b

    def remove(self) -> Iterator[tuple[int, ...]]:
        for a, b in self.links:
            if self.out(a) > self.n and self.into(b) > self.k:
                yield a, b

    def change_source(self) -> Iterator[tuple[int, ...]]:
        for (a, b), other in product(self.links, SOURCES):
            if (other, b) not in self.links and self.out(a) > self.n and self.room(other):
                yield a, b, other

    def change_target(self) -> Iterator[tuple[int, ...]]:
        for (a, b), other in product(self.links, TARGETS):
            if (a, other) not in self.links and self.into(b) > self.k and self.welcome(other):
                yield a, b, other

    def swap(self) -> Iterator[tuple[int, ...]]:
        for (a, b), (c, d) in product(self.links, self.links):
            if a != c and b != d and (a, d) not in self.links and (c, b) not in self.links:
                yield a, b, c, d

    def delete(self) -> Iterator[tuple[int, ...]]:
        for a in SOURCES:
            if all(self.into(b) > self.k for one, b in self.links if one == a):
                yield (a,)

    def rehome(self) -> Iterator[tuple[int, ...]]:
        for a, other in product(SOURCES, SOURCES):
            needy = {b for one, b in self.links if one == a and self.into(b) == self.k}
            fits = self.m is None or self.out(a) + self.out(other) <= self.m
            if a != other and fits and not any((other, b) in self.links for b in needy):
                yield a, other

    def share(self) -> Iterator[tuple[int, ...]]:
        """As rehoming, but one of two or more that need it goes to a third."""
        for a, other, third in permutations(SOURCES):
            needy = [b for one, b in self.links if one == a and self.into(b) == self.k]
            fits = self.m is None or self.out(a) - 1 + self.out(other) <= self.m
            for moved, second in permutations(needy, 2):
                rest = any((other, b) in self.links for b in needy if b != moved)
                if fits and not rest and self.room(third) and (third, moved) not in self.links:
                    yield a, other, third, moved, second

    def create(self) -> Iterator[tuple[int, ...]]:
        """A new source with the `n` targets that it needs, all of them there and with room."""
        for targets in combinations(TARGETS, self.n):
            if all(map(self.welcome, targets)):
                yield targets

    def steal(self) -> Iterator[tuple[int, ...]]:
        """A new source takes its one target from another that keeps enough."""
        for a, b in self.links:
            if self.out(a) > self.n:
                yield a, b


EXPECTED: dict[str, Callable[[Scheme], Iterator[tuple[int, ...]]]] = {
    "add.A.e": Scheme.add,
    "remove.A.e": Scheme.remove,
    "change.A.e.source": Scheme.change_source,
    "change.A.e.target": Scheme.change_target,
    "swap.A.e": Scheme.swap,
    "delete.A": Scheme.delete,
    "delete.A.rehoming": Scheme.rehome,
    "delete.A.spreading.e.all": Scheme.share,
    "create.A": Scheme.create,
    "create.A.stealing.e": Scheme.steal,
}


def expected_names(outer: Bounds, inner: Bounds) -> set[str]:
    """Those of the names above that there are."""
    (n, m), (k, most) = outer, inner
    flexible, wanted = n != m, k != most
    found = {"swap.A.e", "delete.A"}
    found |= {"add.A.e", "remove.A.e"} if flexible and wanted else set()
    found |= {"change.A.e.source"} if flexible else set()
    found |= {"change.A.e.target"} if wanted else set()
    found |= {"delete.A.rehoming"} if k and (m is None or 2 * n <= m) else set()
    found |= {"delete.A.spreading.e.all"} if k and (m is None or 2 * n <= m + 1) else set()
    found |= {"create.A"} if n == 0 or wanted else set()
    found |= {"create.A.stealing.e"} if n == 1 and flexible and most is not None else set()
    return found


def arrange(model: Model, links: Links) -> None:
    feature = model.metamodel.feature("A", "e")
    assert isinstance(feature, Reference)
    for a, b in sorted(links):
        model.graph.link(a, feature, b)


@pytest.mark.parametrize("inner", BOUNDS, ids=text_of)
@pytest.mark.parametrize("outer", BOUNDS, ids=text_of)
def test_reference_operators_follow_the_derivation_scheme(outer: Bounds, inner: Bounds) -> None:
    text = f"""
    class A {{ refers B{text_of(outer)} e opposite f }}
    class B {{ refers A{text_of(inner)} f opposite e }}
    """
    made = engine(text, "A")
    for cls in "AAABB":
        made.model.create(cls)
    there = {name.removeprefix("d.") for name in made.rules}
    assert there & set(EXPECTED) == expected_names(outer, inner)
    pairs = list(product(SOURCES, TARGETS))
    for chosen in chain.from_iterable(combinations(pairs, size) for size in range(len(pairs) + 1)):
        scheme = Scheme(frozenset(chosen), outer, inner)
        if not scheme.valid:
            continue
        savepoint = made.model.graph.history.savepoint()
        arrange(made.model, scheme.links)
        for name in sorted(there & set(EXPECTED)):
            matches = made.matches(f"d.{name}")
            rows = [tuple(value.id for value in match.values() if isinstance(value, Node)) for match in matches]
            if name == "create.A":
                rows = sorted({tuple(sorted(row)) for row in rows})  # targets in any order
            assert sorted(rows) == sorted(EXPECTED[name](scheme)), (name, chosen)
        for name in made.rules:
            for match in made.matches(name)[:2]:
                before = made.model.graph.history.savepoint()
                made.apply(name, match)
                assert check_conformance(made.model) == [], (name, match)
                made.model.graph.history.rollback(before)
        made.model.graph.history.rollback(savepoint)


def only_match(made: Engine, name: str) -> dict[str, int]:
    """The one match of an operator, objects as ids."""
    (match,) = made.matches(name)
    return dict(zip(match.names, match.row, strict=True))


def applied(made: Engine, name: str) -> None:
    """Apply an operator, which leaves the model valid."""
    assert made.apply(f"d.{name}") is not None
    assert check_conformance(made.model) == []
    made.check_integrity()


# --- create


def test_creation_operators_satisfy_lower_bounds() -> None:
    made = engine("class A { refers B[2] e refers B[0..1] f } class B class C { contains A[0..2] parts }", "A")
    assert [name for name in made.rules if "create" in name] == ["d.create.A.parts"]
    home = made.model.create("C")
    one = made.model.create("B")
    assert not made.exists("d.create.A.parts"), "two different targets"
    two = made.model.create("B")
    for _ in range(2):
        applied(made, "create.A.parts")
    assert not made.exists("d.create.A.parts"), "the container is full"
    assert [set(node.e) for node in home.parts] == [{one, two}] * 2 and home.parts[0].f is None


def test_creation_operators_create_required_contents() -> None:
    made = engine("class Car { contains Wheel[4] wheels } class Wheel", "Car")
    assert not [name for name in made.rules if "create" in name], "five objects at once are too many"
    made = engine("class Cart { contains Wheel[2] wheels } class Wheel", "Cart")
    applied(made, "create.Cart.with.Wheel.Wheel")
    assert [len(cart.wheels) for cart in made.model.nodes("Cart")] == [2]
    applied(made, "delete.Cart")
    assert len(made.model) == 0


def test_creation_between_two_linked_objects() -> None:
    made = engine("class T { refers T[1] next opposite prev refers T[1] prev opposite next }", "T")
    lone = made.model.create("T")
    lone.next = lone
    applied(made, "create.T.stealing.next")
    one, two = made.model.nodes("T")
    assert (one.next, two.next) == (two, one)


def test_donors_keep_their_lower_bounds() -> None:
    text = "class A { refers B[2..*] e opposite f } class B { refers A[1] f opposite e }"
    made = engine(text, "A")
    home = made.model.create("A")
    home.e = [made.model.create("B") for _ in range(3)]
    assert not [name for name in made.rules if "create" in name and made.exists(name) and "with" not in name]
    home.e.append(made.model.create("B"))
    name = next(name for name in made.rules if name.startswith("d.create.A.stealing") and made.exists(name))
    applied(made, name.removeprefix("d."))
    assert sorted(len(node.e) for node in made.model.nodes("A")) == [2, 2]


@pytest.mark.parametrize(
    ("key", "free"),
    [
        ("@key(s) class A { string s }", 3),
        ("@key(n) class A { int n }", 3),
        ("@key(c) class A { C c } enum C { red, green }", 2),
        ("@key(b) class A { bool b = true }", 2),
        ("@key(c, b) class A { C c bool b } enum C { red, green }", 4),
        ("@key(f) class A { float f = 2.5 }", 4),
        ("@key(f, b) class A { float f bool b }", 4),
        ("@key(s, n) class A { string s int n }", 3),
        ("@key(n) class A { int n } class B extends A", 3),
    ],
)
def test_created_objects_get_unused_keys(key: str, free: int) -> None:
    made = engine(key, "A")
    for _ in range(free):
        applied(made, "create.A")
    assert made.exists("d.create.A") is (" s" in key or " n" in key or " f" in key)
    keys = [tuple(getattr(node, name) for name in made.model.metamodel.key("A")) for node in made.model.nodes("A")]
    assert len(set(keys)) == len(keys) == free


def test_each_free_key_of_literals_and_truth_values_may_be_taken() -> None:
    made = engine("@key(c, b) class A { C c bool b } enum C { red, green }", "A")
    made.model.create("A", c="green", b=True)
    keys = {(match.c, match.b) for match in made.matches("d.create.A")}
    assert keys == {("red", False), ("red", True), ("green", False)}


def test_objects_that_come_together_have_different_keys_of_literals() -> None:
    made = engine("@key(c, b) class A { C c bool b } enum C { red, green } class B { contains A[2] e }", "B")
    applied(made, "create.B.with.A.A")
    applied(made, "create.B.with.A.A")
    assert sorted((node.c, node.b) for node in made.model.nodes("A")) == [
        ("green", False), ("green", True), ("red", False), ("red", True)
    ]  # fmt: skip
    assert not made.exists("d.create.B.with.A.A")


def test_a_key_of_too_many_literals_is_that_of_the_defaults() -> None:
    enum = f"enum C {{ {', '.join(f'l{number}' for number in range(65))} }}"
    made = engine(f"@key(c) class A {{ C c }} {enum}", "A")
    applied(made, "create.A")
    assert not made.exists("d.create.A")
    made = engine(f"@key(c) class A {{ C c }} class B {{ contains A[2] e }} {enum}", "B")
    assert not made.exists("d.create.B.with.A.A"), "both would have that of the defaults"


def test_float_keys_are_not_increased_beyond_their_limit() -> None:
    made = engine("@key(f) class A { float f }", "A")
    made.model.create("A", f=1e300)
    assert not made.exists("d.create.A")


# --- delete


def test_deletion_operators_refuse_required_objects() -> None:
    made = engine("class A class B { refers A[1..2] e }", "A")
    one, two = made.model.create("A"), made.model.create("A")
    user = made.model.create("B", e=[one])
    assert [match.a.id for match in made.matches("d.delete.A")] == [two.id]
    user.e.append(two)
    assert made.count("d.delete.A") == 2
    applied(made, "delete.A")
    assert len(user.e) == 1 and not made.exists("d.delete.A")


def test_rehoming_changes_only_sources_that_need_a_new_target() -> None:
    made = engine("class A class B { refers A[1..*] e }", "A")
    one, two, three = (made.model.create("A") for _ in range(3))
    needs, free = made.model.create("B", e=[one]), made.model.create("B", e=[one, three])
    made.apply("d.delete.A.rehoming", a=one, other=two)
    assert [*needs.e] == [two] and [*free.e] == [three]


def test_spreading_distributes_targets_of_a_deleted_object() -> None:
    text = "class A { refers B[2..4] e opposite f } class B { refers A[1] f opposite e }"
    made = engine(text, "A")
    spreading = [name for name in made.rules if ".spreading." in name and not name.endswith(".all")]
    assert spreading == ["d.delete.A.spreading.e.e", "d.delete.A.spreading.e.e.2"]
    homes = [made.model.create("A") for _ in range(3)]
    for home, size in zip(homes, (2, 3, 3), strict=True):
        home.e = [made.model.create("B") for _ in range(size)]
    assert check_conformance(made.model) == []
    assert not made.exists("d.delete.A")
    one_receiver, two_receivers = (
        {match.a.id for match in made.matches(name)} for name in sorted(spreading, key=made.count)
    )
    assert one_receiver == set() and two_receivers == {homes[0].id}, "three and two are more than four"
    applied(made, max(spreading, key=made.count).removeprefix("d."))
    assert [len(home.e) for home in homes[1:]] == [4, 4]


def test_targets_that_need_an_object_are_spread_where_nobody_has_room_for_all() -> None:
    text = "class A { refers B[0..3] e opposite f } class B { refers A[1] f opposite e }"
    made = engine(text, "A")
    homes = [made.model.create("A") for _ in range(3)]
    for home, size in zip(homes, (3, 1, 2), strict=True):
        home.e = [made.model.create("B") for _ in range(size)]
    assert {match.a for match in made.matches("d.delete.A.rehoming")} == {homes[1], homes[2]}
    assert made.exists("d.delete.A.spreading.e.all", a=homes[0])
    assert not made.exists("d.delete.A.spreading.e.all", a=homes[0], other=homes[2])
    made.apply("d.delete.A.spreading.e.all", a=homes[0])
    assert [len(home.e) for home in homes[1:]] == [3, 3] and check_conformance(made.model) == []


# --- add, remove, change, swap


def test_references_without_an_opposite_have_no_bound_on_the_other_side() -> None:
    made = engine("class A { refers B[1..2] e } class B", "A")
    a, one, two = made.model.create("A"), made.model.create("B"), made.model.create("B")
    a.e = [one]
    assert only_match(made, "d.add.A.e") == {"source": a.id, "target": two.id}
    assert not made.exists("d.remove.A.e")
    assert only_match(made, "d.change.A.e.target") == {"source": a.id, "target": one.id, "other": two.id}
    applied(made, "change.A.e.target")
    assert [*a.e] == [two]
    applied(made, "add.A.e")
    assert made.count("d.remove.A.e") == 2 and not made.exists("d.add.A.e")


def test_an_object_may_be_linked_to_itself() -> None:
    made = engine("class A { refers A[0..1] e }", "A")
    one = made.model.create("A")
    assert only_match(made, "d.add.A.e") == {"source": one.id, "target": one.id}
    applied(made, "add.A.e")
    assert one.e == one


def test_symmetric_references_have_swap_joining_and_parting_operators() -> None:
    made = engine("class A { refers A[1] e opposite e }", "A")
    assert [name for name in made.rules if "swap" in name] == [
        "d.swap.A.e",
        "d.swap.A.e.joining",
        "d.swap.A.e.parting",
    ]
    one, two = made.model.create("A"), made.model.create("A")
    one.e, two.e = one, two
    applied(made, "swap.A.e.joining")
    assert (one.e, two.e) == (two, one)
    applied(made, "swap.A.e.parting")
    assert (one.e, two.e) == (one, two)


def test_operators_include_references_of_subclasses() -> None:
    text = "abstract class Thing class A extends Thing { refers B[0..1] e } class B"
    assert {"d.add.A.e", "d.remove.A.e", "d.swap.A.e"} < set(names(text, "Thing"))
    assert [name for name in names(text, "B") if ".e" in name] == [], "`B` has no such feature"


# --- move, swap of containers


def test_parts_move_into_containers_with_room_from_those_that_can_spare_them() -> None:
    made = engine("class Box { contains Ball[1..2] balls } class Ball", "Ball")
    boxes = [made.model.create("Box") for _ in range(3)]
    for box, size in zip(boxes, (1, 2, 2), strict=True):
        box.balls = [made.model.create("Ball") for _ in range(size)]
    moves = {(match.part.container.id, match.container.id) for match in made.matches("d.move.Ball.balls")}
    assert moves == {(1, 0), (2, 0)}
    applied(made, "move.Ball.balls")
    swaps = {(match.container.id, match.container2.id) for match in made.matches("d.swap.Ball.balls")}
    assert swaps == set(product(range(3), range(3))) - {(n, n) for n in range(3)}
    first = boxes[0].balls[0]
    made.apply("d.swap.Ball.balls", part=first)
    assert first.container != boxes[0] and check_conformance(made.model) == []


def test_containers_of_another_kind_are_containers() -> None:
    text = """
    class Box { contains Ball[0..1] balls }
    class Bag { contains Ball[0..1] content }
    class Ball
    """
    made = engine(text, "Ball")
    assert {"d.move.Ball.balls", "d.move.Ball.content"} < set(made.rules)
    box, bag, ball = made.model.create("Box"), made.model.create("Bag"), made.model.create("Ball")
    box.balls = ball
    applied(made, "move.Ball.content")
    assert bag.content == ball and box.balls is None


# --- retype


def test_retyping_keeps_container_and_links_that_the_new_class_has() -> None:
    text = """
    class Maze { contains Cell[0..*] cells }
    abstract class Cell { refers Cell[0..1] next }
    class Floor extends Cell { refers Mark[0..1] mark }
    class Wall extends Cell
    @frozen class Ice extends Cell
    class Mark
    class Owner { refers Wall[1] wall }
    """
    made = engine(text, "Cell")
    assert {name for name in made.rules if "retype" in name} == {"d.retype.Floor.Wall", "d.retype.Wall.Floor"}
    maze, floor, ice = made.model.create("Maze"), made.model.create("Floor"), made.model.create("Ice")
    maze.cells = [floor, ice]
    floor.next = ice
    floor.mark = made.model.create("Mark")
    applied(made, "retype.Floor.Wall")
    assert (floor.cls, floor.container, floor.next) == ("Wall", maze, ice)
    made.model.create("Owner", wall=floor)
    assert not made.exists("d.retype.Wall.Floor"), "somebody needs a wall"


# --- set


def test_operators_set_attributes() -> None:
    text = """
    enum Colour { red, green, blue }
    @key(number)
    class A {
        int number
        bool on
        Colour colour
        string label
        @range(0, 3) int level
        @range(0.0, 1.0, step = 0.25) float share
        @frozen bool fixed
        @derived bool worked_out
        int free
    }
    """
    made = engine(text, "A")
    assert [name.removeprefix("d.set.A.") for name in made.rules if ".set." in name] == [
        *("on", "colour.red", "colour.green", "colour.blue"),
        *("level.up", "level.down", "share.up", "share.down"),
    ]
    node = made.model.create("A")
    assert [name for name in made.rules if ".set." in name and not made.exists(name)] == [
        "d.set.A.colour.red",
        "d.set.A.level.down",
        "d.set.A.share.down",
    ]
    for name in ("on", "colour.blue", "level.up", "share.up"):
        applied(made, f"set.A.{name}")
    assert (node.on, node.colour, node.level, node.share) == (True, "blue", 1, 0.25)


# --- what is left alone


def test_frozen_objects_are_not_created_deleted_or_changed() -> None:
    text = """
    class Town { contains House[0..*] houses }
    class House { bool lit refers House[0..*] near }
    @frozen class Castle extends House { refers House[1] gate }
    """
    made = engine(
        text,
        "Town",
    )
    made.add(Derivation("h", "operators", ("House",)))
    assert not [name for name in made.rules if ".Castle" in name]
    town, house, castle = made.model.create("Town"), made.model.create("House"), made.model.create("Castle")
    town.houses = [house, castle]
    castle.gate = house
    castle.near = [house]
    found = {name: made.count(name) for name in made.rules if made.exists(name)}
    assert set(found) == {"d.create.Town", "h.create.House.houses", "h.set.House.lit", "h.add.House.near"}
    assert {match.source.id for match in made.matches("h.add.House.near")} == {house.id}


# --- weights, caps


def test_a_kind_has_its_weight_however_many_rules_it_has() -> None:
    text = "class A { bool b bool c Colour d } enum Colour { red, green }"
    made = derived_rules(
        Derivation(
            "d",
            "operators",
            ("A",),
            weight=2.0,
            annotations=(Annotation("weight", (2.0,), (("set", 3.0), ("delete", 0.0))),),
        ),
        metamodel(text),
    )
    weights = {rule.name: rule.weight for rule in made}
    assert weights == {
        "d.create.A": 2.0,
        **dict.fromkeys(("d.set.A.b", "d.set.A.c", "d.set.A.d.red", "d.set.A.d.green"), 0.75),
    }


def capped(text: str, *cap: object, **caps: object) -> list[str]:
    annotation = Annotation("cap", tuple(cap), tuple(caps.items()))  # type: ignore[arg-type]
    made = Derivation("d", "operators", ("Top",), annotations=(annotation,))
    problems = Engine(Model(metamodel(text))).check(made)
    assert not has_errors(problems), problems
    return [rule.name.removeprefix("d.") for rule in derived_rules(made, metamodel(text))]


TWO = """
abstract class Top
class A extends Top { refers B[1..*] e opposite f bool on }
class B extends Top { refers A[1] f opposite e bool on bool off }
"""


def test_caps_of_kinds_take_some_of_each_class() -> None:
    everything = capped(TWO, 8)
    creating = [name for name in everything if name.startswith("create")]
    assert len([name for name in creating if name.startswith("create.A")]) > 1
    assert [name for name in capped(TWO, create=2) if "create" in name] == [
        next(name for name in creating if name.startswith(f"create.{cls}")) for cls in "AB"
    ]
    assert [name for name in capped(TWO, set=2) if "set." in name] == ["set.A.on", "set.B.on"]
    assert [name for name in capped(TWO, 1, set=9) if "set." in name] == ["set.A.on", "set.B.on", "set.B.off"]
    assert capped(TWO, swap=5) == everything


def test_weights_are_shared_by_the_remaining_rules() -> None:
    annotations = (Annotation("cap", (), (("set", 2),)),)
    made = derived_rules(Derivation("d", "operators", ("Top",), annotations=annotations), metamodel(TWO))
    assert [rule.weight for rule in made if ".set." in rule.name] == [0.5, 0.5]


@pytest.mark.parametrize(
    ("cap", "message"),
    [
        (Annotation("cap"), "`@cap` takes one whole number above 0, or numbers for kinds of operators"),
        (
            Annotation("cap", (2, 3)),
            "`@cap` takes one whole number above 0, or numbers for kinds of operators",
        ),
        (
            Annotation("cap", (True,)),
            "`@cap` takes one whole number above 0, or numbers for kinds of operators",
        ),
        (Annotation("cap", (), (("swop", 2),)), "`swop` is not a kind of operators"),
        (Annotation("cap", (), (("swap", 0),)), "the cap of `swap` is 0, but must be a whole number above 0"),
        (
            Annotation("cap", (), (("swap", 1.5),)),
            "the cap of `swap` is 1.5, but must be a whole number above 0",
        ),
    ],
)
def test_wrong_caps_are_reported(cap: Annotation, message: str) -> None:
    made = Derivation("d", "operators", ("A",), annotations=(cap,))
    assert [one.message for one in Engine(Model(metamodel("class A { bool b }"))).check(made)] == [message]
