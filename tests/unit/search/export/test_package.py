"""A family as a package: what is written, and that it is refused where it cannot be."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from envgraph.env import EnvgraphEnv, ExploredEnvironment, TooManyStates
from envgraph.env.compiled import CompiledEnv, NotCompiled, program_of
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search import Domain, Family, Member, generate
from envgraph.search.export import copy_templates, write_package, write_tables
from tests.unit.learn.small_tables import random_table

SMALL = ("search.generations=1", "search.population=2")


@pytest.fixture(scope="module")
def forest(tmp_path_factory: pytest.TempPathFactory) -> Family:
    return generate("burning_forest/paper.toml", tmp_path_factory.mktemp("forest") / "run.sqlite", overrides=[*SMALL])


@pytest.fixture(scope="module")
def halls() -> Family:
    """With too many states for tables, and agents that take turns."""
    return single_member_family("warehouse")


def single_member_family(domain: str) -> Family:
    """A family whose only member is the model of a domain."""
    loaded = Domain.load(domain)
    model = json.dumps(model_to_json(loaded.initial()))
    return Family("Alone", loaded.workspace.bundle(), (Member("E1", {}, model, initial=True),), loaded)


def imported(folder: Path, name: str) -> ModuleType:
    """A package that was written, without installing it."""
    spec = importlib.util.spec_from_file_location(name, folder / "src" / name / "__init__.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def too_many(family: Family, _: object) -> NoReturn:
    raise TooManyStates(family.behaviour, 3)


def same(one: Any, other: Any, steps: int) -> int:
    """Step two environments side by side; returns how many episodes ended."""
    actions, ended = np.random.default_rng(5), 0
    assert np.array_equal(one.reset(seed=7)[0], other.reset(seed=7)[0])
    for _ in range(steps):
        action = actions.integers(one.action_space.n)
        (seen, *gained, info), (wanted, *expected, facts) = one.step(action), other.step(action)
        assert np.array_equal(seen, wanted) and seen.dtype == wanted.dtype
        assert gained == expected and info == facts
        if gained[1]:
            ended += 1
            (seen, info), (wanted, facts) = one.reset(), other.reset()
            assert np.array_equal(seen, wanted) and info == facts
    return ended


def test_exported_table_environments_step_like_the_original(forest: Family, tmp_path: Path) -> None:
    written = write_package(forest, tmp_path / "some_fires")
    assert sorted(path.relative_to(tmp_path / "some_fires").as_posix() for path in written) == [
        "README.md",
        "pyproject.toml",
        "src/some_fires/__init__.py",
        "src/some_fires/environment.py",
        "src/some_fires/tables.npz",
        "tests/episodes.json",
        "tests/test_environments.py",
    ]
    fires = imported(tmp_path / "some_fires", "some_fires")
    assert (fires.MEMBERS, fires.LIMIT) == (("E1", "E2"), 200)
    for member in forest.members:
        table = forest.explored(member).tabular
        for kind in ("index", "multi"):
            ours = EnvgraphEnv(table, observation=kind)  # type: ignore[arg-type]
            theirs = fires.make(member.name, observation=kind).unwrapped
            assert same(theirs, ours, 300) > 0
            assert (theirs.observation_space, theirs.action_space) == (
                ours.observation_space,
                ours.action_space,
            )
            check_env(theirs)
    with pytest.raises(ValueError, match="there is no member 'E9'"):
        fires.make("E9")
    with pytest.raises(ValueError, match="an observation is"):
        fires.make(observation="pixels")
    with pytest.raises(ValueError, match="there are no options"):
        theirs.reset(options={"state": 3})
    with pytest.raises(ValueError, match=r"not in 0\.\.3"):
        theirs.step(-1)


LIFTERS = {
    "lift.metamodel": "metamodel lift\n@key(name) class Arm { string name bool up = false }",
    "lift.model": 'import "lift.metamodel"\nmodel m : lift { a : Arm { name = "a" } b : Arm { name = "b" } }',
    "lift.query": 'package lift\nimport "lift.metamodel"\npattern low(arm : Arm) { Arm.up(arm, false); }',
    "lift.rules": """package lift
import "lift.query"
rule lift(arm : Arm) { lhs { check !arm.up; } modify { set arm.up = true; } }""",
    "lift.environment": """import "lift.rules"
