"""`envgraph.sb3`: the vector environments of Stable-Baselines3; `make test-integrations` installs and runs it."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envgraph
from envgraph.search import generate, write_family
from tests.integrations.documented import run_section

pytest.importorskip("sb3_contrib")  # modules are imported in `make test`, too, for their doctests

from sb3_contrib import MaskablePPO, RecurrentPPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy as evaluate_masked_policy
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
    VecEnv,
    VecEnvWrapper,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

import envgraph.sb3

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("family")
    found = generate("burning_forest/paper.toml", folder / "run.sqlite", seed=2, generations=30)
    (folder / "family.json").write_text(write_family(found))
    return folder / "family.json"


def same(one: Any, other: Any) -> bool:
    """Whether two observations, masks or infos are equal; times may differ."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(name == "t" or same(one[name], other[name]) for name in one)
    return bool(np.array_equal(one, other))


SOURCES: dict[str, dict[str, Any]] = {
    "tables": {"domain": "keydoor", "max_episode_steps": 13},
    "program": {"domain": "keydoor", "max_episode_steps": 13, "engine": "compiled"},
    "agents": {"domain": "warehouse", "max_episode_steps": 13},
    "live": {"domain": "keydoor", "max_episode_steps": 13, "engine": "live"},
    "coins": {"domain": "taxi", "max_episode_steps": 13, "observation": "dict"},
    "masks in infos": {"domain": "keydoor", "max_episode_steps": 13, "action_masks": True, "observation": "multi"},
    "members": {"variants": ["E1", "E6", "E3"], "max_episode_steps": 13},
}


@pytest.mark.parametrize("source", SOURCES)
def test_steps_are_those_of_single_environments_with_monitors(source: str, family: Path) -> None:
    """All of a `DummyVecEnv`: observations, rewards, ends, statistics, infos of ends and resets, masks."""
    options = {"observation": "flat", **SOURCES[source]}
    variants = options.pop("variants", None)
    if variants:
        options["family"] = family
    ours = envgraph.sb3.make_vec(num_envs=6, variant=variants, **options)
    names = [*(variants or [None]) * 6][:6]
    theirs = DummyVecEnv([lambda name=name: Monitor(envgraph.make(variant=name, **options)) for name in names])
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    actions, ends = np.random.default_rng(0), 0
    for seed in (3, None):
        if seed is not None:
            assert ours.seed(seed) == theirs.seed(seed)
        assert same(ours.reset(), theirs.reset())
        for _ in range(60):
            assert all(map(same, ours.reset_infos, theirs.reset_infos))
            assert same(get_action_masks(ours), get_action_masks(theirs))
            chosen = actions.integers(ours.action_space.n, size=6)
            found, wanted = ours.step(chosen), theirs.step(chosen)
            assert all(map(same, found[:3], wanted[:3]))
            assert (found[1].dtype, found[2].dtype) == (wanted[1].dtype, wanted[2].dtype)
            for over, info, other in zip(found[2], found[3], wanted[3], strict=True):
                assert same(info, other) if over else info == {}
                ends += int(over)
    assert ends > 40 and isinstance(ours, VecEnv)
    assert ours.reset_infos[0] is not ours.reset_infos[1]
    ours.close()
    theirs.close()


def test_attributes_methods_and_options_are_those_of_the_vector(family: Path) -> None:
    envs = envgraph.sb3.make_vec(family, 3, ["E1", "E6"], render_mode="rgb_array")
    assert is_masking_supported(envs) and not envs.has_attr("mask")
    assert envs.get_attr("max_episode_steps", 1) == [200] and envs.get_attr("num_envs") == [3] * 3
    envs.set_attr("max_episode_steps", 5)
    assert envs.get_attr("max_episode_steps", [0, 2]) == [5, 5]
    with pytest.raises(envgraph.EnvgraphError, match="leave out `indices`"):
        envs.set_attr("max_episode_steps", 5, 1)
    with pytest.raises(AttributeError, match=r"`compute_reward` needs single environments"):
        envs.env_method("compute_reward")
    envs.set_options({"variant": "E6"})
    envs.reset()
    assert [info["variant"] for info in envs.reset_infos] == ["E6"] * 3
    assert envs.reset_infos[0].keys() >= {"state", "certificates"}
    envs.set_options([{"variant": name} for name in ("E1", "E6", "E1")])
    envs.reset()
    assert [info["variant"] for info in envs.reset_infos] == ["E1", "E6", "E1"]
    single = envgraph.sb3.make_vec(family, 2, "E1", vectorization_mode="sync")
    single.set_options({"variant": "E6"})
    single.reset()
    assert [info["variant"] for info in single.reset_infos] == ["E6"] * 2
    assert single.get_attr("action_names", 1) == [("left", "down", "right", "up")]
    assert single.env_method("get_wrapper_attr", "render_mode", indices=0) == [None]
    single.set_attr("mark", 7)
    assert single.get_attr("mark") == [7, 7]
    assert len(envs.env_method("action_masks", indices=[0, 2])) == 2
    picture = envs.render()
    assert picture is not None and picture.shape == (512, 512, 3)
    assert envs.env_is_wrapped(Monitor) == [True] * 3 and envs.env_is_wrapped(DummyVecEnv, 0) == [False]
    chosen = np.zeros((20, 3), dtype=np.int64)
    copy, went = deepcopy(envs), [envs.step(actions) for actions in chosen]
    assert all(all(map(same, copy.step(actions)[:3], found[:3])) for actions, found in zip(chosen, went, strict=True))


