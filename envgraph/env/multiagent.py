"""Environments with several agents, with the interfaces of PettingZoo; they need the extra `multiagent`.

`TurnEnv` is an AEC environment of agents that take turns; `TogetherEnv` is a parallel environment of agents that act
together. Both step a live engine, so that each agent can be asked for its observation at any time.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from numpy.typing import NDArray

from envgraph.env._flat_observations import FlatLayout
from envgraph.env._gymnasium import RENDER_MODES, FamilyEnvironment, check_render_mode
from envgraph.env._model_views import TextView
from envgraph.env._observation_components import component_names, merge_sizes
from envgraph.env._observation_spaces import ComponentView, ObservationKind, split_index
from envgraph.env._simulator import SUCCESS, Simulator
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._text import scene_text
from envgraph.errors import InvalidArgument, list_names

_PETTINGZOO: Any = import_module("pettingzoo") if find_spec("pettingzoo") else None
_AEC: Any = _PETTINGZOO.AECEnv if _PETTINGZOO else object  # a missing package is reported when an environment is made
_PARALLEL: Any = _PETTINGZOO.ParallelEnv if _PETTINGZOO else object


class _MultiAgentEnvironment(FamilyEnvironment):
    """The base class of both kinds of environments: agents, observations, and pictures.

    An agent whose object was deleted is `terminated`; an agent whose object has another class stays, and does nothing.
    `state()` returns the observations of all agents, in the order of the agents.
    `reset(options={"variant": v})` switches to a member of the family that has the same agents.

    Args:
        simulator: the engine and its behaviour; nothing else may change its model in the meantime.
        limit: the number of steps (turns, if agents take turns) after which an episode is truncated; None for no limit.
        render_mode: None, "ansi" or "rgb_array".
        observation: "index", "multi", "flat", "dict" or "text".
        cell: the side of a cell in pixels.
        action_masks: add `action_mask`, int8 [actions], to infos: the actions that the agent can do in the current
            state.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        limit: int | None = None,
        render_mode: str | None = None,
        observation: ObservationKind | None = None,
        cell: int = 32,
        action_masks: bool = False,
    ) -> None:
        if _PETTINGZOO is None:
            raise InvalidArgument("this needs PettingZoo, which is not installed: pip install 'envgraph[multiagent]'")
        drawn = simulator.behaviour.draw is not None
        check_render_mode(render_mode, drawn=drawn)
        self.metadata: dict[str, Any] = {
            "name": simulator.behaviour.name,
            "render_modes": [*RENDER_MODES] if drawn else [],
            "render_fps": 4,
        }
        self.render_mode = render_mode
        self.possible_agents = [*simulator.all_agent_names]
        self.agents: list[str] = []
        self.action_names = simulator.agents.action_names
        merge_sizes(simulator.agents.block_sizes)  # all agents observe in one space
        self._shape, self._cell = simulator.agents.shape, cell
        names = component_names(simulator.behaviour, simulator.keys, len(self._shape))
        if observation in ("image", "graph", "padded_graph"):
            raise InvalidArgument(f'agents of PettingZoo see no "{observation}"', 'use "flat", "dict" or "text"')
        is_text = observation == "text"
        self._view = TextView(simulator.behaviour) if is_text else ComponentView(observation, self._shape, names)
        actions = len(self.action_names)
        self._number = {name: number for number, name in enumerate(simulator.all_agent_names)}
        self.observation_spaces = dict.fromkeys(simulator.all_agent_names, self._view.space)
        self.action_spaces = {name: spaces.Discrete(actions) for name in simulator.all_agent_names}
        count, self._layout = len(simulator.all_agent_names), FlatLayout(self._shape)
        self.state_space: spaces.Space[Any] = spaces.MultiDiscrete(([*self._shape] or [1]) * count)
        if self._layout.floats:
            self.state_space = spaces.Box(*np.tile(self._layout.bounds(), count), dtype=np.float32)
        self._switch_member(simulator)
        self._limit, self._steps, self._has_masks = limit, 0, action_masks
        self._random: np.random.Generator | None = None

    def _switch_member(self, member_data: Simulator) -> None:
        if [*member_data.all_agent_names] != self.possible_agents:
            mine, other = list_names(self.possible_agents), list_names(member_data.all_agent_names)
            message = f"this environment has the agents {mine}, but that variant has {other}"
            raise InvalidArgument(message, "make another environment for that variant")
        self.simulator = member_data
        if member_data.behaviour.draw is not None:
            member_data.painter()  # finds parameters in the initial state

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the observation space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        """Return the action space of an agent: positions in `action_names`."""
        return self.action_spaces[agent]

    def observe(self, agent: str) -> Any:
        """Return an agent's observation of the current state, whoever acts next."""
        if isinstance(self._view, TextView):
            return self._view.observe(self.simulator, self._number[agent])
        return self._view.from_index(self.simulator.agents.observation_index(self._number[agent]))

    def state(self) -> NDArray[np.int64] | NDArray[np.float32]:
        """Return the components, or with floats the observations "flat", of all agents in the current state."""
        agents = self.simulator.agents
        seen = [split_index(agents.observation_index(number), self._shape) for number in self._number.values()]
        return np.concatenate([self._layout.encode(one) for one in seen] if self._layout.floats else seen)

    def render(self) -> str | NDArray[np.uint8] | None:
        """Return the current state as text ("ansi") or pixels [height, width, 3] ("rgb_array"); None without a mode."""
        if self.render_mode is None:
            return None
        scene = self.simulator.painter().draw()
        return scene_text(scene) if self.render_mode == "ansi" else scene_rgb(scene, self._cell)

    def close(self) -> None:
        """End the episode: restore the initial state, so that other code may change the model."""
        self.simulator.close()

    def _begin_episode(self, seed: int | None, options: dict[str, Any] | None) -> None:
        # PettingZoo's own tests pass an option "options".
        self._apply_options({name: value for name, value in (options or {}).items() if name != "options"})
        if seed is not None or self._random is None:
            self._random, _ = seeding.np_random(seed)
        self.simulator.reset(self._random)
        self.agents = [*self.possible_agents]
        self._steps = 0

    def _do_step(self, action: int) -> tuple[float, int, dict[str, bool], bool]:
        """Do a step; return the reward, the end, which agents are terminated, and True if the episode is truncated."""
        if self._random is None:
            raise ResetNeeded("no episode has begun: call `reset` first")
        reward, end = self.simulator.step_without_observation(action, self._random)
        self._steps += 1
        gone = self.simulator.agents.is_deleted
        over = {name: end > 0 or gone(self._number[name]) for name in self.agents}
        return reward, end, over, end < 0 or (self._limit is not None and self._steps >= self._limit)

    def _infos(self, success: bool) -> dict[str, dict[str, Any]]:
        return {name: self._info(name, success) for name in self.agents}

    def _info(self, agent: str, success: bool) -> dict[str, Any]:
        info: dict[str, Any] = {"step": self._steps, "success": success}
        if self._variant is not None:
            info["variant"] = self._variant
        if self._has_masks:
            info["action_mask"] = self.simulator.agent_action_mask(self._number[agent]).view(np.int8)
        return info

    def _check_action(self, agent: str, action: Any) -> int:
        if not self.action_spaces[agent].contains(action):
            last = len(self.action_names) - 1
            raise InvalidArgument(f"action {action!r} of `{agent}` is not in 0..{last}")
        return int(action)


