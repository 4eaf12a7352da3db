"""The rewards of an environment apart: the same environment is stepped once more for each of them."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import gymnasium


class RewardsApart(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose infos tell each reward of a step, as `rewards`: by the name of what pays it.

    What happens does not depend on what is paid for it, so environments that differ in their rewards alone have the
    same episodes: beside the environment step those that pay the rewards of one name each. A step costs as many.

    Args:
        env: the environment.
        parts: by name, the same environment with the rewards of this name alone.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], parts: Mapping[str, gymnasium.Env[Any, Any]]) -> None:
        super().__init__(env)
        self._parts = dict(parts)
        self._begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; the info of a reset has no `rewards`."""
        if not self._begun and seed is None:
            for part in self._parts.values():
                part.np_random = deepcopy(self.unwrapped.np_random)
        self._begun = True
        for part in self._parts.values():
            part.reset(seed=seed, options=options)
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As that of the environment; the sum of `info["rewards"]` is the reward, but for rounding."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        info["rewards"] = {name: part.step(action)[1] for name, part in self._parts.items()}
        return observation, reward, terminated, truncated, info