def test_wrappers_of_theirs_fit() -> None:
    def make() -> Any:
        return envgraph.sb3.make_vec(domain="keydoor", num_envs=4, max_episode_steps=20)

    width = make().observation_space.shape[0]
    stacked = VecFrameStack(VecNormalize(VecCheckNan(make()), gamma=0.9), 3)
    monitored = VecMonitor(make())
    for envs, shape in ((stacked, (4, 3 * width)), (monitored, (4, width))):
        assert envs.seed(0) is not None and envs.reset().shape == shape
        assert get_action_masks(envs).shape == (4, envs.action_space.n)
    rng, ends = np.random.default_rng(0), 0
    for _ in range(80):
        chosen = rng.integers(stacked.action_space.n, size=4)
        found, counted = stacked.step(chosen), monitored.step(chosen)
        assert found[0].shape == (4, 3 * width)
        for over, info, other in zip(found[2], found[3], counted[3], strict=True):
            if over:
                assert info["terminal_observation"].shape == (3 * width,)
                assert info["episode"]["l"] == other["episode"]["l"] <= 20
                assert info["episode"]["r"] == pytest.approx(float(other["episode"]["r"]), abs=1e-5)
                ends += 1
            else:
                assert info == other == {}
    assert ends >= 16


@pytest.mark.parametrize("algorithm", [PPO, MaskablePPO, DQN, RecurrentPPO], ids=lambda one: one.__name__)
def test_evaluations_are_those_of_their_function_for_each_member(algorithm: Any, family: Path) -> None:
    """Returns, lengths and members, over tables and single environments, with a `VecNormalize` around and without."""
    names = ["E6", "E1", "E3"]
    envs = VecNormalize(envgraph.sb3.make_vec(family, 6, names, max_episode_steps=30))
    policy = "MlpLstmPolicy" if algorithm is RecurrentPPO else "MlpPolicy"
    options = {} if algorithm is DQN else {"n_steps": 32, "batch_size": 96}
    model = algorithm(policy, envs, seed=0, device="cpu", **options).learn(192)
    test = envgraph.sb3.make_vec(family, 6, names, max_episode_steps=30)
    found = envgraph.sb3.evaluate(model, test, 4)
    assert found.members == ("E1", "E3", "E6") and found.episodes == (8, 8, 8)

    before = deepcopy(envs.obs_rms)
    assert envs.training and same(list(found), list(envgraph.sb3.evaluate(model, envs, 4))) and envs.training
    assert same(before.mean, envs.obs_rms.mean) and before.count == envs.obs_rms.count
    single = DummyVecEnv(
        [lambda n=n: Monitor(envgraph.make(family, n, observation="flat", max_episode_steps=30)) for n in names * 2]
    )
    assert same(list(found), list(envgraph.sb3.evaluate(model, single, 4)))

    copy = VecNormalize(test, training=False, norm_reward=False)
    copy.obs_rms = envs.obs_rms
    copy.seed(0)
    theirs = evaluate_masked_policy if algorithm is MaskablePPO else evaluate_policy
    returns, lengths = theirs(model, copy, 24, return_episode_rewards=True)
    assert np.mean(returns) == pytest.approx(found.returns.mean(), abs=1e-5)
    assert np.mean(lengths) == pytest.approx(found.lengths.mean())
    once = envgraph.sb3.evaluate(model, VecFrameStack(copy, 1), 4)
    assert same(list(found), list(once)), "the `VecNormalize` below another wrapper is used, and not that of the model"
    copy.training = True
    with pytest.raises(envgraph.EnvgraphError, match="below another wrapper would be updated; set its `training`"):
        envgraph.sb3.evaluate(model, VecFrameStack(copy, 1), 4)
    once = envgraph.sb3.evaluate(model.policy, copy, 4)
    assert same(list(found), list(once)), "a policy plays as its model"


