"""Compiled environments with Gymnasium's interface: they do what tables and live ones do, bit by bit."""

from __future__ import annotations

from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from envgraph.env import EnvgraphLiveEnv, EnvgraphVectorEnv, Simulator, Tabular, explore
from envgraph.env.compiled import CompiledEnv, CompiledVectorEnv, has_numba, load_functions, program_of
from tests.profile import NIGHTLY
from tests.unit.env.corners.domains import CORNERS, MODELS, files
from tests.unit.env.side_by_side import Family, family_of, opened


def same(one: Any, other: Any) -> bool:
    """Whether what two environments returned is equal, infos included, but for `state`."""
    if isinstance(one, dict):
        names = {name for name in (*one, *other) if name not in ("state", "_state")}
        return all(same(one[name], other[name]) for name in names)
    if isinstance(one, tuple | list) or (isinstance(one, np.ndarray) and one.dtype == object):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(np.array_equal(one, other))


@cache
def fires() -> tuple[Family, list[Tabular]]:
    """Return a family of forests, and their tables."""
    family = family_of(CORNERS["burning_forest"])
    copies = family.copies()
    return family, [explore(one, family.behaviour, family.keys).tabular for one in copies]


@pytest.mark.parametrize("observation", ["index", "multi"])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_compiled_vector_environment_steps_like_tables(mode: AutoresetMode, observation: Any) -> None:
    family, tables = fires()
    options: dict[str, Any] = {"max_episode_steps": 9, "autoreset_mode": mode, "observation": observation}
    table = EnvgraphVectorEnv(tables, 7, **options)
    compiled = CompiledVectorEnv(family.program, 7, **options)
    assert compiled.action_space == table.action_space
    assert compiled.observation_space == table.observation_space
    actions = np.random.default_rng(0)
    assert same(compiled.reset(seed=5), table.reset(seed=5))
    for _ in range(60):
        chosen = actions.integers(compiled.single_action_space.n, size=7)
        found, wanted = compiled.step(chosen), table.step(chosen)
        assert same(found, wanted)
        over = wanted[2] | wanted[3]
        if mode is AutoresetMode.DISABLED and over.any():
            mask = {"reset_mask": over}
            assert same(compiled.reset(options=mask), table.reset(options=mask))


def test_compiled_vector_with_separate_streams_steps_like_live_environments() -> None:
    engine, behaviour = opened(*files(MODELS["warehouse"]))
    program = program_of(engine.copy(), behaviour, native=False)
    make = lambda: gymnasium.wrappers.TimeLimit(EnvgraphLiveEnv(Simulator(engine.copy(), behaviour)), 20)  # noqa: E731
    live = SyncVectorEnv([make] * 3)
    compiled = CompiledVectorEnv(program, 3, streams="each", max_episode_steps=20)
    assert np.array_equal(compiled.reset(seed=3)[0], live.reset(seed=3)[0])
    actions = np.random.default_rng(0)
    for _ in range(70):
        chosen = actions.integers(compiled.single_action_space.n, size=3)
        assert same(compiled.step(chosen)[:4], live.step(chosen)[:4])


@pytest.mark.parametrize("observation", ["index", "multi"])
def test_compiled_environment_steps_like_the_live_environment(observation: Any) -> None:
    engine, behaviour = opened(*files(MODELS["network"]))
    live = EnvgraphLiveEnv(Simulator(engine.copy(), behaviour), observation=observation, render_mode="ansi")
    program = program_of(engine, behaviour, native=False)
    compiled = CompiledEnv(program, observation=observation, render_mode="ansi")
    actions = np.random.default_rng(0)
    for seed in range(4):
        assert same(compiled.reset(seed=seed), live.reset(seed=seed))
        over = False
        while not over:
            action = int(actions.integers(compiled.action_space.n))
            found, wanted = compiled.step(action), live.step(action)
            assert same(found, wanted)
            over = wanted[2]
            assert compiled.render() == live.render()


def test_compiled_environment_passes_the_gymnasium_checker() -> None:
    engine, behaviour = opened(*files(MODELS["keydoor"]))
    check_env(CompiledEnv(program_of(engine, behaviour, native=False)), skip_render_check=True)


def test_deep_copies_step_like_the_original_and_independently_of_it() -> None:
    family = family_of(CORNERS["warehouse"])
    program = family.native if NIGHTLY and has_numba() else family.program
    many = CompiledVectorEnv(program, 3, max_episode_steps=15)
    one = CompiledEnv(program)
    actions = np.random.default_rng(0).integers(len(program.action_names), size=(60, 3))
    many.reset(seed=1)
    one.reset(seed=1)
    for chosen in actions[:20]:
        many.step(chosen)
        one.step(chosen[0])
    others = deepcopy(many), deepcopy(one)
    went_on = [(many.step(chosen), one.step(chosen[0])) for chosen in actions[20:40]]
    for chosen, wanted in zip(actions[20:40], went_on, strict=True):
        assert same((others[0].step(chosen), others[1].step(chosen[0])), wanted)


def test_programs_run_where_the_cache_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "file" / "cache"))
    text = f"def twice(x):  # {tmp_path}\n    return 2 * x\n"
    assert load_functions(text, (), ("twice",), native=True)["twice"](4) == 8
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


def test_edited_program_text_does_not_run_the_old_machine_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba")
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path))
    for factor in (2, 3, 2):
        text = f"def times(x):\n    return {factor} * x\n"
        load_functions.cache_clear()
        assert load_functions(text, (), ("times",), native=True)["times"](4) == 4 * factor
    assert len([*(tmp_path / "programs").iterdir()]) == 2
