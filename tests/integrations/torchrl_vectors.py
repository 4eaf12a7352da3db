"""TorchRL's `GymWrapper` over vector environments; `make test-integrations` installs and runs it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envgraph
from tests.integrations.documented import run_section

pytest.importorskip("torchrl")  # modules are imported in `make test`, too, for their doctests

import torch
from torchrl.envs import GymWrapper, check_env_specs

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


KINDS = ["index", "multi", "flat", "dict"]


@pytest.mark.parametrize(
    ("source", "observation"),
    [*(("keydoor", kind) for kind in KINDS), *(("warehouse", kind) for kind in KINDS[1:])],  # its index needs 32 GB
)
def test_specs_are_right_and_steps_are_those_of_the_vector(source: str, observation: str) -> None:
    options: dict[str, Any] = {"domain": source, "num_envs": 4, "observation": observation, "max_episode_steps": 17}
    env = GymWrapper(envgraph.make_vec(**options, autoreset_mode="Disabled"), categorical_action_encoding=True)
    check_env_specs(env)
    envs = envgraph.make_vec(**options, autoreset_mode="SameStep")
    env.set_seed(3)
    begun, (seen, _) = env.reset(seed=3), envs.reset(seed=3)
    rng, ends = np.random.default_rng(0), 0
    for _ in range(60):
        for name, array in seen.items() if isinstance(seen, dict) else [("observation", seen)]:
            assert np.array_equal(begun[name].squeeze(-1) if begun[name].ndim > array.ndim else begun[name], array)
        chosen = rng.integers(envs.single_action_space.n, size=4)
        stepped, begun = env.step_and_maybe_reset(begun.set("action", torch.as_tensor(chosen)))
        seen, rewards, terminated, truncated, _ = envs.step(chosen)
        found = stepped["next"]
        assert np.allclose(found["reward"].squeeze(-1), rewards.astype(np.float32))
        assert np.array_equal(found["terminated"].squeeze(-1), terminated)
        assert np.array_equal(found["truncated"].squeeze(-1), truncated)
        ends += int((terminated | truncated).sum())
    assert ends >= 12


@pytest.mark.parametrize("observation", ["index", "flat"])
def test_the_other_mode_that_torchrl_takes(observation: str) -> None:
    envs = envgraph.make_vec(domain="keydoor", num_envs=4, observation=observation, autoreset_mode="SameStep")
    env = GymWrapper(envs, categorical_action_encoding=True)
    check_env_specs(env)
    played = env.rollout(300, break_when_any_done=False)
    assert played["next", "done"].sum() > 4
    with pytest.raises(RuntimeError, match="must be one of SAME_STEP or DISABLED"):
        GymWrapper(envgraph.make_vec(domain="keydoor", num_envs=4))


def test_the_documented_masks_allow_all_that_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_section("howto/torchrl.md", {}) == ["True\n"]