class TurnEnv(_MultiAgentEnvironment, _AEC):  # type: ignore[misc]
    """Agents that take turns, with PettingZoo's AEC interface.

    The reward of a turn is paid to the agent whose turn it was. With the same seed the turns are those of
    `EnvgraphLiveEnv`.
    """

    def __init__(self, simulator: Simulator, **options: Any) -> None:
        if not simulator.agent_names:
            raise _wrong_kind_error(simulator, "make_parallel" if simulator.all_agent_names else None)
        super().__init__(simulator, **options)
        self.metadata["is_parallelizable"] = False

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begin an episode in a sampled start state; the option `variant` first switches to a member of the family."""
        self._begin_episode(seed, options)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.agent_selection = self.possible_agents[self.simulator.turn]
        self.infos = {name: self._reset_info(info) for name, info in self._infos(success=False).items()}

    def step(self, action: Any) -> None:
        """Do the action of `agent_selection`; for an agent that is over, the action must be None, and removes it."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        number = self._check_action(agent, action)
        self._cumulative_rewards[agent] = 0.0
        reward, end, over, cut = self._do_step(number)
        self.rewards = {name: reward if name == agent else 0.0 for name in self.agents}
        self.terminations = over
        self.truncations = dict.fromkeys(self.agents, cut)
        self.agent_selection = self.possible_agents[self.simulator.turn]
        self.infos |= self._infos(success=end == SUCCESS)
        self._accumulate_rewards()
        self._deads_step_first()


class TogetherEnv(_MultiAgentEnvironment, _PARALLEL):  # type: ignore[misc]
    """Agents that act together, with PettingZoo's parallel interface.

    Each agent gets its own and the shared rewards. With the same seed the steps are those of `EnvgraphLiveEnv`, whose
    joint action has one action for each agent.
    """

    def __init__(self, simulator: Simulator, **options: Any) -> None:
        if simulator.joint_stepper is None:
            raise _wrong_kind_error(simulator, "make_aec" if simulator.all_agent_names else None)
        super().__init__(simulator, **options)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode in a sampled start state; return the observations and infos of all agents."""
        self._begin_episode(seed, options)
        infos = self._infos(success=False)
        return self._observations(), {name: self._reset_info(info) for name, info in infos.items()}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Do one action of each agent; return observations, rewards, terminations, truncations and infos.

        Raises:
            InvalidArgument: an agent has no action, or an action that does not exist.
        """
        together = self.simulator.joint_stepper
        assert together is not None
        lacking = [name for name in self.agents if name not in actions]
        if lacking:
            raise InvalidArgument(f"`actions` has no action for `{lacking[0]}`", "give an action for each of `agents`")
        chosen = [
            self._check_action(name, actions[name]) if name in self.agents else 0 for name in self.possible_agents
        ]
        _, end, over, cut = self._do_step(together.joint_action(chosen))
        rewards = {name: together.rewards[self._number[name]] for name in self.agents}
        seen, infos = self._observations(), self._infos(success=end == SUCCESS)
        truncations = dict.fromkeys(self.agents, cut)
        self.agents = [name for name in self.agents if not (over[name] or cut)]
        return seen, rewards, over, truncations, infos

    def _observations(self) -> dict[str, Any]:
        return {name: self.observe(name) for name in self.agents}


def _wrong_kind_error(simulator: Simulator, wanted_function: str | None) -> InvalidArgument:
    """Return the error that tells to use `envgraph.<other>`, or `envgraph.make` if `wanted_function` is None."""
    name = simulator.behaviour.name
    if wanted_function is None:
        return InvalidArgument(f"environment `{name}` has no `agent` blocks", "use `envgraph.make`")
    how = "act together" if simulator.joint_stepper else "take turns"
    return InvalidArgument(f"the agents of `{name}` {how}", f"use `envgraph.{wanted_function}`")
