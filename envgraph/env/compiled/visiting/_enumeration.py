"""Enumerate the states of a compiled environment into a table, equal to that of `explore` on the live engine."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex
from envgraph.env._enumeration import ExploredEnvironment, Progress, explore, fill_table
from envgraph.env._size_errors import TooManyStates, check_observation_count
from envgraph.env._tabular import Tabular, nonempty_masks
from envgraph.env.compiled.batches._batch import CompiledBatch
from envgraph.env.compiled.kernels._loading import has_machine_code, has_numba
from envgraph.env.compiled.kernels._visit_kernels import LIMITED, PAUSED, SPACE
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._program_layout import ERROR, TURN
from envgraph.env.compiled.programs._compiled_program import CompiledProgram, compile_for_model, program_of
from envgraph.env.compiled.programs._growth import with_more_space
from envgraph.env.compiled.visiting._state_visit import Array, NeedsSpace, StateVisit
from envgraph.env.scene._scene import Scene
from envgraph.errors import LIMITS
from envgraph.rewrite import Engine


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
    check_observation_count(program.behaviour, program.observation_shape, program.observation_names)
    while True:
        try:
            visit = TableVisit(program, member, limit, progress)
            return ExploredEnvironment(visit.visit_all(), visit.pictures() if pictures else ())
        except NeedsSpace:
            program = with_more_space(program)


def explore_fast(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex | None = None,
    *,
    limit: int = LIMITS["states"],
    outcomes: int = LIMITS["all outcomes"],
    pictures: bool = False,
    progress: Progress | None = None,
) -> ExploredEnvironment:
    """Return the result of `explore`. With numba installed, a compiled program visits the states if there are many.

    If machine code of the program is cached, the program visits all but the smallest environments. A behaviour that is
    not compiled is always explored by the live engine.
    The arguments are those of `explore`, but a program may visit more `outcomes`: several states for each. Drawing a
    state counts as several.
    """
    pictures = pictures and behaviour.draw is not None
    live = partial(explore, engine, behaviour, keys, pictures=pictures, progress=progress)
    limit = min(limit, outcomes // COSTS.picture_outcomes if pictures else outcomes * COSTS.states_of_program)
    if limit <= COSTS.few_states or not has_numba():
        return live(limit=limit, outcomes=outcomes)
    few = min(COSTS.few_outcomes, outcomes)
    with suppress(TooManyStates):
        return live(limit=COSTS.few_states, outcomes=min(few, COSTS.cached_outcomes))
    with suppress(NotCompiled):
        program = program_of(engine, behaviour, keys=keys)
        if program.native and not has_machine_code(program.functions_for("list")["visit"]):
            with suppress(TooManyStates):
                return live(limit=COSTS.few_states, outcomes=few)
        return _explore_compiled(program, 0, limit, progress, pictures=pictures)
    return live(limit=limit, outcomes=outcomes)


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


class TableVisit(StateVisit):
    """A visit of all reachable states, for a table."""

    def __init__(self, program: CompiledProgram, member: int, limit: int, progress: Progress | None) -> None:
        super().__init__(program, member, limit)
        self._progress = progress

    def visit_all(self) -> Tabular:
        """Visit all states, and return the table. Raise the errors that `enumerate_states` lists."""
        beginnings, chances = self.visit_starts()
        self.run()
        return self._make_tabular(beginnings, chances)

    def pictures(self) -> tuple[Scene, ...]:
        """Draw the states. Equal pictures are the same object."""
        counterpart = self._program.live_counterpart(self._member)
        painter, drawn, found = counterpart.simulator.painter(), dict[Scene, Scene](), list[Scene]()
        for state in range(self.counts[1]):
            with counterpart.in_state(self.rows.states[state], self.rows.floats[state]):
                scene = painter.draw()
            found.append(drawn.setdefault(scene, scene))
        return tuple(found)

    def _check(self, how: int) -> None:
        _, states, _, made = self.counts
        if how == LIMITED:
            raise TooManyStates(self._program.behaviour, self._limit)
        if made > LIMITS["all outcomes"]:
            raise TooManyStates(self._program.behaviour, self._limit, outcomes=LIMITS["all outcomes"])
        if self._progress is not None and how in (SPACE, PAUSED):
            self._progress(states, made)

    def _action_masks(self, states: int) -> NDArray[np.bool_]:
        """Return the action masks [states, actions]: True if an action has an effect, or if none of the state has."""
        program = self._program
        if not program.behaviour.together:
            return nonempty_masks(self.rows.did[:states] > 0)
        batch = CompiledBatch(program, np.full(states, self._member))
        batch.states[:], batch.float_states[:] = self.rows.states[:states], self.rows.floats[:states]
        over = self.rows.states[:states, ERROR] != 0
        return np.asarray(batch.action_masks() | over[:, None])

    def _make_tabular(self, beginnings: Array, chances: Array) -> Tabular:
        program, (_, states, used, _) = self._program, self.counts
        counts = np.diff(self.rows.starts[:states].ravel(), append=used).reshape(states, -1)
        starts: dict[int, float] = {}
        for state, chance in zip(beginnings.tolist(), chances.tolist(), strict=True):
            starts[state] = starts.get(state, 0.0) + chance
        names = program.agent_names(self._member)
        return fill_table(
            program.behaviour,
            counts,
            [array[:used] for array in self.outcomes[:4]],
            observation=self.rows.observations[:states].copy(),
            start_states=np.array(list(starts), dtype=np.int32),
            start_probability=np.array(list(starts.values())),
            n_observations=prod(program.observation_shape),
            observation_shape=program.observation_shape,
            action_names=program.action_names,
            agent_names=names,
            turn=self.rows.states[:states, TURN].astype(np.int32) if names else None,
            allowed=self._action_masks(states),
            observation_names=program.observation_names,
        )
