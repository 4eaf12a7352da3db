"""Step many environments of a compiled program with one call."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cached_property
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from envgraph.env._simulator import Simulator
from envgraph.env.compiled.kernels._scripted_choices import LACKS, MOST, ROOM, SCRIPT
from envgraph.env.compiled.kernels.step_kernels import BEGIN, CAPACITY, FULL, OVERFLOW, SKIP
from envgraph.env.compiled.layout._batch_arrays import (
    NO_RANDOM_NUMBERS,
    BatchArrays,
    EnvironmentRows,
    generator_states,
    zero_rows,
)
from envgraph.env.compiled.layout._member_data import NO_INT
from envgraph.env.compiled.layout._symbols import CreatedCount
from envgraph.env.compiled.programs._compiled_program import CompiledProgram
from envgraph.env.compiled.programs._growth import copy_states, with_more_space
from envgraph.env.compiled.programs._live_counterpart import LiveCounterpart
from envgraph.errors import LIMITS, EvaluationError

CAPACITY_ERRORS: Final = {
    OVERFLOW: f"a condition or rule has more than {CAPACITY} matches, the limit of compiled environments",
    FULL: "rules create too many objects in one step for compiled environments",
}
INT_ERROR: Final = f"compiled environments do not support the int {NO_INT}, or more bits than 64 within an expression"
"""Messages for errors that only compiled programs have, since the live engine has no such bounds."""


class CompiledBatch:
    """The states of many environments, each of a member of a family, that step together.

    Args:
        program: the compiled behaviour.
        members: int [n], the number of the member of each environment; may change before an episode begins.
        threads: number of threads that step the environments; does not change results.
        rows: the state arrays of the environments; new arrays if None.
        has_flat: True to compute `flat` in each step, if `rows` is None.

    Attributes:
        states, float_states: int64 and float64 [n, ..]; a row is the whole state of an environment except `steps`.
        streams: uint64 [n, 4], the states of the random streams.
        steps: int64 [n], steps since the episode began.
        over: bool [n], True if the episode has terminated, was truncated, or stopped at an error.
        observation: int64 [n]; components: int64 [n, ..]; flat: float32 [n, ..], the components as one-hot vectors.
        actions: int64 [n], the actions of the next `advance`.
        reward: float64 [n]; cut: bool [n], True if truncated.
        ended: int64 [n]: 0, or 1 if the last step ended in success, 2 in failure, -1 if the episode was truncated.
    """

    def __init__(
        self,
        program: CompiledProgram,
        members: ArrayLike,
        threads: int = 1,
        rows: EnvironmentRows | None = None,
        *,
        has_flat: bool = False,
    ) -> None:
        self.program = program
        self.members = np.array(members, dtype=np.int64)
        n, arrays, sizes = len(self.members), program.arrays, program.observation_shape or (1,)
        self._rows = rows = rows or zero_rows(n, arrays, len(sizes), sum(sizes) if has_flat else 0)
        self.states, self.float_states, self.streams, self.components = rows[:4]
        self.steps, self.over, self.observation, self.reward, self.ended, self.cut, self._drawn = rows[4:11]
        self.actions, self.flat = rows[11:]
        bounds = [n * number // threads for number in range(threads + 1)]
        self._parts = [(part := slice(*ends), self._arrays_of(part)) for ends in pairwise(bounds) if ends[0] < ends[1]]
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads - 1) if len(self._parts) > 1 else None
        # Without threads, call the program directly: with one environment each extra call costs time.
        self._advance = self._advance_in_threads if self._pool else self._parts[0][1].advance
        self._script = empty_script(LIMITS["random choices"])
        self._live_counterparts: dict[int, LiveCounterpart] = {}
        self._created_counters = [
            int(arrays.offsets[n]) for column, n in program.layout.stored_columns() if isinstance(column, CreatedCount)
        ]

    def _arrays_of(self, part: slice) -> BatchArrays:
        """Return the arrays and the program with which one thread steps a slice of the environments."""
        program, rows = self.program, EnvironmentRows._make(array[part] for array in self._rows)
        sizes, space = program.observation_shape or (1,), program.row_buffer_shape
        function, members = program.functions_for("step")["advance"], self.members[part]
        return BatchArrays(program.arrays, members, rows, space, sizes, function, native=program.native)

    def __reduce__(self) -> tuple[type[CompiledBatch], tuple[Any, ...]]:
        """Return a constructor call for pickle. Objects that share the batch's arrays share those of the copy, too."""
        return CompiledBatch, (self.program, self.members, self._threads, self._rows)

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the action masks, bool [n, actions]: True for actions with an effect, or for all if none has one."""
        masks, own, agents = self._mask_function
        found = np.empty((len(self.members), len(own) ** agents), dtype=np.bool_)
        self._script[MOST] = LIMITS["outcomes"]
        for part, batch_arrays in self._parts:
            batch_arrays.call_function(masks, found[part], own, agents, self._script)
            while self._script[LACKS]:
                self._script = empty_script(len(self._script))
                batch_arrays.call_function(masks, found[part], own, agents, self._script)
        return found

    @cached_property
    def _mask_function(self) -> tuple[Callable[..., None], NDArray[np.bool_], int]:
        """Return the function that computes masks, its buffer for an agent's actions, and the number of agents."""
        agents = self.program.acting_agents
        own = np.empty(round(len(self.program.action_names) ** (1 / agents)), dtype=np.bool_)
        return self.program.functions_for("mask")["masks"], own, agents

    def close(self) -> None:
        """Stop the threads, if the batch has several."""
        if self._pool is not None:
            self._pool.shutdown()

    def seed(self, generators: Sequence[np.random.Generator | None]) -> None:
        """Set the random stream of each environment to a copy of its generator's state; None keeps the stream."""
        which = [place for place, generator in enumerate(generators) if generator is not None]
        self.streams[which] = generator_states([generator for generator in generators if generator is not None])

    def reset(self, which: NDArray[np.bool_], uniforms: NDArray[np.float64] = NO_RANDOM_NUMBERS) -> None:
        """Begin episodes.

        Args:
            which: bool [n], True for the environments that begin a new episode.
            uniforms: a number from [0, 1) for each environment; if empty, each samples from its own stream.

        Raises:
            RuleError, EvaluationError: as the live engine does.
        """
        self.step(np.where(which, BEGIN, SKIP), resets_ended=False, uniforms=uniforms)

    def step(
        self,
        actions: NDArray[np.int64],
        *,
        resets_ended: bool,
        limit: int = 0,
        uniforms: NDArray[np.float64] = NO_RANDOM_NUMBERS,
        starts: NDArray[np.float64] = NO_RANDOM_NUMBERS,
    ) -> None:
        """Do one step in each environment. Then enlarge the state arrays if they have little space for new objects.

        Args:
            actions: int64 [n], each in range.
            resets_ended: True to begin a new episode, instead of a step, in each environment whose episode is over.
            limit: number of steps after which an episode is truncated; 0 for no limit.
            uniforms, starts: numbers from [0, 1) for the steps and for the beginnings of episodes; see `reset`.

        Raises:
            RuleError, EvaluationError: as the live engine does.
        """
        self.actions[:] = actions
        if resets_ended and self.over.any():
            self.actions[self.over] = BEGIN
            uniforms = np.where(self.over, starts, uniforms) if len(starts) else uniforms
        if len(uniforms):
            self._drawn[:] = uniforms
        for _, batch_arrays in self._parts:
            batch_arrays.settings[1:] = len(uniforms) > 0, limit
        self.advance()

    def advance(self) -> None:
        """Step the environments with the `actions`, and with the limit of the last call of `reset` or `step`.

        The action `BEGIN` begins an episode; `SKIP` does nothing.

        Raises:
            RuleError, EvaluationError: as the live engine does.
        """
        failed = self._advance()
        if failed >= 0:
            self._raise_error(failed, int(self.actions[failed]))
        for counter in self._created_counters:
            if 2 * self.states[:, counter].max(initial=0) > self.program.members.spare:
                self._grow()

    def _grow(self) -> None:
        """Replace the program and all arrays by ones with more space for created objects, and copy all states."""
        has_flat = self.flat.shape[1] > 0
        other = CompiledBatch(with_more_space(self.program), self.members, self._threads, has_flat=has_flat)
        rows = copy_states(self.program, other.program, self.members, self.states, self.float_states)
        pairs: Any = zip((*rows, *self._rows[2:]), other._rows, strict=True)
        for mine, other_rows in pairs:
            other_rows[...] = mine
        self.close()
        vars(self).update(vars(other))

    def _advance_in_threads(self) -> int:
        """Run `advance` in all threads. Return the highest index of an environment with an error, or -1 for none."""
        assert self._pool is not None
        (_, first), *others = self._parts
        waiting = [self._pool.submit(batch_arrays.advance) for _, batch_arrays in others]
        failed = [first.advance(), *(one.result() for one in waiting)]
        places = zip(failed, self._parts, strict=True)
        return max(part.start + row if row >= 0 else -1 for row, (part, _) in places)

    def _raise_error(self, row: int, action: int) -> None:
        """Mark an environment's episode as over, and raise the error that its state holds.

        The live engine repeats the step, or the beginning of the episode, to raise its own error. Errors that the live
        engine does not have are raised here.

        Args:
            row: the environment.
            action: of the step; `BEGIN` if an episode was begun.

        Raises:
            RuleError, EvaluationError: always.
        """
        error = int(self.states[row, 0])
        self.over[row] = True
        member = int(self.members[row])
        if error not in CAPACITY_ERRORS:
            counterpart = self._live_counterpart(member)
            begun = action == BEGIN
            batch_arrays = next(batch_arrays for part, batch_arrays in self._parts if row < part.stop)
            arrays = self.program.arrays
            before = arrays.ints[member] if begun else batch_arrays.failed_state[0][1]
            floats = arrays.floats[member] if begun else batch_arrays.failed_state[1][1]
            with counterpart.in_state(before, floats) as simulator:
                uniform = float(self._drawn[row])
                if begun:
                    simulator.reset_with(uniform)
                else:
                    simulator.step_with(action, uniform)
        message = CAPACITY_ERRORS.get(error, INT_ERROR)
        raise EvaluationError(message, self.program.behaviour.span, 'make the environment with `engine="live"`')

    @contextmanager
    def live_simulator(self, row: int) -> Iterator[Simulator]:
        """Return a context manager that yields a live simulator in the state of an environment."""
        with self._live_counterpart(int(self.members[row])).in_state(
            self.states[row], self.float_states[row]
        ) as simulator:
            yield simulator

    def _live_counterpart(self, member: int) -> LiveCounterpart:
        if member not in self._live_counterparts:
            self._live_counterparts[member] = self.program.live_counterpart(member)
        return self._live_counterparts[member]


def empty_script(choices: int) -> NDArray[np.float64]:
    """Return a script of choices for a program, with space for a number of them."""
    script = np.zeros(SCRIPT + 2 * choices)
    script[ROOM], script[MOST] = len(script), LIMITS["outcomes"]
    return script


def padded_to(array: NDArray[Any], size: int) -> NDArray[Any]:
    """Return a copy of an array, extended to `size` rows. The added rows are filled with 0."""
    found = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
    found[: len(array)] = array
    return found
