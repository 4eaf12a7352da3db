"""A compiled visit of all states makes the table that the live engine makes, number by number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envgraph.env import KeyIndex, Tabular, explore, indexed_classes
from envgraph.env.compiled import Program, Tables, enumerated, program_of
from tests.profile import NIGHTLY
from tests.unit.env.side_by_side import BUNDLED, family_keys, mutants, opened

MODELS = {
    "keydoor": BUNDLED / "keydoor/two_rooms.model",
    "burning_forest": BUNDLED / "burning_forest/running_4x4.model",
}


def assert_equal_tables(found: Tabular, wanted: Tabular) -> None:
    found.check()
    for name in Tabular.__slots__:
        one, other = getattr(found, name), getattr(wanted, name)
        if isinstance(other, np.ndarray):
            assert one.dtype == other.dtype, name
            assert np.array_equal(one, other), name
        else:
            assert one == other, name


def domain(model: Path) -> list[Path]:
    return [model, *model.parent.glob("*.environment")]


@pytest.mark.parametrize("native", [False, True], ids=["python", "numba"])
@pytest.mark.parametrize("name", MODELS)
def test_the_table_is_that_of_the_live_engine(name: str, native: bool) -> None:
    if native:
        pytest.importorskip("numba")
        if name != "keydoor" and not NIGHTLY:
            pytest.skip("numba takes seconds for each domain: `make nightly`")
    engine, behaviour = opened(*domain(MODELS[name]))
    engines = mutants(engine, behaviour, 3)
    keys = family_keys(engines, behaviour)
    wanted = [explore(each, behaviour, keys).tabular for each in engines]
    program = program_of(engine, behaviour, engines, keys, native=native)
    for number, table in enumerate(wanted):
        assert_equal_tables(enumerated(program, number), table)


def test_tables_of_many_models_of_one_engine_are_made_by_one_program(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setattr("envgraph.env.compiled._enumeration.LIVE_VISITS", 1)
    written = []

    def counted(*arguments: object, **options: object) -> Program:
        written.append(arguments)
        return program_of(*arguments, **options, native=False)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.env.compiled._enumeration.program_of", counted)
    engine, behaviour = opened(*domain(MODELS["burning_forest"]))
    tables, rng = Tables(behaviour), np.random.default_rng(0)
    rules = [name for name in engine.rules if "retypings" in name]
    for number in range(12):
        keys = KeyIndex.of(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        assert_equal_tables(tables.table(engine, keys), explore(engine, behaviour, keys).tabular)
        engine.model.commit()
        for _ in range(3):
            name = rules[int(rng.integers(len(rules)))]
            if engine.exists(name):
                engine.apply(name)
        assert len(written) <= number + 1
    assert len(written) < 4
