"""Search for a plan, actions that lead to a terminal state, in a compiled environment: breadth-first, then a beam."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from math import inf, isfinite
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex, ObserveFind, OnFind, indexed_classes
from envgraph.code import dataclass
from envgraph.env._explore import Progress
from envgraph.env._prepared import never_acts
from envgraph.env._simulator import Simulator
from envgraph.env._too_many import TooManyStates
from envgraph.env.compiled._batch import longer
from envgraph.env.compiled._costs import COSTS
from envgraph.env.compiled._enumeration import Visit
from envgraph.env.compiled._listing import DONE, FOUND, PAUSED, SPACE
from envgraph.env.compiled._program import Program, program_over
from envgraph.errors import LIMITS
from envgraph.pattern import Negation, PatternCall, Variable
from envgraph.rewrite import Engine

NARROW: Final = 1_000, 100
"""Limit and width of the first search if any plan will do: it finds 6 of 7 `warehouse` plans in 1/4 of the time."""
ENDS: Final = {1: "success", 2: "failure"}


@dataclass(frozen=True, slots=True)
class Plan:
    """The result of a search for a sequence of actions that ends an episode with success or failure.

    >>> str(Plan(inf, (), 124, 20_000, None)), str(Plan(2.0, ("go", "eat"), 25_040, 20_000, 500))
    ('none: all 124 states were searched', 'at most 2 steps, found by a beam of 500 states after the first 20,000')

    Attributes:
        steps: the length of the plan; infinite if the search found no plan.
        actions: the names of its actions. With random effects they reach the end only for suitable outcomes.
        states: the number of states visited.
        limit: the number of visited states after which layers are cut.
        width: the number of states kept of a layer; None if no layer was cut, so that the result is exact.
    """

    steps: float
    actions: tuple[str, ...]
    states: int
    limit: int
    width: int | None

    @property
    def exact(self) -> bool:
        """Return True if no shorter plan exists, or, for a result without a plan, if no plan exists."""
        return self.width is None

    def __str__(self) -> str:
        if isfinite(self.steps):
            if self.width is None:
                return f"{self.steps:.0f} steps, the fewest"
            return (
                f"at most {self.steps:.0f} steps, found by a beam of {self.width:,} states "
                f"after the first {self.limit:,}"
            )
        if self.width is None:
            return f"none: all {self.states:,} states were searched"
        return (
            f"none within {self.states:,} states, by a beam of {self.width:,} after the first {self.limit:,}"
        )


def guided(behaviour: Behaviour, outcome: int = 1, guide: PatternCall | None = None) -> tuple[Behaviour, int]:
    """Return a behaviour with match counts added to its observations, and how many counts were added.

    The counts are the first components of an observation, or the last components if agents act together.

    Args:
        behaviour: a behaviour without errors.
        outcome: 1 for success, 2 for failure.
        guide: the query to count; None: the queries of the shared clauses `on neg find .. terminate` with that outcome.
    """
    calls = [
        effect.condition.relation
        for effect in behaviour.effects
        if isinstance(effect, OnFind)
        and effect.end == ENDS[outcome]
        and isinstance(effect.condition, Negation)
        and isinstance(effect.condition.relation, PatternCall)
    ]
    counts = tuple(
        ObserveFind(call, COSTS.most_matches) for call in ([guide] if guide is not None else calls)
    )
    if behaviour.together:
        return replace(behaviour, observations=(*behaviour.observations, *counts)), len(counts)
    agents = tuple(replace(agent, observations=(*counts, *agent.observations)) for agent in behaviour.agents)
    own = () if agents else counts
    return replace(behaviour, agents=agents, observations=(*own, *behaviour.observations)), len(counts)


class Plans:
    """A planner for one behaviour in many models, each of which is the current model of an engine in turn.

    The first, small searches run in Python. Later searches are compiled with numba if numba is installed.

    Args:
        behaviour: a behaviour without errors.
        outcome: 1 for success, 2 for failure.
        guide: a pattern: the beam keeps the states with the fewest matches; None: see `guided`.
        shortest: search for a shortest plan; False: try a narrow beam first, which may find a longer plan.
    """

    def __init__(
        self, behaviour: Behaviour, outcome: int = 1, guide: str | None = None, shortest: bool = True
    ) -> None:
        self._behaviour, self._outcome, self._guide, self._shortest = behaviour, outcome, guide, shortest
        self._searches = 0
        self._programs: dict[Any, Program] = {}

    def plan(self, engine: Engine, progress: Progress | None = None) -> Plan:
        """Search for a plan in the engine's current model, with objects numbered within this model.

        Raises:
            NotCompiled: the behaviour contains a construct that only the live engine supports.
            EvaluationError, RuleError, ResolutionError: as `explore`.
        """
        return self._searched(engine, progress)[1]

    def episode(self, engine: Engine) -> Iterator[Simulator]:
        """Search for a plan and put the engine into each of its states in turn, from the initial to the last one.

        Yields nothing if the search finds no plan.

        Raises:
            NotCompiled, EvaluationError, RuleError, ResolutionError: as `plan`.
        """
        search, plan = self._searched(engine)
        if isfinite(plan.steps):
            yield from search.episode()

    def _searched(self, engine: Engine, progress: Progress | None = None) -> tuple[PlanSearch, Plan]:
        program, guides = self._guided(engine)
        searches = list[PlanSearch]()
        self._searches += 1
        if program.native and self._searches <= COSTS.searches_of_python:
            slow = PlanSearch(
                replace(program, native=False),
                self._outcome,
                COSTS.breadth,
                COSTS.width,
                COSTS.few_states,
                progress,
            )
            slow.outcomes = COSTS.few_outcomes
            searches.append(slow)
        if not self._shortest:
            searches.append(PlanSearch(program, self._outcome, *NARROW, LIMITS["planned states"], progress))
        for search in searches:
            with suppress(TooManyStates):
                plan = search.plan(guides)
                if isfinite(plan.steps) or plan.exact:
                    return search, plan
            self._searches = COSTS.searches_of_python  # later searches are compiled
        search = PlanSearch(
            program, self._outcome, COSTS.breadth, COSTS.width, LIMITS["planned states"], progress
        )
        return search, search.plan(guides)

    def _guided(self, engine: Engine) -> tuple[Program, int]:
        """Return the program for the engine's current model, and how many observation components are match counts."""
        call = None
        if self._guide is not None:
            pattern = engine.library.resolve(self._guide) or engine.library.get(self._guide)
            call = PatternCall(pattern.qualified_name, (Variable("_"),) * len(pattern.parameters))
        behaviour, guides = guided(self._behaviour, self._outcome, call)
        keys = KeyIndex.of(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        return program_over(self._programs, engine, behaviour, keys), guides


def different_actions(program: Program) -> NDArray[np.int64]:
    """Return the numbers of the actions that a search has to try: all, unless agents act together.

    Of joint actions that differ only in actions that never have an effect, the result contains only one.
    """
    if not program.behaviour.together:
        return np.arange(len(program.action_names))
    with closing(program.twin(0).simulator) as simulator:
        base, found = len(simulator.agents.action_names), np.zeros(1, np.int64)
        for place, seat in enumerate(simulator.agents.seats):
            idle = [number for number, action in enumerate(seat.actions) if never_acts(action)]
            own = [number for number in range(base) if number not in idle[1:]]
            found = (np.array(own)[:, None] * base**place + found).ravel()
    return found


_Rows = tuple[np.ndarray[Any, np.dtype[Any]], ...]
"""Arrays with a row for each state."""


@dataclass(slots=True)
class _Layer:
    """The states that the beam removed from the layer it cut last, best states first.

    Attributes:
        depth: the number of steps that lead to the layer.
        rows: the arrays of the removed states.
    """

    depth: int
    rows: _Rows

    @property
    def count(self) -> int:
        """Return the number of states."""
        return len(self.rows[0]) if self.rows else 0

    def take(self, width: int) -> _Rows:
        """Remove the first `width` states from the layer and return them."""
        taken = tuple(array[:width] for array in self.rows)
        self.rows = tuple(array[width:] for array in self.rows)
        return taken


class PlanSearch(Visit):
    """A search for a shortest plan: breadth-first, and by a beam once `limit` states are visited.

    The beam cuts each layer to the `width` states with the fewest matches of the guides; a fixed seed breaks ties. If a
    layer has no successors, the search continues with the states cut from the layer before. A beam stops at the time
    limit of the behaviour, and its plans may be longer than necessary. Results do not depend on numba.

    Args:
        program: the compiled behaviour.
        outcome: 1 for success, 2 for failure.
        limit: the number of visited states after which layers are cut.
        width: the number of states kept of a layer.
        most: the maximum number of visited states; None: no maximum.
        progress: a callback that gets the number of states from time to time.

    Attributes:
        before, by: the predecessor of each state, and the action that led from there; -1 for initial states.
        outcomes: the maximum number of outcomes before the search is aborted; None: no maximum.
    """

    outcomes: int | None = None

    def __init__(
        self,
        program: Program,
        outcome: int = 1,
        limit: int = COSTS.breadth,
        width: int = COSTS.width,
        most: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(program, 0, limit, progress)
        self._outcome, self._width, self._most = outcome, width, most
        self._tried = different_actions(program)
        self.before, self.by = np.zeros(COSTS.first, np.int64), np.zeros(COSTS.first, np.int64)

    def plan(self, guides: int) -> Plan:
        """Search layer by layer for a plan. The beam keeps the states with the lowest sum of match counts.

        `guides` is the number of match counts in an observation. If it is 0, the beam keeps random states.

        Raises:
            EvaluationError, RuleError, NotCompiled: as `enumerated`.
        """
        behaviour = self._program.behaviour
        start = len(self._program.observation_shape) - guides
        if not behaviour.together:
            start = int(len(behaviour.agents) > 1)  # after the component of the block number
        guide = slice(start, start + guides)
        lot = np.random.default_rng(0)
        first, (last, _, _) = 0, self.begin()
        self.before[:last] = -1
        met, depth, cut = last, 0, False
        left, self._made = _Layer(0, ()), 0
        horizon = self._program.behaviour.limit or COSTS.horizon
        while first < last and (depth < horizon or not cut):
            if last > self._limit and last - first > self._width:
                score = self.components[first:last, guide].sum(axis=1)
                order = first + np.lexsort((lot.random(last - first), score))
                left, cut = _Layer(depth, tuple(array[order[self._width :]] for array in self._rows())), True
                last = self._cut(first, last, np.sort(order[: self._width]))
            found, count = self._expanded(first, last)
            met += count - last
            depth += 1
            if found is not None:
                names = self._program.action_names
                self._found = found
                actions = tuple(names[action] for action in self._actions_to(*found))
                return Plan(float(depth), actions, met, self._limit, self._width if cut else None)
            if self._most is not None and met > self._most:
                return Plan(inf, (), met, self._limit, self._width)
            first, last = last, count
            if first == last and left.count:
                depth, last = left.depth, self._put(first, left.take(self._width))
        return Plan(inf, (), met, self._limit, self._width if cut else None)

    def _expanded(self, first: int, last: int) -> tuple[tuple[int, int] | None, int]:
        """Visit the successors of the states from `first` to `last - 1`, until one of them ends the episode as wanted.

        Returns the state and action that lead to this end, or None; and the number of stored states.
        """
        head, states = first, last
        while True:
            how, head, states, self._made, action = self._kernels["expand"](
                *self._world(),
                self._member,
                self.floats.view(np.int64),
                self.hashed,
                self.components,
                self.observations,
                head,
                last,
                states,
                self._made,
                self._tried,
                LIMITS["outcomes"],
                self._made + COSTS.told if self.outcomes is None else self.outcomes,
                self._outcome,
                self.before,
                self.by,
            )
            if self._progress is not None:
                self._progress(states, 0)
            if how == PAUSED and self.outcomes is not None:
                raise TooManyStates(self._program.behaviour, self._limit, outcomes=self.outcomes)
            if how in {DONE, FOUND}:
                return ((head, action) if how == FOUND else None), states
            if how == SPACE:
                self._grow(states, 0)
            elif how != PAUSED:
                self._raise(head, action, states)

    def _cut(self, first: int, last: int, kept: np.ndarray[tuple[int], np.dtype[np.int64]]) -> int:
        """Remove the states from `first` to `last - 1` except for those in `kept`. Return the new number of states."""
        bits = self.floats.view(np.int64)
        self._kernels["forget_last"](self.states, bits, self.hashed, first, last)
        end = first + len(kept)
        for array in self._rows():
            array[first:end] = array[kept]
        self._kernels["hash_all"](self.states, bits, self.hashed, first, end)
        return end

    def _put(self, first: int, rows: _Rows) -> int:
        """Append states that a beam removed earlier, as rows from `first` on, and return the new number of states."""
        end = first + len(rows[0])
        if end >= len(self.states) - 1:
            self._grow(first, 0)
        for array, row in zip(self._rows(), rows, strict=True):
            array[first:end] = row
        self._kernels["hash_all"](self.states, self.floats.view(np.int64), self.hashed, first, end)
        return end

    def _rows(self) -> _Rows:
        return (self.states, self.floats, self.components, self.before, self.by)

    def _grow(self, states: int, used: int) -> None:
        super()._grow(states, used)
        self.before, self.by = longer(self.before, len(self.states)), longer(self.by, len(self.states))

    def episode(self) -> Iterator[Simulator]:
        """Put a live engine of the member into each state of the plan found last, and yield its simulator."""
        state, action = self._found
        way = [state]
        while self.before[way[-1]] >= 0:
            way.append(int(self.before[way[-1]]))
        twin = self._program.twin(self._member)
        for row in reversed(way):
            with twin.at(self.states[row], self.floats[row]) as simulator:
                yield simulator
        with (
            twin.at(self.states[state], self.floats[state]) as simulator,
            closing(simulator.outcomes(action)) as outcomes,
        ):
            if any(ended == self._outcome for _, _, ended in outcomes):  # the generator pauses in that state
                yield simulator

    def _actions_to(self, state: int, action: int) -> Iterable[int]:
        actions = [action]
        while self.before[state] >= 0:
            actions.append(int(self.by[state]))
            state = int(self.before[state])
        return reversed(actions)
