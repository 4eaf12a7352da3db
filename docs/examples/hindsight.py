"""Hindsight experience replay (HER) with DQN on the routing network, whose episodes have different goals.

pip install "envgraph[fast,sb3]"
python hindsight.py
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from stable_baselines3 import DQN, HerReplayBuffer

import envgraph


class Goals(gymnasium.Wrapper):
    """The components of a dictionary as goals: the reward is 0 if `achieved` equals `desired`, else -1."""

    def __init__(self, env: gymnasium.Env, achieved: str, desired: str) -> None:
        super().__init__(env)
        self.parts = env.observation_space
        self.goals = {"achieved_goal": achieved, "desired_goal": desired}
        sizes = {name: self.parts[part].n for name, part in self.goals.items()}
        sizes["observation"] = spaces.flatdim(self.parts)
        boxes = {name: spaces.Box(0, 1, (size,), np.float32) for name, size in sizes.items()}
        self.observation_space = spaces.Dict(boxes)

    def compute_reward(self, achieved: np.ndarray, desired: np.ndarray, info: Any) -> np.ndarray:
        return (achieved == desired).all(axis=-1).astype(np.float32) - 1

    def convert(self, parts: dict[str, Any]) -> dict[str, np.ndarray]:
        vectors = {name: spaces.flatten(self.parts[part], parts[part]) for name, part in self.goals.items()}
        vectors["observation"] = spaces.flatten(self.parts, parts)
        return {name: vector.astype(np.float32) for name, vector in vectors.items()}

    def reset(self, **options: Any) -> Any:
        parts, info = self.env.reset(**options)
        return self.convert(parts), info

    def step(self, action: Any) -> Any:
        parts, _, terminated, truncated, info = self.env.step(action)
        seen = self.convert(parts)
        reward = self.compute_reward(seen["achieved_goal"], seen["desired_goal"], info)
        return seen, float(reward), terminated, truncated, info


def arrives(model: DQN, env: gymnasium.Env, seed: int) -> bool:
    """Whether the greedy policy delivers the packet in the episode of a seed."""
    seen, info = env.reset(seed=seed)
    while True:
        seen, _, terminated, truncated, info = env.step(int(model.predict(seen, deterministic=True)[0]))
        if terminated or truncated:
            return bool(info["success"])


def main() -> None:
    routing = envgraph.make(domain="network/diverse.toml", observation="dict")
    env = Goals(routing, "packet at", "packet destination")
    settings = {"learning_starts": 200, "learning_rate": 1e-3, "gamma": 0.9, "target_update_interval": 200}
    buffer = {"replay_buffer_class": HerReplayBuffer, "exploration_fraction": 0.5}
    model = DQN("MultiInputPolicy", env, **buffer, **settings, seed=0, device="cpu").learn(3_000)
    print(sum(arrives(model, env, seed) for seed in range(50)), "of 50 packets arrive")


if __name__ == "__main__":
    main()
