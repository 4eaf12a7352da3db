"""The Gymnasium environments: interface, spaces, seeds, limits, rendering, registration."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, ExploredEnvironment, Simulator, explore, register
from envgraph.env.registration import register_bundled
from envgraph.errors import InvalidArgument
from tests.unit.env import forest
from tests.unit.env.coins import loaded

TARGET = explore(forest.engine(forest.published_maps()[5]), forest.behaviour(), pictures=True)

RANDOM = """
action turn = 0.5: turn()
action grab(coin : Coin) = grab(hand, coin, _) reward 1
on reset apply turn()
on neg find up(_) terminate failure
observe hand.holds among Coin or none
observe coin.side for coin : Coin
draw graph Coin label name
"""


def make(name: str, **options: object) -> gymnasium.Env[object, object]:
    """What the ids registered here lead to."""
    if name == "live":
        return EnvgraphLiveEnv(Simulator(*loaded(RANDOM)), **options)  # type: ignore[arg-type]
    found = TARGET if name == "forest" else explore(*loaded(RANDOM), pictures=True)
    return EnvgraphEnv(found.tabular, pictures=found.pictures, **options)  # type: ignore[arg-type]


IDS = {
    name: register(f"Test-{name}", entry_point="tests.unit.env.test_gymnasium:make", limit=200, name=name)
    for name in ("forest", "coins", "live")
}


@pytest.mark.parametrize("observation", ["index", "multi"])
@pytest.mark.parametrize("name", IDS)
def test_environments_with_pictures_pass_the_gymnasium_checker(name: str, observation: str) -> None:
    for mode in ("ansi", "rgb_array"):
        check_env(gymnasium.make(IDS[name], render_mode=mode, observation=observation).unwrapped)


def test_an_environment_without_pictures_passes_the_checker() -> None:
    check_env(gymnasium.make(IDS["forest"]).unwrapped)


def test_the_registered_limit_truncates() -> None:
    env = gymnasium.make(IDS["forest"])
    assert env.spec is not None
    assert env.spec.max_episode_steps == 200
    env.reset(seed=0)
    ends = [env.step(0)[2:4] for _ in range(200)]
    assert ends[:199] == [(False, False)] * 199
    assert ends[199] == (False, True)


def test_the_limit_can_be_overridden() -> None:
    env = gymnasium.make(IDS["forest"], max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(0)[3] for _ in range(3)] == [False, False, True]


def test_info_contains_state_step_and_success() -> None:
    env = EnvgraphEnv(explore(forest.engine(["SG"]), forest.behaviour()).tabular)
    _, info = env.reset()
    assert info == {"state": 0, "step": 0, "success": False, "is_success": False}
    observation, reward, terminated, truncated, info = env.step(2)
    assert (int(observation), reward, terminated, truncated) == (1, 10.0, True, False)
    assert info == {"state": 1, "step": 1, "success": True, "is_success": True}
    assert type(reward) is float
    assert type(terminated) is bool


def test_failure_is_no_success() -> None:
    env = EnvgraphEnv(explore(forest.engine(["SB"]), forest.behaviour()).tabular)
    env.reset()
    _, reward, terminated, _, info = env.step(2)
    assert (reward, terminated, info["success"]) == (-1.0, True, False)


def test_stepping_outside_an_episode_is_refused() -> None:
    env = EnvgraphEnv(explore(forest.engine(["SG"]), forest.behaviour()).tabular)
    with pytest.raises(ResetNeeded):
        env.step(0)
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset()
    env.step(2)
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_actions_and_states_are_checked() -> None:
    env = EnvgraphEnv(TARGET.tabular)
    env.reset()
    for action in (1.5, "right", None):
        with pytest.raises(InvalidArgument, match=r"is not in 0\.\.3.*`action_names`"):
            env.step(action)
    with pytest.raises(InvalidArgument, match=r"0\.\.3"):
        env.step(4)
    with pytest.raises(InvalidArgument, match="the reset option `state` is"):
        env.reset(options={"state": 10_000})
    with pytest.raises(InvalidArgument, match="the reset option `state` is 'x', but must be in"):
        env.reset(options={"state": "x"})
    assert env.reset(options={"state": np.int64(7)})[1]["state"] == 7


def test_unknown_reset_options_are_refused() -> None:
    env, live = EnvgraphEnv(TARGET.tabular), make("live")
    with pytest.raises(
        InvalidArgument, match="unknown reset option `variant`: this environment cannot switch variants"
    ):
        env.reset(options={"variant": 2})
    with pytest.raises(InvalidArgument, match="unknown reset option `stat`: the options are `state`"):
        env.reset(options={"stat": 2})
    with pytest.raises(InvalidArgument, match="unknown reset option `state`: this environment has no reset options"):
        live.reset(options={"state": 2})


def test_multi_observation_components_equal_the_decoded_index() -> None:
    index = EnvgraphEnv(TARGET.tabular)
    parts = EnvgraphEnv(TARGET.tabular, observation="multi")
    assert parts.observation_space == gymnasium.spaces.MultiDiscrete([64, 2])
    for action in (None, 2, 2, 0, 2, 3, 2, 2):
        one = index.reset()[0] if action is None else index.step(action)[0]
        other = parts.reset()[0] if action is None else parts.step(action)[0]
        assert other[0] + 64 * other[1] == one
        assert other in parts.observation_space


def test_a_seed_decides_the_episode() -> None:
    env = make("coins")

    def episode(seed: int) -> list[object]:
        seen = [env.reset(seed=seed)[0]]
        for _ in range(4):
            observation, _, terminated, _, _ = env.step(0)
            seen.append(observation)
            if terminated:
                break
        return [int(index) for index in seen]  # type: ignore[call-overload]

    assert episode(3) == episode(3)
    assert len({tuple(episode(seed)) for seed in range(20)}) > 1


def test_replaced_random_generator_is_used_from_the_next_episode_on() -> None:
    envs = make("coins"), make("live")
    for env in envs:
        env.reset(seed=1)
        env.unwrapped.np_random = np.random.default_rng(3)
    seen = [[env.reset()[0], *(env.step(1)[0] for _ in range(2))] for env in envs for _ in range(3)]
    assert seen[:3] == seen[3:]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copied_environment_continues_the_episode_like_the_original(
    copied: Callable[[EnvgraphEnv], EnvgraphEnv],
) -> None:
    env = EnvgraphEnv(explore(*loaded(RANDOM)).tabular)
    env.reset(seed=2)
    env.step(1)
    other = copied(env)
    one = [env.step(0)[:3] for _ in range(2)]
    assert [other.step(0)[:3] for _ in range(2)] == one


def test_rendering_shows_the_present_state() -> None:
    env = EnvgraphEnv(TARGET.tabular, pictures=TARGET.pictures, render_mode="ansi")
    env.reset()
    assert str(env.render()).startswith("(F) V  V")
    env.step(2)
    assert str(env.render()).startswith(" S (F) V")


def test_pixels_have_the_size_of_the_grid() -> None:
    env = EnvgraphEnv(TARGET.tabular, pictures=TARGET.pictures, render_mode="rgb_array", cell=20)
    env.reset()
    picture: NDArray[np.uint8] = env.render()  # type: ignore[assignment]
    assert (picture.shape, picture.dtype) == ((160, 160, 3), np.uint8)


def test_render_returns_none_without_a_mode_and_invalid_render_modes_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = EnvgraphEnv(TARGET.tabular)
    env.reset()
    assert env.render() is None
    with pytest.raises(InvalidArgument, match=r"no pictures: .*; write a clause such as `draw graph"):
        EnvgraphEnv(TARGET.tabular, render_mode="ansi")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "pygame", None)
        with pytest.raises(InvalidArgument, match=r"`human` needs pygame: pip install 'envgraph\[human\]'"):
            make("forest", render_mode="human")
    with pytest.raises(InvalidArgument, match="unknown render mode"):
        EnvgraphEnv(TARGET.tabular, render_mode="text")
    with pytest.raises(InvalidArgument, match="index"):
        EnvgraphEnv(TARGET.tabular, observation="both")  # type: ignore[arg-type]


def test_a_live_environment_without_a_drawing_cannot_render() -> None:
    simulator = Simulator(*loaded("action wait = nothing()"))
    with pytest.raises(InvalidArgument, match="no `draw`; write a clause such as `draw graph"):
        EnvgraphLiveEnv(simulator, render_mode="ansi")
    assert EnvgraphLiveEnv(simulator).reset()[0] == 0


def test_registering_again_changes_nothing_and_a_conflicting_name_is_refused() -> None:
    before = dict(gymnasium.registry)
    register_bundled()
    for name in IDS:
        register(f"Test-{name}", entry_point="tests.unit.env.test_gymnasium:make", limit=200, name=name)
    assert gymnasium.registry == before
    with pytest.raises(InvalidArgument, match="already registered"):
        register("BurningForest", limit=7, domain="burning_forest")
    with pytest.raises(InvalidArgument, match="cannot name"):
        register("a b", limit=7)


def test_importing_the_package_registers_the_bundled_environment() -> None:
    code = (
        "import json, sys, warnings; warnings.simplefilter('error'); import gymnasium;"
        "import envgraph.env; spec = gymnasium.spec('envgraph/BurningForest-v0');"
        "print(json.dumps([spec.max_episode_steps, spec.entry_point, 'envgraph.search' in sys.modules]))"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(out.stdout) == [200, "envgraph.search:make_environment", False]


def test_explored_environment_has_a_picture_of_each_state() -> None:
    assert isinstance(TARGET, ExploredEnvironment)
    assert len(TARGET.pictures) == TARGET.tabular.n_states == 124
