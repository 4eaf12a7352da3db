"""Gymnasium environments that step in a compiled program: a single one, and a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from envgraph.env._gymnasium import SingleEnvironment, check_render_mode, view_of
from envgraph.env._model_views import ModelView
from envgraph.env._simulator import SUCCESS
from envgraph.env._vector import Bools, Floats, Ints, VectorEnvironmentBase
from envgraph.env._views import Memory, ObservationKind, View
from envgraph.env.compiled._batch import Batch
from envgraph.env.compiled._layout import TURN
from envgraph.env.compiled._program import Program
from envgraph.env.compiled._world import NO_NUMBERS
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import Scene
from envgraph.env.schedules import Schedule
from envgraph.errors import InvalidArgument

Streams = Literal["shared", "each"]


class CompiledEnv(SingleEnvironment):
    """A Gymnasium environment that steps in a compiled program, for environments with too many states for a table.

    With the same seed its episodes and infos equal those of `EnvgraphLiveEnv`. The program copies the state of
    `np_random` at the first reset and at each seeded reset, and samples from the copy; `np_random` does not advance.

    Args:
        program: the compiled behaviour.
        member: number of the member of the family.
        render_mode: None, "ansi", "rgb_array" or "human".
        observation: "index", "multi", "flat", "dict", "image" or "graph"; or a view over more members than these.
        cell: side of a cell of the picture in pixels.
        action_masks: True to add `action_mask` to the infos.
    """

    def __init__(
        self,
        program: Program,
        member: int = 0,
        *,
        render_mode: str | None = None,
        observation: ObservationKind | ModelView = "index",
        cell: int = 32,
        action_masks: bool = False,
    ) -> None:
        check_render_mode(render_mode, drawn=program.behaviour.draw is not None)
        view = view_of(observation, program, [each.model for each in program.members])
        super().__init__(program.action_names, view, render_mode, cell, action_masks)
        self._action = np.zeros(1, dtype=np.int64)
        self._source: np.random.Generator | None = None
        self._one = np.ones(1, dtype=np.bool_)
        self._memory = Memory()
        self._batch = Batch(program, [member])
        self._names = program.agent_names(member)

    @property
    def program(self) -> Program:
        """Return the compiled behaviour."""
        return self._batch.program

    def _enter(self, found: Program) -> None:
        batch = Batch(found, [0])
        batch.go_on(self._batch)
        self._batch, self._names, self._memory = batch, found.agent_names(0), Memory()

    def _allowed(self) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = self._batch.allowed()[0]
        return found

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in a start state that the program samples. Return the observation and the infos."""
        self._options(options)
        super().reset(seed=seed)
        if seed is not None or self.np_random is not self._source:
            self._source = self.np_random
            self._batch.seed([self._source])
        self._batch.reset(self._one)
        self._begin()
        return self._seen(), self._first(self._info(success=False))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Do an action. Return the observation, the reward, True if terminated, True if truncated, and the infos."""
        self._action[0] = self._check_step(action)
        batch = self._batch
        batch.step(self._action, again=False)
        self._steps += 1
        ended = batch.ended.item()
        self._running = not ended
        return self._seen(), batch.reward.item(), ended > 0, ended < 0, self._info(success=ended == SUCCESS)

    def _seen(self) -> Any:
        view = self.view
        if not isinstance(view, View):
            return _remembered(self._memory, view, self._batch, 0)
        return self._batch.observation[0] if view.kind == "index" else view.of_one(self._batch.components[0])

    def _info(self, success: bool) -> dict[str, Any]:
        info = {"step": self._steps, "success": success, "is_success": success}
        names = self._names
        return self._told(info, names[int(self._batch.states[0, TURN])] if names else None)

    def _scene(self) -> Scene:
        with self._batch.model_of(0) as simulator:
            return simulator.painter().scene()


class CompiledVectorEnv(VectorEnvironmentBase):
    """A vector environment that steps many environments in a compiled program, each of a member of a family.

    Environment i is of member `members[i % len(members)]`. Infos and autoreset modes are those of
    `EnvgraphVectorEnv`, except that the infos have no `state`.

    Args:
        program: the compiled behaviour.
        num_envs: number of environments; as many as members if None.
        members: numbers of members; all of them if None.
        max_episode_steps: number of steps after which an episode is truncated; None for no limit.
        render_mode: None or "rgb_array".
        observation: "index", "multi", "flat", "dict", "image" or "graph"; or a view over more members than these.
        autoreset_mode: one of `gymnasium.vector.AutoresetMode`, or its value.
        streams: "shared": all environments sample from one generator, with the same results as `EnvgraphVectorEnv`.
            "each": environment i samples from its own generator, seeded with `seed + i` as in Gymnasium's
            `SyncVectorEnv`, with the same results as a single environment with that seed.
        threads: number of threads that step the environments; does not change results. Starting them takes about ten
            microseconds a step, so threads pay for thousands of environments. `close` ends them.
        schedule: as in `EnvgraphVectorEnv`; its members are indices of `members`.
        action_masks: True to add `action_mask` to the infos.

    Raises:
        InvalidArgument: a count, mode or member is not valid.
    """

    def __init__(
        self,
        program: Program,
        num_envs: int | None = None,
        *,
        members: Sequence[int] | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        observation: ObservationKind | ModelView = "index",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        streams: Streams = "shared",
        threads: int = 1,
        schedule: Schedule | None = None,
        action_masks: bool = False,
    ) -> None:
        check_render_mode(render_mode, ("rgb_array",), drawn=program.behaviour.draw is not None)
        chosen = np.arange(len(program.members)) if members is None else np.asarray(members, dtype=np.int64)
        if not len(chosen) or not ((chosen >= 0) & (chosen < len(program.members))).all():
            raise InvalidArgument(
                f"`members` must be one or more numbers from 0 to {len(program.members) - 1}"
            )
        if streams not in ("shared", "each"):
            raise InvalidArgument(f'`streams` must be "shared" or "each", not {streams!r}')
        if threads < 1:
            raise InvalidArgument(f"`threads` is {threads}, but must be at least 1")
        count = len(chosen) if num_envs is None else num_envs
        which = chosen[np.arange(max(count, 0)) % len(chosen)]
        self._batch = Batch(program, which, threads)
        super().__init__(
            count,
            len(program.action_names),
            view_of(observation, program, [each.model for each in program.members]),
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
            autoreset_mode=autoreset_mode,
            members=len(chosen),
            schedule=schedule,
            action_masks=action_masks,
        )
        self.program = program
        self._members = chosen
        self._memory = Memory()
        self._each = streams == "each"
        self._steps, self._done = self._batch.steps, self._batch.over
        self._names = {one: np.array(program.agent_names(one), dtype=object) for one in chosen.tolist()}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every environment, or in those of `options={"reset_mask": mask}`."""
        if self._each and (seed is not None or not self._begun):
            seeds: list[Any] = [None if seed is None else seed + number for number in range(self.num_envs)]
            self._batch.seed([np.random.Generator(np.random.PCG64(each)) for each in seeds])
        return super().reset(seed=seed, options=options)

    def action_masks(self) -> Bools:
        """Return the action masks, bool [environments, actions]. All actions of an episode that has ended are True."""
        return np.asarray(self._batch.allowed() | (self._batch.ended != 0)[:, None])

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads that step the environments. Gymnasium's `close` calls this method."""
        self._batch.close()

    def _numbers(self) -> Floats:
        return NO_NUMBERS if self._each else self.np_random.random(self.num_envs)

    def _enter(self, mask: Bools, members: Ints) -> None:
        self._batch.members[mask] = self._members[members[mask]]

    def _begin(self, mask: Bools) -> None:
        self._batch.reset(mask.copy(), self._numbers())

    def _advance(self, actions: Ints) -> tuple[Floats, Ints, Bools]:
        batch = self._batch
        again = self.autoreset_mode is AutoresetMode.NEXT_STEP
        uniforms = self._numbers()
        starts = self._numbers() if again and self._done.any() else NO_NUMBERS
        batch.step(
            actions.astype(np.int64, copy=False),
            again=again,
            limit=self.max_episode_steps or 0,
            uniforms=uniforms,
            starts=starts,
        )
        # The batch replaces its arrays when it makes space for new objects.
        self._steps, self._done = batch.steps, batch.over
        return batch.reward.copy(), batch.ended.copy(), batch.cut.copy()

    def _observed(self) -> Any:
        view, batch = self.view, self._batch
        if isinstance(view, View):
            index, parts = batch.observation.copy(), batch.components.copy()
            return index if view.kind == "index" else view.of_components(parts)
        seen = [_remembered(self._memory, view, batch, place) for place in range(self.num_envs)]
        return np.stack(seen) if isinstance(seen[0], np.ndarray) else tuple(seen)

    def _facts(self) -> dict[str, NDArray[Any]]:
        if not self.program.behaviour.agents or self.program.behaviour.together:
            return {}
        turns = self._batch.states[:, TURN]
        members = self._batch.members.tolist()
        acting = [self._names[one][turn] for one, turn in zip(members, turns.tolist(), strict=True)]
        return {"agent": np.array(acting, dtype=object)}

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, or None without a render mode."""
        if self.render_mode is None:
            return None
        pictures = []
        for number in range(self.num_envs):
            with self._batch.model_of(number) as simulator:
                pictures.append(scene_rgb(simulator.painter().scene()))
        return tuple(pictures)


def _remembered(memory: Memory, view: ModelView, batch: Batch, row: int) -> Any:
    """Return the observation of an environment's model, from `memory` if the same state was observed before."""

    def make() -> Any:
        with batch.model_of(row) as simulator:
            return view.of(simulator)

    key = int(batch.members[row]), batch.states[row].tobytes(), batch.float_states[row].tobytes()
    return memory.get(key, make)
