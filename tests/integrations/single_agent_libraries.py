"""Stable-Baselines3, sb3-contrib, Gymnasium's wrappers and a window: `make test-integrations` installs and runs them.

It is no `test_*.py`: `make test` needs none of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AutoresetMode

import envgraph
from envgraph.cli import main
from envgraph.env import torch_graph
from tests.integrations.documented import run_example

pytest.importorskip("sb3_contrib")  # modules are imported in `make test`, too, for their doctests

import torch
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix


def doors(observation: str = "flat", **options: Any) -> gymnasium.Env[Any, Any]:
    return Monitor(envgraph.make(domain="keydoor", observation=observation, **options))


def test_maskable_ppo_learns_and_does_only_what_is_allowed() -> None:
    vector = DummyVecEnv([doors] * 2)
    assert is_masking_supported(vector)
    model = MaskablePPO("MlpPolicy", vector, n_steps=250, batch_size=50, seed=0, device="cpu")
    model.learn(2_000)
    assert model.num_timesteps == 2_000
    assert model.ep_success_buffer, "it has read `is_success`"
    env = envgraph.make(domain="keydoor", observation="flat", action_masks=True)
    observation, info = env.reset(seed=0)
    for _ in range(100):
        masks = get_action_masks(env.unwrapped)
        assert masks.tolist() == info["action_mask"].tolist()
        action, _ = model.predict(observation, action_masks=masks)
        assert masks[action]
        observation, _, terminated, truncated, info = env.step(int(action))
        if terminated or truncated:
            observation, info = env.reset()


@pytest.mark.parametrize(
    ("observation", "policy"),
    [("multi", "MlpPolicy"), ("flat", "MlpPolicy"), ("dict", "MultiInputPolicy"), ("image", "MlpPolicy")],
)
def test_ppo_takes_the_observations(observation: str, policy: str) -> None:
    options = {"engine": "live"} if observation == "image" else {}
    check_env(envgraph.make(domain="keydoor", observation=observation, **options).unwrapped)
    vector = DummyVecEnv([partial(doors, observation, **options)] * 2)
    assert PPO(policy, vector, n_steps=64, batch_size=32, device="cpu").learn(256).num_timesteps == 256


def test_dqn_learns() -> None:
    model = DQN("MlpPolicy", doors(), learning_starts=50, buffer_size=500, device="cpu").learn(300)
    assert model.num_timesteps == 300


def test_a_graph_network_takes_graphs() -> None:
    data = pytest.importorskip("torch_geometric.data")
    from torch_geometric.nn import RGCNConv

    env: Any = envgraph.make(domain="network/diverse.toml", observation="graph", engine="live")
    view = env.unwrapped.view
    graphs = [torch_graph(env.reset(seed=seed)[0]) for seed in range(3)]
    for graph in graphs:
        assert graph.validate() and graph.num_node_features == len(view.features)
        to = view.references.index("Link.to")
        ends = graph.edge_index[:, graph.edge_type == to]
        links, routers = (graph.x[:, view.features.index(name)] for name in ("Link", "Router"))
        assert ends.shape[1] == links.sum() and links[ends[0]].all() and routers[ends[1]].all()
    batch = data.Batch.from_data_list(graphs)
    layer = RGCNConv(len(view.features), 4, num_relations=len(view.references))
    assert layer(batch.x, batch.edge_index, batch.edge_type).shape == (batch.num_nodes, 4)


def test_goals_are_learned_by_hindsight() -> None:
    arrived, *rest = run_example("hindsight.py").split()
    assert int(arrived) > 40 and rest == ["of", "50", "packets", "arrive"]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_loop_in_the_style_of_cleanrl_learns_with_masks(mode: AutoresetMode) -> None:
    envs = envgraph.make_vec(domain="keydoor", num_envs=16, observation="flat", action_masks=True, autoreset_mode=mode)
    envs = wrappers.vector.RecordEpisodeStatistics(envs) if mode is AutoresetMode.NEXT_STEP else envs
    width, actions = envs.single_observation_space.shape[0], envs.single_action_space.n
    policy = torch.nn.Linear(width, actions)
    optimiser = torch.optim.Adam(policy.parameters(), lr=0.05)
    seen, infos = envs.reset(seed=0)
    for _ in range(150):
        masks = torch.as_tensor(infos["action_mask"], dtype=torch.bool)
        logits = policy(torch.as_tensor(seen)).masked_fill(~masks, -torch.inf)
        chosen = torch.distributions.Categorical(logits=logits)
        action = chosen.sample()
        assert masks[torch.arange(16), action].all()
        seen, reward, _, _, infos = envs.step(action.numpy())
        loss = -(chosen.log_prob(action) * torch.as_tensor(reward, dtype=torch.float32)).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        assert torch.isfinite(loss)
    envs.close()


@pytest.mark.parametrize(
    ("observation", "wrap"),
    [
        ("multi", wrappers.FlattenObservation),
        ("dict", wrappers.FlattenObservation),
        ("flat", partial(wrappers.FrameStackObservation, stack_size=4)),
        ("flat", wrappers.TimeAwareObservation),
        ("image", partial(wrappers.ReshapeObservation, shape=(5, 70))),
        ("index", wrappers.RecordEpisodeStatistics),
        ("index", wrappers.Autoreset),
        ("index", partial(wrappers.DtypeObservation, dtype=np.int32)),
    ],
)
def test_gymnasiums_wrappers_fit(
    observation: str, wrap: Callable[[gymnasium.Env[Any, Any]], gymnasium.Env[Any, Any]]
) -> None:
    options = {"engine": "live"} if observation == "image" else {}
    env = wrap(envgraph.make(domain="keydoor", observation=observation, **options))
    seen, info = env.reset(seed=0)
    assert env.observation_space.contains(seen)
    for _ in range(120):
        seen, _, terminated, truncated, info = env.step(int(env.action_space.sample()))
        assert env.observation_space.contains(seen)
        if (terminated or truncated) and not isinstance(env, wrappers.Autoreset):
            env.reset()
    assert env.get_wrapper_attr("action_masks")().shape == (env.action_space.n,)
    assert "is_success" in info


@pytest.mark.parametrize("engine", ["table", "live"])
def test_a_window_shows_each_state(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    env = envgraph.make(domain="keydoor", render_mode="human", engine=engine)
    env.unwrapped.metadata = {**env.unwrapped.metadata, "render_fps": 1000}
    pictures = envgraph.make(domain="keydoor", render_mode="rgb_array", engine=engine)
    for one in (env, pictures):
        one.reset(seed=0)
    for action in (None, 0, 1):
        if action is not None:
            env.step(action), pictures.step(action)
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        assert np.array_equal(shown, pictures.render())
    assert env.render() is None
    env.close()
    assert pygame.display.get_surface() is None


def test_people_play_with_the_keys_of_the_actions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame
    from gymnasium.utils.play import play

    env = envgraph.make(domain="keydoor", render_mode="rgb_array")
    keys = env.unwrapped.get_keys_to_action()
    named = pygame.K_LEFT, pygame.K_DOWN, pygame.K_RIGHT, pygame.K_UP, pygame.K_a, pygame.K_s, pygame.K_d, pygame.K_w
    assert [*keys] == [(code,) for code in (*named, pygame.K_RETURN)]
    waiting, done = [pygame.K_RIGHT, pygame.K_DOWN, pygame.K_d, pygame.K_RETURN], []

    def press_next() -> None:
        if done:
            pygame.event.post(pygame.event.Event(pygame.KEYUP, key=waiting[len(done) - 1]))
        which = pygame.event.Event(pygame.KEYDOWN, key=waiting[len(done)]) if len(done) < len(waiting) else None
        pygame.event.post(which or pygame.event.Event(pygame.QUIT))

    def note(*step: Any) -> None:
        done.append(step[2])
        press_next()

    pygame.init()
    press_next()
    play(env, callback=note, wait_on_player=True, seed=0, fps=1000)
    assert done == [2, 1, 6, 8]


def test_people_play_in_a_window(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    keys = iter([pygame.K_RIGHT, pygame.K_DOWN, pygame.K_RETURN, pygame.K_u, pygame.K_ESCAPE])
    flip, titles = pygame.display.flip, list[str]()

    def press_next() -> None:
        flip()
        titles.append(pygame.display.get_caption()[0])
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=next(keys), unicode=""))

    monkeypatch.setattr(pygame.display, "flip", press_next)
    monkeypatch.setattr("sys.argv", ["envgraph", "play", "keydoor", "--window"])
    assert main() == 0
    steps = [title.removeprefix("E1 of KeyDoorTeaching: ").partition(",")[0] for title in titles]
    assert steps == ["E1 of KeyDoorTeaching", "1 step", "2 steps", "3 steps", "2 steps"]
    assert "2 steps, go(south), reward -0.01, total -0.02" in capsys.readouterr().out
    assert pygame.display.get_surface() is None
