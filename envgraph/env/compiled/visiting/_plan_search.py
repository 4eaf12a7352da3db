"""Search for a plan, actions that lead to a terminal state, in a compiled environment: breadth-first, then a beam."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from math import inf, isfinite
from sys import maxsize
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Behaviour, KeyIndex, ObserveFind, OnFind, indexed_classes
from envgraph.code import dataclass
from envgraph.draw import html_text
from envgraph.env._enumeration import Progress
from envgraph.env._prepared_clauses import never_acts
from envgraph.env._simulator import Simulator
from envgraph.env._size_errors import TooManyStates
from envgraph.env.compiled.kernels._visit_kernels import FOUND, PAUSED, SPACE
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.programs._compiled_program import CompiledProgram, compile_for_model
from envgraph.env.compiled.visiting._state_visit import Array, StateVisit
from envgraph.errors import LIMITS
from envgraph.pattern import Negation, PatternCall, Variable
from envgraph.rewrite import Engine

NARROW_BEAM: Final = 1_000, 100
"""Limit and width of the first search if any plan will do: it finds 6 of 7 `warehouse` plans in 1/4 of the time."""
END_NAMES: Final = {1: "success", 2: "failure"}


@dataclass(frozen=True, slots=True)
class ActionPlan:
    """The result of a search for a sequence of actions that ends an episode with success or failure.

    >>> str(ActionPlan(inf, (), 124, 20_000, None)), str(ActionPlan(2.0, ("go", "eat"), 25_040, 20_000, 500))
    ('none: all 124 states were searched', 'at most 2 steps, found by a beam of 500 states after the first 20,000')

    Attributes:
        steps: the length of the plan; infinite if the search found no plan.
        actions: the names of its actions. With random effects they reach the end only for suitable outcomes.
        states: the number of states visited.
        limit: the number of visited states after which layers are cut.
        width: the number of states kept of a layer; None if no layer was cut, so that the result is exact.
        total_reward: the sum of the rewards of the plan, with the outcomes that lead to the end.
    """

    steps: float
    actions: tuple[str, ...]
    states: int
    limit: int
    width: int | None
    total_reward: float = 0.0

    @property
    def is_exact(self) -> bool:
        """Return True if no shorter plan exists, or, for a result without a plan, if no plan exists."""
        return self.width is None

    _repr_html_ = html_text

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
        return f"none within {self.states:,} states, by a beam of {self.width:,} after the first {self.limit:,}"


def guide_calls(behaviour: Behaviour, outcome: int) -> list[PatternCall]:
    """Return the queries of the shared clauses `on neg find .. terminate` with an outcome (1 success, 2 failure)."""
    return [
        effect.condition.relation
        for effect in behaviour.effects
        if isinstance(effect, OnFind)
        and effect.end == END_NAMES[outcome]
        and isinstance(effect.condition, Negation)
        and isinstance(effect.condition.relation, PatternCall)
    ]


def with_guide_counts(
    behaviour: Behaviour, outcome: int = 1, guide: PatternCall | None = None
) -> tuple[Behaviour, int]:
    """Return a behaviour with match counts added to its observations, and how many counts were added.

    The counts are the first components of an observation, or the last components if agents act together.

    Args:
        behaviour: a behaviour without errors.
        outcome: 1 for success, 2 for failure.
        guide: the query to count; None: those of `guide_calls`.
    """
    calls = [guide] if guide is not None else guide_calls(behaviour, outcome)
    counts = tuple(ObserveFind(call, COSTS.most_matches) for call in calls)
    if behaviour.together:
        return replace(behaviour, observations=(*behaviour.observations, *counts)), len(counts)
    agents = tuple(replace(agent, observations=(*counts, *agent.observations)) for agent in behaviour.agents)
    own = () if agents else counts
    return replace(behaviour, agents=agents, observations=(*own, *behaviour.observations)), len(counts)


class Plans:
    """A planner for one behaviour in many models, each of which is the current model of an engine in turn.

    The first, small searches without a maximum run in Python. Others are compiled with numba if numba is installed.

    Args:
        behaviour: a behaviour without errors.
        outcome: 1 for success, 2 for failure.
        guide: a pattern: the beam keeps the states with the fewest matches; None: see `with_guide_counts`.
        shortest: search for a shortest plan; False: try a narrow beam first, which may find a longer plan.

    Attributes:
        max_outcomes: the maximum number of outcomes of a search, after which a narrow beam is tried; None: no maximum.
    """

    def __init__(self, behaviour: Behaviour, outcome: int = 1, guide: str | None = None, shortest: bool = True) -> None:
        self._behaviour, self._outcome, self._guide, self._shortest = behaviour, outcome, guide, shortest
        self.max_outcomes: int | None = None
        self._search_count = 0
        self._programs: dict[Any, CompiledProgram] = {}

    def plan(self, engine: Engine, progress: Progress | None = None) -> ActionPlan:
        """Search for a plan in the engine's current model, with objects numbered within this model.

        Raises:
            NotCompiled: the behaviour contains a construct that only the live engine supports.
            TooManyStates: the last search has more than the maximum number of outcomes, or a state has too many.
            EvaluationError, RuleError, ResolutionError: as `explore`.
        """
        return self._search(engine, progress)[1]

    def episode(self, engine: Engine) -> Iterator[Simulator]:
        """Search for a plan and put the engine into each of its states in turn, from the initial to the last one.

        Yields nothing if the search finds no plan.

        Raises:
            NotCompiled, EvaluationError, RuleError, ResolutionError: as `plan`.
        """
        search, plan = self._search(engine)
        if isfinite(plan.steps):
            yield from search.visit_plan_states()

    def _search(self, engine: Engine, progress: Progress | None = None) -> tuple[PlanSearch, ActionPlan]:
        program, guides = self._guided_program(engine)
        self._search_count += 1
        beams = [NARROW_BEAM, (COSTS.breadth, COSTS.width)]
        if self._shortest:
            beams = beams[1:] if self.max_outcomes is None else beams[::-1]
        tries = [(program, *beam, LIMITS["planned states"], self.max_outcomes) for beam in beams]
        if program.native and self.max_outcomes is None and self._search_count <= COSTS.searches_of_python:
            slow = replace(program, native=False)
            tries.insert(0, (slow, COSTS.breadth, COSTS.width, COSTS.few_states, COSTS.few_outcomes))
        for program, breadth, width, states, outcomes in tries[:-1]:
            search = PlanSearch(program, self._outcome, breadth, width, states, progress, outcomes)
            with suppress(TooManyStates):
                plan = search.plan(guides)
                if isfinite(plan.steps) or plan.is_exact:
                    return search, plan
            self._search_count = COSTS.searches_of_python  # later searches are compiled
        program, breadth, width, states, outcomes = tries[-1]
        search = PlanSearch(program, self._outcome, breadth, width, states, progress, outcomes)
        return search, search.plan(guides)

    def _guided_program(self, engine: Engine) -> tuple[CompiledProgram, int]:
        """Return the program for the engine's current model, and how many observation components are match counts."""
        call = None
        if self._guide is not None:
            pattern = engine.library.resolve(self._guide) or engine.library.get(self._guide)
            call = PatternCall(pattern.qualified_name, (Variable("_"),) * len(pattern.parameters))
        behaviour, guides = with_guide_counts(self._behaviour, self._outcome, call)
        keys = KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        return compile_for_model(self._programs, engine, behaviour, keys), guides


