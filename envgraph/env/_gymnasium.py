"""Single environments with Gymnasium's interface, over a table or a live engine."""

from __future__ import annotations

from abc import abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from operator import index
from typing import TYPE_CHECKING, Any, Final, TypedDict, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from envgraph.behaviour import key_bindings, key_code
from envgraph.draw import html_picture, html_table
from envgraph.env._enumeration import ExploredEnvironment
from envgraph.env._family_members import MemberFacts, SwitchableMembers
from envgraph.env._model_views import ModelView, model_view
from envgraph.env._observation_spaces import (
    MODEL_KINDS,
    ComponentView,
    ObservationCache,
    ObservationKind,
    check_observation_kind,
)
from envgraph.env._simulator import SUCCESS, Simulator
from envgraph.env._tabular import Tabular, cumulative_sums
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import DRAW_HINT, Scene
from envgraph.env.scene._scene_svg import scene_svg
from envgraph.env.scene._text import scene_text
from envgraph.env.scene._window import Window, has_window
from envgraph.errors import InvalidArgument, list_names
from envgraph.graph import Model

if TYPE_CHECKING:
    from envgraph.env.compiled.programs._compiled_program import CompiledProgram

RENDER_MODES: Final = ("ansi", "rgb_array", "human")
"""Render modes: text, pixels, and a window."""


def view_for(
    observation: ObservationKind | ModelView | None, source: Simulator | CompiledProgram, models: Iterable[Model]
) -> ComponentView | ModelView:
    """Return the view for an observation kind; a given view is returned unchanged.

    Views of the whole model are created with spaces that fit all `models`.

    Raises:
        InvalidArgument: the kind is unknown, or the source does not support it.
    """
    if isinstance(observation, ModelView):
        return observation
    check_observation_kind(observation)
    if observation is not None and observation in MODEL_KINDS:
        return model_view(observation, source.behaviour, [*models])
    return ComponentView(observation, source.observation_shape, source.observation_names)


def check_render_mode(render_mode: str | None, modes: Sequence[str] = RENDER_MODES, *, drawn: bool) -> None:
    """Raise an error unless a render mode is None, or is supported and can be used now.

    Args:
        render_mode: None, or one of the modes.
        modes: the supported modes.
        drawn: True if the behaviour has a `draw` clause.

    Raises:
        InvalidArgument: the mode is unknown, the behaviour has no `draw` clause, or no window can be opened.
    """
    if render_mode is not None and render_mode not in modes:
        raise InvalidArgument(f"unknown render mode {render_mode!r}; the render modes are {list_names(modes)}")
    if render_mode is not None and not drawn:
        raise InvalidArgument(f"this environment has no pictures: its behaviour has no `draw`; {DRAW_HINT}")
    if render_mode == "human" and not has_window():
        raise InvalidArgument("render mode `human` needs pygame: pip install 'envgraph[human]'")


