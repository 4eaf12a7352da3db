"""Objects that rules create: tables of states that have them, and the space that programs have for them."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, Simulator, TooManyStates, explore
from envgraph.env._observation_spaces import split_index
from envgraph.env.compiled import CompiledBatch, CompiledVectorEnv, enumerate_states, program_of
from envgraph.errors import EvaluationError
from tests.unit.env.corners.creation import BORN, DROP, LOOK, MADE, SIZES
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import family_keys, mutants, step_side_by_side

BOUNDED = """
rule born { lhs { y : Yard; n == count Box(_); check n < 4; } modify { create y -boxes-> b : Box { size = n }; } }
rule grow { lhs { b : Box; check b.size < 4; } modify { set b.size += 1; } }
@semantics(spo) rule gone { lhs { b : Box; check b.size == 3; } modify { delete b; } }
rule nested { lhs { b : Box; c : Box; check b.size > c.size; neg Box.inner(c, _); } modify { move c to b.inner; } }
"""
BOXES = "pattern big(b : Box) { Box.size(b, 4); }\npattern boxes(b : Box) { Box(b); }"
BEARS = "action born = born() reward 1\naction grow = grow() reward 0.5\non find big(_) terminate success\n"


@pytest.mark.parametrize("actions", ["", "action gone = gone()\n", "action gone = gone()\naction nest = nested()\n"])
def test_compiled_table_with_created_objects_equals_that_of_the_live_engine(actions: str) -> None:
    rules = BOUNDED.replace("n < 4", "n < 3") if "nest" in actions else BOUNDED
    corner = Yard(rules, actions + BEARS + "observe count find boxes(_) up to 9", BOXES)
    engine, behaviour = corner.opened()
    found = enumerate_states(program_of(engine.copy(), behaviour, native=False, spare=1))
    wanted = explore(engine, behaviour).tabular
    assert found.n_states == wanted.n_states > 20
    for name in ("next_state", "probability", "reward", "terminated", "observation", "allowed"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name))


def test_states_that_differ_only_in_object_ids_are_equal() -> None:
    rules = BOUNDED.replace("size = n", "size = 3").replace("check b.size < 4", "check b.size > 9")
    body = "action born = 0.7: born() reward 1 else reward -1\naction gone = gone()\n"
    body += "observe count find boxes(_) up to 9"
    engine, behaviour = Yard(rules, body, BOXES).opened()
    table = explore(engine, behaviour).tabular
    assert table.n_states == 3
    row, live = EnvgraphEnv(table), EnvgraphLiveEnv(Simulator(engine, behaviour))
    assert row.reset(seed=2)[0] == live.reset(seed=2)[0]
    for action in np.random.default_rng(0).integers(2, size=100).tolist():
        assert row.step(action)[:3] == live.step(action)[:3]


def test_unbounded_object_creation_raises_too_many_states() -> None:
    engine, behaviour = Yard(BORN, "action born = born()\nobserve adam.kind").opened()
    program = program_of(engine, behaviour, native=False, spare=2)
    with pytest.raises(TooManyStates, match="let their patterns limit the number"):
        explore(engine, behaviour, limit=20)
    with pytest.raises(TooManyStates):
        enumerate_states(program, limit=20)


CROWD = """
rule many { lhs { y : Yard; } forall { lhs { s : Spot; m : Man; }
    modify { create y -boxes-> b : Box { size = s.x }; } } modify { } }
