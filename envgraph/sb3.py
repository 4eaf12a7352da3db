"""Vector environments for Stable-Baselines3: `PPO("MlpPolicy", envgraph.sb3.make_vec("family.json", 64))`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from inspect import signature
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from envgraph.env import VectorEnvironment
from envgraph.errors import InvalidArgument
from envgraph.search import make_vec as make_gymnasium_vec

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv, unwrap_vec_normalize
except ModuleNotFoundError as error:
    raise ImportError("`envgraph.sb3` needs Stable-Baselines3: pip install 'envgraph[sb3]'") from error


def make_vec(family: Any = None, num_envs: int = 1, variant: Any = None, **options: Any) -> SB3VectorEnv:
    """Return the vector environment of `envgraph.make_vec` as a `VecEnv`; the arguments and errors are the same.

    `observation` is by default "flat", and `autoreset_mode` cannot be given.
    """
    options = {"observation": "flat", **options}
    return SB3VectorEnv(make_gymnasium_vec(family, num_envs, variant, autoreset_mode="SameStep", **options))


class PolicyResults(NamedTuple):
    """Episodes of a policy: for each member its name, their number, and their mean return, success and length."""

    members: tuple[str, ...]
    episodes: tuple[int, ...]
    returns: NDArray[np.float64]
    success: NDArray[np.float64]
    lengths: NDArray[np.float64]

    def __str__(self) -> str:
        rows = [*zip(*self, strict=True), ("mean", sum(self.episodes), *(column.mean() for column in self[2:]))]
        lines = [f"{row[1]:8}{row[2]:10.2f}{row[3]:9.3f}{row[4]:8.1f}  {row[0]}" for row in rows]
        return "\n".join(["episodes    return  success  length  member", *lines])


def evaluate(model: Any, envs: Any, episodes: int = 20, *, deterministic: bool = True, seed: int = 0) -> PolicyResults:
    """Play exactly `episodes` episodes in each environment, so that short episodes do not count more than long ones.

    `envs` is seeded and reset. A `VecNormalize` around it, or else that of `model`, normalises observations without an
    update; returns and lengths are those of `Monitor`. `model` may also be a policy. If it is None, actions are sampled
    uniformly from those that the masks allow.
    """
    if not isinstance(envs, VecEnv) or episodes < 1:
        raise InvalidArgument("`envs` must be a `VecEnv`, and `episodes` at least 1", "use `envgraph.sb3.make_vec`")
    own, found, rng = unwrap_vec_normalize(envs), dict[str, list[tuple[float, ...]]](), np.random.default_rng(seed)
    if own and own is not envs and own.training:
        raise InvalidArgument("a `VecNormalize` below another wrapper would be updated", "set its `training` to False")
    of_model = None if own or not hasattr(model, "get_vec_normalize_env") else model.get_vec_normalize_env()
    normal, envs = (own, own.venv) if own is envs else (of_model, envs)
    has_masks = envs.has_attr("action_masks") and (not model or "action_masks" in signature(model.predict).parameters)
    count, over, state = np.zeros(envs.num_envs, np.int64), np.ones(envs.num_envs, np.bool_), None
    envs.seed(seed)
    envs.action_space.seed(seed)
    seen = envs.reset()
    while count.min() < episodes:
        masks = {"action_masks": np.stack(envs.env_method("action_masks"))} if has_masks else {}
        if model:
            normalised = normal.normalize_obs(seen) if normal else seen
            actions, state = model.predict(normalised, state, over, deterministic, **masks)
        elif has_masks:
            actions = (rng.random(masks["action_masks"].shape) * masks["action_masks"]).argmax(axis=1)
        else:
            actions = np.stack([envs.action_space.sample() for _ in range(envs.num_envs)])
        seen, _, over, infos = envs.step(actions)
        for place in np.flatnonzero(over & (count < episodes)):
            info = infos[place]
            if "episode" not in info:
                raise InvalidArgument("`envs` report no returns of episodes", "wrap each environment in `Monitor`")
            episode = info["episode"]["r"], info.get("is_success", np.nan), info["episode"]["l"]
            found.setdefault(info.get("variant", ""), []).append(episode)
        count += over
    names = sorted(found, key=lambda name: (len(name), name))
    means = np.array([np.mean(found[name], axis=0) for name in names])
    return PolicyResults(tuple(names), tuple(len(found[name]) for name in names), *means.T)


class SB3VectorEnv(VecEnv):  # type: ignore[misc]
    """A `VecEnv` over `envs`, a vector environment of Gymnasium whose autoreset mode is SAME_STEP.

    Only the infos of environments whose episode ended have entries: the infos of the last step, `terminal_observation`,
    `TimeLimit.truncated`, and `episode` (return, length, seconds) as of `Monitor`. `reset_infos` has the infos of the
    resets. Attributes are those of `envs`, the same for all environments, and `action_masks` is the only method. With
    `vectorization_mode="sync"` attributes and methods are those of single environments.
    """

    def __init__(self, envs: VectorEnvironment) -> None:
        self.envs: Any = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = envs.metadata
        self._start = time.time()

    def reset(self) -> Any:
        """Begin an episode in each environment, with the seeds and options that were set; return the observations."""
        options: Any = self._options[0]
        if any(one != options for one in self._options):
            options = {name: [one[name] for one in self._options] for name in max(self._options, key=len)}
        seeds = None if self._seeds[0] is None else self._seeds
        observations, infos = self.envs.reset(seed=seeds, options=options)
        self.reset_infos = [_info_of(infos, place) for place in range(self.num_envs)]
        self._returns = np.zeros(self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Do the stored actions; return the observations, rewards, ends and infos."""
        observations, rewards, terminated, truncated, found = self.envs.step(self._actions)
        over = terminated | truncated
        self._returns += rewards
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for place in np.flatnonzero(over).tolist():
            last, total = _info_of(found["final_info"], place), self._returns[place].item()
            last["episode"] = {"r": round(total, 6), "l": last["step"], "t": round(time.time() - self._start, 6)}
            last["TimeLimit.truncated"] = not terminated[place]
            last["terminal_observation"] = found["final_obs"][place]
            infos[place], self.reset_infos[place] = last, _info_of(found, place)
        self._returns[over] = 0.0
        return observations, rewards.astype(np.float32), over, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of each environment; None without a render mode."""
        return self.envs.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each environment."""
        each = hasattr(self.envs, "get_attr")
        found = self.envs.get_attr(attr_name) if each else [getattr(self.envs, attr_name)] * self.num_envs
        return [found[place] for place in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of all environments; `indices` must be None."""
        if indices is not None:
            raise InvalidArgument("`set_attr` sets an attribute of all environments", "leave out `indices`")
        self.envs.set_attr(attr_name, value) if hasattr(self.envs, "set_attr") else setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Return the results of a method of each environment."""
        if hasattr(self.envs, "call"):
            found = self.envs.call(method_name, *method_args, **method_kwargs)
        elif method_name == "action_masks":
            found = self.envs.action_masks()
        else:
            raise AttributeError(f'`{method_name}` needs single environments: use `vectorization_mode="sync"`')
        return [found[place] for place in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return True for `Monitor`, because the infos have its statistics, and False for other wrappers."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def _info_of(infos: dict[str, Any], place: int) -> dict[str, Any]:
    """Return the infos of one environment, without those of an episode that ended, from the infos of a vector."""
    found = {}
    for name, value in infos.items():
        if not name.startswith(("_", "final_")) and infos[f"_{name}"][place]:
            one = _info_of(value, place) if isinstance(value, dict) else value[place]
            found[name] = one.item() if isinstance(one, np.generic) else one
    return found
