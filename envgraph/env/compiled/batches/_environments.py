"""Gymnasium environments that step in a compiled program: a single one, and a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, Literal, Unpack

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray

from envgraph.env._gymnasium import SingleEnvironment, ViewOptions, check_render_mode, view_for
from envgraph.env._model_views import ModelView
from envgraph.env._observation_spaces import ComponentView, ObservationCache, ObservationKind
from envgraph.env._simulator import SUCCESS
from envgraph.env._vector_environments import Bools, Floats, Ints, VectorEnvironmentBase, VectorOptions
from envgraph.env.compiled.batches._batch import CompiledBatch
from envgraph.env.compiled.kernels.step_kernels import BEGIN
from envgraph.env.compiled.layout._batch_arrays import NO_RANDOM_NUMBERS
from envgraph.env.compiled.layout._program_layout import TURN
from envgraph.env.compiled.programs._compiled_program import CompiledProgram
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import Scene
from envgraph.errors import InvalidArgument

StreamMode = Literal["shared", "each"]


class CompiledEnv(SingleEnvironment):
    """A Gymnasium environment that steps in a compiled program, for environments with too many states for a table.

    With the same seed its episodes and infos equal those of `EnvgraphLiveEnv`. The program copies the state of
    `np_random` at the first reset and at each seeded reset, and samples from the copy; `np_random` does not advance.

    Args:
        program: the compiled behaviour.
        member: number of the member of the family.
        observation: see `make_environment`; or a view over more members than these.
        options: see `ViewOptions`.
    """

    def __init__(
        self,
        program: CompiledProgram,
        member: int = 0,
        *,
        observation: ObservationKind | ModelView | None = None,
        **options: Unpack[ViewOptions],
    ) -> None:
        view = view_for(observation, program, (each.model for _, each in program.members.read_all()))
        super().__init__(program.action_names, view, program.behaviour.draw is not None, **options)
        self._source: np.random.Generator | None = None
        self._memory = ObservationCache()
        self._is_one_hot = isinstance(view, ComponentView) and view.is_one_hot
        self._batch = CompiledBatch(program, [member], has_flat=self._is_one_hot)
        self._names = program.agent_names(member)

    @property
    def program(self) -> CompiledProgram:
        """Return the compiled behaviour."""
        return self._batch.program

    def _switch_member(self, member_data: CompiledProgram) -> None:
        batch = CompiledBatch(member_data, [0], has_flat=self._is_one_hot)
        batch.streams[:] = self._batch.streams
        self._batch, self._names, self._memory = batch, member_data.agent_names(0), ObservationCache()

    def _current_mask(self) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = self._batch.action_masks()[0]
        return found

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in a start state that the program samples. Return the observation and the infos."""
        self._apply_options(options)
        super().reset(seed=seed)
        if seed is not None or self.np_random is not self._source:
            self._source = self.np_random
            self._batch.seed([self._source])
        self._batch.actions[0] = BEGIN
        self._batch.advance()
        self._begin_episode()
        return self._observations(), self._reset_info(self._info(success=False))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do an action. Return the observation, the reward, True if terminated, True if truncated, and the infos."""
        if type(action) is not int or not self._is_running or not 0 <= action < self._action_count:
            action = self._check_step(action)
        batch = self._batch
        batch.actions[0] = action
        batch.advance()
        self._steps += 1
        ended = batch.ended.item()
        self._is_running = not ended
        info = self._info(success=ended == SUCCESS)
        return self._observations(), batch.reward.item(), ended > 0, ended < 0, info

    def _observations(self) -> Any:
        view, batch = self.view, self._batch
        if not isinstance(view, ComponentView):
            return _cached_observation(self._memory, view, batch, 0)
        if view.kind == "index":
            return batch.observation[0]
        if view.is_one_hot or view.kind == "multi":
            return (batch.flat if view.is_one_hot else batch.components)[0].copy()
        return view.from_components_cached(batch.components[0])

    def _info(self, success: bool) -> dict[str, Any]:
        info: dict[str, Any] = {"step": self._steps, "success": success, "is_success": success}
        if self._names:
            info["agent"] = self._names[self._batch.states[0, TURN]]
        return self._complete_info(info)

    def _scene(self) -> Scene:
        with self._batch.live_simulator(0) as simulator:
            return simulator.painter().draw()


class CompiledVectorEnv(VectorEnvironmentBase):
    """A vector environment that steps many environments in a compiled program, each of a member of a family.

    Environment i is of member `members[i % len(members)]`. Infos and autoreset modes are those of
    `EnvgraphVectorEnv`, except that the infos have no `state`.

    Args:
        program: the compiled behaviour.
        members: numbers of members; all of them if None.
        observation: see `make_environment`; or a view over more members than these.
        streams: "shared": all environments sample from one generator, with the same results as `EnvgraphVectorEnv`.
            "each": a seed means the list of seeds [seed, seed + 1, ..], as in Gymnasium's `SyncVectorEnv`.
        threads: number of threads that step the environments; does not change results. Starting them takes about ten
            microseconds a step, so threads pay for thousands of environments. `close` ends them.
        options: see `VectorOptions`; the members of a schedule are indices of `members`.

    Raises:
        InvalidArgument: a count, mode or member is not valid.
    """

    def __init__(
        self,
        program: CompiledProgram,
        num_envs: int | None = None,
        *,
        members: Sequence[int] | None = None,
        observation: ObservationKind | ModelView | None = None,
        streams: StreamMode = "shared",
        threads: int = 1,
        **options: Unpack[VectorOptions],
    ) -> None:
        check_render_mode(options.get("render_mode"), ("rgb_array",), drawn=program.behaviour.draw is not None)
        chosen = np.arange(len(program.members)) if members is None else np.asarray(members, dtype=np.int64)
        if not len(chosen) or not ((chosen >= 0) & (chosen < len(program.members))).all():
            raise InvalidArgument(f"`members` must be one or more numbers from 0 to {len(program.members) - 1}")
        if streams not in ("shared", "each"):
            raise InvalidArgument(f'`streams` must be "shared" or "each", not {streams!r}')
        if threads < 1:
            raise InvalidArgument(f"`threads` is {threads}, but must be at least 1")
        count = len(chosen) if num_envs is None else num_envs
        which = chosen[np.arange(max(count, 0)) % len(chosen)]
        view = view_for(observation, program, (each.model for _, each in program.members.read_all()))
        has_flat = isinstance(view, ComponentView) and view.is_one_hot
        self._batch = CompiledBatch(program, which, threads, has_flat=has_flat)
        super().__init__(count, program.action_names, view, len(chosen), **options)
        self.program = program
        self._members = chosen
        self._memory = ObservationCache()
        self._each_by_default = streams == "each"
        self._steps, self._is_done = self._batch.steps, self._batch.over
        used = {*chosen.tolist()}
        names = [program.agent_names(one) if one in used else () for one in range(len(program.members))]
        self._names = np.array([*zip_longest(*names)], dtype=object)  # [turns, members]

    def _seed_streams(self, generators: Sequence[np.random.Generator | None]) -> None:
        self._batch.seed(generators)

    def action_masks(self) -> Bools:
        """Return the action masks, bool [environments, actions]. All actions of an episode that has ended are True."""
        return np.asarray(self._batch.action_masks() | (self._batch.ended != 0)[:, None])

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads that step the environments. Gymnasium's `close` calls this method."""
        self._batch.close()

    def _numbers(self) -> Floats:
        return NO_RANDOM_NUMBERS if self._each else self.np_random.random(self.num_envs)

    def _switch_members(self, mask: Bools, members: Ints) -> None:
        self._batch.members[mask] = self._members[members[mask]]

    def _reset_environments(self, mask: Bools) -> None:
        self._batch.reset(mask, self._numbers())

    def _step_environments(self, actions: Ints) -> tuple[Floats, Ints, Bools]:
        batch, limit = self._batch, self.max_episode_steps or 0
        again = self.autoreset_mode is AutoresetMode.NEXT_STEP
        uniforms = self._numbers()
        starts = self._numbers() if again and self._is_done.any() else NO_RANDOM_NUMBERS
        batch.step(actions, resets_ended=again, limit=limit, uniforms=uniforms, starts=starts)
        # The batch replaces its arrays when it makes space for new objects.
        self._steps, self._is_done = batch.steps, batch.over
        return batch.reward.copy(), batch.ended.copy(), batch.cut.copy()

    def _observations(self) -> Any:
        view, batch = self.view, self._batch
        if isinstance(view, ComponentView):
            if view.kind == "index":
                return batch.observation.copy()
            return batch.flat.copy() if view.is_one_hot else view.from_components(batch.components.copy())
        seen = [_cached_observation(self._memory, view, batch, place) for place in range(self.num_envs)]
        batched: Any = create_empty_array(view.space, self.num_envs)
        return concatenate(view.space, seen, batched)

    def _own_infos(self) -> dict[str, NDArray[Any]]:
        if not self.program.behaviour.agents or self.program.behaviour.together:
            return {}
        return {"agent": self._names[self._batch.states[:, TURN], self._batch.members]}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, or None without a render mode."""
        if self.render_mode is None:
            return None
        pictures = []
        for number in range(self.num_envs):
            with self._batch.live_simulator(number) as simulator:
                pictures.append(scene_rgb(simulator.painter().draw()))
        return tuple(pictures)


def _cached_observation(memory: ObservationCache, view: ModelView, batch: CompiledBatch, row: int) -> Any:
    """Return the observation of an environment's model, from `memory` if the same state was observed before."""

    def make() -> Any:
        with batch.live_simulator(row) as simulator:
            return view.observe(simulator)

    key = int(batch.members[row]), batch.states[row].tobytes(), batch.float_states[row].tobytes()
    return view.present(memory.get(key, make))
