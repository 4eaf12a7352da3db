"""Many environments side by side: their states, and one call for a step of all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from math import prod
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.env._simulator import Simulator
from envgraph.env.compiled._growth import carried, grown
from envgraph.env.compiled._kernels import BEYOND, CAPACITY, FULL, OVERFLOW
from envgraph.env.compiled._program import Program, streams
from envgraph.env.compiled._tables import Made
from envgraph.env.compiled._twin import Twin
from envgraph.errors import EvaluationError

NO_NUMBERS: Final = np.zeros(0)
NO_ACTIONS: Final = np.zeros(0, dtype=np.int64)
SHOWN: Final = {
    OVERFLOW: f"a question has more than {CAPACITY} matches",
    BEYOND: "an int has more than 32 bits",
    FULL: "rules create more objects in one step than there is space for",
}
"""What only a program has bounds for."""


class Part:
    """Some environments of a batch, one after the other, and the space that a thread needs for their steps.

    Args:
        program: the compiled behaviour.
        members: of all environments of the batch.
        arrays: those of the batch that have a row for each environment.
        rows: the environments.

    Attributes:
        before: in the second row of each the state before the step in which something went wrong last.
    """

    def __init__(
        self,
        program: Program,
        members: NDArray[np.int64],
        arrays: Sequence[NDArray[Any]],
        rows: slice,
    ) -> None:
        self.rows = rows
        states, floats, streams, *others = (array[rows] for array in arrays)
        shared = program.arrays
        self.before = (
            np.zeros((2, states.shape[1]), dtype=np.int64),
            np.zeros((2, floats.shape[1])),
        )
        self._arrays = (
            tables_of(program),
            shared.floats,
            shared.offsets,
            states,
            floats,
            *space_of(program),
            np.zeros(1),
            members[rows],
            shared.states,
            shared.float_states,
            streams,
            *others,
            *self.before,
        )
        self._world: Any = _addresses_of(self._arrays) if program.native else self._arrays
        self._function = program.functions("step")["advance"]

    def advance(
        self,
        which: NDArray[np.bool_],
        starts: NDArray[np.float64],
        actions: NDArray[np.int64],
        uniforms: NDArray[np.float64],
        limit: int,
    ) -> int:
        """What `advance` of `_kernels` does; the last environment of the batch in which something went wrong, or -1."""
        failed: int = self._function(self._world, which, starts, actions, uniforms, limit)
        return failed if failed < 0 else failed + self.rows.start


class Batch:
    """The states of environments, each over a member of a family.

    Args:
        program: the compiled behaviour.
        members: number of the member of each environment.
        threads: how many step them at a time; changes no result.

    Attributes:
        states, float_states: int64 and float64 [n, ..]; a row is all that an environment is, but for `steps`.
        steps: int64 [n], since the episode began.
        over: bool [n], whether the episode has ended or was truncated.
        observation: int64 [n]; components: int64 [n, ..].
        reward: float64 [n]; ended: int64 [n], 0, 1 for success, 2 for failure; cut: bool [n], whether it was truncated.
    """

    def __init__(self, program: Program, members: Sequence[int] | NDArray[Any], threads: int = 1) -> None:
        self.program = program
        arrays = program.arrays
        self.members = np.asarray(members, dtype=np.int64)
        n = len(self.members)
        self.states = np.zeros((n, arrays.states.shape[1]), dtype=np.int64)
        self.float_states = np.zeros((n, arrays.float_states.shape[1]))
        self.steps = np.zeros(n, dtype=np.int64)
        self.over = np.zeros(n, dtype=np.bool_)
        self.observation = np.zeros(n, dtype=np.int64)
        self.components = np.zeros((n, len(program.observation_shape)), dtype=np.int64)
        self.reward = np.zeros(n)
        self.ended = np.zeros(n, dtype=np.int64)
        self.cut = np.zeros(n, dtype=np.bool_)
        self._drawn = np.zeros(n)
        self._none = np.zeros(n, dtype=np.bool_)
        self._streams = np.zeros((n, 4), dtype=np.uint64)
        self._rows = (
            self.states,
            self.float_states,
            self._streams,
            self.components,
            self.steps,
            self.over,
            self.observation,
            self.reward,
            self.ended,
            self.cut,
            self._drawn,
        )
        bounds = [n * number // threads for number in range(threads + 1)]
        stretches = [slice(*ends) for ends in pairwise(bounds) if ends[0] < ends[1]]
        self._parts = [Part(program, self.members, self._rows, stretch) for stretch in stretches]
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads - 1) if len(self._parts) > 1 else None
        self._twins: dict[int, Twin] = {}
        self._made = [
            int(arrays.offsets[n]) for column, n in program.layout.stored() if isinstance(column, Made)
        ]

    def __deepcopy__(self, memo: dict[int, Any]) -> Batch:
        """Other environments in the same states; what refers to arrays of these refers to arrays of those."""
        twin = Batch(self.program, self.members, self._threads)
        for mine, other in zip(self._rows, twin._rows, strict=True):
            other[...] = mine
            memo[id(mine)] = other
        return twin

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def seed(self, generators: Sequence[np.random.Generator]) -> None:
        """Draw from now on as these generators would, one for each environment; they stay as they are."""
        self._streams[:] = streams(generators)

    def reset(self, which: NDArray[np.bool_], uniforms: NDArray[np.float64] = NO_NUMBERS) -> None:
        """Begin episodes.

        Args:
            which: bool [n], the environments that begin anew.
            uniforms: a number from [0, 1) for each environment; without them each draws from its own stream.

        Raises:
            RuleError, EvaluationError: as the live engine does.
        """
        failed = self._advance(which, uniforms, NO_ACTIONS, NO_NUMBERS, 0)
        if failed >= 0:
            self._raise(failed, None)

    def step(
        self,
        actions: NDArray[np.int64],
        *,
        again: bool,
        limit: int = 0,
        uniforms: NDArray[np.float64] = NO_NUMBERS,
        starts: NDArray[np.float64] = NO_NUMBERS,
    ) -> None:
        """One step of each environment.

        Args:
            actions: int64 [n], each in range.
            again: whether those that are over begin anew instead.
            limit: steps after which an episode is truncated; 0 for none.
            uniforms, starts: numbers from [0, 1) for steps and for beginnings; see `reset`.

        Raises:
            RuleError, EvaluationError: as the live engine does.
        """
        begins = self.over if again else self._none
        failed = self._advance(begins, starts, actions, uniforms, limit)
        if failed >= 0:
            self._raise(failed, int(actions[failed]))
        if self._made and 2 * self.states[:, self._made[0]].max(initial=0) > self.program.spare:
            self._grow()

    def _grow(self) -> None:
        """Make more space for new objects."""
        other = Batch(grown(self.program), self.members, self._threads)
        rows = carried(self.program, other.program, self.members, self.states, self.float_states)
        for mine, other_rows in zip((*rows, *self._rows[2:]), other._rows, strict=True):
            other_rows[...] = mine
        self.close()
        vars(self).update(vars(other))

    def _advance(
        self,
        which: NDArray[np.bool_],
        starts: NDArray[np.float64],
        actions: NDArray[np.int64],
        uniforms: NDArray[np.float64],
        limit: int,
    ) -> int:
        """What `advance` does, in several threads; the last environment in which something went wrong, or -1."""
        parts = self._parts
        if self._pool is None:
            return parts[0].advance(which, starts, actions, uniforms, limit)
        given = [
            (which[rows], starts[rows], actions[rows], uniforms[rows], limit)
            for rows in (part.rows for part in parts)
        ]
        others = [
            self._pool.submit(part.advance, *each) for part, each in zip(parts[1:], given[1:], strict=True)
        ]
        return max(parts[0].advance(*given[0]), *(other.result() for other in others))

    def _raise(self, row: int, action: int | None) -> None:
        """Do on the live engine what went wrong, for the message.

        Raises:
            RuleError, EvaluationError: always.
        """
        error, arrays = int(self.states[row, 0]), self.program.arrays
        self.over[row] = True
        member = int(self.members[row])
        if error not in SHOWN:
            twin = self._twin(member)
            begun = action is None or self.steps[row] == 0
            part = next(part for part in self._parts if row < part.rows.stop)
            before = arrays.states[member] if begun else part.before[0][1]
            floats = arrays.float_states[member] if begun else part.before[1][1]
            with twin.at(before, floats) as simulator:
                _again(simulator, None if begun else action, float(self._drawn[row]))
        message = SHOWN.get(error, "a rule cannot be applied, or something has no value")
        raise EvaluationError(message, self.program.behaviour.span, 'step with `engine="live"`')

    @contextmanager
    def model_of(self, row: int) -> Iterator[Simulator]:
        """Meanwhile a live engine is in the state of an environment: for pictures, and for a close look."""
        with self._twin(int(self.members[row])).at(self.states[row], self.float_states[row]) as simulator:
            yield simulator

    def _twin(self, member: int) -> Twin:
        if member not in self._twins:
            self._twins[member] = self.program.twin(member)
        return self._twins[member]

    @property
    def n_observations(self) -> int:
        """How many observations there are."""
        return prod(self.program.observation_shape)


def longer(array: NDArray[Any], size: int) -> NDArray[Any]:
    """A copy with more rows."""
    found = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
    found[: len(array)] = array
    return found


def tables_of(program: Program) -> NDArray[Any]:
    """The tables of the members; Python calculates with their entries, so there they have 64 bits."""
    tables = program.arrays.tables
    return tables if program.native else tables.astype(np.int64)


def _addresses_of(arrays: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """Where arrays are, and their shapes; they have to outlive that."""
    rows = np.zeros((len(arrays), 3), dtype=np.int64)
    for row, array in zip(rows, arrays, strict=True):
        assert array.flags.c_contiguous
        row[: 1 + array.ndim] = array.ctypes.data, *array.shape
    return rows


def space_of(program: Program) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Space for the rows of a program's questions."""
    shape = CAPACITY * program.levels, program.width
    return np.zeros(shape, dtype=np.int64), np.zeros(shape)


def _again(simulator: Simulator, action: int | None, uniform: float) -> None:
    if action is None:
        simulator.begin(uniform)
    else:
        simulator.act(action, uniform)
