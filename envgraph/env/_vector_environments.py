"""Vector environments, which step many environments at once by indexing arrays."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from copy import deepcopy
from operator import index
from typing import Any, TypedDict, Unpack

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envgraph.env._family_members import VectorVariants
from envgraph.env._gymnasium import check_options, check_render_mode
from envgraph.env._model_views import ModelView
from envgraph.env._observation_spaces import ComponentView, ObservationKind, split_index
from envgraph.env._simulator import SUCCESS
from envgraph.env._tabular import Tabular, cumulative_sums
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import Scene
from envgraph.env.schedules import MemberAssignment, Schedule
from envgraph.errors import InvalidArgument, list_names

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


class VectorOptions(TypedDict, total=False):
    """Options of vector environments of all kinds.

    Attributes:
        max_episode_steps: the number of steps after which an episode is truncated; None for no limit.
        render_mode: None or "rgb_array".
        autoreset_mode: one of `gymnasium.vector.AutoresetMode`, or its value.
        schedule: chooses the member of each episode; None: each environment keeps its member.
        action_masks: add `action_mask` to the infos.
    """

    max_episode_steps: int | None
    render_mode: str | None
    autoreset_mode: AutoresetMode | str
    schedule: Schedule | None
    action_masks: bool


class VectorEnvironmentBase(VectorEnv[Any, Any, Any]):
    """The base class of vector environments over tables and over compiled programs: spaces, order of a step, infos.

    Args:
        action_names: the names of the actions of each environment, by number.
        view: converts observations.
        members: the number of members that the environments use.
        max_episode_steps, render_mode, autoreset_mode, schedule, action_masks: see `VectorOptions`.

    Raises:
        InvalidArgument: a count below 1, or an unknown mode.

    Attributes:
        variants: the members of the environments, for `reset(options={"variant": ..})`; None without a family.
    """

    variants: VectorVariants | None = None
    _variant_names: NDArray[Any]
    _history: int | None = None
    _last_observations: Any = None

    def set_variants(self, variants: VectorVariants) -> None:
        """Set the members of the environments, so that infos name them and `reset` can switch between them."""
        self.variants, self._variant_names = variants, variants.names_for(self._member_numbers)

    def set_history(self, length: int) -> None:
        """Let an observation consist of the last `length` ones, as Gymnasium's `FrameStackObservation` does."""
        self._history = length
        self.single_observation_space = batch_space(self.single_observation_space, length)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        action_names: Sequence[str],
        view: ComponentView | ModelView,
        members: int,
        *,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        schedule: Schedule | None = None,
        action_masks: bool = False,
    ) -> None:
        if not hasattr(num_envs, "__index__") or num_envs < 1:
            raise InvalidArgument(f"`num_envs` is {num_envs!r}, but must be an int of at least 1")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise InvalidArgument(f"`max_episode_steps` is {max_episode_steps}, but must be at least 1")
        self.num_envs = num_envs
        self.autoreset_mode = parse_autoreset_mode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.max_episode_steps = max_episode_steps
        self.action_names = tuple(action_names)
        self.single_action_space = spaces.Discrete(len(self.action_names))
        self.single_observation_space = view.space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.view = view
        self._n_actions = len(self.action_names)
        self._has_begun = False
        self._has_masks = action_masks
        self._each_by_default = self._each = False  # True if each environment has its own random generator
        self._member_numbers: Ints = np.arange(num_envs) % members
        self._scheduled_members = None if schedule is None else MemberAssignment(schedule, num_envs, members)
        self._steps: Ints = np.zeros(num_envs, dtype=np.int64)
        self._is_done: Bools = np.zeros(num_envs, dtype=np.bool_)

    @property
    def schedule(self) -> Schedule | None:
        """Return the schedule that chooses the member of each episode, or None."""
        return self._scheduled_members.schedule if self._scheduled_members else None

    @abstractmethod
    def action_masks(self) -> Bools:
        """Return bool [environments, actions]: True for each action that does something now; all True if none does."""

    @abstractmethod
    def _switch_members(self, mask: Bools, members: Ints) -> None:
        """Switch the environments in `mask` to other members from the next episode on.

        `members` has an entry for every environment.
        """

    @abstractmethod
    def _seed_streams(self, generators: Sequence[np.random.Generator | None]) -> None:
        """Let each environment sample from its own generator from now on; None keeps the present one."""

    @abstractmethod
    def _reset_environments(self, mask: Bools) -> None:
        """Put each environment in the mask into a sampled start state."""

    @abstractmethod
    def _step_environments(self, actions: Ints) -> tuple[Floats, Ints, Bools]:
        """Step all environments, or begin a new episode where one had ended; return rewards, ends and truncations.

        Ends are 0 (none), 1 (success), 2 (failure) and -1 (truncated by the behaviour).
        """

    @abstractmethod
    def _observations(self) -> Any:
        """Return the current observations of all environments."""

    def _observe(self, begun: Bools, *, stepped: bool) -> Any:
        """Return the observations after episodes began in `begun`, and, if `stepped`, after a step of the others."""
        observed = self._observations()
        if self._history is None:
            return observed
        self._last_observations = _append(self._last_observations, observed, begun, stepped, self._history)
        return deepcopy(self._last_observations)

    @abstractmethod
    def _own_infos(self) -> dict[str, NDArray[Any]]:
        """Return the info entries that only this kind of environment has, such as `state` for tables."""

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every environment, or in those of `options={"reset_mask": mask}`.

        With a list of seeds each environment has its own generator, like a single environment; None keeps a generator.
        The first seed of the list also seeds the schedule.

        `options={"variant": v}` switches to another available member, or to one member for each environment. It is
        refused if a schedule chooses the members.
        """
        variants = None if self._scheduled_members else self.variants  # a schedule chooses the members itself
        wanted = check_options(options, ("reset_mask", "variant") if variants else ("reset_mask",))
        mask, variant = self._parse_mask(wanted.get("reset_mask")), wanted.get("variant")
        members = None if variants is None or variant is None else variants.member_numbers(variant, self.num_envs)
        self._seed(seed, mask)
        if members is not None:
            self._set_members(mask, members)
        if self._scheduled_members and (seed is not None or not self._has_begun):
            self._scheduled_members.seed(self.np_random.spawn(1)[0])
        self._has_begun = True
        self._choose_members(mask)
        self._reset_environments(mask)
        return self._observe(mask, stepped=False), self._info(np.zeros(self.num_envs, dtype=np.bool_), mask, mask)

    def _seed(self, seed: int | Sequence[int | None] | None, mask: Bools) -> None:
        """Seed the generator of all environments or, for a list or by default, those of the environments in `mask`."""
        if seed is None and self._has_begun:
            return
        if isinstance(seed, int | None):
            seeds = [None if seed is None else seed + number for number in range(self.num_envs)]
        else:
            seeds = [None if one is None else index(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise InvalidArgument(
                f"`seed` lists {len(seeds)} seeds, but must list {self.num_envs}, one per environment"
            )
        super().reset(seed=next((one for one in seeds if one is not None), None))
        had_each, self._each = self._each, self._each_by_default or not isinstance(seed, int | None)
        if self._each:
            generators = [
                None if had_each and (one is None or not is_reset) else np.random.Generator(np.random.PCG64(one))
                for one, is_reset in zip(seeds, mask.tolist(), strict=True)
            ]
            self._seed_streams(generators)

    def _set_members(self, mask: Bools, members: Ints) -> None:
        self._member_numbers = np.where(mask, members, self._member_numbers)
        self._switch_members(mask, members)
        if self.variants is not None:
            self._variant_names = self.variants.names_for(self._member_numbers)

    def _choose_members(self, mask: Bools) -> None:
        """Switch the environments in the mask to the members that the schedule chooses; do nothing without schedule."""
        if self._scheduled_members:
            self._scheduled_members.begin_episodes(mask)
            self._set_members(mask, self._scheduled_members.member)

    def _parse_mask(self, mask_option: Any) -> Bools:
        """Return the option `reset_mask` as an array, all True for None; raise an error if it is not a valid mask."""
        if mask_option is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(mask_option)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise InvalidArgument(f"`reset_mask` must be an array of {self.num_envs} bools, at least one of them True")
        if not self._has_begun and not mask.all():
            raise ResetNeeded("the first `reset` must reset all environments: call it without `reset_mask`")
        return mask

    def step(self, actions: Any) -> tuple[Any, Floats, Bools, Bools, dict[str, Any]]:
        """Do one action in every environment; the autoreset mode determines what happens to ended episodes."""
        if not self._has_begun:
            raise ResetNeeded("call `reset` before `step`")
        chosen = np.asarray(actions)
        if chosen.shape != (self.num_envs,) or not ((chosen >= 0) & (chosen < self._n_actions)).all():
            raise InvalidArgument(f"`actions` must be {self.num_envs} numbers in 0..{self._n_actions - 1}")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._is_done.any():
            numbers = ", ".join(map(str, np.flatnonzero(self._is_done).tolist()))
            raise ResetNeeded(f"the episodes of environments {numbers} are over: reset them with `reset_mask`")
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._choose_members(self._is_done)
        begun = self._is_done.copy()
        reward, ended, truncated = self._step_environments(chosen)
        terminated = ended > 0
        success = ended == SUCCESS
        if self._scheduled_members:
            self._scheduled_members.record_step(reward, terminated | truncated, success, self._steps)
        observed = self._observe(begun, stepped=True)
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or not self._is_done.any():
            return observed, reward, terminated, truncated, self._info(success, None, begun)
        final, begun = self._final_infos(success, observed), self._is_done.copy()
        self._choose_members(begun)
        self._reset_environments(begun)
        infos = {**final, **self._info(success & ~begun, None, begun)}
        return self._observe(begun, stepped=False), reward, terminated, truncated, infos

    def _final_infos(self, success: Bools, observed: Any) -> dict[str, Any]:
        """Return the info entries about the final states of the episodes that just ended, and their observations."""
        over = self._is_done.copy()
        seen = np.full(self.num_envs, None, dtype=object)
        for place in np.flatnonzero(over).tolist():
            is_dict = isinstance(observed, dict)
            seen[place] = {name: one[place] for name, one in observed.items()} if is_dict else observed[place]
        return {
            "final_obs": seen,
            "_final_obs": over,
            "final_info": self._info(success, over),
            "_final_info": over.copy(),
        }

    def _info(self, success: Bools, mask: Bools | None = None, has_begun: Bools | None = None) -> dict[str, Any]:
        """Return the info of the environments in `mask` (None: all), with certificates for those in `has_begun`.

        `has_begun` marks the environments whose episode just began.
        """
        values: dict[str, NDArray[Any]] = {
            **self._own_infos(),
            "step": self._steps.copy(),
            "success": success.copy(),
            "is_success": success.copy(),
        }
        if self.variants is not None:
            values["variant"] = self._variant_names if mask is None else self._variant_names.copy()
        if self._has_masks:
            values["action_mask"] = self.action_masks().view(np.int8)
        if self._scheduled_members:
            values |= {
                "member": self._scheduled_members.member.copy(),
                "learn": self._scheduled_members.learn.copy(),
            }
        if mask is None:
            mask = np.ones(self.num_envs, dtype=np.bool_)
        else:
            for name, value in values.items():
                value[~mask] = None if name in ("agent", "variant") else 0
        infos = {**values, **{f"_{name}": mask.copy() for name in values}}
        if self.variants is not None and has_begun is not None and has_begun.any():
            infos |= self.variants.certificates(self._member_numbers, has_begun)
        return infos


class EnvgraphVectorEnv(VectorEnvironmentBase):
    """Copies of one environment, or members of a family side by side, stepped by NumPy indexing.

    Environment i is table i modulo the number of tables; all tables need the same actions and observations, as the
    members of a family have. Infos are arrays: `state`, `step`, `success`, `is_success` (the same), `variant` (names
    within a family), and, if several agents take turns, `agent`, the names of the agents that act next; `_state` and
    so on mark the environments that have the entry.

    The autoreset modes are Gymnasium's. In mode DISABLED `reset(options={"reset_mask": mask})` resets the environments
    that the mask, an array of bools, selects; stepping an environment that has ended is an error.

    With a schedule, each episode uses the table that the schedule chooses, whose number is `member` in the infos;
    `learn` is True if the agent should learn from the episode. The schedule is notified of each episode that ends. It
    has its own random generator, which the seed of `reset` determines; its state is kept over a `reset`.

    Args:
        tabulars: one table, or several.
        num_envs: the number of environments; None: one for each table.
        pictures: scenes of every state of each table; only needed for rendering.
        observation: "index", "multi", "flat" or "dict".
        options: see `VectorOptions`.

    Raises:
        InvalidArgument: no table, tables that differ in actions or observations, or a count below 1.
    """

    def __init__(
        self,
        tabulars: Tabular | Sequence[Tabular],
        num_envs: int | None = None,
        *,
        pictures: Sequence[Sequence[Scene]] = (),
        observation: ObservationKind | None = None,
        **options: Unpack[VectorOptions],
    ) -> None:
        tables = (tabulars,) if isinstance(tabulars, Tabular) else tuple(tabulars)
        _check_tables(tables)
        check_render_mode(options.get("render_mode"), ("rgb_array",), drawn=len(pictures) == len(tables))
        first = tables[0]
        view = ComponentView(observation, first.observation_shape, first.observation_names)
        count = len(tables) if num_envs is None else num_envs
        super().__init__(count, first.action_names, view, len(tables), **options)
        self._shape = first.observation_shape or (1,)
        self._pictures = pictures
        self._join_tables(tables)
        self._state: Ints = np.zeros(self.num_envs, dtype=np.int64)
        self._streams: dict[int, np.random.Generator] = {}

    def _join_tables(self, tables: Sequence[Tabular]) -> None:
        """Concatenate the arrays of all tables; states of later tables get higher numbers."""
        outcomes = max(table.next_state.shape[2] for table in tables)
        sizes = [table.n_states for table in tables]
        self._first = np.cumsum([0, *sizes[:-1]])
        shifted = [
            _pad_outcomes(table.next_state.astype(np.int64), outcomes) + first
            for table, first in zip(tables, self._first, strict=True)
        ]
        self._outcomes = outcomes
        self._next = np.concatenate(shifted).ravel()  # flat, because one index is faster than three
        self._reward = np.concatenate([_pad_outcomes(table.reward, outcomes) for table in tables]).ravel()
        self._ended = np.concatenate([_pad_outcomes(table.terminated, outcomes) for table in tables]).ravel()
        sums = np.concatenate([cumulative_sums(_pad_outcomes(table.probability, outcomes)) for table in tables])
        self._sums = sums.reshape(-1, outcomes)
        self._observation = np.concatenate([table.observation for table in tables]).astype(np.int64)
        self._allowed = np.concatenate([table.action_masks for table in tables])
        acting = [np.array(table.agent_names, dtype=object)[table.turn] for table in tables if table.agent_names]
        self._agent = np.concatenate(acting) if acting else None
        width = max(len(table.start_states) for table in tables)
        self._starts = np.zeros((len(tables), width), dtype=np.int64)
        chances = np.zeros((len(tables), width))
        for row, table in enumerate(tables):
            self._starts[row, : len(table.start_states)] = table.start_states + self._first[row]
            chances[row, : len(table.start_states)] = table.start_probability
        self._start_sums = cumulative_sums(chances)

    def _switch_members(self, mask: Bools, members: Ints) -> None:
        """Do nothing: the tables are joined already, and `_member_numbers` selects the table of each environment."""

    def action_masks(self) -> Bools:
        """Return bool [environments, actions]: True for each action that does something now; all True if none does."""
        return np.asarray(self._allowed[self._state])

    def _seed_streams(self, generators: Sequence[np.random.Generator | None]) -> None:
        if not self._streams:  # numbers are drawn in blocks, because a call for each takes long
            self._block, self._used = np.empty((self.num_envs, 64)), np.full(self.num_envs, 64)
        for place, generator in enumerate(generators):
            if generator is not None:
                self._streams[place], self._used[place] = generator, 64

    def _uniforms(self, mask: Bools) -> Floats:
        """Return a number from [0, 1) for each environment. Own generators of those outside `mask` do not advance."""
        if not self._each:
            return self.np_random.random(self.num_envs)
        for place in np.flatnonzero(self._used == 64).tolist():
            self._block[place], self._used[place] = self._streams[place].random(64), 0
        found: Floats = self._block[np.arange(self.num_envs), self._used]
        self._used += mask
        return found

    def _reset_environments(self, mask: Bools) -> None:
        uniform, which = self._uniforms(mask)[mask], self._member_numbers[mask]
        place = (self._start_sums[which] <= uniform[:, None]).sum(axis=1)
        self._state[mask] = self._starts[which, place]
        self._steps = np.where(mask, 0, self._steps)
        self._is_done = self._is_done & ~mask

    def _step_environments(self, actions: Ints) -> tuple[Floats, Ints, Bools]:
        state, again = self._state, self._is_done
        uniform = self._uniforms(~again)  # also for deterministic tables: equal draws for all
        at = state * self._n_actions + actions
        if self._outcomes > 1:
            at = at * self._outcomes + (self._sums[at] <= uniform[:, None]).sum(axis=1)
        reward, ended, self._state = self._reward[at], self._ended[at], self._next[at]
        self._steps = self._steps + ~again
        if again.any():
            reward[again], ended[again] = 0.0, 0
            self._reset_environments(again)
        truncated = ended < 0
        if self.max_episode_steps is not None:
            truncated |= (self._steps >= self.max_episode_steps) & ~again
        self._is_done = (ended > 0) | truncated
        return reward, ended, truncated

    def _observations(self) -> Any:
        index = self._observation[self._state]
        assert isinstance(self.view, ComponentView)
        return index if self.view.kind == "index" else self.view.from_components(split_index(index, self._shape))

    def _own_infos(self) -> dict[str, NDArray[Any]]:
        facts: dict[str, NDArray[Any]] = {"state": self._state - self._first[self._member_numbers]}
        return facts if self._agent is None else {**facts, "agent": self._agent[self._state]}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one picture for each environment, or None without a render mode."""
        if self.render_mode is None:
            return None
        if not self._has_begun:
            raise ResetNeeded("call `reset` before `render`")
        states = self._state - self._first[self._member_numbers]
        places = zip(self._member_numbers.tolist(), states.tolist(), strict=True)
        return tuple(scene_rgb(self._pictures[table][state]) for table, state in places)