"""


def test_step_that_creates_more_objects_than_fit_into_a_state_is_an_error() -> None:
    engine, behaviour = Yard(CROWD, "action many = many()\nobserve adam.kind").opened()
    batch = CompiledBatch(program_of(engine, behaviour, native=False, spare=5), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    with pytest.raises(EvaluationError, match="too many objects in one step"):
        batch.step(np.zeros(1, dtype=np.int64), resets_ended=False)


def test_pattern_of_three_objects_with_space_for_too_many_is_an_error() -> None:
    three = "pattern three(a : Spot, b : Spot, c : Spot) { Spot.east(a, b); Spot.east(b, c); }"
    body = "action born = born()\non neg find three(s0, s1, s3) reward 1\nobserve s0.lit"
    engine, behaviour = Yard(BORN, body, three, head="s0 : Spot, s1 : Spot, s3 : Spot").opened()
    assert program_of(engine, behaviour, native=False, spare=20).members.spare == 20
    with pytest.raises(EvaluationError, match=r"a table of \d\d\d,\d\d\d,\d\d\d entries is too large"):
        program_of(engine, behaviour, native=False, spare=700)


def test_space_of_a_state_grows_when_rules_create_objects() -> None:
    rules = MADE + DROP + BORN + "rule grow { lhs { b : Box; } modify { set b.size += 1; } }\n"
    body = "action born = born() reward 1\naction grow = grow()\naction make(m : Man) = make(m, _)\n"
    body += "action drop = drop()\non find size(_, n) reward n * 0.5\nlimit 120 steps\n" + LOOK
    engine, behaviour = Yard(rules, body, SIZES).opened()
    program = step_side_by_side(mutants(engine, behaviour, 3), behaviour, 100, native=False, spare=2)
    batch = CompiledBatch(program, [0, 2, 0])
    batch.seed([np.random.default_rng(number) for number in range(3)])
    batch.reset(np.ones(3, dtype=np.bool_))
    for _ in range(40):
        batch.step(np.zeros(3, dtype=np.int64), resets_ended=False)
    assert program.members.spare == 2
    assert batch.program.members.spare == 128
    assert batch.steps.tolist() == [40, 40, 40]


def test_vector_episodes_continue_after_the_space_of_states_has_grown() -> None:
    body = "action born = born() reward 1\naction rest = born() else reward 0\nlimit 120 steps\n" + LOOK
    engine, behaviour = Yard(BORN, body, SIZES).opened()
    many = CompiledVectorEnv(program_of(engine, behaviour, native=False, spare=2), 2, max_episode_steps=30)
    many.reset(seed=0)
    found = [many.step(np.zeros(2, dtype=np.int64)) for _ in range(32)]
    assert [step[-1]["step"].tolist() for step in found[-4:]] == [[29, 29], [30, 30], [0, 0], [1, 1]]


def test_created_objects_reuse_the_space_of_deleted_objects() -> None:
    corner = Yard(MADE + DROP, "action make = make(adam, _) else reward -1\naction drop = drop()\nobserve adam.kind")
    engine, behaviour = corner.opened()
    batch = CompiledBatch(program_of(engine, behaviour, native=False, spare=2), [0])
    batch.seed([np.random.default_rng(0)])
    batch.reset(np.ones(1, dtype=np.bool_))
    drop, make = np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    for _ in range(8):
        batch.step(drop, resets_ended=False)
    states = set()
    for _ in range(6):
        batch.step(make, resets_ended=False)
        batch.step(drop, resets_ended=False)
        states.add(tuple(batch.states[0].tolist()))
    assert len(states) == 1


def test_created_object_without_a_key_has_no_index_even_if_another_member_has_one_of_its_id() -> None:
    engine, behaviour = Yard(BORN, "action born = born()\nobserve b.size in 0..5 for b : Box").opened()
    step_side_by_side([engine], behaviour, 20, native=False)
    other = engine.copy()
    other.apply("yard.newItem", other.matches("yard.newItem")[0])
    other.apply("yard.newBox", other.matches("yard.newBox")[0])
    step_side_by_side([engine, other], behaviour, 20, native=False)
    live = Simulator(engine, behaviour, family_keys([engine, other], behaviour))
    for _ in range(3):
        live.step_with(0, 0.5)
    assert split_index(live.observe(), live.observation_shape).tolist() == [2, 1, 0], "another member has a third one"
