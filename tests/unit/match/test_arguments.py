"""What callers may ask, and what they are told."""

from __future__ import annotations

import pytest

from envgraph.errors import InvalidArgument, TypeMismatch
from envgraph.match import FREE
from tests.unit.match.kinds import KINDS
from tests.unit.match.people import World
from tests.unit.match.writing import check, equal, find, op, path, pattern, value

PATTERNS = (
    pattern("age(a : Person, n : int)", [path("Person.age", "a", "n")]),
    pattern("pay(a : Person, n : float)", [path("Person.pay", "a", "n")]),
    pattern("mood(a : Person, m : Mood)", [path("Person.mood", "a", "m")]),
    pattern("older(a : Person, in n : int)", [path("Person.age", "a", "m"), check("m", ">", "n")]),
    pattern("muchOlder(a : Person, in n : int)", [equal("m", value(op("n", "+", 10))), find("older", "a", "m")]),
)


@pytest.fixture(params=KINDS.values(), ids=KINDS)
def world(request: pytest.FixtureRequest) -> World:
    return World(request.param, *PATTERNS)


def test_an_unknown_pattern_is_named_with_a_hint(world: World) -> None:
    with pytest.raises(InvalidArgument, match="did you mean `age`"):
        world.matcher.rows("agee", (FREE,))
    with pytest.raises(InvalidArgument, match="unknown pattern"):
        world.matcher.prepare("nothing", ())


def test_the_number_of_arguments_is_checked(world: World) -> None:
    with pytest.raises(InvalidArgument, match="takes 2 arguments, but 1 were given"):
        world.matcher.rows("age", (FREE,))
    with pytest.raises(InvalidArgument, match="contains position 2"):
        world.matcher.prepare("age", (2,))


@pytest.mark.parametrize(
    ("pattern", "position", "argument", "wanted"),
    [
        ("age", 0, "ada", "the id of a `Person`"),
        ("age", 0, True, "the id of a `Person`"),
        ("age", 1, 30.0, "`int`"),
        ("age", 1, True, "`int`"),
        ("mood", 1, "wild", "`Mood`"),
        ("pay", 1, "4", "`float`"),
    ],
)
def test_an_argument_of_another_type_is_refused(
    world: World, pattern: str, position: int, argument: object, wanted: str
) -> None:
    arguments: list[object] = [FREE, FREE]
    arguments[position] = argument
    with pytest.raises(TypeMismatch, match=f"takes {wanted}, not {argument!r}"):
        world.matcher.exists(pattern, tuple(arguments))


def test_an_int_may_stand_for_a_float(world: World) -> None:
    assert world.rows("pay", ..., 4) == {("bob", 4.0), ("dan", 4.0)}


def test_an_object_of_another_class_has_no_matches(world: World) -> None:
    assert world.matcher.rows("age", (world.id("red"), FREE)) == []


@pytest.mark.parametrize("gone", [10_000, -1])
def test_an_id_that_no_object_has_has_no_matches(world: World, gone: int) -> None:
    assert world.matcher.rows("age", (gone, FREE)) == []
    assert not world.matcher.exists("age", (gone, FREE))
    assert world.matcher.count("age", (gone, 30)) == 0
    assert world.matcher.first("age", (gone, FREE)) is None


def test_a_deleted_object_has_no_matches(world: World) -> None:
    dan = world.id("dan")
    world.model["dan"].delete(semantics="spo")
    assert world.matcher.rows("age", (dan, FREE)) == []


def test_missing_input_values_are_refused(world: World) -> None:
    assert world.rows("older", ..., 25) == {("ada", 25), ("bob", 25), ("cyd", 25)}
    assert world.rows("muchOlder", ..., 25) == {("ada", 25)}
    assert world.rows("older", "ada", 60) == set()
    for ask in (world.matcher.rows, world.matcher.exists, world.matcher.count, world.matcher.first):
        with pytest.raises(InvalidArgument, match="needs a value for `n`"):
            ask("older", (FREE, FREE))
    with pytest.raises(InvalidArgument, match="needs a value for `n`"):
        world.matcher.prepare("older", (0,))


def test_a_prepared_function_takes_the_values_at_the_bound_positions(world: World) -> None:
    by_age = world.matcher.prepare("age", (1,))
    assert sorted(by_age(30)) == [(world.id("bob"), 30), (world.id("cyd"), 30)]
    assert by_age(31) == []
    both = world.matcher.prepare("age", (0, 1))
    assert both(world.id("dan"), 20) == [(world.id("dan"), 20)]


def test_the_repr_of_the_free_marker_is_its_name() -> None:
    assert repr(FREE) == "FREE"


def test_rows_can_be_read_without_a_copy(world: World) -> None:
    look = world.matcher.prepare_listing("age")
    assert sorted(look()) == sorted(world.matcher.rows("age", (FREE, FREE)))
    world.model["dan"].age = 21
    assert sorted(look()) == sorted(world.matcher.rows("age", (FREE, FREE)))
    assert (world.id("dan"), 21) in look()


def test_membership_of_a_row_can_be_tested(world: World) -> None:
    test, dan = world.matcher.prepare_test("age"), world.id("dan")
    assert test((dan, 20)) and not test((dan, 21))
    world.model["dan"].age = 21
    assert test((dan, 21)) and not test((dan, 20))
    world.model["dan"].delete("spo")
    assert not test((dan, 21))
    assert world.matcher.prepare_test("older")((world.id("ada"), 40))