def _append(past: Any, new: Any, begun: Bools, stepped: bool, length: int) -> Any:
    """Return [n, `length`, ..]: `new` where episodes began, else `past`, with `new` at its end if `stepped`."""
    if isinstance(new, dict):
        return {name: _append(past and past[name], one, begun, stepped, length) for name, one in new.items()}
    if past is None:
        return np.repeat(new[:, None], length, axis=1)
    found = np.concatenate([past[:, 1:], new[:, None]], axis=1) if stepped else past.copy()
    found[begun] = new[begun, None]
    return found


def parse_autoreset_mode(wanted_mode: AutoresetMode | str) -> AutoresetMode:
    """Return Gymnasium's autoreset mode with a value or name.

    Raises:
        InvalidArgument: the mode is unknown.
    """
    try:
        return AutoresetMode(wanted_mode)
    except ValueError:
        modes = list_names(mode.value for mode in AutoresetMode)
        raise InvalidArgument(f"unknown autoreset mode {wanted_mode!r}; the modes are {modes}") from None


def _check_tables(tables: Sequence[Tabular]) -> None:
    if not tables:
        raise InvalidArgument("a vector environment needs at least one table")
    first = tables[0]
    for table in tables[1:]:
        if table.action_names != first.action_names:
            raise InvalidArgument("all tables must have the same action names")
        if table.observation_shape != first.observation_shape:
            raise InvalidArgument("all tables must have the same observation shape")
        if bool(table.agent_names) != bool(first.agent_names):
            raise InvalidArgument("some tables have agents that take turns, and others have none")


def _pad_outcomes(array: NDArray[Any], outcomes: int) -> NDArray[Any]:
    """Return an array [states, actions, `outcomes`], padded with zeros: impossible outcomes that lead to state 0."""
    missing = outcomes - array.shape[2]
    return np.pad(array, ((0, 0), (0, 0), (0, missing)))
