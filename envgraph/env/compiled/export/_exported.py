"""Environments that step in a compiled program. They need NumPy, and are fast with numba.

`Environments` steps many at once; `begin` and `step` do the same as functions of a state. `ABOUT` has the names of
actions, members and agents, the sizes of the components of an observation, and the limit of steps of an episode.
"""

# The text of this module is the `__init__` of exported packages, which contain the imported modules as well.

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from envgraph.env._flat_observations import FlatLayout
from envgraph.env._float_ranges import FloatRange
from envgraph.env.compiled.layout._batch_arrays import (
    NO_RANDOM_NUMBERS,
    BatchArrays,
    EnvironmentRows,
    FamilyArrays,
    generator_states,
    zero_rows,
)

__all__ = ["ABOUT", "Environments", "State", "begin", "step"]

FOLDER = Path(__file__).parent
ABOUT: dict[str, Any] = (
    json.loads((FOLDER / "about.json").read_text("utf-8")) if (FOLDER / "about.json").exists() else {}
)
SHAPE = [FloatRange(*one) if isinstance(one, list) else one for one in ABOUT.get("observation_shape") or [1]]
FLAT = FlatLayout(SHAPE)
DEFAULT_KIND = "flat" if FLAT.floats else "index"
ERROR, TURN, SUCCESS, BEGIN = 0, 1, 1, -1
SHARED_STREAM, OWN_STREAMS = "shared", "each"


class State(NamedTuple):
    """The states of n environments: the numbers of their members [n], and their ints and floats [n, ..]."""

    members: NDArray[np.int64]
    ints: NDArray[np.int64]
    floats: NDArray[np.float64]


class Environments:
    """Environments that step together, like a vector environment of Gymnasium.

    After the end of an episode, the next step ignores the action for that environment and begins a new episode.

    Args:
        num_envs: number of environments; as many as members if None.
        members: names or numbers of members, assigned to environments in turn; only the last member if None.
        max_episode_steps: steps after which an episode is truncated; -1 for the limit in `ABOUT`, None for no limit.
        streams: "shared": all environments sample from one generator. "each": environment i samples from its own
            generator, seeded with `seed + i`.
        observation: "index" for one number, "multi" for its components, "flat" for them as one-hot vectors; a float is
            an entry of its own, and only of "flat". None: "flat" if floats are observed, otherwise "index".

    Raises:
        ValueError: a count, member or option is not valid.
    """

    def __init__(
        self,
        num_envs: int | None = None,
        members: Sequence[int | str] | None = None,
        *,
        max_episode_steps: int | None = -1,
        streams: str = SHARED_STREAM,
        observation: str | None = None,
    ) -> None:
        names = ABOUT["members"]
        chosen = [len(names) - 1] if members is None else [_member_number(one, names) for one in members]
        count = len(chosen) if num_envs is None else num_envs
        if count < 1 or not chosen or streams not in (SHARED_STREAM, OWN_STREAMS):
            raise ValueError('`num_envs` must be at least 1, `members` not empty, and `streams` "shared" or "each"')
        self._kind = observation or DEFAULT_KIND
        if self._kind not in ("index", "multi", "flat") or (FLAT.floats and self._kind != "flat"):
            raise ValueError('`observation` must be "flat", or if no floats are observed, "index" or "multi"')
        if self._kind == "index" and prod(SHAPE) >= 2**63:
            raise ValueError('there are too many observations for an index: use `observation="multi"` or "flat"')
        self.num_envs = count
        self.members = np.array([chosen[place % len(chosen)] for place in range(count)], dtype=np.int64)
        self._limit = (ABOUT["limit"] if max_episode_steps == -1 else max_episode_steps) or 0
        self._each = streams == OWN_STREAMS
        self._batch = _BatchState(self.members)
        self._random: np.random.Generator | None = None

    def reset(self, seed: int | None = None) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
        """Begin an episode in each environment. Return observations [n] or [n, ..], and infos."""
        batch = self._batch
        if seed is not None or self._random is None:
            self._random = np.random.default_rng(seed)
            if self._each:
                seeds = [None if seed is None else seed + place for place in range(self.num_envs)]
                batch.rows.streams[:] = generator_states([np.random.default_rng(one) for one in seeds])
        batch.rows.actions[:] = BEGIN
        batch.advance(self._draw_uniforms())
        return batch.observed(self._kind), self._infos()

    def step(
        self, actions: Any
    ) -> tuple[
        NDArray[Any],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, NDArray[Any]],
    ]:
        """Do an action in each environment. Return observations, rewards, terminated, truncated and infos.

        Raises:
            ValueError: the actions are not valid, or `reset` was not called.
            RuntimeError: a rule cannot be applied, or an expression has no value.
        """
        batch = self._batch
        chosen = _checked_actions(actions, self.num_envs)
        if self._random is None:
            raise ValueError("call `reset` before `step`")
        uniforms, over = self._draw_uniforms(), batch.rows.over
        starts = self._draw_uniforms() if over.any() else uniforms
        batch.rows.actions[:] = np.where(over, BEGIN, chosen)
        batch.advance(uniforms if self._each else np.where(over, starts, uniforms), self._limit)
        terminated, truncated = batch.rows.ended > 0, batch.rows.cut.copy()
        return batch.observed(self._kind), batch.rows.reward.copy(), terminated, truncated, self._infos()

    def _draw_uniforms(self) -> NDArray[np.float64]:
        assert self._random is not None
        return NO_RANDOM_NUMBERS if self._each else self._random.random(self.num_envs)

    def _infos(self) -> dict[str, NDArray[Any]]:
        batch = self._batch
        infos: dict[str, NDArray[Any]] = {
            "step": batch.rows.steps.copy(),
            "success": batch.rows.ended == SUCCESS,
        }
        agents, turns = ABOUT["agents"], batch.rows.ints[:, TURN].tolist()
        if agents[0]:
            acting = [agents[member][turn] for member, turn in zip(self.members.tolist(), turns, strict=True)]
            infos["agent"] = np.array(acting, dtype=object)
        return infos