environment Lift {
    agents together
    agent arm : Arm { action lift = 0.5: lift(arm)  action wait = nothing()  observe arm.up }
    on neg find low(_) reward 1.0 terminate success
}""",
    "family.toml": 'name = "Lift"\nmodel = "lift.model"\nenvironment = "lift.environment"\n'
    '[measures.low]\nkind = "count"\nof = "low"\n[diversity]\nkind = "variance"\n'
    '[mutation]\nrules = ["lift"]\n',
}


def test_exported_environments_of_simultaneous_agents_have_no_turns(tmp_path: Path) -> None:
    for name, text in LIFTERS.items():
        (tmp_path / name).write_text(text, "utf-8")
    lifters = single_member_family(str(tmp_path / "family.toml"))
    write_package(lifters, tmp_path / "lifters")
    theirs = imported(tmp_path / "lifters", "lifters").make("E1").unwrapped
    assert same(theirs, EnvgraphEnv(lifters.explored(lifters.members[0]).tabular), 200) > 5
    assert "acts next" not in (tmp_path / "lifters" / "README.md").read_text("utf-8")


def test_exported_package_returns_transitions_as_a_dictionary(forest: Family, tmp_path: Path) -> None:
    write_package(forest, tmp_path / "more_fires")
    found = imported(tmp_path / "more_fires", "more_fires").transitions("E2")
    table = forest.explored(forest.members[1]).tabular
    assert len(found) == table.n_states
    for state, actions in found.items():
        for action, outcomes in actions.items():
            assert sum(one[0] for one in outcomes) == 1.0
            assert outcomes[0][1] == table.next_state[state, action, 0]
            assert outcomes[0][3] == (table.terminated[state, action, 0] > 0)


def test_exported_program_environments_step_like_the_original(
    halls: Family, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = halls.domain.engine()
    program = program_of(engine, halls.behaviour, [halls.domain.engine()], halls.keys, native=False)
    monkeypatch.setattr(Family, "explored", too_many)
    monkeypatch.setattr(Family, "program", lambda *_: program)
    write_package(halls, tmp_path / "some_halls")
    assert (tmp_path / "some_halls/src/some_halls/program/data.npz").is_file()
    assert not (tmp_path / "some_halls/src/some_halls/tables.npz").exists()
    monkeypatch.setitem(sys.modules, "numba", None)
    made = imported(tmp_path / "some_halls", "some_halls")
    for kind in ("index", "multi"):
        theirs = made.make("E1", observation=kind).unwrapped
        same(theirs, CompiledEnv(program, 0, observation=kind), 60)  # type: ignore[arg-type]
    check_env(theirs)


def test_exported_environments_sample_random_outcomes_like_the_original(
    halls: Family, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = replace(random_table(3), agent_names=("left", "right"), turn=np.arange(12, dtype=np.int32) % 2)
    table.check()
    assert not table.deterministic and len(table.start_states) > 1
    monkeypatch.setattr(Family, "explored", lambda *_: ExploredEnvironment(table, ()))
    write_package(halls, tmp_path / "chances")
    theirs = imported(tmp_path / "chances", "chances").make("E1").unwrapped
    assert same(theirs, EnvgraphEnv(table), 500) > 0
    assert theirs.reset()[1]["agent"] in ("left", "right")


def test_family_with_neither_tables_nor_a_program_is_refused(
    halls: Family, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def program(*_: object) -> NoReturn:
        raise NotCompiled("units")

    monkeypatch.setattr(Family, "explored", too_many)
    monkeypatch.setattr(Family, "program", program)
    with pytest.raises(EvaluationError, match=r"more than 3 states, and it cannot be compiled: compiled .* units"):
        write_package(halls, tmp_path / "halls")
    assert not (tmp_path / "halls").exists()


def test_user_templates_receive_models_and_need_no_environment(
    forest: Family, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(Family, "explored")
    templates = tmp_path / "templates"
    templates.mkdir()
    text = "{% for tile in member.model.nodes('Tile') %}{{ tile.cls[0] }}{% endfor %}"
    (templates / "{{member.name}}.map.j2").write_text(text)
    write_package(forest, tmp_path / "my-maps", templates)
    assert sorted(path.name for path in (tmp_path / "my-maps").iterdir()) == ["E1.map", "E2.map"]
    letters = "".join(tile.cls[0] for tile in forest.model(forest.members[1]).nodes("Tile"))
    assert len(letters) == 64 and (tmp_path / "my-maps" / "E2.map").read_text() == letters


def test_failing_template_leaves_no_files(forest: Family, tmp_path: Path) -> None:
    templates = tmp_path / "templates"
    assert len(copy_templates(templates)) == 8
    (templates / "zz.j2").write_text("{{ limit.none }}")
    with pytest.raises(EvaluationError, match=r"zz\.j2:1:1"):
        write_package(forest, tmp_path / "fires", templates)
    assert not (tmp_path / "fires").exists()
    with pytest.raises(InvalidArgument, match="exists already"):
        copy_templates(templates)


@pytest.mark.parametrize("name", ["my-fires", "class", "9"])
def test_folder_names_that_cannot_be_imported_are_refused(forest: Family, tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidArgument, match="cannot be imported as a package"):
        write_package(forest, tmp_path / name)


def test_tables_are_arrays_without_pickle(forest: Family, tmp_path: Path) -> None:
    tables = {one.name: forest.explored(one).tabular for one in forest.members}
    data = write_tables(tables)
    assert data == write_tables(tables)
    (tmp_path / "tables.npz").write_bytes(data)
    with np.load(tmp_path / "tables.npz", allow_pickle=False) as arrays:
        assert arrays["members"].tolist() == ["E1", "E2"]
        assert arrays["action_names"].tolist() == ["left", "down", "right", "up"]
        assert arrays["observation_shape"].tolist() == [64, 2]
        for name in ("next_state", "probability", "reward", "terminated", "observation", "start_states"):
            assert np.array_equal(arrays[f"E2/{name}"], getattr(tables["E2"], name))