def distinct_actions(program: CompiledProgram) -> NDArray[np.int64]:
    """Return the numbers of the actions that a search has to try: all, unless agents act together.

    Of joint actions that differ only in actions that never have an effect, the result contains only one.
    """
    if not program.behaviour.together:
        return np.arange(len(program.action_names))
    with closing(program.live_counterpart(0).simulator) as simulator:
        base, found = len(simulator.agents.action_names), np.zeros(1, np.int64)
        for place, seat in enumerate(simulator.agents.prepared_agents):
            idle = [number for number, action in enumerate(seat.actions) if never_acts(action)]
            own = [number for number in range(base) if number not in idle[1:]]
            found = (np.array(own)[:, None] * base**place + found).ravel()
    return found


class PlanSearch(StateVisit):
    """A search for a shortest plan: breadth-first, and by a beam once `limit` states are visited.

    The beam cuts each layer to the `width` states with the fewest matches of the guides; a fixed seed breaks ties. If a
    layer has no successors, the search continues with the states cut from the layer before. A beam stops at the time
    limit of the behaviour, and its plans may be longer than necessary. Results do not depend on numba.

    Args:
        program: the compiled behaviour.
        outcome: 1 for success, 2 for failure.
        limit: the number of visited states after which layers are cut.
        width: the number of states kept of a layer.
        max_states: the maximum number of visited states; None: no maximum.
        progress: a callback that gets the number of states from time to time.
        max_outcomes: the maximum number of outcomes before the search is aborted; None: no maximum.
    """

    def __init__(
        self,
        program: CompiledProgram,
        outcome: int = 1,
        limit: int = COSTS.breadth,
        width: int = COSTS.width,
        max_states: int | None = None,
        progress: Progress | None = None,
        max_outcomes: int | None = None,
    ) -> None:
        super().__init__(program, 0, limit, distinct_actions(program), sought=outcome)
        self.max_outcomes = max_outcomes
        self._outcome, self._width, self._max_states, self._progress = outcome, width, max_states, progress

    def plan(self, guides: int) -> ActionPlan:
        """Search breadth-first for a shortest plan to the wanted end of an episode.

        After `limit` visited states, each layer is cut to the `width` states with the lowest sum of the `guides` match
        counts in their observation; if `guides` is 0, to random states. The plan may then be longer than the shortest
        one.

        Raises:
            EvaluationError, RuleError, NotCompiled: as `enumerated`.
        """
        behaviour = self._program.behaviour
        start = len(self._program.observation_shape) - guides
        if not behaviour.together:
            start = int(len(behaviour.agents) > 1)  # after the component of the block number
        guide = slice(start, start + guides)
        lot = np.random.default_rng(0)
        self.visit_starts()
        first, last, *_ = self.counts
        met, depth, cut, left, left_depth = last, 0, False, self._rows_at(slice(0)), 0
        horizon = self._program.behaviour.limit or COSTS.horizon
        while first < last and (depth < horizon or not cut):
            if last > self._limit and last - first > self._width:
                score = self.rows.components[first:last, guide].sum(axis=1)
                order = first + np.lexsort((lot.random(last - first), score))
                left, left_depth, cut = self._rows_at(order[self._width :]), depth, True
                kept, (states, floats, *_) = self._rows_at(np.sort(order[: self._width])), self.rows
                self._functions["forget_last"](states, floats.view(np.int64), self._hashed, first, last)
                last = self._append_states(first, kept)
            how, place = self.run(last)
            state, count, *_ = self.counts
            met += count - last
            depth += 1
            if how == FOUND:
                self._way, self._last_action = self._way_to(state), int(self._actions[place])
                numbers = *self.rows.found_by[self._way[1:]], self._last_action
                actions = tuple(self._program.action_names[action] for action in numbers)
                width, gain = self._width if cut else None, float(self.rows.gain[count])
                return ActionPlan(float(depth), actions, met, self._limit, width, gain)
            if self._max_states is not None and met > self._max_states:
                return ActionPlan(inf, (), met, self._limit, self._width)
            first, last = last, count
            if first == last and len(left[0]):
                depth, last = left_depth, self._append_states(first, [array[: self._width] for array in left])
                left = [array[self._width :] for array in left]
        return ActionPlan(inf, (), met, self._limit, self._width if cut else None)

    def _check(self, how: int) -> None:
        if self._progress is not None:
            self._progress(self.counts[1], 0)
        head, states, _, made = self.counts
        if head < 0 and how == SPACE and states > self._limit:
            raise TooManyStates(self._program.behaviour, self._limit)
        if how == PAUSED and self.max_outcomes is not None and made >= self.max_outcomes:
            raise TooManyStates(self._program.behaviour, self._limit, outcomes=self.max_outcomes)

    def _pause_after(self, made: int) -> int:
        return min(super()._pause_after(made), maxsize if self.max_outcomes is None else self.max_outcomes)

    def _append_states(self, first: int, rows: Sequence[Array]) -> int:
        """Append states that were removed, as rows from `first` on, and return the new number of states."""
        end = first + len(rows[0])
        while end >= len(self.rows.states) - 1:
            self._grow_states(first)
        for array, row in zip(self.rows, rows, strict=False):
            array[first:end] = row
        self._hash(first, end)
        self.counts = first, end, *self.counts[2:]
        return end

    def _rows_at(self, numbers: Any) -> list[Array]:
        """Return copies of rows of the arrays of states, without the last arrays, which searches ignore."""
        return [array[numbers] for array in self.rows[:7]]

    def _way_to(self, state: int) -> list[int]:
        way = [state]
        while self.rows.sources[way[-1]] >= 0:
            way.append(int(self.rows.sources[way[-1]]))
        return way[::-1]

    def visit_plan_states(self) -> Iterator[Simulator]:
        """Put a live engine of the member into each state of the plan found last, and yield its simulator."""
        counterpart = self._program.live_counterpart(self._member)
        for state in self._way:
            with counterpart.in_state(self.rows.states[state], self.rows.floats[state]) as simulator:
                yield simulator
        with (
            counterpart.in_state(self.rows.states[state], self.rows.floats[state]) as simulator,
            closing(simulator.outcomes(self._last_action)) as outcomes,
        ):
            if any(ended == self._outcome for _, _, ended in outcomes):  # the generator pauses in that state
                yield simulator
