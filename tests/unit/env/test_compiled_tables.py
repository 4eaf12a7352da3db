"""A compiled visit of all states makes the table that the live engine makes, number by number."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from envgraph.env import Behaviour, ExploredEnvironment, KeyIndex, TooManyStates, explore, indexed_classes
from envgraph.env.compiled import (
    CompiledBatch,
    CompiledProgram,
    NotCompiled,
    Plans,
    TableBuilder,
    enumerate_states,
    explore_fast,
    has_numba,
    program_of,
)
from envgraph.env.compiled.layout._compiled_costs import CompiledCosts
from envgraph.errors import LIMITS, EvaluationError
from envgraph.rewrite import Engine
from tests.profile import NIGHTLY
from tests.unit.env.corners.domains import files
from tests.unit.env.corners.yard import Yard
from tests.unit.env.side_by_side import BUNDLED, Corner, assert_equal_tables, family_of, opened

MODELS = {
    "keydoor": BUNDLED / "keydoor/two_rooms.model",
    "burning_forest": BUNDLED / "burning_forest/running_4x4.model",
}


@pytest.mark.parametrize("name", MODELS)
def test_compiled_table_equals_that_of_the_live_engine(name: str) -> None:
    family = family_of(Corner(partial(opened, *files(MODELS[name]))))
    for number, engine in enumerate(family.copies()):
        wanted = explore(engine, family.behaviour, family.keys).tabular
        assert_equal_tables(enumerate_states(family.program, number), wanted)
        if NIGHTLY and has_numba():
            assert_equal_tables(enumerate_states(family.native, number), wanted)


def die(directory: Path) -> tuple[Engine, Behaviour]:
    """Two states; each of two actions draws a face, every second of which is odd."""
    faces = ", ".join(f"Face {{ odd = {str(number % 2 > 0).lower()} }}" for number in range(10))
    texts = {
        "die.metamodel": "metamodel die\nclass Box { bool odd = false contains Face[*] faces }\n"
        "class Face { bool odd = false }\n",
        "die.rules": """
            package die
            import "die.metamodel"
            rule roll(b : Box) { lhs { b : Box; face : Face; } modify { set b.odd = face.odd; } }
        """,
        "die.model": f'import "die.metamodel"\nmodel m : die {{ box : Box {{ faces = [{faces}] }} }}\n',
        "die.environment": """
            import "die.rules"
            environment Die(box : Box) { action roll = roll(box) action again = roll(box) observe box.odd }
        """,
    }
    for name, text in texts.items():
        (directory / name).write_text(text, "utf-8")
    return opened(directory / "die.model", directory / "die.environment")


def test_outcome_buffer_grows_for_a_state_with_many_outcomes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, behaviour = die(tmp_path)
    wanted = explore(engine, behaviour).tabular
    assert wanted.probability.shape == (2, 2, 10)
    monkeypatch.setattr(CompiledCosts, "first", 12)
    assert_equal_tables(enumerate_states(program_of(engine, behaviour, native=False)), wanted)


def test_enumeration_limits_outcomes_and_reports_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, behaviour = die(tmp_path)
    program, told = program_of(engine, behaviour, native=False), list[tuple[int, int]]()
    monkeypatch.setattr(CompiledCosts, "progress_interval", 10)
    monkeypatch.setitem(LIMITS, "all outcomes", 40)
    wanted = explore(engine, behaviour, outcomes=40).tabular
    assert_equal_tables(enumerate_states(program, progress=lambda *counts: told.append(counts)), wanted)
    assert told == [(2, 20)]
    monkeypatch.setitem(LIMITS, "all outcomes", 39)
    with pytest.raises(TooManyStates, match="more than 39 outcomes of actions in its states"):
        enumerate_states(program)
    with pytest.raises(TooManyStates, match="more than 39 outcomes"):
        explore(engine, behaviour, outcomes=39)


def test_too_many_outcomes_of_one_action_raise_too_many_states(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, behaviour = die(tmp_path)
    monkeypatch.setitem(LIMITS, "outcomes", 9)
    with pytest.raises(TooManyStates, match="action `roll` has more than 9 outcomes in one state"):
        enumerate_states(program_of(engine, behaviour, native=False))
    with pytest.raises(TooManyStates, match="action `roll` has more than 9 outcomes in one state"):
        explore(engine, behaviour)


def test_table_with_too_many_entries_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, behaviour = die(tmp_path)
    program = program_of(engine, behaviour, native=False)
    monkeypatch.setitem(LIMITS, "table entries", 40)
    assert_equal_tables(enumerate_states(program), explore(engine, behaviour).tabular)
    monkeypatch.setitem(LIMITS, "table entries", 39)
    message = "is too large: 2 states, 2 actions, up to 10 outcomes of an action"
    with pytest.raises(TooManyStates, match=message):
        enumerate_states(program)
    with pytest.raises(TooManyStates, match=message):
        explore(engine, behaviour)


def test_few_states_with_many_outcomes_are_enumerated_by_the_compiled_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba")
    engine, behaviour = die(tmp_path)
    wanted, visited = explore(engine, behaviour).tabular, list[int]()

    def counted(*arguments: object, **options: object) -> CompiledProgram:
        visited.append(1)
        return program_of(*arguments, **options, native=False)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.program_of", counted)
    for outcomes, programs in ((40, 0), (39, 1)):
        monkeypatch.setattr(CompiledCosts, "few_outcomes", outcomes)
        assert_equal_tables(explore_fast(engine, behaviour).tabular, wanted)
        assert len(visited) == programs


@pytest.mark.parametrize("cached", [False, True])
def test_cached_machine_code_visits_the_states_from_the_first_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cached: bool
) -> None:
    pytest.importorskip("numba")
    engine, behaviour = die(tmp_path)
    wanted, visited = explore(engine, behaviour).tabular, list[int]()

    def counted(*arguments: object, outcomes: int, **options: object) -> ExploredEnvironment:
        visited.append(outcomes)
        return explore(*arguments, **options, outcomes=outcomes)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.explore", counted)
    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.has_machine_code", lambda function: cached)
    monkeypatch.setattr(CompiledCosts, "cached_outcomes", 39)
    assert_equal_tables(explore_fast(engine, behaviour).tabular, wanted)
    assert visited == ([39] if cached else [39, 20_000])


@pytest.mark.parametrize("name", MODELS)
def test_pictures_of_compiled_states_equal_those_of_the_live_engine(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    engine, behaviour = opened(*files(MODELS[name]))
    wanted = explore(engine, behaviour, pictures=True)
    monkeypatch.setattr(CompiledCosts, "few_outcomes", 1)
    in_python = Mock(side_effect=partial(program_of, native=False))
    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.program_of", in_python)
    found = explore_fast(engine, behaviour, pictures=True)
    in_python.assert_called_once()
    assert_equal_tables(found.tabular, wanted.tabular)
    assert found.pictures == wanted.pictures and len(set(found.pictures)) > 1


def test_one_compiled_program_enumerates_many_models_of_an_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setattr(CompiledCosts, "live_outcomes", 0)
    written = []

    def counted(*arguments: object, **options: object) -> CompiledProgram:
        written.append(arguments)
        return program_of(*arguments, **options, native=False)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.env.compiled.programs._compiled_program.program_of", counted)
    engine, behaviour = opened(*files(MODELS["burning_forest"]))
    tables, rng = TableBuilder(behaviour), np.random.default_rng(0)
    rules = [name for name in engine.rules if "retypings" in name]
    for number in range(12):
        keys = KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        assert_equal_tables(tables.build(engine, keys), explore(engine, behaviour, keys).tabular)
        engine.model.commit()
        for _ in range(3):
            name = rules[int(rng.integers(len(rules)))]
            if engine.exists(name):
                engine.apply(name)
        assert len(written) <= number + 1
    assert 1 <= len(written) < 4


def test_states_computed_with_more_than_64_bits_are_enumerated_by_the_live_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba")
    texts = {
        "big.metamodel": "metamodel big\nclass Box { int n = 0 int large = 1 }\n",
        "big.rules": """
            package big
            import "big.metamodel"
            rule up(b : Box) { lhs { b : Box; check b.n < 9; }
                modify { set b.n += 1; set b.large = b.large * 50000000 / 1000000; } }
        """,
        "big.model": 'import "big.metamodel"\nmodel m : big { box : Box { } }\n',
        "big.environment": """
            import "big.rules"
            environment Big(box : Box) { action up = up(box) observe box.n in 0..9 }
        """,
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, "utf-8")
    engine, behaviour = opened(tmp_path / "big.model", tmp_path / "big.environment")
    wanted = explore(engine, behaviour).tabular
    assert wanted.n_states == 10
    with pytest.raises(NotCompiled, match="64 bits"):
        enumerate_states(program_of(engine, behaviour, native=False))
    with pytest.raises(NotCompiled, match="64 bits"):
        Plans(behaviour).plan(engine)
    monkeypatch.setattr(CompiledCosts, "few_states", 3)
    in_python = Mock(side_effect=partial(program_of, native=False))
    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.program_of", in_python)
    assert_equal_tables(explore_fast(engine, behaviour).tabular, wanted)
    in_python.assert_called_once()
    batch = CompiledBatch(program_of(engine, behaviour, native=False), [0])
    batch.reset(np.ones(1, dtype=np.bool_))
    with pytest.raises(
        EvaluationError, match=r"more bits than 64 within an expression[\s\S]*hint: .*`engine=\"live\"`"
    ):
        for _ in range(9):
            batch.step(np.zeros(1, dtype=np.int64), resets_ended=False)


def test_step_to_an_observed_object_without_an_index_names_the_object(tmp_path: Path) -> None:
    texts = {
        "walk.metamodel": """
            metamodel walk
            @key(n) class Spot { int n refers Spot[0..1] next }
            class Man { refers Spot[1] at }
        """,
        "walk.rules": """
            package walk
            import "walk.metamodel"
            rule go(m : Man) { lhs { m -at-> s : Spot -next-> t : Spot; } modify { set m.at = t; } }
        """,
        "walk.model": """
            import "walk.metamodel"
            model m : walk { b : Spot { n = 2 } a : Spot { n = 1, next = b } man : Man { at = a } }
        """,
        "walk.environment": """
            import "walk.rules"
            environment Walk(m : Man) { action go = go(m) observe m.at among Spot }
        """,
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, "utf-8")
    engine, behaviour = opened(tmp_path / "walk.model", tmp_path / "walk.environment")
    other = engine.copy()
    other.model["b"].delete("spo")
    keys = KeyIndex.of_model(other.model, indexed_classes(behaviour, other.model.metamodel))
    with pytest.raises(EvaluationError, match="has no index among `Spot`"):
        enumerate_states(program_of(engine, behaviour, keys=keys, native=False))


def test_zero_and_negative_zero_are_the_same_state() -> None:
    turn = "rule turn { lhs { i : Item; check i.id == 1; } modify { set i.weight = i.weight * -1.0; } }"
    zero = "rule zero { lhs { i : Item; check i.id == 1; } modify { set i.weight = 0.0; } }"
    actions = "action turn = turn()\naction zero = zero()\nobserve adam.kind"
    engine, behaviour = Yard(f"{turn}\n{zero}", actions).opened()
    table = enumerate_states(program_of(engine, behaviour, native=False))
    assert_equal_tables(table, explore(engine, behaviour).tabular)
    assert table.n_states == 3
