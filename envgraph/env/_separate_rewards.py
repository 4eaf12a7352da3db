"""A wrapper that reports the rewards of an environment separately, by stepping one copy for each named reward."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import gymnasium


class SeparateRewards(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A wrapper that adds `info["rewards"]` to each step: the parts of the reward by name.

    Rewards do not influence transitions, so environments that differ only in rewards have the same episodes. The
    wrapper steps the environment and, for each name, a copy that pays only the rewards of this name.

    Args:
        env: the environment.
        parts: by name, a copy of the environment that pays only the rewards of this name.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], parts: Mapping[str, gymnasium.Env[Any, Any]]) -> None:
        super().__init__(env)
        self._parts = dict(parts)
        self._has_begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and its copies; the info of a reset has no `rewards`.

        On a first reset without a seed, each copy gets a copy of the environment's random generator.
        """
        if not self._has_begun and seed is None:
            for part in self._parts.values():
                part.np_random = deepcopy(self.unwrapped.np_random)
        self._has_begun = True
        for part in self._parts.values():
            part.reset(seed=seed, options=options)
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and its copies, and add the copies' rewards by name to the info as `rewards`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info["rewards"] = {name: part.step(action)[1] for name, part in self._parts.items()}
        return observation, reward, terminated, truncated, info
