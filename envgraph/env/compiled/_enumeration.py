"""Enumerate the states of a compiled environment into a table, equal to that of `explore` on the live engine."""

from __future__ import annotations

from contextlib import closing, suppress
from functools import partial
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.env._enumeration import ExploredEnvironment, Progress, explore
from envgraph.env._size_errors import TooManyStates, check_observation_count, check_table_size
from envgraph.env._tabular import Tabular, nonempty_masks
from envgraph.env.compiled._batch import CompiledBatch, empty_script, padded_to
from envgraph.env.compiled._batch_arrays import zero_row_buffers
from envgraph.env.compiled._compiled_costs import COSTS
from envgraph.env.compiled._compiled_program import CompiledProgram, compile_for_model, program_of
from envgraph.env.compiled._growth import with_more_space
from envgraph.env.compiled._loading import has_numba
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.env.compiled._program_layout import ERROR, TURN
from envgraph.env.compiled._visit_kernels import DONE, PAUSED, SPACE
from envgraph.env.compiled.kernels import CAPACITY, FULL
from envgraph.env.scene._scene import Scene
from envgraph.errors import LIMITS
from envgraph.rewrite import Engine

Array = NDArray[Any]


def enumerate_states(
    program: CompiledProgram,
    member: int = 0,
    *,
    limit: int = LIMITS["states"],
    progress: Progress | None = None,
) -> Tabular:
    """Return the table of a member's reachable states. The table equals that of `explore`, including all numbering.

    Args:
        program: the compiled behaviour.
        member: number of the member.
        limit: the largest number of states allowed.
        progress: called from time to time with the numbers of states and outcomes.

    Raises:
        TooManyStates: as `explore`.
        EvaluationError: an observation has no value.
        RuleError: a rule matches but cannot be applied.
        NotCompiled: a state exceeds a bound of the program, for example the number of created objects.
    """
    return _explore_compiled(program, member, limit, progress, pictures=False).tabular


def _explore_compiled(
    program: CompiledProgram, member: int, limit: int, progress: Progress | None, *, pictures: bool
) -> ExploredEnvironment:
    """Return the table of a member, with a picture of every state if `pictures`.

    If the program has too little space for created objects, the visit is repeated with more space.
    """
    check_observation_count(program.behaviour, program.observation_shape)
    while True:
        visit = StateVisit(program, member, limit, progress)
        try:
            tabular = visit.visit_all()
            return ExploredEnvironment(tabular, visit.pictures(tabular.n_states) if pictures else ())
        except NotCompiled:
            if not visit.is_out_of_space or program.spare >= LIMITS["created objects"]:
                raise
        program = with_more_space(program)


def explore_fast(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex | None = None,
    *,
    limit: int = LIMITS["states"],
    pictures: bool = False,
    progress: Progress | None = None,
) -> ExploredEnvironment:
    """Return the result of `explore`. With numba installed, a compiled program visits the states if there are many.

    A behaviour that is not compiled is always explored by the live engine.
    """
    pictures = pictures and behaviour.draw is not None
    live = partial(explore, engine, behaviour, keys, pictures=pictures, progress=progress)
    if limit <= COSTS.few_states or not has_numba():
        return live(limit=limit)
    with suppress(TooManyStates):
        return live(limit=COSTS.few_states, outcomes=COSTS.few_outcomes)
    with suppress(NotCompiled):
        return _explore_compiled(program_of(engine, behaviour, keys=keys), 0, limit, progress, pictures=pictures)
    return live(limit=limit)


class TableBuilder:
    """A builder of tables for many models with one behaviour, each of which is the current model of an engine in turn.

    Args:
        behaviour: free of errors.
        limit: the largest number of states of a table.
    """

    def __init__(self, behaviour: Behaviour, limit: int = LIMITS["states"]) -> None:
        self._behaviour, self._limit = behaviour, limit
        self._visited = 0
        self._programs: dict[Any, CompiledProgram] = {}

    def build(self, engine: Engine, keys: KeyIndex, progress: Progress | None = None) -> Tabular:
        """Return the table of the engine's current model, equal to that of `explore`.

        After many outcomes, and if numba is installed, a compiled program makes the tables of later models.

        Raises:
            EvaluationError, RuleError, ResolutionError: as `explore`.
        """
        if self._visited > COSTS.live_outcomes and has_numba():
            with suppress(NotCompiled):
                program = compile_for_model(self._programs, engine, self._behaviour, keys)
                return enumerate_states(program, limit=self._limit, progress=progress)
        found = explore_fast(engine, self._behaviour, keys, limit=self._limit, progress=progress).tabular
        self._visited += found.next_state.size
        return found