def test_random_actions_are_allowed_and_each_environment_plays_as_many_episodes(family: Path) -> None:
    class Counting(VecEnvWrapper):  # type: ignore[misc]
        """Counts the ends, and refuses what the masks do not allow."""

        def reset(self) -> Any:
            self.ends, self.met = np.zeros(self.num_envs, np.int64), set[tuple[int, int]]()
            return self.venv.reset()

        def step_async(self, actions: Any) -> None:
            assert get_action_masks(self.venv)[np.arange(self.num_envs), actions].all()
            self.met |= {*enumerate(actions.tolist())}
            self.venv.step_async(actions)

        def step_wait(self) -> Any:
            found = self.venv.step_wait()
            self.ends += found[2]
            return found

    envs = Counting(envgraph.sb3.make_vec(family, 3, ["E1", "E6"]))
    found = envgraph.sb3.evaluate(None, envs, 50)
    assert envs.ends.min() == 50 < envs.ends.max() and found.episodes == (100, 50)
    assert envs.met == {(place, action) for place in range(3) for action in range(4)}
    assert str(found).splitlines()[0] == "episodes    return  success  length  member"
    assert str(found).splitlines()[-1] == f"     150{found.returns.mean():10.2f}{found.success.mean():9.3f}" + (
        f"{found.lengths.mean():8.1f}  mean"
    )
    assert found.success[0] > found.success[1], "E1 is easier"
    assert same(list(found), list(envgraph.sb3.evaluate(None, envs, 50)))
    assert not same(list(found), list(envgraph.sb3.evaluate(None, envs, 50, seed=1)))
    taxi = envgraph.sb3.evaluate(None, envgraph.sb3.make_vec(domain="taxi", num_envs=2, max_episode_steps=9), 3)
    assert taxi.members == ("",) and taxi.episodes == (6,)


def test_wrong_arguments_of_evaluations_are_named(family: Path) -> None:
    for envs, episodes in ((envgraph.make_vec(family, 2), 1), (envgraph.sb3.make_vec(family, 2), 0)):
        with pytest.raises(envgraph.EnvgraphError, match="must be a `VecEnv`, and `episodes` at least 1"):
            envgraph.sb3.evaluate(None, envs, episodes)


ROLLOUTS = {"n_steps": 64, "batch_size": 512, "learning_rate": 2e-3, "ent_coef": 0.01}
ALGORITHMS: list[tuple[Any, int, int, dict[str, Any]]] = [
    (PPO, 64, 60_000, ROLLOUTS),
    (MaskablePPO, 64, 60_000, ROLLOUTS),
    (DQN, 8, 50_000, {"learning_starts": 2_000, "learning_rate": 1e-3, "train_freq": 1, "exploration_fraction": 0.7}),
]


@pytest.mark.parametrize(("algorithm", "count", "steps", "options"), ALGORITHMS, ids=["PPO", "MaskablePPO", "DQN"])
def test_networks_learn_and_the_logger_has_statistics(
    algorithm: Any, count: int, steps: int, options: dict[str, Any]
) -> None:
    envs = envgraph.sb3.make_vec(domain="keydoor", num_envs=count)
    test = envgraph.sb3.make_vec(domain="keydoor", num_envs=4)
    options = {"target_update_interval": 500, **options} if algorithm is DQN else options
    model = algorithm("MlpPolicy", envs, seed=0, device="cpu", **options)
    assert envgraph.sb3.evaluate(model, test, 1).success == [0.0]
    model.learn(steps)
    assert envgraph.sb3.evaluate(model, test, 1).success == [1.0]
    assert np.mean([one["r"] for one in model.ep_info_buffer]) > 0.5
    assert np.mean(model.ep_success_buffer) > 0.8
    if algorithm is not MaskablePPO:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it warns where there are no statistics
            assert evaluate_policy(model, test, 8)[0] > 1.0


@pytest.mark.parametrize("kind", ["index", "multi", "dict", "image"])
def test_dqn_and_ppo_take_the_observations(kind: str) -> None:
    envs = envgraph.sb3.make_vec(domain="keydoor", num_envs=4, observation=kind)
    policy = "MultiInputPolicy" if kind == "dict" else "MlpPolicy"
    DQN(policy, envs, learning_starts=50, buffer_size=500, seed=0, device="cpu").learn(400)
    PPO(policy, envs, n_steps=32, batch_size=64, seed=0, device="cpu").learn(256)


def test_the_documented_example_learns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_section("howto/maskable-ppo.md", {}) == ["True True\n"]
    script = [sys.executable, str(Path(__file__).parents[2] / "docs/examples/train_family.py"), "mazes", "--control"]
    lines = subprocess.run(
        [*script, "--steps", "300000"], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    shares = [float(one[1]) for line in lines if (one := re.search(r"success (\S+)", line))]
    before, alone, taught = shares[:2], shares[4:], shares[2:4]
    assert max(before) < 0.05 and max(alone) < 0.5 < min(taught)