def check_options(options: dict[str, Any] | None, known_names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the options of a reset, or {} if they are None.

    Raises:
        InvalidArgument: an option is not among the known names.
    """
    for name in options or {}:
        if name not in known_names:
            there_are = (
                f"the options are {list_names(known_names)}" if known_names else "this environment has no reset options"
            )
            hint = "this environment cannot switch variants; make another one" if name == "variant" else there_are
            raise InvalidArgument(f"unknown reset option `{name}`: {hint}")
    return options or {}


class FamilyEnvironment:
    """A base class of environments that can switch to another member of their family.

    Attributes:
        members: the family, for `reset(options={"variant": ..})`; None without a family.
    """

    members: SwitchableMembers | None = None
    _facts: MemberFacts | None = None
    _variant: str | None = None

    def set_family(self, members: SwitchableMembers, position: int) -> None:
        """Set the family, and the position of the current member in it, so that `reset` can switch to other members."""
        self.members, self._facts = members, members.about(position)
        self._variant = self._facts["variant"]

    def _apply_options(self, options: dict[str, Any] | None, known_names: Sequence[str] = ()) -> dict[str, Any]:
        """Return the options of a reset, {} for None; if option `variant` names another member, first switch to it.

        Raises:
            InvalidArgument: an option is neither in `known_names` nor `variant` within a family, or the variant is
                unknown.
        """
        if self.members is None:
            return check_options(options, known_names)
        found = check_options(options, (*known_names, "variant"))
        variant = found.get("variant")
        if variant is not None:
            place = self.members.place(variant)
            if self.members.about(place)["variant"] != self._variant:
                self._switch_member(self.members.entered(place))
                self.set_family(self.members, place)
        return found

    @abstractmethod
    def _switch_member(self, member_data: Any) -> None:
        """Replace the environment's table, program or simulator by that of another member."""

    def _reset_info(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return the info of a reset: the given info and, within a family, a copy of the member's certificates."""
        return info if self._facts is None else {**info, "certificates": dict(self._facts["certificates"])}


class ViewOptions(TypedDict, total=False):
    """Options of single environments of all kinds.

    Attributes:
        render_mode: None, "ansi", "rgb_array" or "human".
        cell: the side of a cell in pixels.
        action_masks: add `action_mask` to the infos.
    """

    render_mode: str | None
    cell: int
    action_masks: bool


class SingleEnvironment(FamilyEnvironment, gymnasium.Env[Any, Any]):
    """The base class of environments over a table, over a live engine, and over a compiled program.

    Raises:
        InvalidArgument: a render mode that is unknown, or that needs pictures if the environment is not `drawn`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": [mode for mode in RENDER_MODES if mode != "human" or has_window()],
        "render_fps": 4,
    }

    def __init__(
        self,
        action_names: Sequence[str],
        view: ComponentView | ModelView,
        drawn: bool,
        *,
        render_mode: str | None = None,
        cell: int = 32,
        action_masks: bool = False,
    ) -> None:
        check_render_mode(render_mode, drawn=drawn)
        self._is_drawn = drawn
        self.render_mode = render_mode
        self.action_names = tuple(action_names)
        self.action_keys: Mapping[str, Sequence[str]] | None = {}
        self._action_count = len(self.action_names)
        self.action_space = spaces.Discrete(self._action_count)
        self.view = view
        self.observation_space = view.space
        self._cell = cell
        self._window = Window("envgraph", self.metadata["render_fps"]) if render_mode == "human" else None
        self._is_running = False
        self._steps = 0
        self._has_masks = action_masks
        self._has_begun = False

    def action_masks(self) -> NDArray[np.bool_]:
        """Return an array [actions] that is True for each action that does something now; all True if none does.

        An action does something if one of its branches is `nothing()`, or calls a rule that has a match, or a unit that
        can succeed. All are True outside of an episode. With `action_masks=True` the infos contain this mask as
        `action_mask`, int8.
        """
        return self._current_mask() if self._is_running else np.ones(len(self.action_names), dtype=np.bool_)

    @abstractmethod
    def _current_mask(self) -> NDArray[np.bool_]:
        """Return the action mask of the current state; an episode must have begun."""

    def get_keys_to_action(self) -> dict[tuple[int, ...], int]:
        """Return the action of each key, given as a key code, for `gymnasium.utils.play.play`; see `key_bindings`.

        Raises:
            InvalidArgument: agents act simultaneously, so an action combines several, and has no key.
        """
        if self.action_keys is None:
            raise InvalidArgument("agents act simultaneously, so no key stands for an action", "use `envgraph play`")
        bindings = key_bindings(self.action_names, self.action_keys)
        return {(code,): number for key, number in bindings.items() if (code := key_code(key)) is not None}

    def _complete_info(self, info: dict[str, Any]) -> dict[str, Any]:
        """Add the variant and action mask, if they apply, to an info, and return it; update an open window."""
        if self._variant is not None:
            info["variant"] = self._variant
        if self._has_masks:
            info["action_mask"] = self.action_masks().view(np.int8)
        if self._window is not None:
            self._window.show(scene_rgb(self._scene(), self._cell))
        return info

    def _begin_episode(self) -> None:
        self._is_running = self._has_begun = True
        self._steps = 0

    def _check_step(self, action: Any) -> int:
        if not self._is_running:
            raise ResetNeeded("the episode is over, or no episode has begun: call `reset` first")
        try:
            number = index(action)
        except TypeError:
            number = -1
        if not 0 <= number < self._action_count:
            hint = "use the position of the action's name in `action_names`"
            raise InvalidArgument(f"action {action!r} is not in 0..{self._action_count - 1}", hint)
        return number

    def render(self) -> str | NDArray[np.uint8] | None:
        """Return the current state as text ("ansi") or as pixels [height, width, 3] ("rgb_array"); None without a mode.

        With "human", each reset and step shows the state in a window, and this method returns None. Before the first
        reset it raises `ResetNeeded`.
        """
        if not self._has_begun:
            raise ResetNeeded("call `reset` before `render`")
        if self.render_mode is None or self._window is not None:
            return None
        scene = self._scene()
        return scene_text(scene) if self.render_mode == "ansi" else scene_rgb(scene, self._cell)

    def _repr_html_(self) -> str:
        actions, observed = ", ".join(self.action_names), str(self.observation_space)
        facts = html_table([("actions", actions), ("observation", observed), ("steps", self._steps)])
        return facts + html_picture(lambda: scene_svg(self._scene())) if self._is_drawn and self._has_begun else facts

    def close(self) -> None:
        """Close the window, if one is open."""
        if self._window is not None:
            self._window.close()

    @abstractmethod
    def _scene(self) -> Scene:
        """Return the picture of the current state."""


class EnvgraphEnv(SingleEnvironment):
    """An environment that steps through a table of its states.

    Observations are indices (`Discrete`), or with `observation="multi"` their components (`MultiDiscrete`). The info
    contains `state` (number of the state), `step` (steps since the reset), `success`, `is_success` (the same), the
    name of the `variant` within a family, and `agent`, the agent that acts next, if several agents take turns. Time
    limits are Gymnasium's own: registered, or `gymnasium.wrappers.TimeLimit`. A step after the end of an episode is an
    error.

    `reset(options={"state": s})` begins in state s. `{"variant": v}` switches to another member of the family, for this
    episode and the following ones. Other options are refused.

    Args:
        tabular: the states.
        pictures: one scene for each state; only needed for rendering.
        observation: "index", "multi", "flat" or "dict".
        options: see `ViewOptions`.

    Raises:
        InvalidArgument: an unknown mode, a mode without pictures, or an observation that tables do not support.
    """

    def __init__(
        self,
        tabular: Tabular,
        *,
        pictures: Sequence[Scene] = (),
        observation: ObservationKind | None = None,
        **options: Unpack[ViewOptions],
    ) -> None:
        view = ComponentView(observation, tabular.observation_shape, tabular.observation_names)
        self._convert_observation = np.int64 if view.kind == "index" else view.from_index
        super().__init__(tabular.action_names, view, len(pictures) == tabular.n_states, **options)
        self._state = 0
        self._source: Any = None
        self._switch_member(ExploredEnvironment(tabular, tuple(pictures)))

    def _switch_member(self, member_data: ExploredEnvironment) -> None:
        self.tabular, self._pictures = member_data.tabular, member_data.pictures
        self._flat_table = _TabularViews(member_data.tabular)

    def _current_mask(self) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = self.tabular.action_masks[self._state].copy()
        return found

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in a sampled start state or that of option `state`; option `variant` switches the member."""
        wanted = self._apply_options(options, ("state",)).get("state")
        super().reset(seed=seed)
        if self.np_random is not self._source:
            self._source = self.np_random
            self._uniforms: list[float] = []
        self._state = self._sample_start(wanted)
        self._begin_episode()
        observed = self._convert_observation(self._flat_table.observation[self._state])
        return observed, self._reset_info(self._info(success=False))

    def _next_uniform(self) -> float:
        """Return the next random number. They are sampled in blocks, since single ones take several times as long."""
        if not self._uniforms:
            self._uniforms = self._source.random(64)[::-1].tolist()
        return self._uniforms.pop()

    def _sample_start(self, state_option: Any) -> int:
        if state_option is None:
            place = bisect_right(self._flat_table.start_sums, self._next_uniform())
            return int(self.tabular.start_states[place])
        if not isinstance(state_option, Integral) or not 0 <= int(state_option) < self.tabular.n_states:
            raise InvalidArgument(
                f"the reset option `state` is {state_option!r}, but must be in 0..{self.tabular.n_states - 1}"
            )
        return int(state_option)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do one action. `truncated` is True only if the behaviour truncates the episode, not for a time limit."""
        if type(action) is not int or not self._is_running or not 0 <= action < self._action_count:
            action = self._check_step(action)
        flat = self._flat_table
        outcomes = flat.outcomes
        place = self._state * flat.entries_per_state + action * outcomes
        uniform = self._next_uniform()  # also for deterministic actions, as in the live environment
        if outcomes > 1:
            place = bisect_right(flat.sums, uniform, place, place + outcomes)
        self._state = flat.next_state[place]
        self._steps += 1
        ended = flat.terminated[place]
        self._is_running = not ended
        observed = self._convert_observation(flat.observation[self._state])
        return observed, flat.reward[place], ended > 0, ended < 0, self._info(success=ended == SUCCESS)

    def _info(self, success: bool) -> dict[str, Any]:
        info: dict[str, Any] = {"state": self._state, "step": self._steps, "success": success, "is_success": success}
        turn = self.tabular.turn
        if turn is not None:
            info["agent"] = self.tabular.agent_names[turn[self._state]]
        return self._complete_info(info)

    def _scene(self) -> Scene:
        return self._pictures[self._state]


class _TabularViews:
    """The arrays of a table as flat memory views, which return Python numbers faster than NumPy's indexing does.

    Instances are immutable, so that copies of an environment share them.
    """

    def __init__(self, tabular: Tabular) -> None:
        self._tabular = tabular
        self.outcomes = int(tabular.next_state.shape[2])
        self.entries_per_state = self.outcomes * tabular.n_actions
        self.next_state = _flat_view(tabular.next_state)
        self.reward = _flat_view(tabular.reward)
        self.terminated = _flat_view(tabular.terminated)
        self.sums = _flat_view(cumulative_sums(tabular.probability))
        self.observation = _flat_view(tabular.observation)
        self.start_sums = _flat_view(cumulative_sums(tabular.start_probability))

    def __deepcopy__(self, _: object) -> _TabularViews:
        return self

    def __reduce__(self) -> tuple[type[_TabularViews], tuple[Tabular]]:
        return _TabularViews, (self._tabular,)


def _flat_view(array: NDArray[Any]) -> Any:
    return np.ascontiguousarray(array).reshape(-1).data


class EnvgraphLiveEnv(SingleEnvironment):
    """An environment that steps a live engine, for environments with too many states to enumerate.

    With the same seed it does the same as `EnvgraphEnv` over its table; the info has no `state`.

    Args:
        simulator: the engine and its behaviour; nothing else may change its model in the meantime.
        observation: see `make_environment`; or a view that was made for several members.
        options: see `ViewOptions`.
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        observation: ObservationKind | ModelView | None = None,
        **options: Unpack[ViewOptions],
    ) -> None:
        view = view_for(observation, simulator, [simulator.engine.model])
        super().__init__(simulator.action_names, view, simulator.behaviour.draw is not None, **options)
        self._switch_member(simulator)

    def _switch_member(self, member_data: Simulator) -> None:
        self.simulator = member_data
        if member_data.behaviour.draw is not None:
            member_data.painter()  # finds parameters in the initial state
        self._memory = ObservationCache()

    def _observation(self, index: int) -> Any:
        view, simulator = self.view, self.simulator
        if isinstance(view, ComponentView):
            return view.from_index(index)
        return view.present(self._memory.get(simulator.state_key(), lambda: view.observe(simulator)))

    def _current_mask(self) -> NDArray[np.bool_]:
        return self.simulator.action_mask()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in a sampled start state; the option `variant` first switches to a member of the family."""
        self._apply_options(options)
        super().reset(seed=seed)
        index = self.simulator.reset(self.np_random)
        self._begin_episode()
        return self._observation(index), self._reset_info(self._info(success=False))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do one action. `truncated` is True only if the behaviour truncates the episode, not for a time limit."""
        outcome = self.simulator.step(self._check_step(action), self.np_random)
        self._steps += 1
        self._is_running = not outcome.terminated
        info = self._info(success=outcome.terminated == SUCCESS)
        observed = self._observation(outcome.observation)
        return observed, outcome.reward, outcome.terminated > 0, outcome.terminated < 0, info

    def _info(self, success: bool) -> dict[str, Any]:
        info: dict[str, Any] = {"step": self._steps, "success": success, "is_success": success}
        if self.simulator.agent_names:
            info["agent"] = self.simulator.agent_names[self.simulator.turn]
        return self._complete_info(info)

    def _scene(self) -> Scene:
        return self.simulator.painter().draw()