class StateVisit:
    """A visit of all reachable states, and the growing arrays that it fills.

    Attributes:
        states, floats: a row for each state, and a last row to work in.
        observations: the observation of each state.
        starts: index of the first outcome of each state and action.
        to, chance, reward, ended: next state, probability, reward and end of the episode of each outcome.
        did: for each state and action, 1 if an outcome of the action had an effect, else 0.
        is_out_of_space: True if the visit failed because rules create more objects than the program has space for.
    """

    def __init__(self, program: CompiledProgram, member: int, limit: int, progress: Progress | None) -> None:
        self._program, self._member = program, member
        self._limit, self._progress = limit, progress
        self._kernels = program.functions_for("list")
        arrays = program.arrays
        self._tables = program.tables
        self._space = zero_row_buffers(program.row_buffer_shape)
        self.is_out_of_space = False
        self._draw = empty_script(LIMITS["random choices"])
        self._actions = len(program.action_names)
        self.states = np.zeros((COSTS.first, arrays.ints.shape[1]), dtype=np.int64)
        self.floats = np.zeros((COSTS.first, arrays.floats.shape[1]))
        self.components = np.zeros((COSTS.first, len(program.observation_shape)), dtype=np.int64)
        self.observations = np.zeros(COSTS.first, dtype=np.int64)
        self.starts = np.zeros(COSTS.first * self._actions + 1, dtype=np.int64)
        self.did = np.zeros(COSTS.first * self._actions, dtype=np.int64)
        self.hashed = np.full(4 * COSTS.first, -1, dtype=np.int64)
        self.to, self.ended = np.zeros(COSTS.first, dtype=np.int64), np.zeros(COSTS.first, dtype=np.int64)
        self.chance, self.reward = np.zeros(COSTS.first), np.zeros(COSTS.first)

    def visit_all(self) -> Tabular:
        """Visit all states, and return the table. Raise the errors that `enumerate_states` lists."""
        states, beginnings, chances = self.visit_starts()
        head, used, made = 0, 0, 0
        while True:
            how, head, states, used, made, action = self._kernels["visit"](
                *self._common_arrays(),
                self._member,
                self.floats.view(np.int64),
                self.hashed,
                self.components,
                self.observations,
                head,
                states,
                used,
                made,
                self._actions,
                LIMITS["outcomes"],
                self._limit,
                made + COSTS.progress_interval,
                self.starts,
                self.to,
                self.chance,
                self.reward,
                self.ended,
                self.did,
            )
            if states > self._limit:
                raise TooManyStates(self._program.behaviour, self._limit)
            if made > LIMITS["all outcomes"]:
                raise TooManyStates(self._program.behaviour, self._limit, outcomes=LIMITS["all outcomes"])
            if how == DONE:
                return self._make_tabular(states, used, beginnings, chances)
            if how not in (SPACE, PAUSED):
                self._raise_error(head, action, states)
            if self._progress is not None:
                self._progress(states, made)
            if how == SPACE:
                self._grow(states, used)

    def pictures(self, states: int) -> tuple[Scene, ...]:
        """Draw the first `states` states that were visited. Equal pictures are the same object."""
        counterpart = self._program.live_counterpart(self._member)
        painter, drawn, found = counterpart.simulator.painter(), dict[Scene, Scene](), list[Scene]()
        for state in range(states):
            with counterpart.in_state(self.states[state], self.floats[state]):
                scene = painter.draw()
            found.append(drawn.setdefault(scene, scene))
        return tuple(found)

    def _common_arrays(self) -> tuple[Array, ...]:
        arrays = self._program.arrays
        return (
            self._tables,
            arrays.reals,
            arrays.offsets,
            self.states,
            self.floats,
            *self._space,
            self._draw,
        )

    def visit_starts(self) -> tuple[int, Array, Array]:
        """Visit the start states. Return their number, and the state and the probability of each way to begin."""
        arrays = self._program.arrays
        while True:
            how, states, used = self._kernels["visit_starts"](
                *self._common_arrays(),
                self._member,
                arrays.ints,
                arrays.floats,
                self.floats.view(np.int64),
                self.hashed,
                self.components,
                self.observations,
                self.to,
                self.chance,
            )
            if how == DONE:
                return states, self.to[:used].copy(), self.chance[:used].copy()
            if how != SPACE:
                self._raise_error(-1, 0, states)
            if states > self._limit:
                raise TooManyStates(self._program.behaviour, self._limit)
            self._grow(0, len(self.to))

    def _grow(self, states: int, used: int) -> None:
        """Enlarge the arrays of states if they are half full or `states` is 0, else the arrays of outcomes.

        If both are half full, enlarge both. `used` is the number of outcomes.
        """
        outcomes = 2 * used >= len(self.to)
        if 2 * states >= len(self.states) - 1 or states == 0:
            size = 4 * len(self.states)
            for name in ("states", "floats", "components", "observations"):
                setattr(self, name, padded_to(getattr(self, name), size))
            self.starts = padded_to(self.starts, size * self._actions + 1)
            self.did = padded_to(self.did, size * self._actions)
            self.hashed = np.full(4 * size, -1, dtype=np.int64)
            self._kernels["hash_all"](self.states, self.floats.view(np.int64), self.hashed, 0, states)
        else:
            outcomes = True
        if outcomes:
            for name in ("to", "ended", "chance", "reward"):
                setattr(self, name, padded_to(getattr(self, name), 4 * len(self.to)))

    def _raise_error(self, state: int, action: int, row: int) -> None:
        """Raise the error of a failed step by repeating it on the live engine. State -1 means the start of an episode.

        Set `full` if the step failed because the program has no space for another object.

        Raises:
            RuleError, EvaluationError: as the live engine does.
            NotCompiled: the live engine has no error, so a bound of the program was exceeded.
        """
        program, arrays = self._program, self._program.arrays
        if state < 0:
            before, floats = arrays.ints[self._member], arrays.floats[self._member]
        else:
            before, floats = self.states[state], self.floats[state]
        with (
            program.live_counterpart(self._member).in_state(before, floats) as simulator,
            closing(simulator.reset_outcomes() if state < 0 else simulator.outcomes(action)) as outcomes,
        ):
            for _ in outcomes:
                simulator.observe()
        self.is_out_of_space = bool(self.states[row, ERROR] == FULL)
        bounds = f"{CAPACITY} matches of a condition, {program.spare} created objects, 64 bits within expressions"
        raise NotCompiled(f"a state that exceeds one of the limits: {bounds}")

    def _action_masks(self, states: int) -> NDArray[np.bool_]:
        """Return the action masks [states, actions]: True if an action has an effect, or if none of the state has."""
        program = self._program
        if not program.behaviour.together:
            return nonempty_masks(self.did[: states * self._actions].reshape(states, -1) > 0)
        batch = CompiledBatch(program, np.full(states, self._member))
        batch.states[:], batch.float_states[:] = self.states[:states], self.floats[:states]
        over = self.states[:states, ERROR] != 0
        return np.asarray(batch.action_masks() | over[:, None])

    def _make_tabular(self, states: int, used: int, beginnings: Array, chances: Array) -> Tabular:
        program, actions = self._program, self._actions
        bounds = self.starts[: states * actions + 1]
        bounds[-1] = used
        counts = np.diff(bounds)
        width = max(1, int(counts.max(initial=1)))
        shape = states, actions, width
        check_table_size(program.behaviour, shape)
        rows = np.repeat(np.arange(states * actions), counts)
        places = np.arange(used) - bounds[:-1][rows]
        next_state = np.repeat(np.arange(states, dtype=np.int32), actions * width).reshape(-1, width)
        probability, reward = np.zeros((states * actions, width)), np.zeros((states * actions, width))
        ended = np.zeros((states * actions, width), dtype=np.int8)
        probability[counts == 0, 0] = 1.0
        next_state[rows, places] = self.to[:used]
        probability[rows, places] = self.chance[:used]
        reward[rows, places] = self.reward[:used]
        ended[rows, places] = self.ended[:used]
        starts: dict[int, float] = {}
        for state, chance in zip(beginnings.tolist(), chances.tolist(), strict=True):
            starts[state] = starts.get(state, 0.0) + chance
        names = program.agent_names(self._member)
        return Tabular(
            next_state=next_state.reshape(shape),
            probability=probability.reshape(shape),
            reward=reward.reshape(shape),
            terminated=ended.reshape(shape),
            observation=self.observations[:states].copy(),
            start_states=np.array(list(starts), dtype=np.int32),
            start_probability=np.array(list(starts.values())),
            n_observations=prod(program.observation_shape),
            observation_shape=program.observation_shape,
            action_names=program.action_names,
            agent_names=names,
            turn=self.states[:states, TURN].astype(np.int32) if names else None,
            allowed=self._action_masks(states),
            observation_names=program.observation_names,
        )
