"""`envgraph.sb3` without Stable-Baselines3; tests/integrations/sb3_vectors.py has it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete

import envgraph

THEIRS = ("stable_baselines3", "stable_baselines3.common.monitor", "stable_baselines3.common.vec_env")


class VecEnv:
    """As much of theirs as random actions need."""

    def __init__(self, num_envs: int, observation_space: Any, action_space: Any) -> None:
        self.num_envs, self.observation_space, self.action_space = num_envs, observation_space, action_space
        self.reset_infos: list[Any] = [{}] * num_envs
        self._reset_seeds()
        self._reset_options()

    def _reset_seeds(self) -> None:
        self._seeds: list[int | None] = [None] * self.num_envs

    def _reset_options(self) -> None:
        self._options: list[dict[str, Any]] = [{}] * self.num_envs

    def seed(self, seed: int) -> None:
        self._seeds = [seed + place for place in range(self.num_envs)]

    def step(self, actions: Any) -> Any:
        self.step_async(actions)  # type: ignore[attr-defined]
        return self.step_wait()  # type: ignore[attr-defined]

    def has_attr(self, name: str) -> bool:
        return bool(self.get_attr(name))  # type: ignore[attr-defined]

    def _get_indices(self, indices: Any) -> Any:
        return range(self.num_envs) if indices is None else indices


@pytest.fixture
def sb3(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    for name in THEIRS:
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules[THEIRS[1]].Monitor = type("Monitor", (), {})  # type: ignore[attr-defined]
    sys.modules[THEIRS[2]].VecEnv = VecEnv  # type: ignore[attr-defined]
    sys.modules[THEIRS[2]].unwrap_vec_normalize = lambda envs: None  # type: ignore[attr-defined]
    monkeypatch.delitem(sys.modules, "envgraph.sb3", raising=False)
    yield import_module("envgraph.sb3")
    monkeypatch.delitem(sys.modules, "envgraph.sb3")


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "envgraph.sb3", raising=False)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.monitor", None)
    with pytest.raises(ImportError, match=r"needs Stable-Baselines3: pip install 'envgraph\[sb3\]'"):
        import_module("envgraph.sb3")


def test_random_actions_are_those_of_single_environments_with_as_many_episodes_each(sb3: Any) -> None:
    envs = sb3.make_vec(domain="keydoor", num_envs=3, max_episode_steps=40)
    found = sb3.evaluate(None, envs, 30, seed=5)
    rng, singles = np.random.default_rng(5), [envgraph.make(domain="keydoor", max_episode_steps=40) for _ in range(3)]
    for place, env in enumerate(singles):
        env.reset(seed=5 + place)
    rows: list[list[tuple[float, bool, int]]] = [[], [], []]
    totals = np.zeros(3)
    while min(map(len, rows)) < 30:
        weights = rng.random((3, 9))
        for place, env in enumerate(singles):
            action = np.argmax(weights[place] * env.unwrapped.action_masks())  # type: ignore[attr-defined]
            _, reward, terminated, truncated, info = env.step(action)
            totals[place] += float(reward)
            if terminated or truncated:
                rows[place].append((totals[place], info["success"], info["step"]))
                totals[place] = 0.0
                env.reset()
    means = np.mean([row[:30] for row in rows], axis=(0, 1))
    assert (found.members, found.episodes) == (("",), (90,)) and max(map(len, rows)) > 30
    assert [found.returns[0], found.success[0], found.lengths[0]] == pytest.approx(means.tolist())
    header, row, mean = str(found).splitlines()
    assert header == "episodes    return  success  length  member" and mean == row + "mean"
    assert row == f"{90:8}{means[0]:10.2f}{means[1]:9.3f}{means[2]:8.1f}  "


def test_wrong_arguments_of_evaluations_are_named(sb3: Any) -> None:
    for envs, episodes in (
        (envgraph.make_vec(domain="keydoor", num_envs=2), 1),
        (sb3.make_vec(domain="keydoor", num_envs=2), 0),
    ):
        with pytest.raises(envgraph.EnvgraphError, match="must be a `VecEnv`, and `episodes` at least 1"):
            sb3.evaluate(None, envs, episodes)


def test_random_actions_without_masks_are_samples_of_the_space(sb3: Any) -> None:
    rows = []
    for _ in range(2):
        envs = sb3.make_vec(domain="keydoor", num_envs=2, max_episode_steps=5)
        play, actions, met = envs.step, MultiDiscrete([3, 3]), list[list[int]]()

        def step(chosen: Any, play: Any = play, met: list[list[int]] = met) -> Any:
            met += chosen.tolist()
            return play(chosen @ [3, 1])

        envs.step, envs.has_attr, envs.action_space = step, lambda name: False, actions
        assert sb3.evaluate(None, envs, 20, seed=3).episodes == (40,)
        rows.append(met)
    assert rows[0] == rows[1] and {*map(tuple, rows[0])} == {(x, y) for x in range(3) for y in range(3)}


def test_environments_without_returns_of_episodes_are_refused(sb3: Any) -> None:
    envs = sb3.make_vec(domain="keydoor", num_envs=2)
    play = envs.step

    def step(actions: Any) -> Any:
        *results, infos = play(actions)
        return *results, [{name: value for name, value in info.items() if name != "episode"} for info in infos]

    envs.step = step
    with pytest.raises(envgraph.EnvgraphError, match="report no returns of episodes"):
        sb3.evaluate(None, envs)
