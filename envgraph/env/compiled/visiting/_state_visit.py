"""Visit the states of a program, which are stored in growing arrays; the base of tables, searches and explorations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import closing
from sys import maxsize
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from envgraph.env.compiled.batches._batch import empty_script, padded_to
from envgraph.env.compiled.kernels._visit_kernels import MANY, PAUSED, SPACE, WRONG
from envgraph.env.compiled.kernels.step_kernels import CAPACITY, FULL
from envgraph.env.compiled.layout._batch_arrays import zero_row_buffers
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._program_layout import ERROR
from envgraph.env.compiled.programs._compiled_program import CompiledProgram
from envgraph.errors import LIMITS

Array = NDArray[Any]


class NeedsSpace(NotCompiled):
    """A state with more created objects than the program has space for, but not more than the limit."""


class StateArrays(NamedTuple):
    """Arrays with a row for each state.

    Attributes:
        states, floats: the states, and in the row behind them a state to work in.
        components, observations: the observations, as components and as numbers.
        sources, found_by: the state from which each state was found, -1 for a start state; and by which outcome, or, in
            a search, by which action.
        gain: the sum of the rewards on the way by which each state was found; in the row behind them, those to an end.
        starts: the index of the first outcome of each action.
        did: for each action, 1 if an outcome of it had an effect, else 0.
    """

    states: Array
    floats: Array
    components: Array
    observations: Array
    sources: Array
    found_by: Array
    gain: Array
    starts: Array
    did: Array


class OutcomeArrays(NamedTuple):
    """Arrays with a row for each outcome.

    Attributes:
        to, chance, reward, ended: the next state, the probability, the reward, and the end of the episode.
        match, match_floats: the matches of rules that are explored.
    """

    to: Array
    chance: Array
    reward: Array
    ended: Array
    match: Array
    match_floats: Array


class StateVisit(ABC):
    """A visit of the states of a member, in the order in which they are found.

    Args:
        limit: the largest number of states; a search has none.
        actions: the numbers of the actions to do; None: all.
        sought: the end that a search wants; 0: store all outcomes.
        goal: the component of the observation that ends the visit, or -1.
        match: how many columns of matches are stored, and how many columns of floats.

    Attributes:
        rows, outcomes: what was found.
        counts: the next state, and the numbers of states, of stored outcomes, and of all outcomes.
    """

    def __init__(
        self,
        program: CompiledProgram,
        member: int,
        limit: int,
        actions: Array | None = None,
        *,
        sought: int = 0,
        goal: int = -1,
        match: tuple[int, int] = (0, 0),
    ) -> None:
        self._program, self._member = program, member
        self._functions = program.functions_for("list")
        self._actions = np.arange(len(program.action_names)) if actions is None else actions
        self._limit, self._wanted = limit, (sought, goal, LIMITS["outcomes"], maxsize if sought else limit)
        self._work = *zero_row_buffers(program.row_buffer_shape), empty_script(LIMITS["random choices"])
        size = COSTS.first
        shapes = *[(size,)] * 4, *[(size, len(self._actions))] * 2
        self.rows = StateArrays(
            padded_to(program.arrays.ints[:0], size),
            padded_to(program.arrays.floats[:0], size),
            np.zeros((size, len(program.observation_shape)), np.int64),
            *(np.zeros(shape, kind) for shape, kind in zip(shapes, "qqqdqq", strict=True)),
        )
        self.outcomes = OutcomeArrays(
            np.zeros(size, np.int64),
            np.zeros(size),
            np.zeros(size),
            np.zeros(size, np.int64),
            np.zeros((size, match[0]), np.int64),
            np.zeros((size, match[1])),
        )
        self._hashed = np.full(4 * size, -1, np.int64)
        self.counts = -1, 0, 0, 0

    def visit_starts(self) -> tuple[Array, Array]:
        """Visit the start states. Return the state and the probability of each way to begin."""
        self.run(0)
        _, states, used, _ = self.counts
        self.counts = 0, states, 0, 0
        return self.outcomes.to[:used].copy(), self.outcomes.chance[:used].copy()

    def run(self, last: int = maxsize) -> tuple[int, int]:
        """Do all actions in the states before `last`, after a visit of the start states if that was not made.

        Returns how it ended, and the place of the last action.
        """
        program, arrays = self._program, self._program.arrays
        while True:
            states, floats, *rows = self.rows
            how, place, *counts = self._functions["visit"](
                arrays.tables_for(program.native), arrays.reals, arrays.offsets, states, floats, *self._work,
                self._member, floats.view(np.int64), self._hashed, arrays.ints, arrays.floats, *rows, *self.outcomes,
                *self.counts, last, self._actions, *self._wanted, self._pause_after(self.counts[3]),
            )  # fmt: skip
            self.counts = head, count, _, _ = tuple(counts)
            self._check(how)
            if how in (WRONG, MANY):
                self._raise_error(head, int(self._actions[place]))
            if how not in (SPACE, PAUSED):
                return how, place
            if how == SPACE and count + 1 >= len(states):
                self._grow_states(count)
            elif how == SPACE:
                self.outcomes = OutcomeArrays(*(padded_to(array, 4 * len(array)) for array in self.outcomes))

    @abstractmethod
    def _check(self, how: int) -> None:
        """Report the progress, and raise an exception if there are too many states or outcomes."""

    def _pause_after(self, made: int) -> int:
        """Return the number of outcomes after which the visit pauses."""
        return made + COSTS.progress_interval

    def _grow_states(self, count: int) -> None:
        """Make space for more states than the `count` that are known."""
        size = 4 * len(self.rows.states)
        self.rows = StateArrays(*(padded_to(array, size) for array in self.rows))
        self._hashed = np.full(4 * size, -1, np.int64)
        self._hash(0, count)

    def _hash(self, first: int, last: int) -> None:
        """Add the states from `first` to `last - 1` to the hash table."""
        states, floats, *_ = self.rows
        self._functions["hash_all"](states, floats.view(np.int64), self._hashed, first, last)

    def _raise_error(self, state: int, action: int) -> None:
        """Raise the error of a failed step by repeating it on the live engine. State -1 means the start of an episode.

        Raises:
            RuleError, EvaluationError: as the live engine does.
            NeedsSpace: the program has no space for another object.
            NotCompiled: another bound of the program was exceeded.
        """
        program, arrays = self._program, self._program.arrays
        states, floats, row = arrays.ints, arrays.floats, self._member
        if state >= 0:
            states, floats, row = self.rows.states, self.rows.floats, state
        with (
            program.live_counterpart(self._member).in_state(states[row], floats[row]) as simulator,
            closing(simulator.reset_outcomes() if state < 0 else simulator.outcomes(action)) as outcomes,
        ):
            for _ in outcomes:
                simulator.observe()
        self._raise_not_compiled()

    def _raise_not_compiled(self) -> None:
        spare = self._program.members.spare
        bounds = f"{CAPACITY} matches of a condition, {spare} created objects, 64 bits within expressions"
        full = self.rows.states[self.counts[1], ERROR] == FULL and spare < LIMITS["created objects"]
        raise (NeedsSpace if full else NotCompiled)(f"a state that exceeds one of the limits: {bounds}")