def begin(members: Sequence[int], uniforms: Sequence[float]) -> tuple[State, NDArray[Any]]:
    """Begin episodes.

    Args:
        members: number of the member of each environment [n].
        uniforms: numbers from [0, 1) that decide all random choices [n].

    Returns:
        The states, and observations: indices [n], or if floats are observed, vectors [n, entries].
    """
    batch = _BatchState(np.asarray(members, dtype=np.int64))
    batch.rows.actions[:] = BEGIN
    batch.advance(np.asarray(uniforms, dtype=np.float64))
    return batch.state(), batch.observed(DEFAULT_KIND)


def step(
    state: State, actions: Sequence[int], uniforms: Sequence[float]
) -> tuple[State, NDArray[Any], NDArray[np.float64], NDArray[np.int64]]:
    """Do one step in each environment. `state` is not changed.

    Args:
        state: of n environments whose episodes have not ended.
        actions: numbers of actions [n].
        uniforms: numbers from [0, 1) that decide all random choices [n].

    Returns:
        The states, observations as those of `begin`, rewards [n], and ends [n]: 0 if the episode goes on, 1 for
        success, 2 for failure, -1 for truncation.
    """
    batch = _BatchState(state.members)
    batch.rows.ints[:], batch.rows.floats[:] = state.ints, state.floats
    batch.rows.actions[:] = _checked_actions(actions, len(state.members))
    batch.advance(np.asarray(uniforms, dtype=np.float64))
    return batch.state(), batch.observed(DEFAULT_KIND), batch.rows.reward, batch.rows.ended


class _BatchState:
    """The states of n environments, and the program that steps them."""

    def __init__(self, members: NDArray[np.int64], rows: EnvironmentRows | None = None) -> None:
        program, arrays = _load_program(), _load_arrays()
        self.members = members
        self.rows = rows or zero_rows(len(members), arrays, len(SHAPE))
        space = ABOUT["capacity"] * ABOUT["levels"], ABOUT["width"]
        self._batch = BatchArrays(arrays, members, self.rows, space, SHAPE, program.advance, native=program.NATIVE)

    def __reduce__(self) -> tuple[type[_BatchState], tuple[NDArray[np.int64], EnvironmentRows]]:
        """Return a constructor call for pickle, without the program, which holds memory addresses of its arrays."""
        return _BatchState, (self.members, self.rows)

    def advance(self, uniforms: NDArray[np.float64], limit: int = 0) -> None:
        """Step the environments with the actions in `rows.actions`; the action `BEGIN` begins an episode.

        `uniforms` are the random numbers; if empty, each environment samples from its own stream.

        Raises:
            RuntimeError: a rule cannot be applied, or an expression has no value.
        """
        if len(uniforms):
            self.rows.drawn[:] = uniforms
        self._batch.settings[1:] = len(uniforms) > 0, limit
        failed = self._batch.advance()
        if failed >= 0:
            error = ABOUT["errors"][str(self.rows.ints[failed, ERROR])]
            raise RuntimeError(f"environment {failed}: {error}")

    def observed(self, kind: str) -> NDArray[Any]:
        """Return a copy of the current observations of a kind."""
        if kind == "flat":
            return FLAT.encode(self.rows.components)
        return (self.rows.components if kind == "multi" else self.rows.observation).copy()

    def state(self) -> State:
        """Return the states of all environments, without copying their arrays."""
        return State(self.members, self.rows.ints, self.rows.floats)


@cache
def _load_arrays() -> FamilyArrays:
    with np.load(FOLDER / "data.npz", allow_pickle=False) as arrays:
        return FamilyArrays(*(np.ascontiguousarray(arrays[name]) for name in FamilyArrays._fields))


@cache
def _load_program() -> Any:
    return import_module(".program", __package__)


def _member_number(member: int | str, names: Sequence[str]) -> int:
    if member in names:
        return names.index(str(member))
    if isinstance(member, str) or not 0 <= member < len(names):
        raise ValueError(f"unknown member {member!r}: choose {', '.join(names)}, or 0 to {len(names) - 1}")
    return member


def _checked_actions(actions: Any, count: int) -> NDArray[Any]:
    chosen = np.asarray(actions)
    most = len(ABOUT["actions"])
    if chosen.shape != (count,) or not ((chosen >= 0) & (chosen < most)).all():
        raise ValueError(f"`actions` must be {count} numbers from 0 to {most - 1}")
    return chosen
