"""Objects that rules create: the compiled environment does what the live one does, as long as there is space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, explore
from envgraph.env._too_many import TooManyStates
from envgraph.env.compiled import Batch, CompiledVectorEnv, NotCompiled, enumerated, program_of
from envgraph.errors import EvaluationError
from tests.profile import NIGHTLY
from tests.unit.env.side_by_side import mutants, step_side_by_side
from tests.unit.env.test_compiled_corners import LIKED, LIKES, MANY, STEPS, Corner, refusal, written

BORN = "rule born { lhs { y : Yard; } modify { create y -boxes-> b : Box { size = 4 }; } }\n"
MADE = """
rule make(m : Man, out i : Item) {
    lhs { m -at-> s : Spot; most == max Item.id(_, #); }
    modify { create m -bag-> i : Item { id = most + 1, at = s, weight = 0.5 * most }; }
}
"""
DROP = "@semantics(spo) rule drop { lhs { i : Item; } modify { delete i; } }\n"
GO = "rule go(m : Man, way : Way) { lhs { m -at-> s : Spot; find step(s, way, t); } modify { set m.at = t; } }\n"
SIZES = """
pattern size(b : Box, n : int) { Box.size(b, n); }
pattern sizes(n : int) { n == count Box(_); }
pattern carried(m : Man, i : Item, k : Kind) { Man.bag(m, i); Item.kind(i, k); }
pattern heavy(i : Item, w : float) { Item.weight(i, w); check w > 1.0; }
pattern near(i : Item, j : Item) { Item.at(i, s); Item.at(j, s); }
pattern any(i : Item) { Item(i); }
"""
LOOK = "observe count find size(_, _) up to 9\nobserve count find any(_) up to 9\n"

CORNERS = {
    "boxes are made": Corner(
        BORN
        + """
        rule grow { lhs { b : Box; check b.size < 6; } modify { set b.size += 1; } }
        """,
        "action born = born() reward 1 else reward -1\naction grow = grow() reward 0.5 else reward -0.5\n"
        "on find size(b, n) reward n * 0.01\non find sizes(n) reward n\n" + LOOK,
        SIZES,
    ),
    "items are made and dropped": Corner(
        MADE + DROP + GO,
        "action make(m : Man) = make(m, i) reward i.weight else reward -1\naction drop = drop() reward 0.25\n"
        "action go(way : Way) = go(adam, way)\n"
        "on find carried(m, i, k) reward k == ::mole ? 0.1 : 0.2\non find heavy(_, w) reward w\n"
        "on find near(i, j) reward i.weight * 3.0 - j.weight\n"
        "observe adam.at among Spot or none\nobserve find carried(adam, _, _)\n" + LOOK,
        SIZES,
    ),
    "those that come last go first": Corner(
        MADE
        + """
        @semantics(spo) rule pop { lhs { m == max Item.id(_, #); Item.id(i, m); i : Item; } modify { delete i; } }
        @semantics(spo) rule shift { lhs { m == min Item.id(_, #); Item.id(i, m); i : Item; } modify { delete i; } }
        rule wed { lhs { i : Item; j : Item; check i.id < j.id; neg Item.pair(i, _); neg Item.paired(j, _); }
            modify { create i -pair-> j; } }
        """,
        "action make(m : Man) = make(m, _)\naction pop = pop() reward 1\naction shift = shift() reward 2\n"
        "action wed = wed() reward 4\non find weds(i, j) reward j.id - i.id\nobserve find weds(_, _)\n"
        + LOOK,
        SIZES + "pattern weds(i : Item, j : Item) { Item.pair(i, j); }",
    ),
    "several at once, one inside the other": Corner(
        """
        rule twin(n : Kind) { lhs { y : Yard; s : Spot; most == max Item.id(_, #); }
            modify {
                create y -boxes-> b : Box; create b -item-> i : Heavy { id = most + 1, kind = n };
                create y -items-> j : Item { id = most + 2, at = s, pair = i };
            } }
        rule empty { lhs { y : Yard; b : Box -item-> i : Item; } modify { move i to y.items; } }
        rule wrap { lhs { y : Yard -items-> i : Item; check i.id > 3; }
            modify { create y -boxes-> b : Box { size = i.id }; move i to b.item; } }
        """
        + DROP,
        "action twin(k : Kind) = twin(k) reward 1\naction empty = empty() reward 0.5\n"
        "action wrap = wrap() reward 0.1\naction drop = drop()\n"
        "on find heavies(i) reward i.kind == ::ant ? 1 : 2\n" + LOOK,
        SIZES + "pattern heavies(i : Heavy) { Heavy(i); }",
    ),
    "new objects change their class": Corner(
        MADE
        + DROP
        + """
        rule heavier { lhs { i : Item; neg Heavy(i); } modify { retype i : Heavy; } }
        rule lighter { lhs { i : Heavy; } modify { retype i : Item; } }
        """,
        "action make(m : Man) = make(m, _) reward 1\naction heavier = heavier() reward 2\n"
        "action lighter = lighter() reward 4\naction drop = drop() reward 8\n"
        "observe count find heavies(_) up to 8\n" + LOOK,
        SIZES + "pattern heavies(i : Heavy) { Heavy(i); }",
    ),
    "what is made is wanted, and refused where there is no room": Corner(
        MADE
        + """
        rule want(m : Man) { lhs { m : Man; i : Item; } modify { set m.wants = i; } }
        rule kill { lhs { i : Item; } modify { delete i; } }
        rule sell { lhs { m : Man -bag-> i : Item; y : Yard; } modify { move i to y.items; } }
        """,
        "action make(m : Man) = make(m, i) reward i.id\naction want(m : Man) = want(m)\naction kill = kill()\n"
        "action sell = sell() reward 2\non find wanted(m, i) reward i.weight + m.power\n" + LOOK,
        SIZES + "pattern wanted(m : Man, i : Item) { Man.wants(m, i); }",
    ),
    "arrivals by chance, and each that waits may leave": Corner(
        MADE
        + "@semantics(spo) rule leave(i : Item) { lhs { i : Item; check i.id > 3; } modify { delete i; } }\n",
        "action wait = nothing()\neach step apply 0.4: make(adam, _) | 0.3: make(eve, _)\n"
        "on find late(i) reward -1 apply leave(i)\non reset apply make(adam, _)\n" + LOOK,
        SIZES + "pattern late(i : Item) { Item.id(i, n); check n > 6 && n % 2 == 0; }",
        "adam : Man, eve : Man",
    ),
    "links with many at both ends, of new objects": Corner(
        MADE + DROP + MANY,
        "action make(m : Man) = make(m, _)\naction drop = drop() reward 0.25\n" + LIKES + LOOK,
        SIZES + LIKED,
    ),
    "men and spots that are new": Corner(
        """
        rule dig { lhs { y : Yard; s : Spot; most == max Spot.x(_, #); neg Spot.east(s, _); }
            modify { create y -spots-> t : Spot { x = most + 1, west = s }; } }
        @semantics(spo) rule fill { lhs { s : Spot; neg Spot.east(s, _); check s.x > 2; } modify { delete s; } }
        rule visit { lhs { m : Man; s : Spot; check (s.x + m.hunger) % 2 == 1; } modify { create m -visited-> s; } }
        """,
        "action dig = dig() reward 1\naction fill = fill() reward 2\naction visit = visit()\n"
        "on find seen(m, s) reward m.hunger * 0.1 + s.x\n" + LOOK,
        SIZES + LIKED,
    ),
    "new spots are reached along closures": Corner(
        """
        rule dig { lhs { y : Yard; s : Spot; most == max Spot.x(_, #); neg Spot.east(s, _); }
            modify { create y -spots-> t : Pit { x = most + 1, kind = ::mole, west = s, tag = "new" }; } }
        rule mend { lhs { p : Pit; neg Spot.east(p, _); } modify { retype p : Spot; } }
        """,
        "action dig = dig() reward 1\naction mend = mend() reward 2\n"
        'on find end(s) reward s.x * 0.1\non find named(_, t) reward t == "new" ? 0.01 : 0.02\n' + LOOK,
        SIZES
        + "pattern next(a : Spot, b : Spot) { Spot.east(a, b); }\n"
        + "pattern end(s : Spot) { find next+(_, s); neg find next(s, _); }\n"
        + "pattern named(s : Spot, t : string) { Spot.tag(s, t); }",
    ),
}


@pytest.mark.parametrize("name", CORNERS)
def test_it_steps_as_the_live_engine_does(name: str, tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, CORNERS[name])
    step_side_by_side(mutants(engine, behaviour, 3), behaviour, STEPS, native=False)


@pytest.mark.parametrize(
    "name",
    [
        "arrivals by chance, and each that waits may leave",
        *(["items are made and dropped", "several at once, one inside the other"] if NIGHTLY else []),
    ],
)
def test_compiled_by_numba_too(name: str, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    engine, behaviour = written(tmp_path, CORNERS[name])
    step_side_by_side(mutants(engine, behaviour, 4), behaviour, 4 * STEPS, native=True)


BOUNDED = """
rule born { lhs { y : Yard; n == count Box(_); check n < 4; } modify { create y -boxes-> b : Box { size = n }; } }
rule grow { lhs { b : Box; check b.size < 4; } modify { set b.size += 1; } }
@semantics(spo) rule gone { lhs { b : Box; check b.size == 3; } modify { delete b; } }
rule nested { lhs { b : Box; c : Box; check b.size > c.size; neg Box.inner(c, _); } modify { move c to b.inner; } }
"""
BOXES = "pattern big(b : Box) { Box.size(b, 4); }\npattern boxes(b : Box) { Box(b); }"
BEARS = "action born = born() reward 1\naction grow = grow() reward 0.5\non find big(_) terminate success\n"


@pytest.mark.parametrize(
    "actions", ["", "action gone = gone()\n", "action gone = gone()\naction nest = nested()\n"]
)
def test_a_table_of_states_with_new_objects_is_that_of_the_live_engine(actions: str, tmp_path: Path) -> None:
    rules = BOUNDED.replace("n < 4", "n < 3") if "nest" in actions else BOUNDED
    corner = Corner(rules, actions + BEARS + "observe count find boxes(_) up to 9", BOXES)
    engine, behaviour = written(tmp_path, corner)
    found = enumerated(program_of(engine.copy(), behaviour, native=False, spare=1))
    wanted = explore(engine, behaviour).tabular
    assert found.n_states == wanted.n_states > 20
    for name in ("next_state", "probability", "reward", "terminated", "observation", "allowed"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name))


def test_states_that_differ_by_ids_alone_are_one(tmp_path: Path) -> None:
    rules = BOUNDED.replace("size = n", "size = 3").replace("check b.size < 4", "check b.size > 9")
    body = "action born = 0.7: born() reward 1 else reward -1\naction gone = gone()\n"
    body += "observe count find boxes(_) up to 9"
    engine, behaviour = written(tmp_path, Corner(rules, body, BOXES))
    table = explore(engine, behaviour).tabular
    assert table.n_states == 3
    row, live = EnvgraphEnv(table), EnvgraphLiveEnv(Simulator(engine, behaviour))
    assert row.reset(seed=2)[0] == live.reset(seed=2)[0]
    for action in np.random.default_rng(0).integers(2, size=100).tolist():
        assert row.step(action)[:3] == live.step(action)[:3]


def test_where_objects_have_no_bound_there_are_too_many_states(tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, Corner(BORN, "action born = born()\nobserve adam.kind"))
    program = program_of(engine, behaviour, native=False, spare=2)
    with pytest.raises(TooManyStates, match="let the rules ask how many there are"):
        explore(engine, behaviour, limit=20)
    with pytest.raises(TooManyStates):
        enumerated(program, limit=20)


CROWD = """
rule many { lhs { y : Yard; } forall { lhs { s : Spot; m : Man; }
    modify { create y -boxes-> b : Box { size = s.x }; } } modify { } }
"""


def test_more_new_objects_in_a_step_than_there_is_space_for_are_an_error(tmp_path: Path) -> None:
    engine, behaviour = written(tmp_path, Corner(CROWD, "action many = many()\nobserve adam.kind"))
    batch = Batch(program_of(engine, behaviour, native=False, spare=5), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    with pytest.raises(EvaluationError, match="more objects in one step than there is space for"):
        batch.step(np.zeros(1, dtype=np.int64), again=False)


def test_the_space_grows_with_what_rules_create(tmp_path: Path) -> None:
    rules = MADE + DROP + BORN + "rule grow { lhs { b : Box; } modify { set b.size += 1; } }\n"
    body = "action born = born() reward 1\naction grow = grow()\naction make(m : Man) = make(m, _)\n"
    body += "action drop = drop()\non find size(_, n) reward n * 0.5\nlimit 120 steps\n" + LOOK
    engine, behaviour = written(tmp_path, Corner(rules, body, SIZES))
    program = step_side_by_side(mutants(engine, behaviour, 3), behaviour, STEPS, native=False, spare=2)
    batch = Batch(program, [0, 2, 0])
    batch.seed([np.random.default_rng(number) for number in range(3)])
    batch.reset(np.ones(3, dtype=np.bool_))
    for _ in range(40):
        batch.step(np.zeros(3, dtype=np.int64), again=False)
    assert program.spare == 2
    assert batch.program.spare == 128
    assert batch.steps.tolist() == [40, 40, 40]


def test_a_vector_goes_on_where_its_space_has_grown(tmp_path: Path) -> None:
    body = "action born = born() reward 1\naction rest = born() else reward 0\nlimit 120 steps\n" + LOOK
    engine, behaviour = written(tmp_path, Corner(BORN, body, SIZES))
    many = CompiledVectorEnv(program_of(engine, behaviour, native=False, spare=2), 2, max_episode_steps=30)
    many.reset(seed=0)
    found = [many.step(np.zeros(2, dtype=np.int64)) for _ in range(32)]
    assert [step[-1]["step"].tolist() for step in found[-4:]] == [[29, 29], [30, 30], [0, 0], [1, 1]]


def test_what_goes_leaves_its_space_to_what_comes(tmp_path: Path) -> None:
    corner = Corner(
        MADE + DROP, "action make = make(adam, _) else reward -1\naction drop = drop()\nobserve adam.kind"
    )
    engine, behaviour = written(tmp_path, corner)
    batch = Batch(program_of(engine, behaviour, native=False, spare=2), [0])
    batch.seed([np.random.default_rng(0)])
    batch.reset(np.ones(1, dtype=np.bool_))
    drop, make = np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    for _ in range(8):
        batch.step(drop, again=False)
    states = set()
    for _ in range(6):
        batch.step(make, again=False)
        batch.step(drop, again=False)
        states.add(tuple(batch.states[0].tolist()))
    assert len(states) == 1


@pytest.mark.parametrize("observed", ["observe i.kind for i : Item", "observe adam.wants among Item or none"])
def test_new_objects_have_no_index(observed: str, tmp_path: Path) -> None:
    refused = refusal(tmp_path, Corner(MADE, f"action make = make(adam, _)\n{observed}"))
    assert refused.construct == "objects with a key that a rule creates (`Item`)"
    assert "yard.rules" in str(refused.span)


def test_new_objects_without_a_key_have_none_that_other_members_know(tmp_path: Path) -> None:
    engine, behaviour = written(
        tmp_path, Corner(BORN, "action born = born()\nobserve b.size in 0..5 for b : Box")
    )
    step_side_by_side([engine], behaviour, 20, native=False)
    other = engine.copy()
    other.apply("yard.newItem", other.matches("yard.newItem")[0])
    other.apply("yard.newBox", other.matches("yard.newBox")[0])
    with pytest.raises(NotCompiled, match="objects without a key that rules create"):
        step_side_by_side([engine, other], behaviour, 20, native=False)
